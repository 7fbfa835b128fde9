"""The benches in the study: one true motion and response that every trial repeats, read by noisy sensors.

An experiment has `exact`, the parameters that made its trials, where the joint has such parameters, and `theory`, the
prediction of linear theory, both by quantity; `estimates` of a trial, whose name decides its noise, through noisy or
`ideal` sensors; and `bounds`, the smallest standard deviation of any unbiased estimate, by quantity.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.components import ACTUATOR_PARAMETERS, actuator_trial, belt_trial, moving_rows
from osl_analysis.bench.effects import IMPEDANCE, TRANSMISSION, Model, plain_sums, with_effects
from osl_analysis.bench.phasors import SegmentPhasors, phasors_of_record, polar_row
from osl_analysis.bench.record import Record, sine_record
from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis
from osl_analysis.config.configuration import StudySettings
from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import compensated_gains, predicted_impedance
from osl_analysis.second_order import impedance_columns, impedance_torque
from osl_analysis.signals import LowPass, Motion
from osl_analysis.simulator.bench import (
    BenchResponse,
    belt_scatter,
    current_schedule,
    drivetrain_effects,
    moved,
    recorded_actuator,
    recorded_dynamometer,
    simulate_belt,
    simulate_impedance,
    simulate_transmission,
    turning,
)
from osl_analysis.simulator.joint_motion import JointMotion, sine_command, there_and_back
from osl_analysis.simulator.settings import Effect, Encoder, RecorderSettings, SimulationSettings, stream
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.study import BENCH_EXPERIMENTS, RECORDINGS, RecordedAs
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.settings import WalkingAnalysis

StudyRow = dict[str, Any]  # one row of the study's table of estimates
STUDIED_QUANTITIES = ("K", "B", "I")


@dataclass(frozen=True)
class StudyInputs:
    """Settings with which the study simulates and analyses its trials."""

    study: StudySettings
    simulation: SimulationSettings
    gait: WalkingSettings | None  # the simulated gait laboratory; None where the simulation has none
    p: DrivetrainParameters  # that make the trials
    dynamometer: DynamometerAnalysis
    actuator: ActuatorAnalysis
    walking: WalkingAnalysis
    sources: Path  # folder of the source files


@dataclass(frozen=True)
class StudyEstimate:
    """An estimate with its standard error and 95 % interval, all in the unit of the quantity."""

    value: float
    se: float
    low: float
    high: float


Estimates = Iterator[tuple[str, str, Mapping[str, StudyEstimate]]]
"""The estimates of one trial: estimator, kind of interval, and an estimate for each quantity."""


def of_filtered(fit: LinearFit, names: Sequence[str]) -> Estimates:
    """The named estimates of the bench's estimator: one filter for all signals, derivatives, least squares."""
    yield (
        "filtered",
        fit.interval_method,
        {name: StudyEstimate(fit[name], fit.se(name), *fit.interval(name)) for name in names},
    )


def ideal_sensors(settings: SimulationSettings) -> SimulationSettings:
    """The settings without errors of sensors and recorders."""
    sensors = (
        "load_cell_noise", "load_cell_offset", "load_cell_drift", "load_cell_quantisation", "load_cell_hum",
        "load_cell_flicker", "joint_encoder", "actuator_encoder", "current_noise", "current_quantisation",
        "encoder_zero",
    )  # fmt: skip
    # the controller sees the actuator's encoder too, but its motion has been simulated before the sensors read it
    return settings.model_copy(update={"effects": settings.effects.without(*sensors), "recorder": RecorderSettings()})


def recorded_trial(
    name: str, time: Array, joint: Mapping[str, Array], torque_time: Array, torque: Mapping[str, Array]
) -> Trial:
    """The trial of two recordings with stamps [s] of their own: what moves and the torque, in canonical columns."""
    samples = pl.DataFrame({"time": time - time[0], **joint})
    if np.array_equal(time, torque_time):
        return Trial(name, samples.with_columns(**{column: pl.Series(values) for column, values in torque.items()}))
    other = pl.DataFrame({"time": torque_time - time[0], **torque})
    return Trial(name, samples.join(other, on="time", how="full", coalesce=True).sort("time"))


