"""What an earlier trial showed of the distortion of a joint, from the tables of its campaign."""

from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.design.precision import NAMES, Density, Distortion, Spread
from osl_analysis.errors import InputError
from osl_analysis.spectral.equation_error import REALISATIONS
from osl_analysis.table import read_table

OF_RESPONSE = ("frequency_hz", "angle_deg", "odd_level")  # columns of `response.csv` that are used


def earlier_distortion(path: Path, trial: str | None) -> Distortion:
    """The distortion that an earlier trial showed.

    `response.csv` has levels; `impedance.csv` the spread of a multisine's realisations, or a stepped sine's friction.
    """
    table = read_table(path)
    levels, there = set(OF_RESPONSE), set(table.columns)
    if "trial" not in there or not (levels <= there or "coulomb_torque" in there):
        raise InputError(f"{path}: no columns of response.csv or impedance.csv; give one of these tables")
    rows = table if trial is None else table.filter(pl.col("trial") == trial)
    names = rows["trial"].unique().to_list()
    if len(names) != 1:
        what = f"no trial '{trial}'" if trial else f"{len(names)} trials"
        such = f", such as {table['trial'][0]}" if len(table) else ""
        raise InputError(f"{path}: {what}; choose one with --trial{such}")
    if levels <= there:
        return level_of(rows, path)
    spread = spread_of(rows)
    return friction_of(rows, path) if spread is None else Distortion(spread=spread)


def spread_of(rows: pl.DataFrame) -> Spread | None:
    """The spread of the realisations of a multisine, from its row of `impedance.csv`; None of any other trial."""
    columns = ["realisations", "band_low_hz", "band_high_hz", "theta_rms_deg", *(f"{name}_se" for name in NAMES)]
    if not set(columns) <= set(rows.columns):
        return None
    known = rows.filter(pl.col("interval_method") == REALISATIONS).select(pl.col(columns).cast(pl.Float64)).drop_nulls()
    if not len(known):
        return None
    count, low, high, rms_deg, *errors = known.row(0)
    return Spread(count * np.array(errors) ** 2, (low, high), float(np.deg2rad(rms_deg)))


def friction_of(rows: pl.DataFrame, path: Path) -> Distortion:
    """The friction of the row over all amplitudes, or of a single row, from the columns of `impedance.csv`."""
    whole = rows.filter(pl.col("amplitude_deg").is_null())
    value = (whole if len(whole) else rows)["coulomb_torque"].cast(pl.Float64)[0]
    if value is None or not np.isfinite(value):
        raise InputError(f"{path}: coulomb_torque of trial {rows['trial'][0]} is empty; state --friction")
    return Distortion(coulomb=abs(float(value)))


def level_of(rows: pl.DataFrame, path: Path) -> Distortion:
    """The density of the distortion, from the columns of `response.csv`.

    A level is E|d|^2 of Z, times |theta|^2 twice the mean square of the torque that a line has; odd lines are as far
    apart as the closest two.
    """
    known = rows.select(pl.col(OF_RESPONSE).cast(pl.Float64)).drop_nulls().sort("frequency_hz")
    f, angle_deg, level = (known[name].to_numpy() for name in OF_RESPONSE)
    if len(f) < 2 or not np.isfinite(level).all():
        raise InputError(f"{path}: no odd_level of trial {rows['trial'][0]}; it needs a periodic motion with odd lines")
    return Distortion(earlier=Density(f, 0.5 * (level * np.deg2rad(angle_deg)) ** 2 / float(np.min(np.diff(f)))))
