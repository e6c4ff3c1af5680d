"""``python -m ema``: the same as the command ``ema``."""

from ema.cli import main

if __name__ == "__main__":
    main()
