"""The transmission alone on its bench, with the motor detached: its losses (Eq. 4)."""

import polars as pl

from osl_analysis.bench import effects
from osl_analysis.bench.analysis import Analysis, analysed
from osl_analysis.bench.coulomb import coulomb_fits
from osl_analysis.bench.effects import TRANSMISSION
from osl_analysis.bench.joint_inference import (
    COLUMNS_OF_LOSSES,
    estimate_columns,
    fault_columns,
    suspected_fault_of_losses,
)
from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import EFFECTS_LIMIT, fit_groups, held_out_vaf
from osl_analysis.dictionary import table_of
from osl_analysis.stats.estimates import Estimate, Row

LOSSES = ("B_j", "J_j")


def transmission_of(record: Record) -> Analysis:
    """Losses with the motor detached, Eq. 4 with theta_s = 0, fitted to a stepped sine; raises as
    `analysed`."""
    return analysed(record, TRANSMISSION)


def transmission_table(analysis: Analysis) -> pl.DataFrame:
    """The trial's rows of `transmission.csv`: one per amplitude [deg], and one for all of them
    (amplitude null).

    A late torque reduces J_j by B_j times the lag, and leaves a third derivative of the angle,
    which shows it."""
    record, s = analysis.record, effects.sums_of(analysis.record, TRANSMISSION)
    friction = coulomb_fits(s, analysis)
    fault = suspected_fault_of_losses(record)
    VAF_held_out = held_out_vaf(analysis.sums, analysis.model)
    rows: list[Row] = []
    for label, fit in analysis.fits.items():
        # a weight acts as a spring: its torque grows with the angle
        with_weight = {**TRANSMISSION, "weight": "theta"}
        weight = fit_groups(s, with_weight, s.groups.of(label), EFFECTS_LIMIT)
        share_of_weight = 0.0
        if weight.certain("weight", effects.FALSE_ALARM):
            share_of_weight = 1 - fit["J_j"] / weight["J_j"]
        coulomb = friction.get(label)
        certain = coulomb.certain if coulomb else None
        viscous = Estimate.of_fit(certain, "B_j") if certain else None
        rows.append(
            {
                **analysis.row(label, *LOSSES),
                "T_C": certain["T_C"] if certain else None,
                "coulomb_share": coulomb.share if coulomb else None,
                **estimate_columns("B_j_viscous", viscous),
                "weight_share": share_of_weight,
                "VAF_held_out": VAF_held_out,
                "load_cell_drift": 60 * analysis.whole["drift"],
                **analysis.time_base_row(label, LOSSES),
                **fault_columns(fault, COLUMNS_OF_LOSSES),
                "delay_told_s": fault.delay_told_s if fault else None,
            }
        )
    return table_of(rows, "transmission")
