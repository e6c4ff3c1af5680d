"""The command line: the verbs and nouns of the library, plus paths."""


def main() -> None:
    """Entry point of the ``ema`` command."""
    from ema.cli.app import app

    app()
