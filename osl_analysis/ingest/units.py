"""Units as laboratories spell them, and their factors to the canonical SI unit."""

import math

from osl_analysis.errors import InputError

DEGREE = math.pi / 180

SPELLINGS: dict[str, dict[str, float]] = {
    "1": {"1": 1.0, "%": 0.01},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": DEGREE, "°": DEGREE, "mdeg": 1e-3 * DEGREE},
    "rad/s": {"rad/s": 1.0, "deg/s": DEGREE, "°/s": DEGREE, "rpm": math.pi / 30},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "A": {"A": 1.0, "mA": 1e-3},
    "V": {"V": 1.0, "Volt": 1.0, "Volts": 1.0, "mV": 1e-3, "uV": 1e-6},
    "N": {"N": 1.0, "nt": 1.0, "kN": 1e3, "mN": 1e-3},
    "N*m": {"N*m": 1.0, "Nm": 1.0, "N*cm": 1e-2, "Ncm": 1e-2, "N*mm": 1e-3, "Nmm": 1e-3, "ntmm": 1e-3, "mNm": 1e-3},
    "N*m/rad": {"N*m/rad": 1.0, "Nm/rad": 1.0, "N*m/deg": 1 / DEGREE, "Nm/deg": 1 / DEGREE},
    "N*m*s/rad": {"N*m*s/rad": 1.0, "Nms/rad": 1.0, "N*m*s/deg": 1 / DEGREE, "Nms/deg": 1 / DEGREE},
    "N*m/kg": {"N*m/kg": 1.0, "Nm/kg": 1.0, "N*mm/kg": 1e-3, "Nmm/kg": 1e-3},
}


def si_factor(unit: str, expected: str) -> float:
    """Factor from `unit` to the SI unit `expected`, a key of `SPELLINGS`.

    A middle dot, a full stop or a blank counts as the multiplication sign, both micro signs as `u`.

    Raises
    ------
    InputError
        The unit is empty, unknown or of another dimension; the message lists what would do.
    """
    spelling = normalised(unit)
    accepted = SPELLINGS[expected]
    if spelling in accepted:
        return accepted[spelling]
    for dimension, spellings in SPELLINGS.items():
        if spelling in spellings:
            raise InputError(f"unit '{unit}' measures [{dimension}], expected one of {', '.join(accepted)}")
    problem = f"unit '{unit}' is unknown" if spelling else "the unit is empty"
    raise InputError(f"{problem}; write one of {', '.join(accepted)}")


def normalised(unit: str) -> str:
    """One spelling for the signs that writers vary: `N·mm`, `N.mm` and `N mm` are `N*mm`."""
    text = unit.strip()
    for sign in ("·", "⋅", ".", " "):
        text = text.replace(sign, "*")
    return text.replace("µ", "u").replace("μ", "u")
