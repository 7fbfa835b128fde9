"""What stands behind the load cell and turns with the joint: a fixture, measured alone, and taken
off the torque of every other trial."""

from dataclasses import replace

import numpy as np
import polars as pl

from osl_analysis.bench.analysis import QUANTITIES, Analysis
from osl_analysis.bench.bench_settings import Fixture
from osl_analysis.bench.plausibility import check_resists
from osl_analysis.bench.regression import GroupFit
from osl_analysis.signals.grid import origin
from osl_analysis.stats.estimates import NORMAL_HALF_WIDTH
from osl_analysis.stats.table_rows import Row, estimates_row
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


def fixture_alone(analysis: Analysis) -> tuple[GroupFit, float]:
    """Inertia and weight of a fixture that turns alone, and the angle at which it hangs.

    Parameters
    ----------
    analysis
        Eq. 15 of the recording: K is the slope of the weight's torque in the middle of the motion.

    Returns
    -------
    fit : GroupFit
        Of `inertia` [kg*m^2] and `weight` [N*m].
    rest_deg : float
        The middle of the motion, or opposite to it, where the weight's torque falls with the
        angle. No small motion tells it from another one with the same slope.

    Raises
    ------
    InputError
        The inertia is certainly negative.
    """
    fit, record = analysis.calibrated(analysis.whole), analysis.record
    check_resists(record.name, "I", fit["I"], fit.interval("I")[1])
    middle_deg = float(np.rad2deg(record.motion.theta[record.rows()].mean()))
    at = [fit.names.index(name) for name in ("I", "K")]
    way = np.array([1.0, 1.0 if fit["K"] >= 0 else -1.0])
    rest_deg = middle_deg if fit["K"] >= 0 else middle_deg + 180
    found = replace(
        fit,
        names=("inertia", "weight"),
        estimates=way * fit.estimates[at],
        covariance=np.outer(way, way) * fit.covariance[np.ix_(at, at)],
        degrees_of_freedom=np.array([fit.freedom(name) for name in ("I", "K")]),
    )
    return found, rest_deg


SAME_FIXTURE = 0.02  # share by which a stated fixture may differ, as rounding does


def compared(fit: GroupFit, stated: Fixture) -> Row:
    """How far a stated fixture is from the measured one, in its units, and at most in multiples of
    what the intervals of both, or `SAME_FIXTURE`, leave open."""
    row: Row = {}
    multiples = []
    errors = {"inertia": stated.inertia_error, "weight": stated.weight_error}
    for name, error in errors.items():
        off = getattr(stated, name) - fit[name]
        half_width = fit.interval(name)[1] - fit[name]
        open_by = max(np.hypot(half_width, 2 * error), SAME_FIXTURE * abs(fit[name]))
        row[f"{name}_off"] = off
        multiples.append(abs(off) / open_by)
    return {**row, "fixture_error": max(multiples)}


def error_to_state(fit: GroupFit, name: str) -> float:
    """The standard error to state of an estimate: half of its interval over 1.96, since a stated
    error has no degrees of freedom."""
    return (fit.interval(name)[1] - fit[name]) / NORMAL_HALF_WIDTH


def fixture_row(analysis: Analysis, stated: Fixture | None = None) -> Row:
    """The estimates of a fixture alone for its row of `calibration.csv`, and how far the fixture
    that is `stated` is from them."""
    fit, rest_deg = fixture_alone(analysis)
    inertia, weight = max(fit["inertia"], 0.0), fit["weight"]
    to_state = (
        f"fixture: {{inertia: {inertia:.4g}, weight: {weight:.4g}, rest_deg: {rest_deg:.3g},"
        f" inertia_error: {error_to_state(fit, 'inertia'):.2g},"
        f" weight_error: {error_to_state(fit, 'weight'):.2g}}}"
    )
    return {
        **estimates_row(fit, "inertia", "weight"),
        "rest_deg": rest_deg,
        "to_state": to_state,
        **(compared(fit, stated) if stated else {}),
        **analysis.diagnostics(),
        **analysis.time_base_row(None, QUANTITIES),
    }