def through_sensors(
    trial: str, settings: SimulationSettings, encoder: Encoder, ideal: bool
) -> tuple[SimulationSettings, float]:
    """Settings with which a trial is recorded, and the zero of its encoder [rad].

    Every trial repeats the motion. With samples at the same phases of it the rounding of an encoder would repeat too:
    recorders start anywhere between two instants of the simulated motion, and the zero lies anywhere between two steps.
    """
    if ideal:
        return ideal_sensors(settings), 0.0
    later = float(stream(settings.seed, trial, "sampling_phase").random()) / settings.dynamometer.rate_hz
    nodes = {
        name: node.model_copy(update={"phase": Effect(enabled=True, size=node.phase.value + later, unit="s")})
        for name in ("node", "torque_node")
        if (node := getattr(settings.recorder, name)) is not None
    }
    zero = encoder.value * float(stream(settings.seed, trial, "encoder_zero").random())
    return settings.model_copy(update={"recorder": settings.recorder.model_copy(update=nodes)}), zero


def recorded_as(inputs: StudyInputs, recording: RecordedAs) -> StudyInputs:
    """The inputs with another recorder, rate or encoder of the bench."""
    simulation = inputs.simulation
    bench = simulation.dynamometer.model_copy(update={"rate_hz": recording.rate_hz})
    changes: dict[str, object] = {
        "dynamometer": bench,
        "recorder": RecorderSettings.model_validate(recording.recorder),
    }
    if recording.bits is not None:
        encoder = Encoder(enabled=True, size=recording.bits, unit="bit")
        changes["effects"] = simulation.effects.model_copy(update={"joint_encoder": encoder})
    return replace(inputs, simulation=simulation.model_copy(update=changes))


def torque_noise(settings: SimulationSettings, time: Array) -> tuple[float, Array]:
    """Standard deviations [N*m] of the load cell's white noise, with its rounding, and of its drift at `time` [s]."""
    effects = settings.effects
    white = float(np.hypot(effects.load_cell_noise.value, effects.load_cell_quantisation.value / np.sqrt(12)))
    return white, effects.load_cell_drift.value / 60 * time


def regression_bound(columns: Mapping[str, Array], noise: float, drift: Array | None = None) -> dict[str, float]:
    """Smallest standard error of any unbiased estimate of y = X b + e, for exactly known columns, shape (n,) each.

    The error e is Gaussian. It is white with standard deviation `noise`, plus a random multiple of `drift`, shape (n,),
    which is the standard deviation of a drift in time. Cramer and Rao: cov(b) >= (X' V^-1 X)^-1 with
    V = noise^2 1 + drift drift'. Its inverse is Sherman and Morrison's. A filter that passes the columns does not
    change the bound: per frequency the information is |H X|^2/(|H|^2 noise^2), and H cancels.
    """
    X = np.column_stack(list(columns.values()))
    drift = np.zeros(len(X)) if drift is None else drift
    seen = X.T @ drift
    information = (X.T @ X - np.outer(seen, seen) / (noise**2 + drift @ drift)) / noise**2
    covariance = np.linalg.inv(information)
    return dict(zip(columns, np.sqrt(np.diag(covariance)).tolist(), strict=True))


