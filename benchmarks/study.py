# SPDX-License-Identifier: Apache-2.0
"""The Monte Carlo study: bias, error and coverage of the estimators on simulated trials, for
`docs/study.md`.

Run from the repository: `python benchmarks/study.py [trials] [campaigns] [recorded]`, 100, 80 and
80 by default. Writes the table of the page. Each trial's name decides its noise. Jobs share all
cores; 240, 60 and 120 take a quarter of an hour on two. What is simulated, and what the truth is,
stands on the page.
"""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np
import polars as pl
from causes import ROOT, markdown, write_between

from osl_analysis.base.errors import OslAnalysisError
from osl_analysis.base.trial import Array, Trial
from osl_analysis.base.yaml_settings import read_yaml
from osl_analysis.bench.bench_settings import DynamometerAnalysis
from osl_analysis.campaign.configuration import config_for_trials
from osl_analysis.commands.fit import run_fit
from osl_analysis.commands.fit_results import FitTables
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.model.compensator import compensated_gains
from osl_analysis.model.drivetrain import DrivetrainParameters, read_parameters
from osl_analysis.signals.filters import runs
from osl_analysis.simulator.bench_trial import drivetrain_effects, true_signals
from osl_analysis.simulator.laboratory_files import leg_markers, write_capture
from osl_analysis.simulator.laboratory_settings import WalkingSettings
from osl_analysis.simulator.recorder import TrueSignal, recording_of
from osl_analysis.simulator.simulated_crossing import (
    SimulatedCrossing,
    impedance_of_leg,
    simulate_crossing,
)
from osl_analysis.simulator.simulation_settings import (
    Effect,
    RecorderSettings,
    SecondOrderJoint,
    SimulationSettings,
)
from osl_analysis.simulator.step import GaitTrial, draw_step
from osl_analysis.simulator.trial_plan import generator_of
from osl_analysis.simulator.walking_trial import simulate_walking_trial
from osl_analysis.stats.budget import IN_INTERVAL
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.walking.crossing import PER_UNIT, Crossing, analyse_crossing
from osl_analysis.walking.impedance_fit import fit_without_offset
from osl_analysis.walking.isolated_response import isolate_response, unperturbed_gait
from osl_analysis.walking.plate import Stance
from osl_analysis.walking.plate_inertia import NO_CORRECTION, PlateModel, identify_plate_model
from osl_analysis.walking.plate_lag import PlateTiming, timing_of
from osl_analysis.walking.poses import static_calibration
from osl_analysis.walking.tables import group_headline
from osl_analysis.walking.walking_settings import FootSettings, WalkingAnalysis

Made = TypeVar("Made")
Row = dict[str, Any]
CONFIG, PAGE = ROOT / "config/config.yaml", ROOT / "docs/study.md"
SEED, CROSSINGS = 1, 10
INTERVAL_ENDS = ("", "_low", "_high")  # endings of an estimate's columns: value, 95 % interval
NORMAL_QUANTILE = 1.96  # half-width of a 95 % interval in standard errors
# of the stepped sine, at the frequencies of the configuration
SHORT = {"amplitudes_deg": (4.0,), "cycles": 12}
JOINT = {"K": 300.0, "B": 5.0, "I": 0.02}  # of the exact joint; the leg is asked for its K and B


def on(size: float, unit: str) -> Mapping[str, Any]:
    """A switch of the simulation that is on."""
    return {"enabled": True, "size": size, "unit": unit}


TWO_RECORDERS = {
    "node": {"rate": on(333, "Hz")},
    "torque_node": {"phase": on(3e-4, "s")},  # how much later it samples the torque
}
BENCHES = (
    "two recorders", "drivetrain", "frequency response", "transmission", "belt", "actuator",
)  # fmt: skip
CANONICAL = {
    "joint_angle": "theta", "actuator_angle": "theta_m", "commanded_angle": "theta_command",
    "motor_current": "current",
    "load_cell_torque": "torque", "output_torque": "torque_m",
}  # fmt: skip
"""Canonical column of each channel. The load cell's torque has the other sign."""


