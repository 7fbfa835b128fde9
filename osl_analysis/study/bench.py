"""The dynamometer in the study: one true motion and response that every trial repeats, read by noisy sensors."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.bench.belt import belt_trial
from osl_analysis.bench.impedance import impedance_of
from osl_analysis.bench.segments import rows_of
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.bench.stepped_sine import stepped_sine_alone
from osl_analysis.bench.transmission import fit_transmission
from osl_analysis.model.compensator import compensated_gains, predicted_impedance
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.second_order import fit_impedance, impedance_columns, impedance_torque
from osl_analysis.signals import LowPass, Motion
from osl_analysis.simulator.bench import (
    BenchResponse,
    drivetrain_effects,
    moved,
    recorded_dynamometer,
    simulate_belt,
    simulate_impedance,
    simulate_transmission,
)
from osl_analysis.simulator.joint_motion import JointMotion, stepped_sine, there_and_back
from osl_analysis.simulator.settings import SimulationSettings, stream
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.regression import LinearFit
from osl_analysis.study.performance import regression_bound
from osl_analysis.study.recorded import at_any_phase, ideal_sensors, recorded_trial
from osl_analysis.study.trials import DEFAULT, Estimates, StudyInputs, estimates_of, torque_noise
from osl_analysis.trial import Array, Trial

QUANTITIES = ("K", "B", "I")
Fitter = Callable[["StudyBench", Trial], Iterator[tuple[str, str, LinearFit]]]


@dataclass(frozen=True)
class StudyBench:
    """One experiment: the true motion and response, which every trial repeats, and the sensors that read them.

    Attributes
    ----------
    command
        Commanded angle [rad], shape (n,).
    motion
        True motion of the joint.
    response
        True response of the joint to this motion.
    settings
        The simulated campaign, with the study's short protocol.
    p
        Parameters of the device, as the analysis knows them.
    analysis
        Settings of the analysis, with the study's short protocol.
    names
        Quantities that are estimated.
    fit
        Yields estimator, kind of interval and fit of a trial.
    exact
        Parameters that made the torque, by quantity, where the joint has such parameters. Else empty.
    theory
        Prediction of linear theory, by quantity.
    """

    command: Array
    motion: JointMotion
    response: BenchResponse
    settings: SimulationSettings
    p: DrivetrainParameters
    analysis: DynamometerAnalysis
    names: tuple[str, ...]
    fit: Fitter
    exact: dict[str, float]
    theory: dict[str, float]

    def trial(self, name: str, ideal: bool = False) -> Trial:
        """One trial as ingest would give it. The encoder's zero lies anywhere between two of its steps."""
        settings = ideal_sensors(self.settings) if ideal else at_any_phase(name, self.settings)
        zero = settings.effects.joint_encoder.value * stream(settings.seed, name, "encoder_zero").random()
        motion = replace(self.motion, theta=self.motion.theta + zero)
        log, _ = recorded_dynamometer(name, self.command, motion, self.response, settings)
        joint = {"theta": log.joint_angle, "theta_m": log.actuator_angle, "theta_command": log.commanded_angle}
        return recorded_trial(name, log.time, joint, log.torque_time, {"torque": -log.load_cell_torque})

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The estimates of every estimator, from noisy or ideal sensors."""
        for name, method, fit in self.fit(self, self.trial(trial, ideal)):
            yield name, method, estimates_of(fit, self.names)

    def bounds(self) -> dict[str, float]:
        """Cramer-Rao bound of the load cell's noise and drift, for the true motion in the rows that are fitted."""
        motion, rate = self.motion, self.settings.dynamometer.rate_hz
        if self.names != ("K_s",):
            rows = rows_of(stepped_sine_alone(self.trial("ideal", ideal=True), self.analysis).segments(None))
            columns = impedance_columns(Motion(motion.theta[rows], motion.omega[rows], motion.alpha[rows]))
        else:
            rows = np.arange(int(np.argmax(motion.theta > 0.05 * motion.theta.max())), int(np.argmax(motion.theta)) + 1)
            columns = {"K_s": motion.theta[rows], "offset": np.ones(len(rows))}
        if "B_j" in self.names:
            columns = {"B_j": columns["B"], "J_j": columns["I"], "offset": columns["offset"]}
        return regression_bound(columns, *torque_noise(self.settings, rows / rate))


def impedance_fits(bench: StudyBench, trial: Trial) -> Iterator[tuple[str, str, LinearFit]]:
    """K, B and I with the covariance of cycles, and with two of autocorrelated residuals for comparison."""
    stepped = stepped_sine_alone(trial, bench.analysis)
    every, rows = stepped.independent_samples, rows_of(stepped.segments(None))
    off = (stepped.torque - stepped.filtered_torque)[rows]
    covariances = {
        "cycles": stepped.residual_correlation(None),
        "HAC": ResidualCorrelation(every=every, filtered_off=off),
        "HAC, 1 s": ResidualCorrelation(every=every, lags=1000, filtered_off=off),
    }
    for method, residuals in covariances.items():
        yield DEFAULT, method, fit_impedance(*stepped.part(None), residuals).fit