@dataclass(frozen=True)
class StudyBench:
    """One experiment: the true motion and response, which every trial repeats, and the sensors that read them. Settings
    and analysis have the study's short protocol."""

    command: Array  # commanded angle [rad], shape (n,)
    motion: JointMotion
    response: BenchResponse
    settings: SimulationSettings
    p: DrivetrainParameters  # as the analysis knows them
    analysis: DynamometerAnalysis
    names: tuple[str, ...]  # quantities that are estimated
    fit: Callable[["StudyBench", Trial], LinearFit]  # as the tables have it
    exact: dict[str, float]  # parameters that made the torque, where the joint has such parameters
    theory: dict[str, float]  # prediction of linear theory

    def trial(self, name: str, ideal: bool = False) -> Trial:
        """One trial as ingest would give it."""
        settings, zero = through_sensors(name, self.settings, self.settings.effects.joint_encoder, ideal)
        motion = replace(self.motion, theta=self.motion.theta + zero)
        log, _ = recorded_dynamometer(name, self.command, motion, self.response, settings)
        joint = {"theta": log["joint_angle"], "theta_m": log["actuator_angle"], "theta_command": log["commanded_angle"]}
        return recorded_trial(name, log.time, joint, log.torque_time, {"torque": -log["load_cell_torque"]})

    def record(self, name: str, ideal: bool = False) -> Record:
        return sine_record(self.trial(name, ideal), self.analysis)

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The estimates of the pipeline's fit, from noisy or ideal sensors."""
        yield from of_filtered(self.fit(self, self.trial(trial, ideal)), self.names)

    def bounds(self) -> dict[str, float]:
        """Cramer-Rao bound of the load cell's noise and drift, for the true motion in the rows that are fitted."""
        motion, rate = self.motion, self.settings.dynamometer.rate_hz
        if self.names != ("K_s",):
            rows = self.record("ideal", ideal=True).rows()
            columns = impedance_columns(Motion(motion.theta[rows], motion.omega[rows], motion.alpha[rows]))
        else:
            rows = np.arange(int(np.argmax(motion.theta > 0.05 * motion.theta.max())), int(np.argmax(motion.theta)) + 1)
            columns = {"K_s": motion.theta[rows], "offset": np.ones(len(rows))}
        if "B_j" in self.names:
            columns = {"B_j": columns["B"], "J_j": columns["I"], "offset": columns["offset"]}
        return regression_bound(columns, *torque_noise(self.settings, rows / rate))


def sine_fit(bench: StudyBench, trial: Trial, model: Model) -> LinearFit:
    return with_effects(plain_sums(sine_record(trial, bench.analysis), model), model)


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
    command, motion = moved(sine_command(schedule, settings.dynamometer.rate_hz), settings)
    still = np.zeros_like(motion.theta)
    return StudyBench(
        command=command,
        motion=motion,
        response=BenchResponse(still, still, still),
        settings=settings,
        p=inputs.p,
        analysis=analysis.model_copy(update=short),
        names=STUDIED_QUANTITIES,
        fit=lambda own, trial: sine_fit(own, trial, IMPEDANCE),
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
    return replace(bench, response=response, theory=dict(zip(STUDIED_QUANTITIES, predicted, strict=True)))


def linear_drivetrain(inputs: StudyInputs) -> StudyBench:
    """The joint of a compensated controller, without friction and hysteresis."""
    effects = inputs.simulation.effects.without("friction", "belt_hysteresis")
    changed = inputs.simulation.model_copy(update={"effects": effects})
    return drivetrain(replace(inputs, simulation=changed))


def transmission(inputs: StudyInputs) -> StudyBench:
    """The joint with the motor detached."""
    bench, exact = sine_bench(inputs), {"B_j": inputs.p.B_j, "J_j": inputs.p.J_j}
    return replace(
        bench,
        response=simulate_transmission(bench.motion, inputs.p),
        names=tuple(exact),
        fit=lambda own, trial: sine_fit(own, trial, TRANSMISSION),
        exact=exact,
        theory=exact,
    )


def belt(inputs: StudyInputs) -> StudyBench:
    """The belt of a locked actuator, with its hysteresis. K_s is the slope while loading."""
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
        fit=lambda own, trial: belt_trial(trial, own.p, own.analysis).loading.whole,  # nothing repeats within a trial
        exact={"K_s": inputs.p.K_s},
        theory={"K_s": inputs.p.K_s},
    )


