"""Units for the schemas of source files: names that laboratories write, of all that `si_factor` reads, and products.

`si_factor` asks pint, which knows rare names too. An editor that knew those would take nearly every slip for a unit.
"""

import re
from typing import Annotated

from pydantic import WithJsonSchema

from osl_analysis.ingest.units import ALIASES, EXAMPLES

NAMES: dict[str, str] = {
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
WORDS: dict[str, str] = {
    "s": "second seconds millisecond milliseconds microsecond microseconds nanosecond nanoseconds",
    "rad": "deg degs degree degrees rad rads radian radians revolution revolutions",
    "m": "meter meters metre metres millimeter millimeters millimetre millimetres",
    "A": "amp amps ampere amperes",
    "V": "volt volts",
    "N": "newton newtons",
    "rad/s": "rpm",
}
"""Names whose case has no meaning."""
SEPARATOR = "(?: +|[*/·⋅∙.])"
"""What stands between the names of a product or a quotient."""
MOST_NAMES = 8
"""Largest number of names in a unit."""


def one_of(*canonical: str) -> str:
    """Regular expression of one name of these canonical units; of any known name without one."""
    exact = [name for key in canonical or NAMES for name in NAMES[key].split()]
    exact += [] if canonical else ALIASES
    words = [word for key in canonical or WORDS for word in WORDS.get(key, "").split()]
    any_case = ["".join(f"[{letter.upper()}{letter}]" for letter in word) for word in words]
    return "(?:" + "|".join([*map(re.escape, exact), *any_case]) + ")"


def as_schema(common: list[str], pattern: str) -> WithJsonSchema:
    """A text that is one of the common units, which an editor proposes, or matches a pattern."""
    return WithJsonSchema({"type": "string", "anyOf": [{"enum": common}, {"pattern": f"^ *{pattern} *$"}]})


def common(*canonical: str) -> list[str]:
    """The units that messages propose for these canonical units."""
    return list(dict.fromkeys(unit for key in canonical or EXAMPLES for unit in EXAMPLES[key]))


Unit = Annotated[str, as_schema(common(), f"{one_of()}(?:{SEPARATOR}{one_of()}){{0,{MOST_NAMES - 1}}}")]
"""Any unit."""
TimeUnit = Annotated[str, as_schema(common("s"), one_of("s"))]
"""A unit of time."""
LengthUnit = Annotated[str, as_schema(common("m"), one_of("m"))]
"""A unit of length."""
ForceUnit = Annotated[str, as_schema(common("N"), one_of("N"))]
"""A unit of force."""
