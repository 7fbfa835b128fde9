"""The benches in the study: one true motion and response that every trial repeats, read by noisy sensors and fitted as
every trial of a campaign is."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.analysis import FitTables
from osl_analysis.campaign.configuration import StudyTrials
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import Gains, compensated_gains, predicted_impedance
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.signals import runs
from osl_analysis.simulator.bench import true_signals
from osl_analysis.simulator.recorder import TrueSignal, recording_of
from osl_analysis.simulator.settings import Effect, RecorderSettings, SecondOrderJoint, SimulationSettings, stream
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.study import RECORDINGS
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.settings import WalkingAnalysis

StudyRow = dict[str, Any]  # one row of the study's table of estimates
STUDIED_QUANTITIES = ("K", "B", "I")
CANONICAL = {
    "joint_angle": "theta", "actuator_angle": "theta_m", "commanded_angle": "theta_command", "motor_current": "current",
    "load_cell_torque": "torque", "output_torque": "torque_m",
}  # fmt: skip
"""Canonical column of each channel. The load cell's torque has the other sign."""
Estimates = Iterator[tuple[str, str, Mapping[str, Sequence[float]]]]
"""Of one trial: estimator, kind of interval, and by quantity value, standard error and 95 % interval, in its unit."""


@dataclass(frozen=True)
class StudyInputs:
    """Settings with which the study simulates and analyses its trials."""

    study: StudyTrials
    simulation: SimulationSettings
    gait: WalkingSettings | None  # the simulated gait laboratory; None where the simulation has none
    p: DrivetrainParameters  # that make the trials
    analysis: Mapping[str, Any]  # settings of the fits, by section of the configuration
    walking: WalkingAnalysis
    sources: Path  # folder of the source files
    fit: Callable[[str, Trial, Mapping[str, Any]], FitTables]
    """The fit of a trial of an experiment, as a campaign, the command line and notebooks have it, by these settings."""


def recorded_trial(name: str, log: Mapping[str, Array]) -> Trial:
    """The trial of a log, with one or two recordings that have stamps [s] of their own, as ingest would give it."""
    time, later = log["time"], log["torque_time"]
    columns = {CANONICAL[n]: -values if "load_cell" in n else values for n, values in log.items() if n in CANONICAL}
    torque = {column: columns.pop(column) for column in ("torque", "torque_m") if column in columns}
    samples = pl.DataFrame({"time": time - time[0], **columns})
    if np.array_equal(time, later):
        return Trial(name, samples.with_columns(pl.DataFrame(torque)))
    other = pl.DataFrame(torque).with_columns(time=pl.Series(later - time[0]))
    return Trial(name, samples.join(other, on="time", how="full", coalesce=True).sort("time"))


def regression_bound(columns: Mapping[str, Array], noise: float, drift: Array | None = None) -> dict[str, float]:
    """Smallest standard error of any unbiased estimate of y = X b + e, for exactly known columns (n,), where e
    is Gaussian: white of standard deviation `noise`, plus a random multiple of `drift` (n,). cov(b) >= (X' V^-1 X)^-1
    with V = noise^2 1 + drift drift' (Cramer and Rao), whose inverse is Sherman and Morrison's. A filter that passes
    the columns does not change the bound."""
    X = np.column_stack(list(columns.values()))
    drift = np.zeros(len(X)) if drift is None else drift
    seen = X.T @ drift
    information = (X.T @ X - np.outer(seen, seen) / (noise**2 + drift @ drift)) / noise**2
    covariance = np.linalg.inv(information)
    return dict(zip(columns, np.sqrt(np.diag(covariance)).tolist(), strict=True))


