from ema.tables.former import FormerNames as FormerNames
from ema.tables.former import renamed as renamed
from ema.tables.former import warn as warn
from ema.tables.lines import line_of as line_of
from ema.tables.schema import Table as Table
from ema.tables.schema import document_of as document_of
from ema.tables.schema import validated as validated
