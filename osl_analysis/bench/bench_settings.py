# SPDX-License-Identifier: Apache-2.0
"""Choices of the analysis on the benches, each with its unit, as `config.yaml` has them."""

from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from osl_analysis.base.measured import UNIFORM_WIDTH
from osl_analysis.base.trial import Array
from osl_analysis.base.units import quantity
from osl_analysis.base.yaml_settings import (
    Amplitudes,
    CycleCount,
    Frequencies,
    NotNegative,
    Positive,
    Settings,
    check_rising,
    refuse_if,
)
from osl_analysis.config.sheet import Windows
from osl_analysis.signals.grid import FilterSettings

Angle = Annotated[float, Field(ge=-180, le=180)]
# a standard uncertainty; what is larger is a percentage
UncertainShare = Annotated[float, Field(ge=0, lt=0.5)]


def check_stiffness(text: str) -> str:
    """A stiffness with its unit. Raises ValueError: it is not positive, or no stiffness."""
    if quantity(text, "N*m/rad") <= 0:
        raise ValueError("write a positive number with its unit, as in '218 N*m/deg'")
    return text


StiffnessText = Annotated[str, AfterValidator(check_stiffness)]


class BenchStiffness(Settings):
    """Torsional stiffness of what yields between the bench's encoder and the joint: frame, mount
    and coupling."""

    value: StiffnessText  # stiffness with its unit, as `12500 N*m/rad` or `218 N*m/deg`
    # with its unit; null: not known, and not in the intervals
    standard_error: StiffnessText | None = None

    _known = refuse_if(
        lambda s: not s.compliance_error < s.compliance,
        "the standard error is not below the value; check the units",
    )

    @property
    def compliance(self) -> float:
        """Its inverse [rad/(N*m)]."""
        return 1 / quantity(self.value, "N*m/rad")

    @property
    def compliance_error(self) -> float:
        """Standard error of the inverse [rad/(N*m)]; 0 where it is not stated."""
        stated = self.standard_error
        return 0.0 if stated is None else quantity(stated, "N*m/rad") * self.compliance**2


class Calibration(Settings):
    """Standard uncertainties of a bench's calibration, of type B (JCGM 100:2008, 4.3), which all of
    its trials share and no scatter shows; 0: not stated, and in no interval."""

    # relative, of the torque's gain: 0.001 of a load cell of 0.1 %
    torque_gain: UncertainShare = 0.0
    angle_gain: UncertainShare = 0.0  # relative, of the angle's gain
    misalignment_deg: Annotated[float, Field(ge=0, lt=90)] = 0.0
    """Angle [deg] between the axes of joint and load cell, whose torque is low by 1 - cos."""
    hysteresis: UncertainShare = 0.0
    """Of the load cell: largest distance between rising and falling readings, over the range of
    torque of a trial."""
    # time [s] by which the torque may be late, or early, beyond a stated `delay`
    delay: UncertainShare = 0.0

    @property
    def tells_delay(self) -> bool:
        """Whether the delay was measured, as by a known spring."""
        return self.delay > 0

    @property
    def torque(self) -> float:
        """Relative standard uncertainty of the torque."""
        return float(np.hypot(self.torque_gain, 1 - np.cos(np.deg2rad(self.misalignment_deg))))

    def polar(self, frequency_hz: float) -> tuple[float, float]:
        """Of the response to a sine: relative of the magnitude, and of the phase [rad] (describing
        function)."""
        turn = np.hypot(2 * np.pi * frequency_hz * self.delay, 4 / np.pi * 2 * self.slip)
        return np.hypot(self.torque, self.angle_gain), turn

    @property
    def slip(self) -> float:
        """That of half the width of the load cell's loop, over the range of torque: a rectangular
        distribution."""
        return self.hysteresis / UNIFORM_WIDTH


NOT_STATED = Calibration()


class Fixture(Settings):
    """What turns with the joint between it and the load cell, such as a clamp, as a calibration of
    the fixture alone measures it. Its torque is taken off every trial of the bench."""

    inertia: NotNegative = 0.0  # about the axis [kg*m^2]
    weight: NotNegative = 0.0  # torque [N*m] with its centre level with the axis, m g r
    rest_deg: Annotated[float, Field(ge=-180, le=360)] = 0.0  # angle [deg] at which it hangs
    inertia_error: NotNegative = 0.0  # standard uncertainty [kg*m^2]; 0: not stated
    weight_error: NotNegative = 0.0  # standard uncertainty [N*m]; 0: not stated
    rest_error_deg: NotNegative = 0.0  # standard uncertainty [deg]; 0: not stated


class BenchAnalysis(FilterSettings):
    """What the fits of all trials on the dynamometer share."""

    bench_stiffness: BenchStiffness | None = None  # null: the bench does not yield
    calibration: Calibration = NOT_STATED  # what is not known of torque and angle
    fixture: Fixture | None = None  # what turns with the joint behind the load cell; null: nothing
    # [rad] by which a joint turns at most, to each side
    largest_angle: Annotated[float, Field(gt=0, le=3.2)] = 1.2
    # largest torque [N*m] that the load cell measures; null: not stated
    load_cell_range: Positive | None = None

    def joint_angle(self, theta: Array, torque: Array) -> Array:
        """Angle of the joint (n,) [rad] from the bench's: the bench turns the joint through its
        frame, which the resisting torque [N*m] deflects: theta_bench = theta + torque/k."""
        bench = self.bench_stiffness
        return theta - bench.compliance * torque if bench else theta


