"""Bench trials of the study: inputs, recordings, a table row for each estimate, and how well the estimates do."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis
from osl_analysis.config import StudySettings
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.signals import LowPass
from osl_analysis.simulator.settings import Effect, Encoder, RecorderSettings, SimulationSettings, stream
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.stats.regression import LinearFit
from osl_analysis.study import Recording
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.settings import WalkingAnalysis

StudyRow = dict[str, Any]  # One row of the study's table of estimates
KEYS = ("experiment", "estimator", "interval_method", "quantity")
"""Columns that the rows of one performance have in common."""
SENSORS = (
    "load_cell_noise", "load_cell_offset", "load_cell_drift", "load_cell_quantisation", "load_cell_hum",
    "load_cell_flicker", "joint_encoder", "actuator_encoder", "current_noise", "current_quantisation", "encoder_zero",
)  # fmt: skip
"""Effects of sensors, which ideal ones do not have."""


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
class Estimate:
    """An estimate with its standard error and 95 % interval, all in the unit of the quantity."""

    value: float
    se: float
    low: float
    high: float


DEFAULT = "filtered"
"""Name of the bench's estimator in the tables: one filter for all signals, then derivatives, then least squares."""
Estimates = Iterator[tuple[str, str, Mapping[str, Estimate]]]
"""The estimates of one trial: estimator, kind of interval, and an estimate for each quantity."""


