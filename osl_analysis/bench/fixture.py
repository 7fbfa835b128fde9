"""What stands behind the load cell and turns with the joint: a fixture, measured alone, and taken
off the torque of every other trial."""

from dataclasses import replace

import polars as pl

from osl_analysis.bench.bench_settings import Fixture
from osl_analysis.signals.grid import origin
from osl_analysis.trial import Trial


def with_fixture(trial: Trial, fixture: Fixture | None) -> Trial:
    """Let the time base take the fixture of the settings off the torque; one that the sheet states
    for this trial comes first."""
    if fixture is None or "torque" not in trial.columns or fixture_of(trial):
        return trial
    columns = dict(trial.provenance.get("columns", {}))
    columns["torque"] = {**columns.get("torque", {}), "fixture": fixture.arguments}
    return replace(trial, provenance={**trial.provenance, "columns": columns})


def fixture_of(trial: Trial) -> dict[str, float]:
    """Arguments of `signals.grid.fixture_torque` by which a trial's torque is corrected; empty
    without a fixture."""
    return dict(origin(trial, "torque").get("fixture") or {})


def fixture_column(trial: Trial) -> pl.Expr:
    """The column `fixture`: what is taken off the torque, in words; null if nothing is."""
    parts = [f"{name} {value:g}" for name, value in fixture_of(trial).items() if value]
    return pl.lit(", ".join(parts) or None, pl.String).alias("fixture")


def fixture_weight_column(trial: Trial) -> pl.Expr:
    """The column `fixture_weight` [N*m]: what is taken off the torque with the fixture level."""
    weight = fixture_of(trial).get("weight")
    return pl.lit(weight or None, pl.Float64).alias("fixture_weight")
