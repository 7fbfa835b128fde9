"""Units as laboratories spell them: their factors to SI, and their patterns in the schemas of source files.

Unit texts come from untrusted files. Only names joined by `*` and `/` are given to pint, whose parser would evaluate
`9**9**9**9` without end. The registry is built at import, so that processes forked later share it. Schemas know the
names that laboratories write: an editor that knew all of pint's would take nearly every slip for a unit.
"""

import math
import re
from functools import cache
from typing import Annotated

import pint
from pydantic import AfterValidator, WithJsonSchema

from osl_analysis.errors import InputError

REGISTRY: pint.UnitRegistry[float] = pint.UnitRegistry(cache_folder=None)

# valid units that a message lists, by canonical unit
EXAMPLES: dict[str, tuple[str, ...]] = {
    "1": ("1", "%"),
    "s": ("s", "ms", "us", "ns"),
    "Hz": ("Hz", "kHz"),
    "rad": ("rad", "mrad", "deg", "°", "rev"),
    "rad/s": ("rad/s", "deg/s", "rpm"),
    "m": ("m", "cm", "mm", "um"),
    "A": ("A", "mA"),
    "V": ("V", "mV", "uV"),
    "N": ("N", "kN", "mN", "lbf"),
    "N*m": ("N*m", "Nm", "N*cm", "N*mm", "Nmm", "mNm", "lbf*in", "lbf*ft"),
    "N*m/rad": ("N*m/rad", "Nm/rad", "N*m/deg"),
    "N*m*s/rad": ("N*m*s/rad", "Nms/rad", "N*m*s/deg"),
    "N*m/kg": ("N*m/kg", "Nm/kg", "N*mm/kg"),
}

# spellings that pint does not know, or reads as another unit: `Nm` as a textile count, `nt` as a nanotonne, `amps` as a
# velocity, `rads` as a dose
ALIASES = {
    "Nm": "N*m",
    "Nmm": "N*mm",
    "Ncm": "N*cm",
    "mNm": "mN*m",
    "kNm": "kN*m",
    "Nms": "N*m*s",
    "Nmms": "N*mm*s",
    "nt": "N",
    "ntm": "N*m",
    "ntmm": "N*mm",
    "volts": "V",
    "amps": "A",
    "rads": "radian",
    "°": "deg",
    "rev": "revolution",
    "%": "percent",
    "1": "dimensionless",
}
# units that mean different things to different people, with what to write instead
AMBIGUOUS = {
    "grad": "is gon (a 400th of a turn) to some and degree to others: write `deg`, or `gon`",
    "grads": "is gon (a 400th of a turn) to some and degree to others: write `deg`, or `gon`",
    "grade": "is gon (a 400th of a turn) to some and degree to others: write `deg`, or `gon`",
}
# names whose case has no meaning, since they have no prefix that it could distinguish
WORDS = re.compile(
    r"(milli)?met(er|re)s?|volts?|deg(ree)?s?|rad(ian)?s?|newtons?|amp(ere)?s?|(milli|micro|nano)?seconds?|revolutions?|rpm",
    re.IGNORECASE,
)
NAMES = re.compile(r"[^\W\d_]\w{0,30}|°|%|1")
SMALLEST, LARGEST = 1e-9, 1e5  # factors from ns to N*m/mdeg; others are misspellings such as `Mm` and `MN`


def si_factor(unit: str, expected: str) -> float:
    """Factor from `unit` to the SI unit `expected`, a key of `EXAMPLES`.

    A middle dot, a full stop or a blank is read as the multiplication sign, both micro signs as `u`. An angle is a
    dimension: N*m/rad is not N*m.
    """
    advice = ", ".join(EXAMPLES[expected])
    spelling = normalised(unit)
    if not spelling:
        raise InputError(f"the unit is empty; write one of {advice}")
    for name in re.split(r"[*/]", spelling):
        if name.lower() in AMBIGUOUS:
            raise InputError(f"unit {quoted_unit(unit)}: '{name}' {AMBIGUOUS[name.lower()]}")
    found = base_units(spelling)
    if found is None:
        raise InputError(f"unit {quoted_unit(unit)} is unknown; write one of {advice}")
    factor, base = found
    if base != dimension(expected):
        measured = next((one for one in EXAMPLES if dimension(one) == base), base.replace(" ", ""))
        raise InputError(f"unit {quoted_unit(unit)} measures [{measured}], expected one of {advice}")
    if not SMALLEST <= factor <= LARGEST:
        raise InputError(
            f"unit {quoted_unit(unit)} is {factor:g} {expected}, an implausible size; write one of {advice}"
        )
    return factor


def quantity(text: str, expected: str) -> float:
    """A number with its unit, as `2 ms`, in the SI unit `expected`, a key of `EXAMPLES`."""
    number, _, unit = text.strip().partition(" ")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{quoted_unit(text)} is not a number with a unit; write it as in `2 {EXAMPLES[expected][0]}`")
    return value * si_factor(unit, expected)


