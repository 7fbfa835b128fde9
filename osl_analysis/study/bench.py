"""The bench of the validation study: a true motion and response that every trial repeats, and noisy sensors."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from osl_analysis.bench.belt import fit_belt_stiffness
from osl_analysis.bench.estimators import DEFAULT, ESTIMATORS, CovarianceChoice
from osl_analysis.bench.protocol import SteppedSineProtocol, find_blocks, repeated_cycles, rows_of, settled
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.bench.stepped_sine import RawSignals, drift_rate, without_drift
from osl_analysis.bench.transmission import fit_transmission
from osl_analysis.config import ValidationStudy
from osl_analysis.model.compensator import compensated_gains
from osl_analysis.model.rendering import predicted_impedance
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.second_order import impedance_columns, impedance_torque
from osl_analysis.signals import LowPass, Motion, filtered_motion
from osl_analysis.simulator.dynamometer import (
    BenchResponse,
    drivetrain_effects,
    moved,
    recorded_dynamometer,
    simulate_belt,
    simulate_impedance,
    simulate_transmission,
)
from osl_analysis.simulator.joint_motion import JointMotion, stepped_sine, there_and_back
from osl_analysis.simulator.sensors import stream
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.regression import LinearFit
from osl_analysis.study.performance import regression_bound
from osl_analysis.trial import Array

SENSORS = (
    "load_cell_noise", "load_cell_offset", "load_cell_drift", "load_cell_quantisation", "joint_encoder",
    "current_noise", "current_quantisation",
)  # fmt: skip
COVARIANCES = {
    "cycles": CovarianceChoice(),
    "HAC": CovarianceChoice(cycles=False),
    "HAC, 1 s": CovarianceChoice(cycles=False, lags=1000),
}
QUANTITIES = ("K", "B", "I")
Fitter = Callable[["Bench", RawSignals, LowPass], Iterator[tuple[str, str, LinearFit]]]


@dataclass(frozen=True)
class Estimate:
    """A value, its standard error, and its 95 % interval from `low` to `high`, in the unit of the quantity."""

    value: float
    se: float
    low: float
    high: float


Estimates = Iterator[tuple[str, str, Mapping[str, Estimate]]]
"""Of one trial: estimator, kind of interval, and its estimates by quantity."""


class Experiment(Protocol):
    """What the study repeats: estimates of a trial, whose name decides its noise, and what they are held against.

    `exact` are the parameters that made the trial, where the model is exact, `theory` what linear theory predicts,
    `bounds` no unbiased estimate's standard deviation can be below.
    """

    @property
    def exact(self) -> Mapping[str, float]: ...

    @property
    def theory(self) -> Mapping[str, float]: ...

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates: ...

    def bounds(self) -> Mapping[str, float]: ...


def estimates_of(fit: LinearFit, names: tuple[str, ...]) -> dict[str, Estimate]:
    """The named estimates of a fit."""
    return {name: Estimate(fit[name], fit.se(name), *fit.interval(name)) for name in names}


def torque_noise(settings: SimulationSettings, time: Array) -> tuple[float, Array]:
    """Standard deviation [N*m] of the load cell's white noise, rounding counted in, and of its drift at `time` [s]."""
    effects = settings.effects
    white = float(np.hypot(effects.load_cell_noise.value, effects.load_cell_quantisation.value / np.sqrt(12)))
    return white, effects.load_cell_drift.value / 60 * time


@dataclass(frozen=True)
class Bench:
    """One experiment: the true motion and response, which every trial repeats, and the sensors that read them.

    `fit` yields estimator, kind of interval and fit of a record; `exact` the parameters that made the torque, where
    it is exactly of the fitted form; `theory` what linear theory predicts, `names` what is estimated.
    `load_cell_drift` [N*m/min] is what the analysis takes it for.
    """

    command: Array
    motion: JointMotion
    response: BenchResponse
    settings: SimulationSettings
    protocol: SteppedSineProtocol | None
    settle_cycles: int
    load_cell_drift: float
    names: tuple[str, ...]
    fit: Fitter
    exact: dict[str, float]
    theory: dict[str, float]

    def record(self, trial: str, ideal: bool = False) -> RawSignals:
        """What the sensors make of one trial, the encoder's zero being anywhere between two of its steps."""
        settings = self.settings
        if ideal:
            settings = settings.model_copy(update={"effects": settings.effects.without(*SENSORS)})
        zero = settings.effects.joint_encoder.value * stream(settings.seed, trial, "encoder_zero").random()
        motion = replace(self.motion, theta=self.motion.theta + zero)
        log, _ = recorded_dynamometer(trial, self.command, motion, self.response, settings)
        time = log.time - log.time[0]
        blocks = find_blocks(time, log.joint_angle, self.protocol) if self.protocol else ()
        segments = settled(blocks, self.settle_cycles) if blocks else ()
        torque = -log.load_cell_torque
        torque = without_drift(time, torque, drift_rate(time, torque, segments))
        return RawSignals(time, log.joint_angle, log.commanded_angle, torque, settings.dynamometer.rate_hz, segments)

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """Every estimator's, from noisy or ideal sensors."""
        for name, method, fit in self.fit(self, self.record(trial, ideal), low_pass):
            yield name, method, estimates_of(fit, self.names)

    def bounds(self) -> dict[str, float]:
        """Cramer-Rao bound of the load cell's noise and drift, for the true motion in the rows that are fitted."""
        record, motion = self.record("ideal", ideal=True), self.motion
        if self.protocol:
            rows = rows_of(record.segments)
            columns = impedance_columns(Motion(motion.theta[rows], motion.omega[rows], motion.alpha[rows]))
        else:
            rows = np.arange(int(np.argmax(motion.theta > 0.05 * motion.theta.max())), int(np.argmax(motion.theta)) + 1)
            columns = {"K_s": motion.theta[rows], "offset": np.ones(len(rows))}
        if "B_j" in self.names:
            columns = {"B_j": columns["B"], "J_j": columns["I"], "offset": columns["offset"]}
        return regression_bound(columns, *torque_noise(self.settings, record.time[rows]))


