"""How a number is rounded: as its interval allows."""

import math
from typing import Literal, overload

DIGITS = 3  # of a number without an interval
DIGITS_OF_HALF = 2  # of half of the interval


def decimal_places(value: float, low: float | None, high: float | None) -> int:
    """Decimal places that leave two digits of half of the interval, or three of the number."""
    half = 0.0 if low is None or high is None else abs(high - low) / 2
    size, digits = (half, DIGITS_OF_HALF) if half > 1e-9 * abs(value) else (abs(value), DIGITS)
    return max(digits - 1 - math.floor(math.log10(size)), 0) if size else 0


@overload
def written(value: float, low: float | None = None, high: float | None = None) -> str: ...
@overload
def written(
    value: float, low: float | None, high: float | None, parts: Literal[True]
) -> tuple[str, str, str]: ...
def written(
    value: float, low: float | None = None, high: float | None = None, parts: bool = False
) -> str | tuple[str, str, str]:
    """A number as `300.1 (298.7 to 301.6)`; as three texts if `parts`."""
    places = decimal_places(value, low, high)
    texts = ["" if end is None else f"{end:.{places}f}" for end in (value, low, high)]
    if parts:
        return texts[0], texts[1], texts[2]
    return f"{texts[0]} ({texts[1]} to {texts[2]})" if texts[1] and texts[2] else texts[0]
