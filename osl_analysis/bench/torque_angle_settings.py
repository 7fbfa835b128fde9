"""Choices of the analysis of torque against angle, each with its unit, as `config.yaml` has them."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from osl_analysis.bench.settings import BenchAnalysis
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Positive, Settings


class DesiredCurve(Settings):
    """A torque-angle curve that a device was designed for, as points of a broken line."""

    angle_deg: Annotated[tuple[float, ...], Field(min_length=2)]
    """Angles [deg] of the points, rising."""
    torque: Annotated[tuple[float, ...], Field(min_length=2)]
    """Torques [N*m] at these angles; they resist the motion."""

    @model_validator(mode="after")
    def _is_a_function(self) -> Self:
        if len(self.angle_deg) != len(self.torque):
            raise ValueError(f"{len(self.angle_deg)} angles and {len(self.torque)} torques; give one torque per angle")
        if not (np.diff(self.angle_deg) > 0).all():
            raise ValueError("the angles do not rise from point to point; sort them, each once")
        return self

    def at(self, angle_deg: Array) -> Array:
        """Torques [N*m] at angles (n,) [deg]; NaN beyond the ends of the curve."""
        return np.asarray(np.interp(angle_deg, self.angle_deg, self.torque, left=np.nan, right=np.nan))


class TorqueAngleAnalysis(BenchAnalysis):
    """Choices for a trial of torque against angle."""

    zero: Literal["end", "start", "none"]
    """Where the torque's zero is: its mean over `rest_s` at the end or at the start of the recording, where the joint
    rests; none: the torque is as recorded."""
    rest_s: Positive
    """Duration [s] of this rest."""
    angle_step_deg: Positive
    """Step [deg] of the angles at which the curves stand."""
    window_share: Annotated[float, Field(gt=0, le=0.25)]
    """Angle to each side of a point, as a share of the range of motion, over which its torque and slope are fitted."""
    smallest_motion_deg: Positive
    """Range of motion [deg] below which a trial is refused."""
    settle_cycles: Annotated[int, Field(ge=0, le=1000)] | None
    """Number of first cycles that are not analysed: a device with hysteresis begins another way than it goes on. None:
    the first one, where its torque does not come back and that of later ones does."""
    shortest_cycle_s: Positive
    """Duration [s] of a cycle below which a trial is refused: inertia and damping are in its torque."""
    desired: dict[str, DesiredCurve] = Field(default_factory=dict)
    """Desired curves by name. The column `desired` of the sample sheet says which one a trial should follow."""