@dataclass(frozen=True)
class ResponseBench:
    """The integral admittance Y = theta/torque of a bench, at one amplitude and each frequency of its protocol. The
    quantities have the frequency in their names: `magnitude, 2 Hz` [rad/(N*m)] and `phase, 2 Hz` [deg]. A drivetrain
    with friction has no exact value, and linear theory does not describe it."""

    bench: StudyBench
    exact: Mapping[str, float] = field(default_factory=dict)
    theory: Mapping[str, float] = field(default_factory=dict)

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The estimates from raw signals. Each frequency has its own row, like an estimator."""
        for segment in self.phasors(trial, ideal):
            f, row = segment.frequency_hz, polar_row(segment.admittance)
            parts = {"magnitude": "", "phase": "_deg"}
            yield f"sinusoid, {f:g} Hz", "cycles", {
                f"{part}, {f:g} Hz": StudyEstimate(*(row[f"{part}{end}{unit}"] for end in ("", "_se", "_low", "_high")))
                for part, unit in parts.items()
            }  # fmt: skip

    def phasors(self, trial: str, ideal: bool) -> list[SegmentPhasors]:
        return phasors_of_record(self.bench.record(trial, ideal))

    def bounds(self) -> dict[str, float]:
        """Bounds from that of a phasor in white noise, 2 sigma^2/N per quadrature. Relative to the torque's amplitude
        it is the bound of the magnitude, and in radian that of the phase (Rife and Boorstyn, IEEE Trans. Inf. Theory
        20, 1974)."""
        white, _ = torque_noise(self.bench.settings, np.zeros(1))
        record, bounds = self.bench.record("ideal", ideal=True), {}
        samples = np.bincount(record.groups.stratum, record.groups.stop - record.groups.first)
        for count, phasors in zip(samples, phasors_of_record(record), strict=True):
            f, torque = phasors.frequency_hz, abs(phasors.torque.value)
            relative = white * float(np.sqrt(2 / count)) / torque
            bounds[f"magnitude, {f:g} Hz"] = abs(phasors.theta.value) / torque * relative
            bounds[f"phase, {f:g} Hz"] = float(np.rad2deg(relative))
        return bounds


def response_bench(inputs: StudyInputs) -> ResponseBench:
    """The compensated drivetrain at the first of the study's amplitudes."""
    single = inputs.study.model_copy(update={"amplitudes_deg": inputs.study.amplitudes_deg[:1]})
    return ResponseBench(drivetrain(replace(inputs, study=single)))


@dataclass(frozen=True)
class RepeatedBench:
    """A bench of which the mean over several trials is estimated."""

    nominal: StudyBench  # without scatter from trial to trial
    count: int  # trials in a mean
    bench_of: Callable[[str], StudyBench]  # the bench of the trial with this name
    scatter: Mapping[str, float]  # standard deviation from trial to trial, in the unit of the quantity

    @property
    def exact(self) -> Mapping[str, float]:
        return self.nominal.exact

    @property
    def theory(self) -> Mapping[str, float]:
        return self.nominal.theory

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The mean over the trials. Through ideal sensors it is the estimate of the nominal bench."""
        if ideal:
            for name, _, estimates in self.nominal.estimates(trial, low_pass, ideal=True):
                yield name, "Student", estimates
            return
        singles = [f"{trial}_{i}" for i in range(self.count)]
        each = [next(iter(self.bench_of(single).estimates(single, low_pass))) for single in singles]
        means = {name: over_repeats([estimates[name].value for _, _, estimates in each]) for name in self.nominal.names}
        yield each[0][0], "Student", {name: StudyEstimate(m.mean, m.se, m.low, m.high) for name, m in means.items()}

    def bounds(self) -> dict[str, float]:
        """The bound of one trial and the scatter, over the root of the number of trials."""
        single = self.nominal.bounds()
        return {
            n: float(np.hypot(single[n], self.scatter.get(n, 0.0)) / np.sqrt(self.count)) for n in self.nominal.names
        }


def repeated_belt(inputs: StudyInputs) -> RepeatedBench:
    """The campaign's belt trials. K_s scatters from trial to trial."""
    nominal, settings, p = belt(inputs), inputs.simulation, inputs.p

    def scattered(trial: str) -> StudyBench:
        own = replace(p, K_s=p.K_s * belt_scatter(trial, settings))
        return replace(nominal, response=simulate_belt(nominal.motion, drivetrain_effects(settings), own))

    deviation = {"K_s": p.K_s * settings.effects.belt_scatter.value}
    return RepeatedBench(nominal, settings.experiments.belt, scattered, deviation)


def repeated_transmission(inputs: StudyInputs) -> RepeatedBench:
    """The campaign's transmission trials. They differ in their noise alone."""
    nominal = transmission(inputs)
    return RepeatedBench(nominal, inputs.simulation.experiments.transmission, lambda _: nominal, {})