@cache
def laboratory() -> tuple[SimulationSettings, DrivetrainParameters]:
    """The shipped simulation with the seed of the study, and the device that it simulates."""
    settings = read_yaml(ROOT / "config/simulation/default.yaml", SimulationSettings).model_copy(
        update={"seed": SEED}
    )
    return settings, read_parameters(ROOT / "config/parameters/default.yaml")


def recorded_trial(name: str, log: Mapping[str, Array]) -> Trial:
    """The trial of a log, with one or two recordings that have stamps [s] of their own, as ingest
    would give it."""
    time, later = log["time"], log["torque_time"]
    columns = {
        CANONICAL[n]: -values if "load_cell" in n else values
        for n, values in log.items()
        if n in CANONICAL
    }
    torque = {column: columns.pop(column) for column in ("torque", "torque_m") if column in columns}
    samples = pl.DataFrame({"time": time - time[0], **columns})
    if np.array_equal(time, later):
        return Trial(name, samples.with_columns(pl.DataFrame(torque)))
    other = pl.DataFrame(torque).with_columns(time=pl.Series(later - time[0]))
    return Trial(name, samples.join(other, on="time", how="full", coalesce=True).sort("time"))


def regression_bound(
    columns: Mapping[str, Array], noise: float, drift: Array | None = None
) -> dict[str, float]:
    """Smallest standard error of any unbiased estimate of y = X b + e, for exactly known columns
    (n,), where e is Gaussian: white of standard deviation `noise`, plus a random multiple of
    `drift` (n,). cov(b) >= (X' V^-1 X)^-1 with V = noise^2 1 + drift drift' (Cramer and Rao), whose
    inverse is Sherman and Morrison's. A filter that passes the columns does not change the
    bound."""
    X = np.column_stack(list(columns.values()))
    drift = np.zeros(len(X)) if drift is None else drift
    seen = X.T @ drift
    information = (X.T @ X - np.outer(seen, seen) / (noise**2 + drift @ drift)) / noise**2
    covariance = np.linalg.inv(information)
    return dict(zip(columns, np.sqrt(np.diag(covariance)).tolist(), strict=True))


