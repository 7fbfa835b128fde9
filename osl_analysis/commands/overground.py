"""Overground gait beside the ankle moment that its laboratory computed."""

from pathlib import Path

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.table import write_table
from osl_analysis.trial import Trial
from osl_analysis.trial_file import read_trial
from osl_analysis.walking.overground import MomentComparison, check_plates, compare_moments
from osl_analysis.walking.settings import GaitAnalysis


def compare(trial: Path, settings: GaitAnalysis, output: Path) -> None:
    """One row per stance and plate of a trial: our ankle moment against the laboratory's."""
    record = read_trial(trial)
    check_plates(record, settings.largest_zero_n)
    mass = body_mass(record, settings.body_mass_kg)
    rows = [
        {"trial": record.name, "body_mass_kg": mass, **comparison_row(c)}
        for c in compare_moments(record, mass, settings.load_on_n)
    ]
    write_table(pl.DataFrame(rows), output)


def body_mass(trial: Trial, configured: float | None) -> float:
    """Body mass [kg]: as configured, else as the recording says.

    Raises
    ------
    InputError
        Neither knows it.
    """
    recorded = trial.provenance.get("mocap", {}).get("body_mass_kg")
    mass = configured or recorded
    if not mass:
        raise InputError(
            f"trial {trial.name}: the recording states no body mass, found {recorded!r}; set gait.body_mass_kg in the "
            "configuration"
        )
    return float(mass)


def comparison_row(comparison: MomentComparison) -> dict[str, object]:
    """One row of `ankle_moment.csv`; moments in N*m/kg, plantarflexion positive."""
    peak = comparison.peak
    return {
        "side": comparison.side,
        "plate": comparison.plate,
        "heel_strike_s": comparison.stance.heel_strike,
        "toe_off_s": comparison.stance.toe_off,
        "frames": len(comparison.time),
        "correlation": comparison.correlation,
        "slope": comparison.slope,
        "reference_peak": float(comparison.reference[peak]),
        "moment_at_peak": float(comparison.moment[peak]),
    }
