"""Begin the process of the parsers: ``python -I <this file> <folders of installed packages>``.

An isolated interpreter ignores ``PYTHONPATH``, the current folder and the packages of the user, so that nothing beside
a data file is ever imported. The packages of the parent are loaded from where this file lies, and that folder is on
the path for no longer than that takes.
"""

import os
import sys


def begin() -> None:
    """Load the packages, then serve."""
    root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    sys.path.extend(folder for folder in sys.argv[1:] if folder not in sys.path)
    sys.path.insert(0, root)
    import acquisition
    from ema import __version__

    sys.path.remove(root)
    from acquisition.isolated.worker import serve

    serve(os.path.dirname(os.path.abspath(acquisition.__file__)), __version__)


if __name__ == "__main__":
    begin()