@dataclass(frozen=True)
class StudyBench:
    """One experiment: true signals that every trial repeats, and the sensors that read them."""

    simulation: SimulationSettings
    analysis: DynamometerAnalysis
    experiment: str  # of a campaign, whose fit it has
    signals: Mapping[str, TrueSignal]  # by channel, (n,) each
    columns: Mapping[str, Array]  # true columns (n,) of the regression, an offset among them
    # what is estimated, with the parameter that made the torque if there is one
    quantities: Mapping[str, float | None]
    response: bool = False
    """Whether Y = theta/torque at each frequency is estimated. Its quantities have the frequency in
    their names: `magnitude, 2 Hz` [rad/(N*m)] and `phase, 2 Hz` [deg]."""

    def trial(self, name: str, ideal: bool = False) -> Trial:
        """One trial, through noisy or ideal sensors, as ingest would give it. Every trial repeats
        the motion; so that the rounding of an encoder does not, recorders start anywhere between
        two instants of it, and the encoder's zero lies anywhere between two steps."""
        settings, signals = self.simulation, dict(self.signals)
        # the controller sees the actuator's encoder too, but its motion has been simulated before
        if ideal:
            starts = ("load_cell", "current", "encoder")
            sensors = [n for n in type(settings.effects).model_fields if n.startswith(starts)]
            exact = {}
            for sensor in (*sensors, "joint_encoder", "actuator_encoder"):
                effect = getattr(settings.effects, sensor)
                exact[sensor] = effect.model_copy(update={"enabled": False})
            effects = settings.effects.model_copy(update=exact)
            settings = settings.model_copy(
                update={"effects": effects, "recorder": RecorderSettings()}
            )
        else:
            later = (
                float(generator_of(SEED, name, "sampling_phase").random())
                / settings.dynamometer.rate_hz
            )
            nodes = {
                key: node.model_copy(
                    update={"phase": Effect(enabled=True, size=node.phase.value + later, unit="s")}
                )
                for key in ("node", "torque_node")
                if (node := getattr(settings.recorder, key)) is not None
            }
            angle = "joint_angle" if "joint_angle" in signals else "actuator_angle"
            step = getattr(settings.effects, angle.replace("angle", "encoder")).value
            signals[angle] = signals[angle] + step * float(
                generator_of(SEED, name, "encoder_zero").random()
            )
            settings = settings.model_copy(
                update={"recorder": settings.recorder.model_copy(update=nodes)}
            )
        return recorded_trial(name, recording_of(name, signals, settings)[0])

    def fitted(self, name: str, ideal: bool = False) -> FitTables:
        """The fit that a campaign would make of a trial, without what a sheet may state of it."""
        own = {"dynamometer": self.analysis, "gain_weight": self.simulation.gain_weight}
        config = config_for_trials(CONFIG).model_copy(update=own)
        return run_fit(self.experiment, self.trial(name, ideal), self.simulation.parameters, config)

    def estimated(
        self, found: FitTables
    ) -> Iterator[tuple[str, str, Mapping[str, Sequence[float]]]]:
        """Estimator, kind of interval, and by quantity value, standard error and 95 % interval of a
        fit, from the table of a campaign: each frequency of a response is like an estimator. A
        table has no standard errors: those of a fit are half-widths over 1.96."""
        if not self.response:
            row = found.estimates[self.experiment].row(-1, named=True)
            quantities = dict[str, Sequence[float]]()
            for name in self.quantities:
                value, low, high = (row[f"{name}{end}"] for end in INTERVAL_ENDS)
                quantities[name] = value, (high - low) / (2 * NORMAL_QUANTILE), low, high
            yield "filtered", row.get("interval_method", "budget"), quantities
            return
        for row in found.compute_others()["response"].filter(scope="all").iter_rows(named=True):
            hertz = f"{row['frequency_hz']:g} Hz"
            quantities = {}
            for name in ("magnitude", "phase_deg"):
                value, low, high = (row[f"{name}{end}"] for end in INTERVAL_ENDS)
                quantity = f"{name.removesuffix('_deg')}, {hertz}"
                quantities[quantity] = value, (high - low) / (2 * NORMAL_QUANTILE), low, high
            yield f"sinusoid, {hertz}", "cycles", quantities

    def bounds(self, ideal: FitTables) -> dict[str, float]:
        """Cramer-Rao bounds of the torque sensor's noise, with its rounding, and drift, for the
        true motion in the rows that are fitted. That of a phasor in white noise is 2 sigma^2/N per
        quadrature (Rife and Boorstyn, IEEE Trans. Inf. Theory 20, 1974): relative to the torque's
        amplitude the bound of the magnitude, and in radian that of the phase."""
        effects, rate = self.simulation.effects, self.simulation.dynamometer.rate_hz
        white = float(
            np.hypot(
                effects.load_cell_noise.value, effects.load_cell_quantisation.value / np.sqrt(12)
            )
        )
        fitted, bounds = ideal.samples["is_fitted"].to_numpy(), {}
        if self.response:
            segments = ideal.compute_others()["response"].filter(scope="amplitude")
            for run, row in zip(runs(fitted), segments.iter_rows(named=True), strict=True):
                magnitude = row["magnitude"]
                # the amplitude names all frequencies, of which each moves the joint 1 % otherwise
                torque = np.deg2rad(row["amplitude_deg"]) / magnitude
                relative = white * float(np.sqrt(2 / (run.stop - run.start))) / torque
                bounds[f"magnitude, {row['frequency_hz']:g} Hz"] = magnitude * relative
                bounds[f"phase, {row['frequency_hz']:g} Hz"] = float(np.rad2deg(relative))
            return bounds
        rows = np.flatnonzero(fitted)
        columns = {name: column[rows] for name, column in self.columns.items()}
        return regression_bound(
            columns, white, np.asarray(effects.load_cell_drift.value / 60 * rows / rate)
        )

    def rows(self, trials: Iterable[str]) -> Iterator[Row]:
        """Value, truth, interval and bound for every trial, estimator and quantity. The truth is
        the parameter that made the torque, else the estimate of the same estimator with ideal
        sensors."""
        ideal = self.fitted("ideal", ideal=True)
        true, bounds = (
            {name: estimates for name, _, estimates in self.estimated(ideal)},
            self.bounds(ideal),
        )
        for trial in trials:
            for name, method, estimates in self.estimated(self.fitted(trial)):
                for quantity, (value, se, low, high) in estimates.items():
                    made = self.quantities.get(quantity)
                    row: Row = {
                        "estimator": name,
                        "interval_method": method,
                        "quantity": quantity,
                        "value": value,
                    }
                    row |= {"se": se, "low": low, "high": high, "bound": bounds[quantity]}
                    yield row | {"truth": true[name][quantity][0] if made is None else made}


