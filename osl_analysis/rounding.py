"""How a number is rounded, everywhere alike: as its interval allows."""

import math

DIGITS = 3  # of a number without an interval
DIGITS_OF_HALF = 2  # of half of the interval
DIGITS_OF_REST = 2  # of what a percentage without an interval leaves to 100
LARGEST_REST = 1.0  # percent, below which these digits are more than those of the number
LEAST_REST = 1e-6  # percent; less is rounding


def decimal_places(
    value: float, low: float | None = None, high: float | None = None, unit: str = ""
) -> int:
    """Decimal places that leave two digits of half of the interval. Without one they leave three
    digits of the number, of a percentage near 100 two of what it leaves to 100, and of a whole
    number none."""
    half = 0.0 if low is None or high is None else abs(high - low) / 2
    if half > 1e-9 * abs(value):
        return places_of(half, DIGITS_OF_HALF)
    if value == round(value):
        return 0
    rest = 100 - value
    if unit == "%" and LEAST_REST < rest < LARGEST_REST:
        return places_of(rest, DIGITS_OF_REST)
    return places_of(abs(value), DIGITS)


def places_of(size: float, digits: int) -> int:
    """Decimal places that leave so many significant digits of a size."""
    return max(digits - 1 - math.floor(math.log10(size)), 0)


def with_places(places: int, *numbers: float | None) -> list[str]:
    """Numbers with so many decimal places; empty for none."""
    return ["" if number is None else f"{number:z.{places}f}" for number in numbers]


def written(
    value: float, low: float | None = None, high: float | None = None, unit: str = ""
) -> str:
    """A number as `300.1 (298.7 to 301.6)`."""
    text, *ends = with_places(decimal_places(value, low, high, unit), value, low, high)
    return f"{text} ({' to '.join(ends)})" if all(ends) else text
