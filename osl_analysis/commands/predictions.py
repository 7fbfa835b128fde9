"""The job that predicts every impedance trial from components that were measured alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench import prediction
from osl_analysis.bench.bench_settings import FilterSettings
from osl_analysis.bench.component_summary import PLACE
from osl_analysis.bench.controller_law import law_that_ran
from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.bench.measured_components import Components, components_of
from osl_analysis.bench.record import read_record
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.model.actuator_in_time import Controller
from osl_analysis.model.compensator import Weight
from osl_analysis.model.drivetrain import DrivetrainParameters, FileOrNone, known_parameters
from osl_analysis.table import read_table, with_evidence, write_table

CONDITION = ("controller", "K_d", "B_d")


@dataclass(frozen=True)
class PredictedTrial:
    """What one trial gives to the tables of predictions."""

    terms: pl.DataFrame  # as `prediction_terms`
    misses: pl.DataFrame  # as `miss_over_frequency`
    law: str  # that its controller ran: programmed or measured


@dataclass
class Predictions:
    """The tables of predictions, part by part, and why other trials have none."""

    reasons: dict[str, str]
    rows: list[pl.DataFrame] = field(default_factory=list)  # of `prediction.csv`
    causes: list[pl.DataFrame] = field(default_factory=list)  # of `prediction_causes.csv`
    misses: list[pl.DataFrame] = field(default_factory=list)  # of `prediction_frequencies.csv`


@dataclass(frozen=True)
class Predictor:
    """What the prediction of a trial needs beside the components of its joint."""

    p: DrivetrainParameters  # of the parameter file
    records: Mapping[str, Path]  # by trial
    laws: pl.DataFrame  # `law.csv`: where other gains ran than were programmed, these count
    weight: Weight  # W of Eq. 14
    sign_width: float  # over which the controller smooths the sign of the velocity [rad/s]
    settings: FilterSettings

    def predicted(self, row: Mapping[str, Any], components: Components) -> PredictedTrial:
        """Predict the trial of one row of `impedance.csv`. Raises as `prediction_terms`."""
        desired = DesiredImpedance(row["controller"], row["K_d"], row["B_d"])
        programmed = desired.gains(self.p, self.weight)
        assert programmed is not None  # of other trials no record is read
        record = read_record(self.records[row["trial"]], self.settings.low_pass)
        law_of_trial = self.laws.filter(trial=row["trial"])
        gains, cancelled_friction = law_that_ran(law_of_trial, programmed, self.p)
        controller = Controller(gains, cancelled_friction, self.sign_width)
        terms, misses = prediction.prediction_terms(record, controller, components)
        is_programmed = gains == programmed and cancelled_friction == self.p
        return PredictedTrial(terms, misses, "programmed" if is_programmed else "measured")

    def add_place(
        self, fits: pl.DataFrame, measured: Mapping[str, pl.DataFrame], predictions: Predictions
    ) -> None:
        """Add the trials of one joint and side, by the tables of `measured` components."""
        no_components = "components that predict a torque ({})"
        try:
            components = components_of(measured, fits.select(PLACE).row(0), self.p)
        except (InputError, IdentifiabilityError) as error:
            reason = no_components.format(error)
            predictions.reasons.update(dict.fromkeys(fits["trial"], reason))
            return
        trials: dict[str, PredictedTrial] = {}
        for row in fits.iter_rows(named=True):
            try:
                trials[row["trial"]] = self.predicted(row, components)
            except (InputError, IdentifiabilityError) as error:
                predictions.reasons[row["trial"]] = no_components.format(error)
        if not trials:
            return
        terms = {name: trial.terms for name, trial in trials.items()}
        predicted_fits = fits.filter(pl.col("trial").is_in(list(trials)))
        rows, causes = prediction.prediction_table(terms, predicted_fits, components)
        law = pl.col("trial").replace_strict({name: trial.law for name, trial in trials.items()})
        predictions.rows.append(rows.with_columns(law=law))
        predictions.causes.append(causes)
        predictions.misses += [trial.misses for trial in trials.values()]


def gather_predictions(
    records: Sequence[Path],
    table: Path,
    law: Path,
    components: Mapping[str, Path],
    unpredicted: Mapping[str, str],
    weight: Weight,
    sign_width: float,
    settings: FilterSettings,
    output: Path,
    causes: Path,
    frequencies: Path,
    parameters: FileOrNone = None,
    data: str = "",
) -> None:
    """Write the predictions of all trials with their intervals, what would explain what they leave,
    and how much that is at each frequency.

    Parameters
    ----------
    records
        Those of the trials' fits.
    table, law
        `impedance.csv`, and `law.csv`: where other gains ran than were programmed, these count.
    unpredicted
        Why other trials with known gains have no prediction.
    weight
        W of Eq. 14.
    sign_width
        Over which the controller smooths the sign of the velocity [rad/s].
    """
    fits = with_evidence(table).filter(pl.col("amplitude_deg").is_null())
    p = known_parameters(parameters)
    measured = {part: read_table(path) for part, path in components.items()}
    laws = read_table(law)
    record_paths = {path.stem: path for path in records}
    predictions = Predictions(dict(unpredicted))
    if p is not None:  # without a parameter file no gains are known
        predictor = Predictor(p, record_paths, laws, weight, sign_width, settings)
        with_record = fits.filter(pl.col("trial").is_in(list(record_paths)))
        for at_place in with_record.partition_by(PLACE, maintain_order=True):
            predictor.add_place(at_place, measured, predictions)

    rows = [rows_without_prediction(fits, predictions.reasons), *predictions.rows]
    write_table(pl.concat(rows, how="diagonal_relaxed"), output, data)
    no_causes = pl.DataFrame(schema=[*PLACE, "component"])
    write_table(pl.concat([no_causes, *predictions.causes], how="diagonal_relaxed"), causes, data)
    misses = pl.concat([pl.DataFrame(schema=prediction.MISSES), *predictions.misses])
    conditions = fits.select("trial", *PLACE, *CONDITION, "doubtful")
    write_table(conditions.join(misses, on="trial", maintain_order="left"), frequencies, data)


def rows_without_prediction(fits: pl.DataFrame, reasons: Mapping[str, str]) -> pl.DataFrame:
    """The rows of `prediction.csv` of trials without a prediction, with the reason."""
    reason = pl.col("trial").replace_strict(reasons, default=None, return_dtype=pl.String)
    rows = fits.filter(pl.col("trial").is_in(list(reasons)))
    rows = rows.select("trial", *PLACE, *CONDITION, missing_components=reason)
    numbers = pl.DataFrame(schema=dict.fromkeys(prediction.NUMBERS, pl.Float64))
    return pl.concat([rows, numbers], how="diagonal_relaxed").with_columns(
        doubtful=pl.lit(None, pl.String)
    )
