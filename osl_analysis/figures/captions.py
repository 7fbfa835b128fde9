"""Words and numbers of the captions: Markdown text for a manuscript, from the plotted numbers of a figure.

Every module of a figure has a function `caption`, from its plotted numbers to one paragraph of Markdown. Its first
sentence says what is shown. Then follow what marks and bars mean, how many trials there are, the key numbers with units
and intervals, and which trials are doubtful (`doubtful_fits`). Symbols stand between dollar signs, as `$K_d$`. Every
name that comes from a file goes through `as_text`.
"""

import math
import re
from collections.abc import Iterable

import polars as pl

from osl_analysis.figures.style import IS_DOUBTFUL

UNIT_OF = {"K": "N·m/rad", "B": "N·m·s/rad", "I": "kg·m²"}
"""Units of stiffness, damping and inertia as they are printed."""
MOST_NAMED = 6
"""Trials that a caption names; the tables have all of them."""
DIGITS = 2
"""Significant digits of half the width of an interval, and of a standard deviation."""
MOST_DIGITS = 5
"""Significant digits of an estimate, whatever its interval."""
SPECIAL = re.compile(r"[\\`*_{}\[\]<>#|~$&!^@\"']|:(?=//)|(?<=-)-|(?<=\.)\.|(?<=www)\.")
"""Signs that mean something in Markdown, as its dialects have it: repeated hyphens and dots are joined by some."""


def as_text(name: str) -> str:
    """A name from a file, of which Markdown shows every sign: no HTML, link, mathematics, emphasis or line break."""
    return SPECIAL.sub(lambda sign: f"\\{sign[0]}", " ".join(re.sub(r"[\x00-\x1f\x7f\u2028\u2029]", " ", name).split()))


def listed(names: Iterable[str], most: int = MOST_NAMED) -> str:
    """Names from files one after the other, each once; of more than `most` the first ones and how many more."""
    found = [as_text(name) for name in dict.fromkeys(names)]
    return ", ".join(found[:most]) + (f" and {len(found) - most} more" if len(found) > most else "")


def decimals_of(spread: float, largest: float = 0.0) -> int:
    """Digits behind the point at which a half width or standard deviation has `DIGITS` significant ones.

    A number of the size `largest` has no more than `MOST_DIGITS`: rounding leaves a spread where there is none.
    """
    sizes = ((spread, DIGITS), (largest, MOST_DIGITS))
    digits = [most - 1 - math.floor(math.log10(abs(size))) for size, most in sizes if size and math.isfinite(size)]
    return max(min(digits, default=0), 0)


def number(value: float, decimals: int) -> str:
    """A number with so many digits behind the point, with a minus sign; never minus zero."""
    return f"{value:.{decimals}f}".replace("-", "−") if round(value, decimals) else f"{0:.{decimals}f}"


def with_interval(value: float, low: float | None, high: float | None, unit: str) -> str:
    """An estimate with its 95 % interval, as `299.1 N·m/rad (95 % interval 298.2 to 300.0)`; alone without one."""
    if low is None or high is None:
        return f"{value:.4g} {unit}".replace("-", "−")
    digits = decimals_of((high - low) / 2, value)
    ends = f"{number(low, digits)} to {number(high, digits)}"
    return f"{number(value, digits)} {unit} (95 % interval {ends})"


def with_sd(mean: float, sd: float | None, unit: str) -> str:
    """A mean with its standard deviation, as `338 ± 20 N·m/rad`; alone without one."""
    if sd is None:
        return f"{mean:.3g} {unit}".replace("-", "−")
    digits = decimals_of(sd, mean)
    return f"{number(mean, digits)} ± {number(sd, digits)} {unit}"


def counted(n: int, one: str, several: str = "") -> str:
    """A number of things, as `1 trial` or `32 trials`."""
    return f"{n} {one if n == 1 else several or one + 's'}"


def doubtful_fits(table: pl.DataFrame, look: str, fit: str = "fit") -> str:
    """Which of the drawn fits are doubtful and how they `look`, as `Doubtful, drawn open: 2 of 32 fits (a, b).`

    `table` has a row per fit, with `trial` and `doubtful`; the reasons stand there.
    """
    found = table.filter(IS_DOUBTFUL)
    if found.is_empty():
        return f"No {fit} is doubtful."
    return f"Doubtful, {look}: {len(found)} of {counted(len(table), fit)} ({listed(found['trial'])})."
