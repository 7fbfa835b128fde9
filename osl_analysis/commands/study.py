"""Jobs of the Monte Carlo study. They keep nothing but tables.

The simulator hands its signals over in memory, except where the study is of recorded files.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.analysis import FitTables
from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis, ModelComparison
from osl_analysis.campaign.configuration import StudyTrials
from osl_analysis.commands.bench import fit_tables, job_of
from osl_analysis.compiled import require_compiler
from osl_analysis.errors import InputError
from osl_analysis.files import write_text
from osl_analysis.model.parameters import read_parameters
from osl_analysis.refusal import Refusal
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.study import WALKING_EXPERIMENTS
from osl_analysis.study.bench import StudyInputs, studied, study_rows
from osl_analysis.study.walking import walking_rows
from osl_analysis.table import SIMULATED, read_table, tables_of, write_table
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.settings import WalkingAnalysis
from osl_analysis.yaml_settings import read_yaml


def study_inputs(
    study: StudyTrials,
    dynamometer: DynamometerAnalysis,
    actuator_analysis: ActuatorAnalysis,
    walking: WalkingAnalysis,
    sources: Path,
) -> StudyInputs:
    """What a study simulates and analyses, by the sections of a configuration."""
    simulation = read_yaml(study.simulation, SimulationSettings).model_copy(update={"seed": study.seed})
    gait = None if simulation.walking is None else read_yaml(simulation.walking, WalkingSettings)
    parameters = simulation.parameters

    def fit(experiment: str, trial: Trial, sections: Mapping[str, Any]) -> FitTables:
        """The door to every fit, without what the sheet may state of a trial, which changes no estimate."""
        friction = ModelComparison(sign_width=simulation.drivetrain.sign_width)
        chosen = {**sections, "gain_weight": simulation.gain_weight, "model_comparison": friction}
        settings = {name: chosen[section] for name, (section, _) in job_of(experiment).settings.items()}
        found = fit_tables(experiment, trial, parameters, settings)
        assert isinstance(found, FitTables)
        return found

    analysis = {"dynamometer": dynamometer, "actuator": actuator_analysis}
    return StudyInputs(study, simulation, gait, read_parameters(parameters), analysis, walking, sources, fit)


def run_batch(
    experiment: str,
    first: int,
    number: int,
    study: StudyTrials,
    dynamometer: DynamometerAnalysis,
    actuator_analysis: ActuatorAnalysis,
    walking: WalkingAnalysis,
    sources: Path,
    output: Path,
) -> None:
    """Estimates of trials (or campaigns of walking) number `first` to `first + number - 1` of one experiment."""
    require_compiler()
    inputs = study_inputs(study, dynamometer, actuator_analysis, walking, sources)
    with tables_of(SIMULATED):
        if experiment in WALKING_EXPERIMENTS:
            numbers, recorded = range(first, first + number), experiment == "walking recorded"
            rows = list(walking_rows(inputs, numbers, recorded))
        else:
            trials = [f"{experiment}_{one:05d}" for one in range(first, first + number)]
            rows = study_rows(studied(experiment, inputs), trials)
        table = pl.DataFrame(rows, infer_schema_length=None)
        write_table(table.select(pl.lit(experiment).alias("experiment"), pl.all()), output)


def write_page(table: Path, output: Path) -> None:
    """The study's table in Markdown, as docs/study.md has it, and what of it lies outside the aim."""
    write_text(output, study_page(read_table(table)))


def summarise_study(batches: Sequence[Path], output: Path, refused: Sequence[Refusal] = ()) -> None:
    """Bias, error over the bound and coverage, for each experiment, estimator, kind of interval and quantity."""
    if refused:
        raise InputError(
            f"{output}: {len(refused)} batches failed; there is no study without them, because it would be too good; "
            "correct the settings of the study and run again"
        )
    estimates = pl.concat([read_table(path) for path in batches], how="diagonal_relaxed")
    with tables_of(SIMULATED):
        write_table(performance_table(estimates), output)