@dataclass(frozen=True)
class ActuatorExperiment:
    """The actuator's bench: the motion and the actuator that every trial repeats, and the analysis."""

    motion: JointMotion  # true motion of the actuator's output
    current: Array  # true q-axis current [A], shape (n,)
    actuator: DrivetrainParameters  # that made the torque, with the friction of the settings
    settings: SimulationSettings
    analysis: ActuatorAnalysis
    exact: Mapping[str, float]
    names: tuple[str, ...] = ACTUATOR_PARAMETERS

    @property
    def theory(self) -> Mapping[str, float]:
        return self.exact  # the fitted model is exact

    def trial(self, name: str, ideal: bool = False) -> Trial:
        """One trial as ingest would give it."""
        settings, zero = through_sensors(name, self.settings, self.settings.effects.actuator_encoder, ideal)
        motion = replace(self.motion, theta=self.motion.theta + zero)
        log, _ = recorded_actuator(name, motion, self.current, self.actuator, settings)
        actuator = {"theta_m": log["actuator_angle"], "current": log["motor_current"]}
        return recorded_trial(name, log.time, actuator, log.torque_time, {"torque_m": log["output_torque"]})

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The estimates of the pipeline's fit."""
        fit = actuator_trial(self.trial(trial, ideal), self.analysis).whole
        yield from of_filtered(fit, self.names)

    def bounds(self) -> dict[str, float]:
        """Cramer-Rao bound of the torque's noise in the fitted rows. Noise in the columns would increase it
        slightly."""
        rate, omega = self.settings.dynamometer.rate_hz, self.motion.omega
        rows = np.flatnonzero(moving_rows(omega, rate, self.analysis))
        direction, time = np.sign(omega), np.arange(len(omega)) / rate
        columns = {
            "k_tau_n_m": self.current,
            "f_C": -direction,
            "f_G": -direction * np.abs(self.current),
            "B_m": -omega,
            "J_m": -self.motion.alpha,
            "offset": np.ones_like(omega),
            "drift": time - np.mean(time),
        }
        fitted = {name: column[rows] for name, column in columns.items()}
        return regression_bound(fitted, *torque_noise(self.settings, time[rows]))


def actuator(inputs: StudyInputs) -> ActuatorExperiment:
    """The campaign's schedule, with every effect of the simulation settings."""
    settings, p = inputs.simulation, inputs.p
    if settings.actuator is None:
        raise InputError(
            f"{inputs.study.simulation}: has no 'actuator' schedule, which the study needs; add one as in "
            "config/simulation/default.yaml"
        )
    rate, friction = settings.dynamometer.rate_hz, settings.effects.friction.value
    _, motion = moved(turning(settings.actuator, rate), settings)
    current, true = current_schedule(settings.actuator, rate), replace(p, f_C=friction * p.f_C, f_G=friction * p.f_G)
    exact = {"k_tau_n_m": p.k_tau * p.n_m, "f_C": true.f_C, "f_G": true.f_G, "B_m": p.B_m, "J_m": p.J_m}
    return ActuatorExperiment(motion, current, true, settings, inputs.actuator, exact)


StudiedExperiment = StudyBench | ResponseBench | RepeatedBench | ActuatorExperiment


def studied(experiment: str, inputs: StudyInputs) -> StudiedExperiment:
    """An experiment on a bench, ready to be repeated."""
    _, _, recording = experiment.partition(", ")
    if recording in RECORDINGS:
        inputs = recorded_as(inputs, RECORDINGS[recording])
    ready: StudiedExperiment = globals()[BENCH_EXPERIMENTS[experiment]](inputs)
    return ready


def study_rows(experiment: StudiedExperiment, trials: Sequence[str], low_pass: LowPass) -> list[StudyRow]:
    """Value, truth, interval and bound for every trial, estimator and quantity. The truth is the parameter that made
    the torque, where the joint has such a parameter. `model_truth` is the estimate of the same estimator in the same
    trial with ideal sensors. Without such a parameter it is also the truth. `model_error` is `model_truth` minus the
    prediction of linear theory."""
    ideal = {name: estimates for name, _, estimates in experiment.estimates("ideal", low_pass, ideal=True)}
    bounds, rows = experiment.bounds(), []
    for trial in trials:
        for name, method, estimates in experiment.estimates(trial, low_pass):
            for quantity, estimate in estimates.items():
                model_truth = ideal[name][quantity].value
                truth = experiment.exact.get(quantity, model_truth)
                row: StudyRow = {"trial": trial, "estimator": name, "interval_method": method, "quantity": quantity}
                error = model_truth - experiment.theory[quantity] if quantity in experiment.theory else None
                row |= {**asdict(estimate), "truth": truth, "model_truth": model_truth}
                rows.append(row | {"bound": bounds[quantity], "model_error": error})
    return rows
