"""Equations as MathML, which browsers draw themselves: the site fetches nothing and needs no TeX."""

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx


def inline(self: Any, node: nodes.math) -> None:
    """Write an equation within a line."""
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


LAID_OUT = "display: block; overflow: auto; padding: 0.6em 0"
"""The theme lays equations out for MathJax: it cuts off what is higher than a line and moves them to the right."""


def block(self: Any, node: nodes.math_block) -> None:
    """Write an equation of its own, with its number where it has one."""
    number = f'<span class="eqno" style="float: right">({node["number"]})</span>' if node.get("number") else ""
    anchor = f' id="equation-{node["label"]}"' if node.get("label") else ""
    equation = convert(node.astext(), display="block")
    self.body.append(f'<div class="math" style="{LAID_OUT}"{anchor}>{number}{equation}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
