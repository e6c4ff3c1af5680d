"""Numbers as a reader wants them: rounded by their uncertainty, and never more digits than are known."""

import math
from dataclasses import dataclass

MISSING = "–"


@dataclass(frozen=True)
class Value:
    """A number with the text that shows it; tables beside the report hold the number itself."""

    value: float
    text: str

    def __str__(self) -> str:
        return self.text


def plain(value: float | None, digits: int = 4) -> Value:
    """A number with that many significant digits; a dash where it is ``None`` or not finite."""
    if value is None or not math.isfinite(value):
        return Value(math.nan, MISSING)
    if value == 0:
        return Value(value, "0")
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    small_or_large = not -4 <= math.log10(abs(value)) < 6
    return Value(value, f"{value:.{digits - 1}e}" if small_or_large else f"{value:.{max(0, decimals)}f}")


def short(value: float | None) -> str:
    """A number in running text, without trailing zeros."""
    return MISSING if value is None or not math.isfinite(value) else f"{value:.5g}"


def fixed(value: float | None, decimals: int) -> Value:
    """A number with that many decimals."""
    if value is None or not math.isfinite(value):
        return Value(math.nan, MISSING)
    return Value(value, f"{value:.{decimals}f}")


def _decimals(uncertainty: float) -> int:
    """Decimals that show two significant digits of an uncertainty."""
    decimals = 1 - math.floor(math.log10(uncertainty))
    # an uncertainty that rounds up to the next power of ten needs one digit less
    return decimals - 1 if round(uncertainty, decimals) >= 10 ** (2 - decimals) else decimals


def _known(value: float | None, uncertainty: float | None) -> bool:
    return all(x is not None and math.isfinite(x) for x in (value, uncertainty)) and bool(
        uncertainty and uncertainty > 0
    )


def rounded(value: float | None, by: float | None, digits: int = 5) -> Value:
    """A number to the second significant digit of an uncertainty or tolerance that is shown elsewhere."""
    if value is None or by is None or not _known(value, by):
        return plain(value, digits)
    decimals = _decimals(by)
    return Value(value, f"{round(value, decimals):.{max(0, decimals)}f}")


def with_uncertainty(value: float | None, uncertainty: float | None, digits: int = 5) -> Value:
    """``499.021 ± 0.046``: both to the second significant digit of the uncertainty; ``digits`` where it is unknown."""
    if value is None or uncertainty is None or not _known(value, uncertainty):
        return plain(value, digits)
    return Value(value, f"{rounded(value, uncertainty)} ± {rounded(uncertainty, uncertainty)}")
