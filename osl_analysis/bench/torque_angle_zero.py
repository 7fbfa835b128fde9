"""The zero of the torque: its mean at rest, the load cell's offset or what hysteresis leaves in the device.

A device with hysteresis that comes to rest on its way keeps a torque of up to half the width of its loop there. One
recording cannot tell it from an offset. A rest before the motion, or the loop around it, says that it may be there.
"""

from dataclasses import dataclass

import numpy as np

from osl_analysis.bench.torque_angle_settings import TorqueAngleAnalysis
from osl_analysis.errors import InputError
from osl_analysis.trial import Array

AT_REST = 0.01
"""Part of the range of motion by which the angle may change while the joint rests."""
OFF_MIDDLE = 0.25
"""Distance of the zero from the middle of the loop, as a part of its width there, from which it is said: 0.5 on a
branch, 0 where friction lets go at rest."""
LEAST_SHIFT = 0.005
"""The same as a part of the range of torque, below which it is not worth a word."""
LEAST_LOOP = 0.02
"""Width of the loop, as a part of the range of torque, below which hysteresis leaves nothing worth a word."""
SMALL_ZERO = 0.1
"""Torque taken for zero, as a part of the width of the loop, below which it is no matter what it is."""


def torque_zero(theta: Array, torque: Array, rate_hz: float, settings: TorqueAngleAnalysis) -> float:
    """Torque [N*m] at rest, by the rule of the settings; 0 if there is none.

    Raises
    ------
    InputError
        The joint does not rest there.
    """
    if settings.zero == "none":
        return 0.0
    count = max(round(settings.rest_s * rate_hz), 1)
    rows = slice(-count, None) if settings.zero == "end" else slice(count)
    moved = float(np.ptp(theta[rows]))
    if count >= len(theta) or moved > AT_REST * np.ptp(theta):
        other = "start" if settings.zero == "end" else "end"
        raise InputError(
            f"the joint does not rest at the {settings.zero} of the recording: the angle moves by "
            f"{np.rad2deg(moved):.2g} deg in {settings.rest_s:g} s; write `zero: {other}` under torque_angle, or "
            "`zero: none` if the torque was zeroed before, or a shorter `rest_s`"
        )
    return float(torque[rows].mean())


def rest_change(theta: Array, torque: Array, rate_hz: float, settings: TorqueAngleAnalysis) -> float | None:
    """Difference of the torque (n,) [N*m] between rest at the end and at the start, as a share of its range.

    None where the zero is not that of the end, or the joint does not rest at both at one angle (n,) [rad]. A zero at
    the start, before the device was moved, is right although hysteresis leaves a torque at the end.
    """
    count = max(round(settings.rest_s * rate_hz), 1)
    ends = np.concatenate([theta[:count], theta[-count:]])
    if settings.zero != "end" or float(np.ptp(ends)) > AT_REST * float(np.ptp(theta)):
        return None
    return float((torque[-count:].mean() - torque[:count].mean()) / np.ptp(torque))


@dataclass(frozen=True)
class Loop:
    """The loop at the angle of the rest, [N*m] from the zero."""

    middle: float
    """Mean of loading and unloading."""
    width: float
    """Their distance."""


def loop_at(at_deg: float, angle_deg: Array, loading: Array, unloading: Array) -> Loop | None:
    """The loop at an angle [deg], from the torques (m,) of both branches at the angles (m,); None beyond these."""
    if not angle_deg[0] <= at_deg <= angle_deg[-1]:
        return None
    one, other = (float(np.interp(at_deg, angle_deg, branch)) for branch in (loading, unloading))
    return Loop((one + other) / 2, abs(one - other))


def may_be_left(zero: float, loop: Loop | None, widest: float, torque_range: float) -> bool:
    """Whether the torque [N*m] at rest that was taken for zero may be what hysteresis leaves: it lies on a branch of
    the loop and not in its middle.

    Where the joint rests at an end of the motion the loop does not tell. There a `zero` that is small against the
    `widest` loop is no matter.
    """
    if loop is None:
        return widest > LEAST_LOOP * torque_range and abs(zero) > SMALL_ZERO * widest
    return abs(loop.middle) > max(OFF_MIDDLE * loop.width, LEAST_SHIFT * torque_range)
