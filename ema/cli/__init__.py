"""The command line: what the library does, with paths."""

import sys

FORMER_OPTIONS = {"--out": "--output", "--write": "--output"}
"""Options under the names that they had before; they go with the next release."""


def main() -> None:
    """Entry point of the ``ema`` command."""
    if not sys.argv[1:]:
        from ema.cli.guidance import alone

        alone()
    from ema.cli.app import app

    sys.argv[1:] = [_present(argument) for argument in sys.argv[1:]]
    app()


def _present(argument: str) -> str:
    """An argument with the present name of its option; says so where it had another one."""
    name, equals, value = argument.partition("=")
    if name not in FORMER_OPTIONS:
        return argument
    print(f"ema: {name} is called {FORMER_OPTIONS[name]} now; the old name goes with the next release", file=sys.stderr)
    return f"{FORMER_OPTIONS[name]}{equals}{value}"