def studied(experiment: str) -> StudyBench:
    """An experiment on a bench, ready to be repeated, with the short protocol, simulated and
    expected. `two recorders` have the angle at 333 Hz and the torque at 1 kHz of a joint that is
    exactly Eq. 15, `drivetrain` is that of a compensated controller with every effect of the
    simulation settings, `frequency response` its angle and torque."""
    (settings, p), analysis = laboratory(), config_for_trials(CONFIG).dynamometer
    short = SHORT | {"frequencies_hz": analysis.frequencies_hz}
    changes: dict[str, object] = {"protocol": settings.protocol.model_copy(update=short)}
    gains, of_campaign, quantities = None, experiment, dict[str, float | None]()
    if experiment == "two recorders":
        of_campaign, quantities = "impedance", {**JOINT}
        changes["joint"] = SecondOrderJoint.model_validate(JOINT)
        changes["recorder"] = RecorderSettings.model_validate(TWO_RECORDERS)
    elif experiment in ("drivetrain", "frequency response"):
        of_campaign, quantities, gains = (
            "impedance",
            dict.fromkeys(JOINT),
            compensated_gains(JOINT["K"], JOINT["B"], p),
        )
    elif experiment == "transmission":
        quantities = {"B_j": p.B_j, "J_j": p.J_j}
    elif experiment == "belt":
        quantities = {"K_s": p.K_s}
    elif experiment == "actuator":
        friction = settings.effects.friction.value
        p = replace(p, f_C=friction * p.f_C, f_G=friction * p.f_G)
        quantities = {
            "k_tau_n_m": p.k_tau * p.n_m,
            "f_C": p.f_C,
            "f_G": p.f_G,
            "B_m": p.B_m,
            "J_m": p.J_m,
        }
    settings = settings.model_copy(update=changes)
    motion, signals = true_signals(
        {"trial": "study", "experiment": of_campaign}, settings, p, gains
    )
    columns = {"K": motion.theta, "B": motion.omega, "I": motion.alpha}
    if experiment == "belt":
        columns = {"K_s": motion.theta}
    elif experiment == "transmission":
        columns = {"B_j": motion.omega, "J_j": motion.alpha}
    elif experiment == "actuator":
        current, direction = np.asarray(signals["motor_current"]), np.sign(motion.omega)
        columns = {"k_tau_n_m": current, "f_C": -direction, "f_G": -direction * np.abs(current)}
        late = np.arange(len(current)) - (len(current) - 1) / 2
        columns |= {"B_m": -motion.omega, "J_m": -motion.alpha, "drift": late}
    if experiment != "actuator":
        signals.pop("motor_current")
    columns["offset"] = np.ones_like(motion.theta)
    shortened, response = analysis.model_copy(update=SHORT), experiment == "frequency response"
    return StudyBench(settings, shortened, of_campaign, signals, columns, quantities, response)