def performance(error: Array, se: Array, covered: NDArray[np.bool_], bound: Array) -> dict[str, float]:
    """Performance of an estimator over n trials, from errors about the truth, stated standard errors, whether the 95 %
    interval contains the truth, and the smallest possible standard errors, shape (n,) each: the bias and the stated
    standard error (root mean square) over the standard deviation of the estimates, the root mean square error, also
    over the bound, and the share of intervals with the truth. Names in `_mc` are Monte Carlo standard errors."""
    n, sd = len(error), float(np.std(error, ddof=1))
    ratio = float(np.sqrt(np.mean((error / bound) ** 2)))
    kurtosis = float(np.mean(error**4) / np.mean(error**2) ** 2)
    share = (float(np.sum(covered)) + 2) / (n + 4)  # Agresti and Coull: no error of zero where all are covered
    return {
        "n": n,
        "bias": float(np.mean(error)) / sd,
        "bias_mc": 1 / float(np.sqrt(n)),
        "rmse": float(np.sqrt(np.mean(error**2))),
        "rmse_over_bound": ratio,
        "rmse_over_bound_mc": ratio * float(np.sqrt(max(kurtosis - 1, 0.0) / (4 * n))),
        "se_over_sd": float(np.sqrt(np.mean(se**2))) / sd,
        "coverage": float(np.mean(covered)),
        "coverage_mc": float(np.sqrt(share * (1 - share) / (n + 4))),
    }


def performance_table(estimates: pl.DataFrame) -> pl.DataFrame:
    """Performance for each experiment, estimator, kind of interval and quantity, from a row per estimate."""
    rows, keys = [], ("experiment", "estimator", "interval_method", "quantity")
    for key, group in estimates.group_by(keys, maintain_order=True):
        value, truth, model_truth, low, high, se, bound = (
            group[name].cast(pl.Float64).fill_null(np.nan).to_numpy()
            for name in ("value", "truth", "model_truth", "low", "high", "se", "bound")
        )
        judged = performance(value - truth, se, (low <= truth) & (truth <= high), bound)
        model = {
            "model_coverage": float(np.mean((low <= model_truth) & (model_truth <= high))),
            "model_error": group["model_error"].cast(pl.Float64).mean(),
        }
        rows.append({**dict(zip(keys, key, strict=True)), **judged, **model})
    return pl.DataFrame(rows, infer_schema_length=None).fill_nan(None)


def study_page(table: pl.DataFrame) -> str:
    """The table of `performance_table` in Markdown, a line for each experiment, estimator and interval, and which
    coverages lie outside the aim by two Monte Carlo errors."""
    signs = {"k_tau_n_m": "k_τ n_m", "magnitude": "\\|Y\\|", "phase": "arg Y"}
    head = "| experiment | estimator, interval | quantities | n | bias / SD | RMSE / bound | SE / SD | coverage, % |"
    lines = [head, f"| {' | '.join(['---'] * 8)} |"]
    for _, rows in table.group_by(["experiment", "estimator", "interval_method", "n"], maintain_order=True):

        def each(name: str, form: str = "{:.2f}", scale: float = 1.0, of: pl.DataFrame = rows) -> str:
            return ", ".join("–" if value is None else form.format(scale * value) for value in of[name])

        first, names = rows.row(0, named=True), [quantity.partition(",")[0] for quantity in rows["quantity"]]
        bias_mc, coverage_mc = (max(rows[name].drop_nulls(), default=0.0) for name in ("bias_mc", "coverage_mc"))
        line = [
            first["experiment"],
            f"{first['estimator']}, {first['interval_method']}",
            ", ".join(signs.get(name, name) for name in names),
            str(first["n"]),
            f"{each('bias')} ± {bias_mc:.2f}",
            each("rmse_over_bound"),
            each("se_over_sd"),
            f"{each('coverage', '{:.1f}', 100)} ± {100 * coverage_mc:.1f}",
        ]
        lines.append(f"| {' | '.join(line)} |")
    default = table.filter(pl.col("estimator").str.contains("filtered|sinusoid"))
    coverage, slack = pl.col("coverage"), 2 * pl.col("coverage_mc")
    off = default.filter((coverage + slack < 0.93) | (coverage - slack > 0.97))
    inside = default.filter(coverage.is_between(0.93, 0.97))
    mean = 100 * float(default["coverage"].mean() or 0.0)  # type: ignore[arg-type]
    named = [f"{r['experiment']}, {r['quantity']}: {100 * r['coverage']:.1f} %" for r in off.iter_rows(named=True)]
    lines += [
        "",
        f"* Bench, default estimator: {len(default)} coverages with a mean of {mean:.1f} %; {len(inside)} lie "
        "between 93 and 97 %.",
        f"* Outside by more than 2 Monte Carlo errors: {'; '.join(named) or 'none'}.",
        "",
    ]
    return "\n".join(lines)