@dataclass(frozen=True)
class StudyBench:
    """One experiment: true signals that every trial repeats, and the sensors that read them."""

    inputs: StudyInputs  # with the study's short protocol and recorder
    experiment: str  # of a campaign, whose fit it has
    signals: Mapping[str, TrueSignal]  # by channel, (n,) each
    columns: Mapping[str, Array]  # true columns (n,) of the regression, an offset among them
    theory: Mapping[str, float]  # of the quantities that are estimated, what linear theory predicts
    exact: bool  # whether these are the parameters that made the torque
    response: bool = False
    """Whether Y = theta/torque at each frequency is estimated. Its quantities have the frequency in their names:
    `magnitude, 2 Hz` [rad/(N*m)] and `phase, 2 Hz` [deg]."""
    repeats: int = 1  # trials of which the mean is estimated
    scatter: Mapping[str, float] = field(default_factory=dict)  # SD of a quantity from trial to trial, in its unit
    own: Callable[[str], "StudyBench"] | None = None  # the bench of one trial by name; None: they differ in noise alone

    def trial(self, name: str, ideal: bool = False) -> Trial:
        """One trial, through noisy or ideal sensors, as ingest would give it. Every trial repeats the motion; so that
        the rounding of an encoder does not, recorders start anywhere between two instants of it, and the encoder's zero
        lies anywhere between two steps."""
        settings, signals = self.inputs.simulation, dict(self.signals)
        if ideal:  # the controller sees the actuator's encoder too, but its motion has been simulated before
            sensors = [
                n for n in type(settings.effects).model_fields if n.startswith(("load_cell", "current", "encoder"))
            ]
            effects = settings.effects.without(*sensors, "joint_encoder", "actuator_encoder")
            settings = settings.model_copy(update={"effects": effects, "recorder": RecorderSettings()})
        else:
            later = float(stream(settings.seed, name, "sampling_phase").random()) / settings.dynamometer.rate_hz
            nodes = {
                key: node.model_copy(update={"phase": Effect(enabled=True, size=node.phase.value + later, unit="s")})
                for key in ("node", "torque_node")
                if (node := getattr(settings.recorder, key)) is not None
            }
            angle = "joint_angle" if "joint_angle" in signals else "actuator_angle"
            step = getattr(settings.effects, angle.replace("angle", "encoder")).value
            signals[angle] = signals[angle] + step * float(stream(settings.seed, name, "encoder_zero").random())
            settings = settings.model_copy(update={"recorder": settings.recorder.model_copy(update=nodes)})
        return recorded_trial(name, recording_of(name, signals, settings)[0])

    def fitted(self, name: str, ideal: bool = False) -> FitTables:
        return self.inputs.fit(self.experiment, self.trial(name, ideal), self.inputs.analysis)

    @cached_property
    def ideal(self) -> FitTables:
        return self.fitted("ideal", ideal=True)

    def estimates(self, trial: str) -> Estimates:
        """The estimates of one trial, or of the mean of several."""
        if self.repeats == 1:
            yield from self.estimated(self.fitted(trial))
            return
        singles = [f"{trial}_{i}" for i in range(self.repeats)]
        tables = [(self.own(single) if self.own else self).fitted(single) for single in singles]
        each = [next(iter(self.estimated(table))) for table in tables]
        means = {name: over_repeats([found[name][0] for *_, found in each]) for name in self.theory}
        yield each[0][0], "Student", {name: (m.mean, m.se, m.low, m.high) for name, m in means.items()}

    def estimated(self, found: FitTables) -> Estimates:
        """The estimates of a fit, from the table of a campaign: each frequency of a response is like an estimator."""
        ends = ("", "_se", "_low", "_high")
        if not self.response:
            row = found[self.experiment].row(-1, named=True)
            yield "filtered", row["interval_method"], {n: [row[f"{n}{end}"] for end in ends] for n in self.theory}
            return
        for row in found["phasors"].iter_rows(named=True):
            hertz, units = f"{row['frequency_hz']:g} Hz", {"magnitude": "", "phase": "_deg"}
            quantities = {f"{n}, {hertz}": [row[f"Y_{n}{end}{unit}"] for end in ends] for n, unit in units.items()}
            yield f"sinusoid, {hertz}", row["interval_method"], quantities

    def bounds(self) -> dict[str, float]:
        """Cramer-Rao bounds of the torque sensor's noise, with its rounding, and drift, for the true motion in the rows
        that are fitted; with the scatter, over the root of the number of trials. That of a phasor in white noise is 2
        sigma^2/N per quadrature (Rife and Boorstyn, IEEE Trans. Inf. Theory 20, 1974): relative to the torque's
        amplitude the bound of the magnitude, and in radian that of the phase."""
        effects, rate = self.inputs.simulation.effects, self.inputs.simulation.dynamometer.rate_hz
        white = float(np.hypot(effects.load_cell_noise.value, effects.load_cell_quantisation.value / np.sqrt(12)))
        fitted, bounds = self.ideal.measured.fitted, {}
        if self.response:
            segments = self.ideal["phasors"].iter_rows(named=True)
            for run, row in zip(runs(fitted), segments, strict=True):
                torque = abs(complex(row["torque_re"], row["torque_im"]))
                relative = white * float(np.sqrt(2 / (run.stop - run.start))) / torque
                bounds[f"magnitude, {row['frequency_hz']:g} Hz"] = row["Y_magnitude"] * relative
                bounds[f"phase, {row['frequency_hz']:g} Hz"] = float(np.rad2deg(relative))
            return bounds
        rows = np.flatnonzero(fitted)
        columns = {name: column[rows] for name, column in self.columns.items()}
        drift = np.asarray(effects.load_cell_drift.value / 60 * rows / rate)
        single = regression_bound(columns, white, drift)
        return {n: float(np.hypot(single[n], self.scatter.get(n, 0.0)) / np.sqrt(self.repeats)) for n in self.theory}