@dataclass(frozen=True)
class StudyLaboratory:
    """The settings that make a crossing, and those that analyse it."""

    settings: SimulationSettings
    gait: WalkingSettings
    p: DrivetrainParameters
    analysis: WalkingAnalysis
    plate: PlateModel = NO_CORRECTION
    timing: PlateTiming = field(default_factory=lambda: PlateTiming({}, {}))
    recorded: Callable[[str, SimulatedCrossing], Crossing] | None = None
    """How a crossing that was recorded by markers and plate is analysed; None: angle and torque
    themselves are seen."""

    def unperturbed(self, name: str) -> Crossing:
        """An unperturbed crossing through the sensors."""
        return self.seen(name, self.walk(name, False), noisy=True)

    def perturbed(self, name: str) -> tuple[Crossing, LinearFit, Mapping[str, float]]:
        """A perturbed crossing through the sensors; the same estimator's fit to the perturbation
        alone, through ideal sensors; and the impedance that the leg rendered, by name. The same
        crossing is also simulated without the perturbation, whose effect is the difference."""
        unperturbed, walked = self.walk(name, False), self.walk(name, True)
        alone = unperturbed_gait([self.seen(name, unperturbed, noisy=False)], 1)
        walked_ideally, analysis = self.seen(name, walked, noisy=False), self.analysis
        # the same crossing's stance without the perturbation, whatever the perturbation does to it
        ideal = isolate_response(walked_ideally, alone, analysis)
        exact = fit_without_offset(ideal.fitted_motion, ideal.fitted_torque)
        return (
            self.seen(name, walked, noisy=True),
            exact,
            impedance_of_leg(walked, unperturbed),
        )

    def walk(self, name: str, perturbed: bool) -> SimulatedCrossing:
        """One crossing. Its name determines its random quantities, which are the same with and
        without the perturbation."""
        step = draw_step(GaitTrial(name, self.settings.seed, self.gait))
        effects = drivetrain_effects(self.settings) | {"cancels_friction": True}
        return simulate_crossing(step, perturbed, effects, self.p)

    def seen(self, name: str, walked: SimulatedCrossing, noisy: bool) -> Crossing:
        """Filtered angle and torque of a crossing at the markers' rate. Noise of markers and forces
        acts on a lever of
        0.1 m: from the middle of a cluster to its markers, and from the plate to the ankle."""
        if noisy and self.recorded is not None:
            return self.recorded(name, walked)
        every, rate = (
            self.gait.rates.motion_hz // self.gait.rates.points_hz,
            float(self.gait.rates.points_hz),
        )
        effects, lever_m, found = self.gait.effects, 0.1, []
        for effect, size, signal in (
            ("angle_noise", 1e-3 * effects.marker_noise.value / lever_m, walked.motion.theta),
            (
                "torque_noise",
                np.hypot(effects.moment_noise.value, lever_m * effects.force_noise.value),
                walked.torque,
            ),
        ):
            noise = float(size) * generator_of(self.settings.seed, name, effect).standard_normal(
                len(signal[::every])
            )
            found.append(self.analysis.low_pass(signal[::every] + noisy * noise, rate))
        step, platform = walked.step, walked.platform
        load = np.zeros((3, len(found[0])))
        stance = Stance(step.heel_strike, step.toe_off)
        seen = walked.time[::every], found[0], found[1], load
        changes = np.zeros((len(PER_UNIT), len(load[0])))
        return Crossing(name, *seen, stance, platform.onset, bridged=0.0, changes=changes)


def gait_laboratory() -> StudyLaboratory:
    """The shipped gait laboratory, and the analysis of the shipped configuration."""
    gait = read_yaml(ROOT / "config/simulation/walking.yaml", WalkingSettings)
    return StudyLaboratory(
        laboratory()[0], gait, laboratory()[1], config_for_trials(CONFIG).walking
    )


