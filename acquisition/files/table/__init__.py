"""Text tables: CSV, TXT, TSV, with decimal point or comma, several header lines and several segments."""

from acquisition.files.table.blocks import parse
from acquisition.files.table.reading import arranged, decode, merge, read
from acquisition.files.table.segment import Segment

__all__ = ["Segment", "arranged", "decode", "merge", "parse", "read"]