def impedance_fits(bench: Bench, record: RawSignals, low_pass: LowPass) -> Iterator[tuple[str, str, LinearFit]]:
    """Every estimator with the spread of cycles, the default one with HAC too."""
    for name, estimator in ESTIMATORS.items():
        for method, covariance in COVARIANCES.items():
            if method == "cycles" or name == DEFAULT:
                yield name, method, estimator(record, low_pass, covariance)


def transmission_fits(bench: Bench, record: RawSignals, low_pass: LowPass) -> Iterator[tuple[str, str, LinearFit]]:
    """B_j and J_j."""
    motion, torque = filtered_motion(record.time, record.theta, record.torque, low_pass)
    rows = rows_of(record.segments)
    yield (
        DEFAULT,
        "cycles",
        fit_transmission(motion[rows], torque[rows], ResidualCorrelation(repeated_cycles(record.segments))),
    )


def belt_fits(bench: Bench, record: RawSignals, low_pass: LowPass) -> Iterator[tuple[str, str, LinearFit]]:
    """Loading slope; nothing repeats within a trial."""
    theta, torque = (low_pass(signal, record.rate_hz) for signal in (record.theta, record.torque))
    every, drift = low_pass.independent_samples(record.rate_hz), bench.load_cell_drift / 60 / record.rate_hz
    fit = fit_belt_stiffness(theta, torque, every, drift).loading
    yield DEFAULT, fit.interval_method, fit


def sine_bench(study: ValidationStudy, settings: SimulationSettings, analysis: DynamometerAnalysis) -> Bench:
    """The study's stepped sine, and as yet nothing that answers it."""
    short = {
        "cycles": study.cycles,
        "amplitudes_deg": study.amplitudes_deg,
        "frequencies_hz": analysis.frequencies_hz,
    }
    settings = settings.model_copy(update={"protocol": settings.protocol.model_copy(update=short)})
    command, motion = moved(stepped_sine(settings.protocol, settings.dynamometer.rate_hz), settings)
    protocol = SteppedSineProtocol(tuple(np.deg2rad(study.amplitudes_deg)), analysis.frequencies_hz, study.cycles)
    still = np.zeros_like(motion.theta)
    nothing = BenchResponse(still, still, still)
    settle, drift = analysis.settle_cycles, analysis.load_cell_drift
    return Bench(command, motion, nothing, settings, protocol, settle, drift, QUANTITIES, impedance_fits, {}, {})


def second_order(
    study: ValidationStudy, settings: SimulationSettings, p: DrivetrainParameters, analysis: DynamometerAnalysis
) -> Bench:
    """A joint that is exactly Eq. 15."""
    bench = sine_bench(study, settings, analysis)
    motion = Motion(bench.motion.theta, bench.motion.omega, bench.motion.alpha)
    torque = impedance_torque(study.K_d, study.B_d, study.I, motion)
    exact = {"K": study.K_d, "B": study.B_d, "I": study.I}
    return replace(bench, response=replace(bench.response, torque=torque), exact=exact, theory=exact)


def drivetrain(
    study: ValidationStudy, settings: SimulationSettings, p: DrivetrainParameters, analysis: DynamometerAnalysis
) -> Bench:
    """The compensated joint with everything that the settings switch on."""
    bench = sine_bench(study, settings, analysis)
    gains = compensated_gains(study.K_d, study.B_d, p)
    effects, rate = drivetrain_effects(bench.settings), settings.dynamometer.rate_hz
    response = simulate_impedance(rate, bench.motion, gains, effects, p)
    theory = dict(zip(QUANTITIES, predicted_impedance(gains, p, analysis.frequencies_hz), strict=True))
    return replace(bench, response=response, theory=theory)


def linear_drivetrain(
    study: ValidationStudy, settings: SimulationSettings, p: DrivetrainParameters, analysis: DynamometerAnalysis
) -> Bench:
    """The same without friction and hysteresis."""
    effects = settings.effects.without("friction", "belt_hysteresis")
    return drivetrain(study, settings.model_copy(update={"effects": effects}), p, analysis)


def transmission(
    study: ValidationStudy, settings: SimulationSettings, p: DrivetrainParameters, analysis: DynamometerAnalysis
) -> Bench:
    """The joint with the motor detached."""
    bench = sine_bench(study, settings, analysis)
    exact = {"B_j": p.B_j, "J_j": p.J_j}
    response = simulate_transmission(bench.motion, p)
    return replace(bench, response=response, names=tuple(exact), fit=transmission_fits, exact=exact, theory=exact)


def belt(
    study: ValidationStudy, settings: SimulationSettings, p: DrivetrainParameters, analysis: DynamometerAnalysis
) -> Bench:
    """The locked actuator's belt, with its hysteresis."""
    command, motion = moved(there_and_back(settings.belt, settings.dynamometer.rate_hz), settings)
    response = simulate_belt(motion, drivetrain_effects(settings), p)
    drift = analysis.load_cell_drift
    return Bench(command, motion, response, settings, None, 0, drift, ("K_s",), belt_fits, {}, {"K_s": p.K_s})


Builder = Callable[[ValidationStudy, SimulationSettings, DrivetrainParameters, DynamometerAnalysis], Bench]
BENCHES: dict[str, Builder] = {
    "second order": second_order,
    "linear drivetrain": linear_drivetrain,
    "drivetrain": drivetrain,
    "transmission": transmission,
    "belt": belt,
}
