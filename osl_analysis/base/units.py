# SPDX-License-Identifier: Apache-2.0
"""Units as laboratories spell them, their factors to SI, and the factors that are often confused.

The texts come from files: only names joined by `*` and `/` are given to pint, whose parser would
evaluate `9**9**9**9` without end.
"""

import math
import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator

from osl_analysis.base.errors import InputError, shortened
from osl_analysis.base.files import package_yaml

DATA = package_yaml(Path(__file__).with_name("units.yaml"))
EXAMPLES = DATA["examples"]
SI_UNITS = DATA["si_units"]
LONG_TIMES = DATA["long_times"]
ALIASES = DATA["aliases"]
SIGNS = DATA["signs"]
# By signal: factors between units, or between ways to state a current, that are often confused.
UNIT_FACTORS = DATA["confused"]
# in any spelling: `N_cm`, `lbf-ft`, `ftlbs`; a pound and an ounce in a torque are forces
TORQUE = re.compile(
    r"(?<![A-Za-z])(?:([mkcd]?N|k?gf)[*·_. -]?([cm]?m)"
    r"|(?i:(ft|in|foot|inch)[*·_. -]?(lb|oz)[fs]?|(lb|oz)[fs]?[*·_."
    r" -]?(ft|in|foot|inch)))(?![A-Za-z])"
)
TICKS = re.compile(r"(\d+(?:\.\d+)?)\*?([mun]?s|[mu]?secs?)")
# names whose case has no meaning, since they have no prefix that it could distinguish
ANY_CASE = re.compile(
    r"(milli)?met(er|re)s?|volts?|deg(ree)?s?|rad(ian)?s?|newtons?|amp(ere)?s?"
    r"|(milli|micro|nano)?seconds?|m?secs?|revolutions?|rpm",
    re.IGNORECASE,
)


NEWTONS = {"N": 1.0, "kilogram": 9.80665}  # by the SI unit of what a load cell at an arm is read in


def si_factor(unit: str, expected: str) -> float:
    """Find the factor from a unit to an SI unit.

    Parameters
    ----------
    unit : str
        As a laboratory spells it. A middle dot, a full stop or a blank is read as the
        multiplication sign, both micro signs as `u`. An angle is a dimension: N*m/rad is not N*m.
    expected : str
        The SI unit, a key of `EXAMPLES`.

    Raises
    ------
    InputError
        The unit is empty, ambiguous, unknown, of another dimension or of an implausible size.
    """
    examples = ", ".join(EXAMPLES[expected])
    spelling = normalised(unit)
    if expected == "s":
        spelling = spelling.lower()  # no siemens: `TIME(S)`
    if not spelling:
        raise InputError("the unit is empty", f"write one of {examples}")
    factor, si_unit = in_si(spelling)
    # from that of ns to that of N*m/mdeg; others are misspellings such as `Mm` and `MN`
    if si_unit != expected or not 1e-9 <= factor <= 1e5:
        measured = f"{factor:g} {si_unit}" if si_unit else "unknown"
        remedy = f"write one of {examples}"
        if expected == "N*m" and si_unit in NEWTONS:
            force = factor * NEWTONS[si_unit]
            scale = "ARM" if force == 1 else f"ARM*{force:.6g}"
            remedy = (
                f"a torque is a force times its arm: write `unit: N*m` and `scale: {scale}`, with"
                " the arm in m for ARM"
            )
        raise InputError(f"unit '{shortened(unit)}' is {measured}", remedy)
    return factor


def quantity(text: str, expected: str) -> float:
    """Read a number with its unit, as `2 ms`, in the SI unit `expected`, a key of `EXAMPLES`.
    Raises InputError as `si_factor`, or if there is no number."""
    number, _, unit = text.strip().partition(" ")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            f"'{shortened(text)}' is not a number with a unit",
            f"write it as in `2 {next(iter(EXAMPLES[expected]))}`",
        )
    return value * si_factor(unit, expected)


def normalised(unit: str) -> str:
    """One spelling for a unit: `N·mm`, `N.mm` and `N mm` become `N*mm`."""
    text = unit.strip(" .\t\n")
    for pattern, sign in SIGNS.items():
        text = re.sub(pattern, sign, text)
    return re.sub("[µμ]", "u", TORQUE.sub(torque_spelled, text))