def prepared(
    inputs: StudyInputs, experiment: str, theory: Mapping[str, float], gains: Gains | None = None
) -> StudyBench:
    """A bench whose trials are of an experiment of a campaign; without gains its theory is exact."""
    motion, signals = true_signals({"trial": "study", "experiment": experiment}, inputs.simulation, inputs.p, gains)
    one = np.ones_like(motion.theta)
    if experiment == "belt":
        columns = {"K_s": motion.theta, "offset": one}
    elif experiment == "transmission":
        columns = {"B_j": motion.omega, "J_j": motion.alpha, "offset": one}
    elif experiment == "impedance":
        columns = {"K": motion.theta, "B": motion.omega, "I": motion.alpha, "offset": one}
    else:
        current, direction = np.asarray(signals["motor_current"]), np.sign(motion.omega)
        columns = {"k_tau_n_m": current, "f_C": -direction, "f_G": -direction * np.abs(current)}
        late = np.arange(len(one)) - (np.sum(one) - 1) / 2
        columns |= {"B_m": -motion.omega, "J_m": -motion.alpha, "offset": one, "drift": late}
    if experiment != "actuator":
        signals.pop("motor_current")
    return StudyBench(inputs, experiment, signals, columns, theory, gains is None)


def studied(experiment: str, inputs: StudyInputs) -> StudyBench:
    """An experiment on a bench, ready to be repeated: with the study's short protocol, simulated and expected, and the
    recorder, rate and encoder of its name. `second order` is a joint that is exactly Eq. 15, `drivetrain` that of a
    compensated controller with every effect of the simulation settings (`linear` without friction and hysteresis),
    `frequency response` its angle and torque at the first of the study's amplitudes, `repeated` the mean over the
    trials of a campaign, of which belts scatter in K_s."""
    kind, _, recording = experiment.partition(", ")
    study, p, analysis, simulation = inputs.study, inputs.p, inputs.analysis["dynamometer"], inputs.simulation
    amplitudes = study.amplitudes_deg[:1] if kind == "frequency response" else study.amplitudes_deg
    hertz = analysis.frequencies_hz or simulation.protocol.frequencies_hz
    short = {"cycles": study.cycles, "amplitudes_deg": amplitudes, "frequencies_hz": hertz}
    changes: dict[str, object] = {"protocol": simulation.protocol.model_copy(update=short)}
    if recording:
        nodes, rate_hz, bits = RECORDINGS[recording]
        changes["dynamometer"] = simulation.dynamometer.model_copy(update={"rate_hz": float(rate_hz)})
        changes["recorder"] = RecorderSettings.model_validate(nodes)
        if bits is not None:
            encoder = Effect(enabled=True, size=bits, unit="bit")
            changes["effects"] = simulation.effects.model_copy(update={"joint_encoder": encoder})
    if kind == "linear drivetrain":
        changes["effects"] = simulation.effects.without("friction", "belt_hysteresis")
    exact = {"K": study.K_d, "B": study.B_d, "I": study.I}
    if kind == "second order":
        changes["joint"] = SecondOrderJoint.model_validate(exact)
    simulation = simulation.model_copy(update=changes)
    sections = {**inputs.analysis, "dynamometer": analysis.model_copy(update=short)}
    inputs = replace(inputs, simulation=simulation, analysis=sections)
    if kind == "second order":
        return prepared(inputs, "impedance", exact)
    if kind in ("linear drivetrain", "drivetrain", "frequency response"):
        gains = compensated_gains(study.K_d, study.B_d, p)
        predicted = predicted_impedance(gains, p, hertz)
        found = prepared(inputs, "impedance", dict(zip(STUDIED_QUANTITIES, predicted, strict=True)), gains)
        return replace(found, response=True) if kind == "frequency response" else found
    if kind == "actuator":
        if simulation.actuator is None:
            raise InputError(
                f"{study.simulation}: has no 'actuator' schedule, which the study needs; add one as in "
                "config/simulation/default.yaml"
            )
        friction = simulation.effects.friction.value
        p = replace(p, f_C=friction * p.f_C, f_G=friction * p.f_G)
        exact = {"k_tau_n_m": p.k_tau * p.n_m, "f_C": p.f_C, "f_G": p.f_G, "B_m": p.B_m, "J_m": p.J_m}
        return prepared(replace(inputs, p=p), "actuator", exact)
    if kind.endswith("transmission"):
        exact, repeats = {"B_j": p.B_j, "J_j": p.J_j}, simulation.experiments.transmission
        found = prepared(inputs, "transmission", exact)
        return replace(found, repeats=repeats) if kind.startswith("repeated") else found

    def belt(stiffness: float) -> StudyBench:
        return prepared(replace(inputs, p=replace(p, K_s=stiffness)), "belt", {"K_s": stiffness})

    if not kind.startswith("repeated"):
        return belt(p.K_s)
    scatter = simulation.effects.belt_scatter.value

    def scattered(trial: str) -> StudyBench:
        draw = stream(simulation.seed, trial, "belt_scatter").standard_normal()
        return belt(p.K_s * float(1 + scatter * draw))

    deviation = {"K_s": p.K_s * scatter}
    return replace(belt(p.K_s), repeats=simulation.experiments.belt, scatter=deviation, own=scattered)


def study_rows(bench: StudyBench, trials: Sequence[str]) -> list[StudyRow]:
    """Value, truth, interval and bound for every trial, estimator and quantity. The truth is the parameter that made
    the torque, else `model_truth`, the estimate of the same estimator with ideal sensors; `model_error` is
    `model_truth` minus the prediction of linear theory."""
    ideal = {name: estimates for name, _, estimates in bench.estimated(bench.ideal)}
    bounds, rows = bench.bounds(), []
    for trial in trials:
        for name, method, estimates in bench.estimates(trial):
            for quantity, (value, se, low, high) in estimates.items():
                model_truth, theory = ideal[name][quantity][0], bench.theory.get(quantity)
                error = None if theory is None else model_truth - theory
                truth = theory if bench.exact else model_truth
                row: StudyRow = {"trial": trial, "estimator": name, "interval_method": method, "quantity": quantity}
                row |= {"value": value, "se": se, "low": low, "high": high}
                row |= {"truth": truth, "model_truth": model_truth}
                rows.append(row | {"bound": bounds[quantity], "model_error": error})
    return rows
