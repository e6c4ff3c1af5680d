"""The readers that are fuzzed, by name."""

from collections.abc import Callable

from tests.fuzz.cases import Subject
from tests.fuzz.containers import CONTAINERS
from tests.fuzz.frd import Frd
from tests.fuzz.frf_text import FrfTable, SignalCalc
from tests.fuzz.ours import Matrix, Store, Toml
from tests.fuzz.rst import Rst
from tests.fuzz.tables import Json, Lvm, Table
from tests.fuzz.uff import Uff
from tests.fuzz.uff_model import UffModel

SUBJECTS: dict[str, Callable[[], Subject]] = {
    "uff": Uff,
    "uff-model": UffModel,
    "table": Table,
    "lvm": Lvm,
    "frf-table": FrfTable,
    "signalcalc": SignalCalc,
    "json": Json,
    **CONTAINERS,
    "market": lambda: Matrix("market", ".mtx"),
    "boeing": lambda: Matrix("boeing", ".hb"),
    "store": Store,
    "toml": Toml,
    "frd": Frd,
    "rst": Rst,
}
