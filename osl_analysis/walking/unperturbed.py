"""Unperturbed gait: the unperturbed crossings on a common grid of stance phase."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing

PHASES = np.linspace(0.0, 1.0, 401)
"""Phases of stance at which unperturbed crossings are sampled, finer than the markers' frames."""


@dataclass(frozen=True)
class UnperturbedGait:
    """Unperturbed crossings at `PHASES`: 0 at heel strike, 1 at toe-off.

    names: the crossings.
    theta: ankle angle (crossings, phases) [rad].
    torque: ankle torque (crossings, phases) [N*m].
    stance: duration of stance (crossings,) [s].
    plate_errors: (m, crossings, phases) [N*m], as in `Crossing`.
    """

    names: tuple[str, ...]
    theta: Array
    torque: Array
    stance: Array
    plate_errors: Array

    def theta_at(self, phase: Array) -> Array:
        """Angle (crossings, k) [rad] at phases (k,)."""
        return at_phases(self.theta, phase)

    def torque_at(self, phase: Array) -> Array:
        """Torque (crossings, k) [N*m] at phases (k,)."""
        return at_phases(self.torque, phase)

    def mean_plate_errors_at(self, phase: Array) -> Array:
        """Plate errors (m, k) [N*m] of the mean crossing at phases (k,)."""
        return at_phases(self.plate_errors.mean(axis=1), phase)


def unperturbed_gait(crossings: Sequence[Crossing], fewest: int) -> UnperturbedGait:
    """Crossings on the common grid of stance phase.

    Raises
    ------
    InputError
        There are fewer than `fewest`.
    """
    if len(crossings) < fewest:
        raise InputError(
            f"{len(crossings)} unperturbed crossings ({', '.join(c.name for c in crossings) or 'none'}), expected "
            f"{fewest} or more; record more, or exclude fewer in the sheet"
        )
    theta, torque, plate_errors = (
        np.stack([signal_at(c, getattr(c, signal), stance_times(c)) for c in crossings], axis=-2)
        for signal in ("theta", "torque", "plate_errors")
    )
    stance = np.array([c.stance.duration for c in crossings])
    return UnperturbedGait(tuple(c.name for c in crossings), theta, torque, stance, plate_errors)


def stance_times(crossing: Crossing, phases: Array = PHASES) -> Array:
    """Times [s] of the phases (k,) of a crossing's stance."""
    return crossing.stance.heel_strike + phases * crossing.stance.duration


def signal_at(crossing: Crossing, signal: Array, time: Array) -> Array:
    """Signals (..., n) of a crossing at other times (k,) [s], by a cubic spline; constant beyond the recording."""
    inside = np.clip(time, crossing.time[0], crossing.time[-1])
    return np.asarray(make_interp_spline(crossing.time, signal, k=3, axis=-1)(inside))


def at_phases(curves: Array, phase: Array) -> Array:
    """Curves (..., `PHASES`) at other phases (k,): (..., k), by a cubic spline."""
    return np.asarray(make_interp_spline(PHASES, curves, k=3, axis=-1)(phase))
