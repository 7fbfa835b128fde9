"""One analysed crossing of the walkway: ankle angle and torque over stance, with events and quality."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.trial import Array
from osl_analysis.walking.encoder import EncoderCheck
from osl_analysis.walking.events import Stance
from osl_analysis.walking.load import Load

FEWEST_SAMPLES = 6
"""Samples that a spline of fifth degree needs."""


@dataclass(frozen=True)
class CrossingQuality:
    """Numbers that show the quality of a crossing.

    residuals: RMS distance [m], in stance, of each cluster's markers from their rigid body.
    zero: vertical force [N] of the plate before the step, which was removed; None if no zero was removed.
    placement: position (2,) [m] of the ankle, forward and to the left of the plate's centre, while the foot is flat.
    encoder: comparison with the leg's own encoder; None without a column theta.
    outside: largest distance [m] by which a foot marker lies outside the plate while the foot is flat.
    """

    residuals: Mapping[str, float]
    zero: float | None
    placement: tuple[float, float]
    encoder: EncoderCheck | None
    outside: float = 0.0


@dataclass(frozen=True)
class Crossing:
    """Ankle angle and torque of one crossing, n samples at the marker rate.

    name: the trial.
    time: (n,) [s].
    theta: joint angle (n,) [rad].
    torque: internal plantarflexion moment (n,) [N*m].
    platform: rotation (n,) [rad] of the platform, not filtered.
    stance: heel strike and toe-off.
    onset: onset [s] of the perturbation; None without one.
    bridged: fraction of the frames in stance in which a hidden cluster was interpolated.
    quality: numbers that show the quality of the crossing.
    plate_errors: changes (m, n) [N*m] of the torque. Row i is the change if the plate's model is identified without the
        i-th of m plate trials. With a single plate trial m = 0.
    load: ground reaction on the foot; None if it is not known.
    turn: largest turn [rad] of the platform about the ankle's axis in the window, toes up positive; None if
        unperturbed or unknown.
    body_mass: [kg]; None if nobody states it.

    Raises
    ------
    InputError
        Fewer than six samples, time that does not go forward, a stance without duration, or a signal that is not finite
        or cannot be measured. The message names the trial.
    """

    name: str
    time: Array
    theta: Array
    torque: Array
    platform: Array
    stance: Stance
    onset: float | None
    bridged: float
    quality: CrossingQuality
    plate_errors: Array
    load: Load | None = None
    turn: float | None = None
    body_mass: float | None = None

    def __post_init__(self) -> None:
        for signal in ("time", "theta", "torque", "plate_errors"):
            check_measured(f"trial {self.name}: {signal}", getattr(self, signal))
        if len(self.time) < FEWEST_SAMPLES or not (np.diff(self.time) > 0).all():
            raise InputError(
                f"trial {self.name}: {len(self.time)} samples, expected {FEWEST_SAMPLES} or more, each later than the "
                "one before; exclude the trial"
            )
        if not self.stance.duration > 0:
            raise InputError(f"trial {self.name}: stance lasts {self.stance.duration:g} s; exclude the trial")

    @property
    def sign(self) -> int:
        """-1 if the platform turned the toes down, else 1."""
        return -1 if self.turn is not None and self.turn < 0 else 1


@dataclass(frozen=True)
class RefusedCrossing:
    """A crossing that cannot be analysed.

    name: the trial.
    perturbed: whether the sheet says that the crossing is perturbed.
    reason: why it is refused.
    """

    name: str
    perturbed: bool
    reason: str