def recording(of: StudyLaboratory, folder: Path, perturbed: Sequence[str]) -> StudyLaboratory:
    """A laboratory whose noisy crossings are recorded by markers and plate, written as C3D in
    `folder`, ingested and analysed, after its static trial and six trials of the unloaded plate.
    The foot's inertial parameters are known: otherwise its inertia would be part of the ankle's.
    The mean ramp is that of the `perturbed` crossings; one that cannot be read has no part."""
    mass, body = of.gait.effects.foot_inertia.value, of.gait.foot
    inertia = mass * body.gyration_m[1] ** 2
    foot = FootSettings(mass_kg=mass, centre_of_mass_m=body.centre_of_mass_m, inertia_kg_m2=inertia)
    analysis = of.analysis.model_copy(update={"foot": foot})

    def ingested(name: str) -> Trial:
        row = {"trial": name, "mocap": f"vicon/{name}.c3d", "mocap_source": "vicon"}
        return trial_from_files(row, folder, ROOT / "config/sources")

    rows = [{"trial": "static_1", "experiment": "static"}]
    rows += [{"trial": f"plate_{i}", "experiment": "plate"} for i in range(6)]
    for row in rows:
        simulate_walking_trial(row, of.settings, of.gait, of.p, folder)
    standing, *unloaded = (ingested(row["trial"]) for row in rows)
    calibration = static_calibration(standing, analysis)
    plate = identify_plate_model([(trial, calibration) for trial in unloaded], analysis)

    def write_crossing(walked: SimulatedCrossing) -> None:
        markers = leg_markers(walked.foot, walked.shank)
        write_capture(folder, walked.step.trial, markers, walked.platform, walked.reaction)

    turned = []
    for name in perturbed:
        write_crossing(of.walk(name, True))
        with suppress(OslAnalysisError):
            turned.append((ingested(name), calibration))
    timing = timing_of(turned, plate, analysis)

    def analysed(name: str, walked: SimulatedCrossing) -> Crossing:
        is_perturbed = walked.platform.onset is not None
        if not is_perturbed:
            write_crossing(walked)
        trial, onset = ingested(name), timing.onsets.get(name)
        lag = timing.lags.get(name, timing.lag) or 0.0
        return analyse_crossing(trial, calibration, plate, is_perturbed, analysis, onset, lag)

    return replace(of, analysis=analysis, recorded=analysed, plate=plate, timing=timing)


def campaign_rows(names: Sequence[str], of: StudyLaboratory) -> Iterator[Row]:
    """Estimates of a campaign of crossings, every second one of which is perturbed, by the fit to
    the mean response. The truth is the estimate of the same estimator
    for the same perturbations without gait, with ideal sensors. `model_error` is the truth minus
    the impedance that the leg rendered."""
    gait = unperturbed_gait(usable(of.unperturbed, names[::2]), of.analysis.fewest_unperturbed)
    perturbed = usable(of.perturbed, names[1::2])
    crossings = [one for one, *_ in perturbed]
    headline = group_headline(crossings, gait, of.analysis, of.plate, of.timing)
    for quantity in JOINT:
        truth = float(np.mean([exact[quantity] for _, exact, _ in perturbed]))
        rendered = float(np.mean([leg[f"{quantity}_rendered"] for *_, leg in perturbed]))
        budget = headline.ensemble.budgets[quantity]
        own = [each.standard or 0.0 for each in budget.in_parts(*IN_INTERVAL)]
        yield {
            "estimator": "ensemble",
            "interval_method": "budget",
            "quantity": quantity,
            "bound": None,
            "truth": truth,
            "model_error": truth - rendered,
            "value": budget.value,
            "se": float(np.linalg.norm(own)),
            "low": budget.low,
            "high": budget.high,
        }


def usable(make: Callable[[str], Made], names: Iterable[str]) -> list[Made]:
    """Result of `make` for each name. Crossings that the analysis refuses are excluded, as in a
    recorded campaign."""
    made = []
    for name in names:
        with suppress(OslAnalysisError):
            made.append(make(name))
    return made


def walking_rows(number: int, recorded: bool, crossings: int = CROSSINGS) -> Iterator[Row]:
    """Estimates of one campaign. The signals of `recorded` campaigns go through files and
    ingest."""
    shipped, names = gait_laboratory(), [f"study_{number:05d}_{i}" for i in range(2 * crossings)]
    if not recorded:
        yield from campaign_rows(names, shipped)
        return
    own = shipped.settings.model_copy(update={"seed": SEED + 1 + number})
    with TemporaryDirectory() as folder:
        of_files = recording(replace(shipped, settings=own), Path(folder), names[1::2])
        yield from campaign_rows(names, of_files)


