"""Units as laboratories spell them, and their factors to SI. The texts come from files: only names joined by `*` and
`/` are given to pint, whose parser would evaluate `9**9**9**9` without end."""

import math
import re
from functools import cache
from typing import Annotated

from pydantic import AfterValidator, WithJsonSchema

from osl_analysis.errors import InputError

# units that a message lists, by canonical unit, with the factors to it that pint gives, which takes 0.2 s to know them
EXAMPLES: dict[str, dict[str, float]] = {
    "1": {"1": 1.0, "%": 0.01}, "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}, "Hz": {"Hz": 1.0, "kHz": 1e3},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180, "rev": 2 * math.pi},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}, "A": {"A": 1.0, "mA": 1e-3},
    "V": {"V": 1.0, "mV": 1e-3, "uV": 1e-6}, "N": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "lbf": 4.4482216152605005},
    "N*m": {"N*m": 1.0, "Nm": 1.0, "N*cm": 1e-2, "N*mm": 1e-3, "Nmm": 1e-3, "mNm": 1e-3,
            "lbf*in": 0.11298482902761671, "lbf*ft": 1.3558179483314006},
    "N*m/rad": {"N*m/rad": 1.0, "Nm/rad": 1.0, "N*m/deg": 180 / math.pi},
    "N*m*s/rad": {"N*m*s/rad": 1.0, "Nms/rad": 1.0, "N*m*s/deg": 180 / math.pi},
    "N*m/kg": {"N*m/kg": 1.0, "Nm/kg": 1.0, "N*mm/kg": 1e-3},
}  # fmt: skip

# spellings that pint does not know, or reads as another unit: `Nm` as a textile count, `nt` as a nanotonne, `amps` as a
# velocity, `rads` as a dose
ALIASES = {
    "Nm": "N*m", "Nmm": "N*mm", "Ncm": "N*cm", "mNm": "mN*m", "kNm": "kN*m", "Nms": "N*m*s", "Nmms": "N*mm*s",
    "nt": "N", "ntm": "N*m", "ntmm": "N*mm", "volts": "V", "amps": "A", "rads": "radian", "°": "deg",
    "dps": "deg/s", "ftlb": "lbf*ft", "inlb": "lbf*in", "lbft": "lbf*ft", "lbin": "lbf*in",
    "oz": "force_ounce", "ozf": "force_ounce", "rev": "revolution", "%": "percent", "1": "dimensionless",
}  # fmt: skip
# names whose case has no meaning, since they have no prefix that it could distinguish
ANY_CASE = re.compile(
    r"(milli)?met(er|re)s?|volts?|deg(ree)?s?|rad(ian)?s?|newtons?|amp(ere)?s?|(milli|micro|nano)?seconds?|m?secs?|revolutions?|rpm",
    re.IGNORECASE,
)


def si_factor(unit: str, expected: str) -> float:
    """Factor from `unit` to the SI unit `expected`, a key of `EXAMPLES`. A middle dot, a full stop or a blank is read
    as the multiplication sign, both micro signs as `u`. An angle is a dimension: N*m/rad is not N*m."""
    advice, spelling = ", ".join(EXAMPLES[expected]), normalised(unit)
    if known := EXAMPLES[expected].get(spelling):
        return known
    quoted = f"unit '{unit[:40]}{'...' * (len(unit) > 40)}'"
    if not spelling:
        raise InputError(f"the unit is empty; write one of {advice}")
    for name in re.split(r"[*/]", spelling):
        if name.lower() in ("grad", "grads", "grade"):
            raise InputError(
                f"{quoted}: '{name}' is gon (a 400th of a turn) to some and degree to others: write `deg`, or `gon`"
            )
    found = base_units(spelling)
    if found is None:
        raise InputError(f"{quoted} is unknown; write one of {advice}")
    factor, base = found
    if base != dimension(expected):
        measured = next((one for one in EXAMPLES if dimension(one) == base), base.replace(" ", ""))
        raise InputError(f"{quoted} measures [{measured}], expected one of {advice}")
    if not 1e-9 <= factor <= 1e5:  # from ns to N*m/mdeg; others are misspellings such as `Mm` and `MN`
        raise InputError(f"{quoted} is {factor:g} {expected}, an implausible size; write one of {advice}")
    return factor


def quantity(text: str, expected: str) -> float:
    """A number with its unit, as `2 ms`, in the SI unit `expected`, a key of `EXAMPLES`."""
    number, _, unit = text.strip().partition(" ")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            f"'{text[:40]}{'...' * (len(text) > 40)}' is not a number with a unit; write it as in `2 "
            f"{next(iter(EXAMPLES[expected]))}`"
        )
    return value * si_factor(unit, expected)


def normalised(unit: str) -> str:
    """One spelling for a unit: `N·mm`, `N.mm` and `N mm` become `N*mm`."""
    text = re.sub("[·⋅∙.]", "*", "*".join(unit.strip().strip(".").split()))
    text = re.sub(r"(?<=[A-Za-z])-(?=[A-Za-z])", "*", text)  # `N-m`, `ft-lb`
    text = re.sub(r"\bN\*M\b", "N*m", text)  # in capitals, as a Biodex writes it
    text = re.sub(r"(?i)\b(ft|in|foot|inch)\*(lb)f?s?\b", r"\2*\1", text)  # a pound in a torque is a force
    text = re.sub(r"(?i)\b(lb)f?s?\*(ft|in|foot|inch)\b", lambda found: f"lbf*{found[2].lower()}", text)
    return text.replace("µ", "u").replace("μ", "u").replace("º", "°").replace("°/sec", "°/s")


@cache
def base_units(spelling: str) -> tuple[float, str] | None:
    """Factor to base units, and their product as text; None if the text is not a unit."""
    parts = re.split(r"([*/])", spelling)
    if len(parts) > 15 or not all(re.fullmatch(r"[^\W\d_]\w{0,30}|°|%|1", name) for name in parts[::2]):
        return None
    spelled = [name.lower() if ANY_CASE.fullmatch(name) else name for name in parts]
    from pint import PintError, application_registry  # all its units, which take 0.2 s, are read once

    tidy = [ALIASES.get(name, name) for name in spelled]
    grouped = [f"({name})" if len(name) > 1 and "*" in name else name for name in tidy]
    try:
        one = application_registry.Quantity(1.0, application_registry.parse_units("".join(grouped))).to_base_units()
    except (PintError, ValueError, AssertionError, TypeError):
        return None
    return float(one.magnitude), str(one.units)


def is_unit(text: str) -> bool:
    """Whether a text is a unit that is known."""
    return base_units(normalised(text)) is not None


def dimension(canonical: str) -> str:
    return (base_units(canonical) or (1.0, ""))[1]


def measured_in(expected: str = "") -> tuple[AfterValidator, WithJsonSchema]:
    """The check that a unit measures what the SI unit `expected` does, if any, and the units for an editor."""

    def checked(unit: str) -> str:
        if expected:
            si_factor(unit, expected)
        return unit

    proposed = list(dict.fromkeys(unit for key in [expected] * bool(expected) or EXAMPLES for unit in EXAMPLES[key]))
    return AfterValidator(checked), WithJsonSchema({"type": "string", "examples": proposed})


Unit = Annotated[str, *measured_in()]
TimeUnit = Annotated[str, *measured_in("s")]
LengthUnit = Annotated[str, *measured_in("m")]
ForceUnit = Annotated[str, *measured_in("N")]
MomentUnit = Annotated[str, *measured_in("N*m")]