class StudiedExperiment(Protocol):
    """An experiment that the study repeats. The name of a trial decides its noise."""

    @property
    def exact(self) -> Mapping[str, float]:
        """The parameters that made the trial, by quantity, where the joint has such parameters. Else empty."""
        ...

    @property
    def theory(self) -> Mapping[str, float]:
        """Prediction of linear theory, by quantity; empty without a prediction."""
        ...

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The estimates of one trial. The sensors of an `ideal` trial have no errors."""
        ...

    def bounds(self) -> Mapping[str, float]:
        """The smallest standard deviation of any unbiased estimate, by quantity."""
        ...


def estimates_of(fit: LinearFit, names: tuple[str, ...]) -> dict[str, Estimate]:
    """The named estimates of a fit."""
    return {name: Estimate(fit[name], fit.se(name), *fit.interval(name)) for name in names}


def ideal_sensors(settings: SimulationSettings) -> SimulationSettings:
    """The settings without errors of sensors and recorders."""
    # the controller sees the actuator's encoder too, but its motion has been simulated before the sensors read it
    return settings.model_copy(update={"effects": settings.effects.without(*SENSORS), "recorder": RecorderSettings()})


def recorded_trial(
    name: str, time: Array, joint: Mapping[str, Array], torque_time: Array, torque: Mapping[str, Array]
) -> Trial:
    """The trial of two recordings with stamps [s] of their own: what moves and the torque, in canonical columns."""
    samples = pl.DataFrame({"time": time - time[0], **joint})
    if np.array_equal(time, torque_time):
        return Trial(name, samples.with_columns(**{column: pl.Series(values) for column, values in torque.items()}))
    other = pl.DataFrame({"time": torque_time - time[0], **torque})
    return Trial(name, samples.join(other, on="time", how="full", coalesce=True).sort("time"))


def at_any_phase(trial: str, settings: SimulationSettings) -> SimulationSettings:
    """The settings with recorders that start anywhere between two instants of the simulated motion. Every trial repeats
    the motion. With samples at the same phases of it the rounding of an encoder would repeat too."""
    later = float(stream(settings.seed, trial, "sampling_phase").random()) / settings.dynamometer.rate_hz
    recorder = settings.recorder
    nodes = {"node": recorder.node, "torque_node": recorder.torque_node}
    moved = {
        name: node.model_copy(update={"phase": Effect(enabled=True, size=node.phase.value + later, unit="s")})
        for name, node in nodes.items()
        if node is not None
    }
    return settings.model_copy(update={"recorder": recorder.model_copy(update=moved)})


def recorded_as(inputs: StudyInputs, recording: Recording) -> StudyInputs:
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


def trial_rows(experiment: StudiedExperiment, trials: Sequence[str], low_pass: LowPass) -> list[StudyRow]:
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


@dataclass(frozen=True)
class Performance:
    """Performance of an estimator over n simulated trials. Names in `_mc` are Monte Carlo standard errors."""

    n: int
    bias: float  # mean error divided by the standard deviation of the estimates
    bias_mc: float
    rmse: float  # root mean square error, in the unit of the estimate
    rmse_over_bound: float  # divided by the Cramer-Rao bound
    rmse_over_bound_mc: float
    se_over_sd: float  # stated standard error (root mean square) over the standard deviation of the estimates
    coverage: float  # share of the 95 % intervals that contain the truth
    coverage_mc: float


def performance(error: Array, se: Array, covered: NDArray[np.bool_], bound: Array) -> Performance:
    """Performance from errors about the truth, stated standard errors, coverage and bounds, shape (n,) each. `covered`
    says whether the interval contains the truth. `bound` is the smallest possible standard error."""
    n, sd = len(error), float(np.std(error, ddof=1))
    ratio = float(np.sqrt(np.mean((error / bound) ** 2)))
    kurtosis = float(np.mean(error**4) / np.mean(error**2) ** 2)
    share = (float(np.sum(covered)) + 2) / (n + 4)  # Agresti and Coull: no error of zero where all are covered
    return Performance(
        n=n,
        bias=float(np.mean(error)) / sd,
        bias_mc=1 / float(np.sqrt(n)),
        rmse=float(np.sqrt(np.mean(error**2))),
        rmse_over_bound=ratio,
        rmse_over_bound_mc=ratio * float(np.sqrt(max(kurtosis - 1, 0.0) / (4 * n))),
        se_over_sd=float(np.sqrt(np.mean(se**2))) / sd,
        coverage=float(np.mean(covered)),
        coverage_mc=float(np.sqrt(share * (1 - share) / (n + 4))),
    )


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


def performance_table(estimates: pl.DataFrame) -> pl.DataFrame:
    """Performance for each experiment, estimator, kind of interval and quantity, from a row per estimate."""
    rows = []
    for key, group in estimates.group_by(KEYS, maintain_order=True):
        value, truth, model_truth, low, high, se, bound = (
            group[name].cast(pl.Float64).fill_null(np.nan).to_numpy()
            for name in ("value", "truth", "model_truth", "low", "high", "se", "bound")
        )
        judged = performance(value - truth, se, (low <= truth) & (truth <= high), bound)
        model = {
            "model_coverage": float(np.mean((low <= model_truth) & (model_truth <= high))),
            "model_error": group["model_error"].cast(pl.Float64).mean(),
        }
        rows.append({**dict(zip(KEYS, key, strict=True)), **asdict(judged), **model})
    return pl.DataFrame(rows, infer_schema_length=None).fill_nan(None)


AIM = (0.93, 0.97)  # Coverage of 95 % intervals that the study aims at
CERTAIN = 2.0  # Monte Carlo errors by which a coverage must lie outside before it is said to
HEADER = ("experiment", "estimator, interval", "quantities", "n", "bias / SD", "RMSE / bound", "SE / SD", "coverage, %")
LETTERS = {"k_tau_n_m": "k_τ n_m", "magnitude": "\\|Y\\|", "phase": "arg Y"}


def page(table: pl.DataFrame) -> str:
    """The table of `performance_table` in Markdown, and what lies outside the aim."""
    keys = ["experiment", "estimator", "interval_method", "n"]
    groups = [rows for _, rows in table.group_by(keys, maintain_order=True)]
    lines = [line(HEADER), line(["---"] * len(HEADER)), *(line(cells(rows)) for rows in groups)]
    return "\n".join([*lines, "", *(f"* {sentence}" for sentence in findings(table)), ""])


def cells(rows: pl.DataFrame) -> list[str]:
    """The cells of one experiment, estimator and interval: a number for each quantity."""
    first = rows.row(0, named=True)
    names = [quantity.partition(",")[0] for quantity in rows["quantity"]]
    bias, errors = range_of(rows["bias_mc"], "{:.2f}"), range_of(100 * rows["coverage_mc"], "{:.1f}")
    return [
        first["experiment"],
        f"{first['estimator']}, {first['interval_method']}",
        ", ".join(LETTERS.get(name, name) for name in names),
        str(first["n"]),
        f"{numbers(rows['bias'], '{:.2f}')} ± {bias}",
        numbers(rows["rmse_over_bound"], "{:.2f}"),
        numbers(rows["se_over_sd"], "{:.2f}"),
        f"{numbers(100 * rows['coverage'], '{:.1f}')} ± {errors}",
    ]


def findings(table: pl.DataFrame) -> list[str]:
    """How many coverages are there, the mean of them, and which lie outside the aim beyond chance."""
    low, high = AIM
    default = table.filter(pl.col("estimator").str.contains("filtered|sinusoid"))
    off = default.filter(
        (pl.col("coverage") + CERTAIN * pl.col("coverage_mc") < low)
        | (pl.col("coverage") - CERTAIN * pl.col("coverage_mc") > high)
    )
    inside = default.filter(pl.col("coverage").is_between(low, high))
    mean = 100 * float(default["coverage"].mean() or 0.0)  # type: ignore[arg-type]
    named = [f"{r['experiment']}, {r['quantity']}: {100 * r['coverage']:.1f} %" for r in off.iter_rows(named=True)]
    return [
        f"Bench, default estimator: {len(default)} coverages with a mean of {mean:.1f} %; {len(inside)} lie between "
        f"{100 * low:g} and {100 * high:g} %.",
        f"Outside by more than {CERTAIN:g} Monte Carlo errors: {'; '.join(named) or 'none'}.",
    ]


def numbers(values: pl.Series, form: str) -> str:
    """The numbers of some quantities, a dash where there is none."""
    return ", ".join("–" if value is None else form.format(value) for value in values)


def range_of(values: pl.Series, form: str) -> str:
    """The largest of some Monte Carlo errors."""
    return form.format(float(values.max() or 0.0))  # type: ignore[arg-type]


def line(columns: Iterable[str]) -> str:
    """A row of a Markdown table."""
    return f"| {' | '.join(columns)} |"
