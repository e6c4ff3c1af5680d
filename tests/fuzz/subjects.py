"""The readers that are fuzzed, by name."""

from tests.fuzz.uff import Uff

SUBJECTS = {"uff": Uff}