def torque_spelled(match: re.Match[str]) -> str:
    """A match of `TORQUE` as a product."""
    newtons, metres, length_first, force_second, force_first, length_second = match.groups()
    if newtons:
        return f"{newtons}*{metres}"
    return f"{force_second or force_first}f*{length_first or length_second}".lower()


NAME = r"(?:[^\W\d_]\w{0,30}|°|%|‰|1)"  # of one unit within a product
NO_UNIT = (0.0, "")


@cache
def in_si(spelling: str) -> tuple[float, str]:
    """Factor to an SI unit, and this, a key of `EXAMPLES` or a product of base units; 0 and empty
    if the text is not a unit. `10*us` are ticks of 10 us."""
    for si_unit, factors in EXAMPLES.items():
        if spelling in factors:
            return factors[spelling], si_unit
    ticks = TICKS.fullmatch(spelling)
    if ticks:
        tick_factor, si_unit = in_si(ticks[2])
        return float(ticks[1]) * tick_factor, si_unit
    if not re.fullmatch(rf"{NAME}([*/]{NAME}){{,7}}", spelling):
        return NO_UNIT
    from pint import PintError, application_registry  # takes 0.3 s, once

    text = re.sub(NAME, name_for_pint, spelling)
    try:
        in_base_units = application_registry.Quantity(1.0, text).to_base_units()
    except (PintError, ValueError, AssertionError, TypeError):
        return NO_UNIT
    product = str(in_base_units.units)
    return float(in_base_units.magnitude), SI_UNITS.get(product, product)


def name_for_pint(match: re.Match[str]) -> str:
    """A match of `NAME` as pint reads it."""
    name = match[0].lower() if ANY_CASE.fullmatch(match[0]) else match[0]
    return f"({ALIASES.get(name, name)})"


def is_unit(text: str) -> bool:
    """Whether a text is a unit."""
    return in_si(normalised(text)) != NO_UNIT


def measures(expected: str) -> AfterValidator:
    """The check that a unit measures what the SI unit `expected` does."""
    return AfterValidator(lambda unit: si_factor(unit, expected) and unit)


TimeUnit = Annotated[str, measures("s")]
LengthUnit = Annotated[str, measures("m")]
ForceUnit = Annotated[str, measures("N")]
MomentUnit = Annotated[str, measures("N*m")]


def known_factor(ratio: float, signals: Sequence[str], near: float) -> str:
    """Name the confused units that explain a number which is too large or too small.

    Parameters
    ----------
    ratio : float
        Of the number to what is expected, or its inverse, not 0; the sign does not count.
    signals : Sequence of str
        Keys of `UNIT_FACTORS` that come into question.
    near : float
        Largest relative difference from a factor.

    Returns
    -------
    str
        The factor and which units may be confused, to be appended; empty if no factor is near.
    """
    return next((f", {text}" for text in factors_near(ratio, signals, near)), "")


def factors_near(ratio: float, signals: Sequence[str], near: float) -> list[str]:
    """All factors between confused units near a ratio, the nearest first; arguments as of
    `known_factor`."""
    known = [pair for signal in signals for pair in UNIT_FACTORS[signal].items()]
    size = max(abs(ratio), 1 / abs(ratio))
    sorted_by_distance = sorted(
        (abs(math.log(size / factor)), name, factor) for name, factor in known
    )
    return [
        f"{factor:.3g} is the factor {name}"
        for _, name, factor in sorted_by_distance
        if abs(size / factor - 1) < near
    ]


CLOCK_NAMES = (
    "time|t|timestamps?|stamp|(state|loop|pi|sys|ros|elapsed)_time|elapsed|clock|seconds?"
    "|time_since_start|x_value|millis|micros|[mu]s|(date_?)?time|datetime|date_and_time"
    "|time_of_day|(uhr)?zeit|tijd|temps|tiempo|tempo"
)


def is_clock(name: str) -> bool:
    """Tell whether a column is named like a clock: `time`, `t_s`, `loop_time`."""
    last = re.split("[/:]", name)[-1]  # without groups of HDF5
    words = re.sub(r"\s+", "_", last.strip())
    return re.fullmatch(f"_*({CLOCK_NAMES})(_(s|sec|ms|us|ns))?", words, re.IGNORECASE) is not None
