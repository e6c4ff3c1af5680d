"""Log lines and warnings of foreign readers are suppressed: what they found out is returned as findings."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np


@contextmanager
def suppressed_warnings(*loggers: str) -> Iterator[None]:
    """No log lines of these loggers and no warnings inside the block; everything is as before behind it."""
    found = [
        logging.getLogger(name)
        for name in list(logging.root.manager.loggerDict)
        if any(name == logger or name.startswith(f"{logger}.") for logger in loggers)
    ]
    before = [logger.disabled for logger in found]
    for logger in found:
        logger.disabled = True
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, state in zip(found, before, strict=True):
            logger.disabled = state
