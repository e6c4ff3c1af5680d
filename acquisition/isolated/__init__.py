"""Foreign parsers run in a process of their own, so that a file that crashes one of them ends in a sentence here."""

from acquisition.isolated.process import ParserError, call

__all__ = ["ParserError", "call"]
