"""Jobs of the Monte Carlo study. They keep nothing but tables.

The simulator hands its signals over in memory, except where the study is of recorded files.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.analysis import FitTables
from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis
from osl_analysis.campaign.configuration import StudySettings
from osl_analysis.commands.bench import fit_tables, job_of
from osl_analysis.compiled import require_compiler
from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.model.parameters import read_parameters
from osl_analysis.refusal import Refusal
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.study import WALKING_EXPERIMENTS
from osl_analysis.study.bench import StudyInputs, StudyRow, studied, study_rows
from osl_analysis.study.performance import performance_table, study_page
from osl_analysis.study.walking import walking_rows
from osl_analysis.table import SIMULATED, read_table, tables_of, write_table
from osl_analysis.trial import Trial
from osl_analysis.walking.settings import WalkingAnalysis
from osl_analysis.yaml_settings import read_yaml


def study_inputs(
    study: StudySettings,
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
        chosen = {**sections, "gain_weight": simulation.gain_weight.weight}
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
    study: StudySettings,
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
        rows = batch_rows(experiment, range(first, first + number), inputs)
        write_table(pl.DataFrame(rows, infer_schema_length=None), output)


def batch_rows(experiment: str, numbers: range, inputs: StudyInputs) -> list[StudyRow]:
    """The rows of trials (or campaigns of walking) with these numbers."""
    if experiment in WALKING_EXPERIMENTS:
        rows = list(walking_rows(inputs, numbers, recorded=experiment == "walking recorded"))
    else:
        rows = study_rows(studied(experiment, inputs), [f"{experiment}_{number:05d}" for number in numbers])
    return [{"experiment": experiment, **row} for row in rows]


def write_page(table: Path, output: Path) -> None:
    """The study's table in Markdown, as docs/study.md has it, and what of it lies outside the aim."""
    with atomic_path(output) as temporary:
        temporary.write_text(study_page(read_table(table)), encoding="utf-8")


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
