"""Text tables: CSV, TXT, TSV, with decimal point or comma, several header lines and several segments."""

from acquisition.files.table.blocks import parse
from acquisition.files.table.reading import decode, merge, read, segment_contents
from acquisition.files.table.segment import Segment

__all__ = ["Segment", "decode", "merge", "parse", "read", "segment_contents"]
