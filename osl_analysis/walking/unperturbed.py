"""Unperturbed gait: the unperturbed crossings on a common grid of stance phase."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing

MOST_NAMED = 8
"""Most crossings that a message names."""
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

    def mean_plate_errors_at(self, phase: Array) -> Array:
        """Plate errors (m, k) [N*m] of the mean crossing at phases (k,)."""
        return at_phases(self.plate_errors.mean(axis=1), phase)


def unperturbed_gait(
    crossings: Sequence[Crossing], fewest: int, lost: Mapping[str, str] | None = None
) -> UnperturbedGait:
    """Crossings on the common grid of stance phase. `lost` has the reasons of those that are not used, by trial.

    Raises
    ------
    InputError
        There are fewer than `fewest`.
    """
    if len(crossings) < fewest:
        if lost:
            raise InputError(
                f"{len(crossings)} of {len(crossings) + len(lost)} unperturbed crossings can be used"
                f"{' (' + ', '.join(c.name for c in crossings) + ')' if crossings else ''}, expected {fewest} or more; "
                + most_frequent(lost)
            )
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


def most_frequent(reasons: Mapping[str, str]) -> str:
    """The most frequent reason by trial, with one trial's words, and how often; for a message.

    Reasons that differ in numbers and in the trial's name alone are one.
    """
    said = {trial: why.removeprefix(f"trial {trial}: ") for trial, why in reasons.items()}
    kinds = {trial: re.sub(r"[-+]?\d+(\.\d+)?", "#", why) for trial, why in said.items()}
    kind, count = Counter(kinds.values()).most_common(1)[0]
    trial = next(name for name, of in kinds.items() if of == kind)
    others = len(reasons) - count
    more = f" beside {others} for other reasons, which walking_crossings.csv lists" if others else ""
    alike = ", ".join(name for name, of in kinds.items() if of == kind)
    times = f"{count} times ({alike})" if 1 < count <= MOST_NAMED else f"{count} times"
    return f"{times}{more}, as in {trial}: {said[trial]}"


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
