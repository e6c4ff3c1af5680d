"""What the suite says of a commit does not hang on chance: fresh draws belong to the benches."""

import ast
from pathlib import Path

import pytest

FRESH = {"tests/bench", "tests/fuzz", "tests/faults"}  # these draw anew, or as they are told
GENERATORS = {"default_rng", "RandomState", "Random", "SeedSequence"}


def unseeded(tree: ast.AST) -> list[int]:
    """Lines that make a random generator without a seed, or with ``None`` for one."""
    lines = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        seeds = [*node.args, *(keyword.value for keyword in node.keywords)]
        if name in GENERATORS and all(isinstance(seed, ast.Constant) and seed.value is None for seed in seeds):
            lines.append(node.lineno)
    return lines


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("np.random.default_rng()", [1]),
        ("default_rng(seed=None)", [1]),
        ("random.Random()", [1]),
        ("np.random.default_rng(0)", []),
        ("default_rng([seed, 3])", []),
    ],
)
def test_a_generator_without_a_seed_is_found(line: str, found: list[int]) -> None:
    assert unseeded(ast.parse(line)) == found


def test_tests_draw_from_fixed_seeds(root: Path) -> None:
    found = [
        f"{path.relative_to(root)}:{line}"
        for path in sorted((root / "tests").rglob("*.py"))
        if not any(path.is_relative_to(root / folder) for folder in FRESH)
        for line in unseeded(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert not found
