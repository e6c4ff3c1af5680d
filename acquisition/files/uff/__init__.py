"""Universal files (UFF, UNV): I-DEAS data sets 15, 18, 55, 58, 58b, 82, 151, 164, 2411, 2412, 2414, 2420."""

from acquisition.files.uff.index import Entry
from acquisition.files.uff.reading import functions, list_sets, read
from acquisition.files.uff.values58 import Function
from acquisition.files.uff.writing import write

__all__ = ["Entry", "Function", "functions", "list_sets", "read", "write"]