def normalised(unit: str) -> str:
    """One spelling for a unit: `N·mm`, `N.mm` and `N mm` become `N*mm`."""
    text = "*".join(unit.strip().strip(".").split())
    for sign in ("·", "⋅", "∙", "."):
        text = text.replace(sign, "*")
    return text.replace("µ", "u").replace("μ", "u").replace("º", "°")


@cache
def base_units(spelling: str) -> tuple[float, str] | None:
    """Factor to base units, and their product as text; None if the text is not a unit."""
    parts = re.split(r"([*/])", spelling)
    if len(parts) > 15 or not all(NAMES.fullmatch(name) for name in parts[::2]):
        return None
    spelled = [name.lower() if WORDS.fullmatch(name) else name for name in parts]
    tidy = [ALIASES.get(name, name) for name in spelled]
    grouped = [f"({name})" if len(name) > 1 and "*" in name else name for name in tidy]
    try:
        one = REGISTRY.Quantity(1.0, REGISTRY.parse_units("".join(grouped))).to_base_units()
    except (pint.PintError, ValueError, AssertionError, TypeError):
        return None
    return float(one.magnitude), str(one.units)


def is_unit(text: str) -> bool:
    """Whether a text is a unit that is known."""
    return base_units(normalised(text)) is not None


@cache
def dimension(canonical: str) -> str:
    found = base_units(canonical)
    assert found is not None  # the canonical units are ours
    return found[1]


def quoted_unit(unit: str) -> str:
    """A unit in quotes, no longer than a line can hold."""
    return f"'{unit[:40]}...'" if len(unit) > 40 else f"'{unit}'"


KNOWN_NAMES: dict[str, str] = {
    "1": "percent dimensionless ppm",
    "s": "s ms us µs μs ns sec min minute minutes h hour hours",
    "Hz": "Hz kHz MHz hertz",
    "rad": "mrad urad µrad μrad mdeg º turn turns gon arcmin arcsec cycle cycles",
    "m": "m dm cm mm um µm μm nm km centimeter centimeters centimetre centimetres in inch inches ft foot feet",
    "A": "A kA mA uA µA μA",
    "V": "V kV mV uV µV μV",
    "N": "N kN cN mN uN µN μN lbf ozf kgf gf dyn dyne",
    "kg": "kg g mg lb lbs gram grams kilogram kilograms",
    "N*m": "J mJ kJ joule joules",
}
"""Names whose case matters, as that of a prefix does, by canonical unit. `ALIASES` are known besides."""
ANY_CASE: dict[str, str] = {
    "s": "second seconds millisecond milliseconds microsecond microseconds nanosecond nanoseconds",
    "rad": "deg degs degree degrees rad rads radian radians revolution revolutions",
    "m": "meter meters metre metres millimeter millimeters millimetre millimetres",
    "A": "amp amps ampere amperes",
    "V": "volt volts",
    "N": "newton newtons",
    "rad/s": "rpm",
}
"""Names whose case has no meaning."""
SEPARATOR = "(?: +|[*/·⋅∙.])"  # what stands between the names of a product or a quotient
MOST_NAMES = 8  # largest number of names in a unit


def one_of(*canonical: str) -> str:
    """Regular expression of one name of these canonical units; of any known name without one."""
    exact = [name for key in canonical or KNOWN_NAMES for name in KNOWN_NAMES[key].split()]
    exact += [] if canonical else ALIASES
    words = [word for key in canonical or ANY_CASE for word in ANY_CASE.get(key, "").split()]
    any_case = ["".join(f"[{letter.upper()}{letter}]" for letter in word) for word in words]
    return "(?:" + "|".join([*map(re.escape, exact), *any_case]) + ")"


def as_schema(common: list[str], pattern: str) -> WithJsonSchema:
    """A text that is one of the common units, which an editor proposes, or matches a pattern."""
    return WithJsonSchema({"type": "string", "anyOf": [{"enum": common}, {"pattern": f"^ *{pattern} *$"}]})


def measuring(expected: str) -> AfterValidator:
    """The check that a unit measures what the SI unit `expected` does."""

    def checked(unit: str) -> str:
        si_factor(unit, expected)
        return unit

    return AfterValidator(checked)


def common(*canonical: str) -> list[str]:
    return list(dict.fromkeys(unit for key in canonical or EXAMPLES for unit in EXAMPLES[key]))


Unit = Annotated[str, as_schema(common(), f"{one_of()}(?:{SEPARATOR}{one_of()}){{0,{MOST_NAMES - 1}}}")]
"""Any unit."""
TimeUnit = Annotated[str, measuring("s"), as_schema(common("s"), one_of("s"))]
LengthUnit = Annotated[str, measuring("m"), as_schema(common("m"), one_of("m"))]
ForceUnit = Annotated[str, measuring("N"), as_schema(common("N"), one_of("N"))]
MomentUnit = Annotated[Unit, measuring("N*m")]