class BeltAnalysis(BenchAnalysis):
    """Choices for a belt trial."""

    load_cell_drift: NotNegative = 0.0
    """Standard deviation of the load cell's drift [N*m/min], which the interval of a belt trial
    includes; 0: none."""


class SteppedSineAnalysis(BenchAnalysis):
    """Choices for a stepped-sine trial, and its protocol."""

    amplitudes_deg: Amplitudes | None
    """Commanded amplitudes [deg], one block each, in the order of the protocol; null: not
    stated."""
    frequencies_hz: Frequencies | None
    """Frequencies [Hz] of a block, one segment each, in the order of the protocol; null: not
    stated."""
    cycles: CycleCount | tuple[CycleCount, ...] | None
    """Number of cycles at each frequency: one number for all, or one for each; null: not stated. It
    is an expectation: the fits use what was recorded, and the quality check `protocol` says where
    the two differ."""
    settle_cycles: Annotated[int, Field(ge=0, le=10_000)]
    """Number of cycles at the start of each segment that are not fitted."""
    _has_a_number_for_each = refuse_if(
        lambda s: isinstance(s.cycles, tuple) and len(s.cycles) != len(s.frequencies_hz or ()),
        "cycles has another length than frequencies_hz; give one number for all, or one for each",
        "cycles",
    )
    # the last cycle is fitted where it is the only one
    _some_cycles_are_settled = refuse_if(
        lambda s: s.settle_cycles + 1 >= max(np.min(s.cycles or np.inf), 2),
        "settle_cycles = {s.settle_cycles} and the last leave none of cycles = {s.cycles}; lower"
        " it, or raise cycles",
        "settle_cycles",
    )


class ImpedanceAnalysis(SteppedSineAnalysis):
    """Choices for an impedance trial, whose motion may be another one than the stepped sine."""

    excitation: Literal["auto", "stepped_sine", "any"] = "auto"
    """What moves the joint in impedance trials: the stepped sine, any other motion, or what each
    recording shows."""
    at_hz: Annotated[float | None, Field(gt=0)] = None
    """Frequency [Hz] at which K and B of the response are headline numbers, too: those of Eq. 15
    depend on the motion, of a joint that is not of second order. null: none."""
    windows: Windows | None = None
    """Stretches [s] of a recording that are fitted, from its start, as `2-30 40-62`, where the
    motion is no stepped sine and the sample sheet states none; null: from the first to the last
    motion."""

    _passes = refuse_if(
        lambda s: s.excitation != "any" and max(s.frequencies_hz or (0,)) >= s.cutoff_hz,
        "cutoff_hz = {s.cutoff_hz:g} takes out some of frequencies_hz; raise it, or correct"
        " frequencies_hz",
        "cutoff_hz",
    )


class DynamometerAnalysis(ImpedanceAnalysis, BeltAnalysis):
    """Choices for all trials of the dynamometer."""


class ActuatorAnalysis(BenchAnalysis):
    """Filter and treatment of friction on the actuator's bench."""

    # velocity [rad/s] over which its sign is smoothed: tanh(omega_m/sign_width)
    sign_width: Positive


class DesiredCurve(Settings):
    """A torque-angle curve that a device was designed for, as points of a broken line."""

    # of the points [deg]
    angle_deg: Annotated[tuple[Angle, ...], Field(min_length=2), AfterValidator(check_rising)]
    # torques [N*m] there; they resist the motion
    torque: Annotated[tuple[float, ...], Field(min_length=2)]

    _is_a_function = refuse_if(
        lambda s: len(s.angle_deg) != len(s.torque),
        "angle_deg and torque differ in length; give one torque per angle",
        "angle_deg",
    )

    def at(self, angle_deg: Array) -> Array:
        """Torques [N*m] at angles (n,) [deg]; NaN beyond the ends of the curve."""
        return np.interp(angle_deg, self.angle_deg, self.torque, left=np.nan, right=np.nan)


class TorqueAngleAnalysis(BenchAnalysis):
    """Choices for a trial of torque against angle."""

    zero: Literal["end", "start", "none"] | None
    """Where the torque's zero is: its mean over `rest_s` at the end or at the start of the
    recording, where the joint rests; none: the torque is as recorded, and has its zero; null: not
    stated, the torque is as recorded."""
    rest_s: Positive  # duration [s] of this rest
    # step [deg] of the angles at which the curves stand
    angle_step_deg: Annotated[float, Field(gt=0, le=10)]
    settle_cycles: Annotated[int, Field(ge=0, le=1000)]
    """Number of first cycles that are not analysed: a device with hysteresis begins another way
    than it goes on."""
    shortest_cycle_s: Positive
    """Duration [s] of a cycle below which a trial is refused: inertia and damping are in its
    torque."""
    desired: dict[str, DesiredCurve] = Field(default_factory=dict)
    """Desired curves by name. The column `desired` of the sample sheet says which one a trial
    should follow."""
    _passes = refuse_if(
        lambda s: s.cutoff_hz * s.shortest_cycle_s <= 1,
        "cutoff_hz = {s.cutoff_hz:g} takes out cycles of shortest_cycle_s = {s.shortest_cycle_s:g};"
        " raise one of them",
        "cutoff_hz",
    )
