"""The transmission alone on its bench, with the motor detached: its losses (Eq. 4)."""

import polars as pl

from osl_analysis.bench import effects
from osl_analysis.bench.analysis import Analysis, analysed
from osl_analysis.bench.coulomb import CoulombFit, coulomb_fits
from osl_analysis.bench.effects import TRANSMISSION
from osl_analysis.bench.group_fit import GroupFit
from osl_analysis.bench.joint_fit import LOSSES_SYMBOLS, estimate_columns, fault_columns
from osl_analysis.bench.joint_inference import suspected_fault_of_losses
from osl_analysis.bench.record import Record
from osl_analysis.stats.estimates import Estimate
from osl_analysis.stats.table_rows import Row, estimates_row

LOSSES = ("B_j", "J_j")


def transmission_of(record: Record) -> Analysis:
    """Losses with the motor detached, Eq. 4 with theta_s = 0, fitted to a stepped sine; raises as
    `analysed`."""
    return analysed(record, effects.plain_sums(record, TRANSMISSION), TRANSMISSION)


def transmission_table(analysis: Analysis) -> pl.DataFrame:
    """The trial's rows of `transmission.csv`: one per amplitude [deg], and one for all of them
    (amplitude null).

    A late torque reduces J_j by B_j times the lag, and leaves a third derivative of the angle,
    which shows it."""
    record, s = analysis.record, effects.sums_of(analysis.record, TRANSMISSION)
    friction = coulomb_fits(s, analysis)
    fault = suspected_fault_of_losses(record)
    rows = list[Row]()
    for label, fit in analysis.fits.items():
        beside_friction = effects.with_effects(s, TRANSMISSION, ("T_C",), label)
        weight = effects.with_effects(s, TRANSMISSION, ("weight",), label)
        share_of_weight = 0.0
        if weight.certain("weight", effects.FALSE_ALARM):
            share_of_weight = 1 - fit["J_j"] / weight["J_j"]
        rows.append(
            {
                **analysis.row(label, *LOSSES),
                **losses_friction_columns(
                    friction.get(label), analysis.calibrated(beside_friction, label)
                ),
                **estimates_row(analysis.calibrated(weight, label), "weight"),
                "J_j_weightless": weight["J_j"],
                "weight_share": share_of_weight,
                "B_j_coulomb": beside_friction["B_j"],
                "VAF_coulomb": beside_friction.vaf,
                **analysis.beside_diagnostics(label, *LOSSES),
                **fault_columns(fault, LOSSES_SYMBOLS),
                "VAF_in_band": fault.VAF_held_out if fault else None,
                "delay_told_s": fault.delay_told_s if fault else None,
            }
        )
    texts = dict.fromkeys(("fault", "fault_family", "explanations"), pl.String)
    table = pl.DataFrame(rows, infer_schema_length=None, schema_overrides=texts)
    return table.with_columns(pl.col(pl.Null).cast(pl.Float64))


def losses_friction_columns(coulomb: CoulombFit | None, beside: GroupFit) -> Row:
    """The columns of friction beside losses; `beside` is the model with friction, certain or
    not."""
    certain = coulomb.certain if coulomb else None
    viscous = Estimate.of_fit(certain, "B_j") if certain is not None else None
    size = Estimate.of_fit(beside if certain is None else certain, "T_C")
    return {
        **size.columns("T_C"),
        "T_C_se_bench": beside.se_bench("T_C"),
        "coulomb_torque": coulomb.torque if coulomb else None,
        "coulomb_damping": coulomb.damping if coulomb else None,
        "coulomb_share": coulomb.share if coulomb else None,
        **estimate_columns("B_j_viscous", viscous),
    }
