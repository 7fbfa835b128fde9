"""What makes a bench fit doubtful: estimates that change with the amplitude, a wrong sign."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from osl_analysis.bench.stepped_sine import SteppedSineTrial, held_out_vaf
from osl_analysis.signals import Motion
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

LITTLE = {"K": 0.0, "B": 2.0}
"""Size of an estimate below which its own share says little, added in quadrature to what a change is divided by.
Friction changes B by as many N*m*s/rad where B is nearly 0. At 5 Hz, 2 N*m*s/rad make a fifth of the torque of
K = 300 N*m/rad."""
GAP = 3e-3  # Share of K that a gap takes off, from which on a lag cannot be told from it. At 6 deg, a gap of 0.02 deg.
CONFIRMED = 0.5
"""Part of the change of K over the amplitudes, as a cause implies it, that must be seen for the cause to count."""


def change_over_amplitudes(small: Row, large: Row, whole: Row, name: str) -> float:
    """By how much an estimate changes from the smallest to the largest amplitude, as a share of that to all of them. It
    is lowered in size by the 95 % half-width of the difference, to 0 at most: noise is no change. What it is divided by
    is not less than `LITTLE`."""
    difference = number_in(large, name) - number_in(small, name)
    halves = [number_in(row, f"{name}_high") - number_in(row, name) for row in (small, large)]
    half = float(np.hypot(halves[0], halves[1]))
    return float(
        np.sign(difference) * max(abs(difference) - half, 0.0) / np.hypot(number_in(whole, name), LITTLE[name])
    )


def number_in(row: Row, name: str) -> float:
    value = row[name]
    assert isinstance(value, float)
    return value


def over_amplitudes(rows: Sequence[Row]) -> list[Row]:
    """The rows of single amplitudes and, last, of all of them, with `K_change` and `B_change` in the last one.

    Friction behind the belt makes harmonics at the phase of a gap or of a spring that stiffens, but K does not change
    with the amplitude as these let it change. With two amplitudes or more, `backlash_share` and `stiffening` therefore
    stand in the last row only, and are 0 if K does not change as they imply. With one amplitude, a gap counts where it
    makes more of the harmonics than friction.
    """
    single = sorted(rows[:-1], key=lambda row: number_in(row, "amplitude_deg"))
    if len(single) < 2:
        return [{**row, **gap_beside_friction(row), "K_change": None, "B_change": None} for row in rows]
    K, B = (change_over_amplitudes(single[0], single[-1], rows[-1], name) for name in "KB")
    least, most = (number_in(row, "amplitude_deg") for row in (single[0], single[-1]))
    implied = {"backlash_share": 1.0, "stiffening": 0.75 * (1 - (least / most) ** 2)}
    found = {name: number_in(rows[-1], name) for name in implied}
    whole = {name: x if K * x > CONFIRMED * implied[name] * x**2 else 0.0 for name, x in found.items()}
    hidden: Row = dict.fromkeys((*implied, "K_change", "B_change"))
    table = [*({**row, **hidden} for row in rows[:-1]), {**rows[-1], **whole, "K_change": K, "B_change": B}]
    return [{**row, **no_lag(row)} for row in table] if whole["backlash_share"] > GAP else table


def no_lag(row: Row) -> Row:
    """What takes the certainty from the lag of a row: beside a gap, a lag is a part of what the gap leaves."""
    found = {"certain_lag_damping": 0.0, "lag_share": 0.0, "lag_inertia_share": 0.0, "frame_stiffness": None}
    return {name: value for name, value in found.items() if row.get(name) is not None}


def gap_beside_friction(row: Row) -> Row:
    """`backlash_share` of a row, 0 where its gap takes off less torque than Coulomb friction adds."""
    gap = number_in(row, "K") * np.deg2rad(number_in(row, "backlash_deg")) / 2
    counts = gap > abs(number_in(row, "coulomb_torque"))
    return {"backlash_share": number_in(row, "backlash_share") if counts else 0.0}


def lowest_held_out_vaf(
    trial: SteppedSineTrial, amplitude: float | None, fit: LinearFit, columns: Callable[[Motion], Mapping[str, Array]]
) -> float | None:
    """Lowest VAF [percent] of the fit to one amplitude [deg] at the other amplitudes. Null for the fit to all
    amplitudes (None), and for the only one."""
    others = [other for other in trial.amplitudes if other is not None and other != amplitude]
    if amplitude is None or not others:
        return None
    return min(held_out_vaf(fit, trial, other, columns) for other in others)