def default_fits(bench: StudyBench, trial: Trial) -> Iterator[tuple[str, str, LinearFit]]:
    """K, B and I as the pipeline's tables have them."""
    yield DEFAULT, "cycles", impedance_of(stepped_sine_alone(trial, bench.analysis), None)


def default_only(bench: StudyBench) -> StudyBench:
    """The bench without the intervals that are compared."""
    return replace(bench, fit=default_fits)


def transmission_fits(bench: StudyBench, trial: Trial) -> Iterator[tuple[str, str, LinearFit]]:
    """B_j and J_j of a transmission trial."""
    stepped = stepped_sine_alone(trial, bench.analysis)
    yield DEFAULT, "cycles", fit_transmission(*stepped.part(None), stepped.residual_correlation(None))


def belt_fits(bench: StudyBench, trial: Trial) -> Iterator[tuple[str, str, LinearFit]]:
    """K_s, the slope while loading. Nothing repeats within a trial."""
    fit = belt_trial(trial, bench.p, bench.analysis).fit.loading
    yield DEFAULT, fit.interval_method, fit


def sine_bench(inputs: StudyInputs) -> StudyBench:
    """The study's stepped sine, with a joint that does not resist."""
    study, analysis = inputs.study, inputs.dynamometer
    short = {
        "cycles": study.cycles,
        "amplitudes_deg": study.amplitudes_deg,
        "frequencies_hz": analysis.frequencies_hz,
    }
    schedule = inputs.simulation.protocol.model_copy(update=short)
    settings = inputs.simulation.model_copy(update={"protocol": schedule})
    command, motion = moved(stepped_sine(schedule, settings.dynamometer.rate_hz), settings)
    still = np.zeros_like(motion.theta)
    return StudyBench(
        command=command,
        motion=motion,
        response=BenchResponse(still, still, still),
        settings=settings,
        p=inputs.p,
        analysis=analysis.model_copy(update=short),
        names=QUANTITIES,
        fit=impedance_fits,
        exact={},
        theory={},
    )


def second_order(inputs: StudyInputs) -> StudyBench:
    """A joint that is exactly Eq. 15."""
    bench, study = sine_bench(inputs), inputs.study
    motion = Motion(bench.motion.theta, bench.motion.omega, bench.motion.alpha)
    torque = impedance_torque(study.K_d, study.B_d, study.I, motion)
    exact = {"K": study.K_d, "B": study.B_d, "I": study.I}
    return replace(bench, response=replace(bench.response, torque=torque), exact=exact, theory=exact)


def drivetrain(inputs: StudyInputs) -> StudyBench:
    """The joint of a compensated controller, with every effect of the simulation settings."""
    bench, p = sine_bench(inputs), inputs.p
    gains = compensated_gains(inputs.study.K_d, inputs.study.B_d, p)
    effects, rate = drivetrain_effects(bench.settings), bench.settings.dynamometer.rate_hz
    response = simulate_impedance(rate, bench.motion, gains, effects, p)
    predicted = predicted_impedance(gains, p, inputs.dynamometer.frequencies_hz)
    return replace(bench, response=response, theory=dict(zip(QUANTITIES, predicted, strict=True)))


def linear_drivetrain(inputs: StudyInputs) -> StudyBench:
    """The joint of a compensated controller, without friction and hysteresis."""
    effects = inputs.simulation.effects.without("friction", "belt_hysteresis")
    changed = inputs.simulation.model_copy(update={"effects": effects})
    return default_only(drivetrain(replace(inputs, simulation=changed)))


def transmission(inputs: StudyInputs) -> StudyBench:
    """The joint with the motor detached."""
    bench, exact = sine_bench(inputs), {"B_j": inputs.p.B_j, "J_j": inputs.p.J_j}
    response = simulate_transmission(bench.motion, inputs.p)
    return replace(bench, response=response, names=tuple(exact), fit=transmission_fits, exact=exact, theory=exact)


def belt(inputs: StudyInputs) -> StudyBench:
    """The belt of a locked actuator, with its hysteresis."""
    settings = inputs.simulation
    command, motion = moved(there_and_back(settings.belt, settings.dynamometer.rate_hz), settings)
    return StudyBench(
        command=command,
        motion=motion,
        response=simulate_belt(motion, drivetrain_effects(settings), inputs.p),
        settings=settings,
        p=inputs.p,
        analysis=inputs.dynamometer,
        names=("K_s",),
        fit=belt_fits,
        exact={"K_s": inputs.p.K_s},
        theory={"K_s": inputs.p.K_s},
    )
