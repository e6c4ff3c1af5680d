#!/usr/bin/env -S python -m nox
# /// script
# dependencies = ["nox>=2025.2.9"]
# ///
"""Tasks in environments of their own: ``nox -l`` lists them, ``nox -s tests`` runs one (``pip install nox``)."""

import nox

nox.needs_version = ">=2025.2.9"
nox.options.default_venv_backend = "uv|virtualenv"


@nox.session
def style(session: nox.Session) -> None:
    """Linter, formatter, types and layers."""
    session.install("-e", ".[dev]")
    session.run("ruff", "check")
    session.run("ruff", "format", "--check")
    session.run("mypy")
    session.run("lint-imports", "--no-cache")


@nox.session(python=["3.11", "3.12", "3.13"])
def tests(session: nox.Session) -> None:
    """README's tests; arguments behind ``--`` go to pytest."""
    session.install("-e", ".[dev]")
    session.run("python", "-m", "pytest", *session.posargs)


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """The site, without a warning."""
    session.install("-e", ".[docs]")
    session.run("python", "-m", "sphinx", "-W", "-b", "html", "docs", "docs/_build/site")


@nox.session(default=False)
def build(session: nox.Session) -> None:
    """Wheel and source archive in ``dist/``."""
    session.install("build")
    session.run("python", "-m", "build")


if __name__ == "__main__":
    nox.main()