def rows_of(experiment: str, numbers: Iterable[int]) -> list[Row]:
    """Estimates of trials, or of campaigns of walking, by their numbers."""
    if experiment.startswith("walking"):
        rows = [
            row
            for number in numbers
            for row in walking_rows(number, experiment == "walking recorded")
        ]
    else:
        rows = list(studied(experiment).rows(f"{experiment}_{number:05d}" for number in numbers))
    return [{"experiment": experiment} | row for row in rows]


def performance(rows: pl.DataFrame) -> dict[str, float]:
    """Performance of an estimator over n trials: the bias and the stated standard error (root mean
    square) over the standard deviation of the estimates, the root mean square error over the bound,
    and the share of intervals with the truth. Names in `_mc` are Monte Carlo standard errors."""
    columns = rows.select(
        pl.col("value", "truth", "se", "low", "high", "bound").cast(pl.Float64).fill_null(np.nan)
    )
    value, truth, se, low, high, bound = columns.to_numpy().T
    n = len(rows)
    error = value - truth
    covered = (low <= truth) & (truth <= high)
    sd = float(np.std(error, ddof=1))
    share = (covered.sum() + 2) / (n + 4)  # Agresti and Coull: never 0
    return {
        "bias": float(np.mean(error)) / sd,
        "bias_mc": 1 / float(np.sqrt(n)),
        "rmse_over_bound": float(np.sqrt(np.mean((error / bound) ** 2))),
        "se_over_sd": float(np.sqrt(np.mean(se**2))) / sd,
        "coverage": float(np.mean(covered)),
        "coverage_mc": float(np.sqrt(share * (1 - share) / (n + 4))),
    }


def page_rows(estimates: pl.DataFrame) -> Iterator[Sequence[str]]:
    """A line for each experiment, estimator and interval."""
    signs = {"k_tau_n_m": "k_τ n_m", "magnitude": "\\|Y\\|", "phase": "arg Y"}
    keys = ("experiment", "estimator", "interval_method")
    for rows in estimates.partition_by(keys, maintain_order=True):
        experiment, estimator, method = rows.select(keys).row(0)
        quantities = rows.partition_by("quantity", maintain_order=True)
        found = pl.DataFrame([performance(of_quantity) for of_quantity in quantities])
        symbols = []
        for of_quantity in quantities:
            name = str(of_quantity["quantity"][0]).partition(",")[0]
            symbols.append(signs.get(name, name))
        bias_mc = found["bias_mc"].to_numpy().max()
        coverage_mc = 100 * found["coverage_mc"].to_numpy().max()
        yield (
            str(experiment),
            f"{estimator}, {method}",
            ", ".join(symbols),
            str(len(rows) // len(quantities)),
            f"{listed(found['bias'])} ± {bias_mc:.2f}",
            listed(found["rmse_over_bound"]),
            listed(found["se_over_sd"]),
            f"{listed(100 * found['coverage'], digits=1)} ± {coverage_mc:.1f}",
        )


def listed(numbers: pl.Series, digits: int = 2) -> str:
    """Numbers with commas, a dash for one that is not known."""
    return ", ".join("–" if np.isnan(number) else f"{number:.{digits}f}" for number in numbers)


HEAD = (
    "experiment",
    "estimator, interval",
    "quantities",
    "n",
    "bias / SD",
    "RMSE / bound",
    "SE / SD",
    "coverage, %",
)


def main(trials: int = 100, campaigns: int = 80, recorded: int = 80) -> None:
    numbers = dict.fromkeys(BENCHES, trials) | {"walking": campaigns, "walking recorded": recorded}
    jobs = [
        (name, range(first, min(first + 10, n)))
        for name, n in numbers.items()
        for first in range(0, n, 10)
    ]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        made = [row for rows in pool.map(rows_of, *zip(*jobs, strict=True)) for row in rows]
    write_between(
        PAGE,
        {"study": markdown(HEAD, list(page_rows(pl.DataFrame(made, infer_schema_length=None))))},
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
