"""Transmission losses with the motor detached: torque = B_j omega + J_j alpha + offset (Eq. 4 with theta_s = 0)."""

import numpy as np
import polars as pl

from osl_analysis.bench.analysis import Analysis, analysed
from osl_analysis.bench.effects import TRANSMISSION, causes, clock_drift_of, plain_sums, sums_of, with_effects
from osl_analysis.bench.phasors import at_amplitude, harmonic_shares, phasors_of_record
from osl_analysis.bench.record import Record
from osl_analysis.judge.doubts import summary_of_trials
from osl_analysis.stats.fit_row import Row, estimates_row
from osl_analysis.timebase.device_clock import drift_row

SUMMARISED = ("B_j", "J_j", "VAF", "T_C", "VAF_coulomb")
"""Columns of the transmission table of which `transmission_summary.csv` has a mean over trials."""
LOSSES = ("B_j", "J_j")


def transmission_of(record: Record) -> Analysis:
    """Eq. 4 fitted to a record of a stepped sine; raises as `analysed`."""
    return analysed(record, plain_sums(record, TRANSMISSION), TRANSMISSION)


def transmission_table(analysis: Analysis) -> pl.DataFrame:
    """The trial's rows of `transmission.csv`: one per amplitude [deg], and one for all of them (amplitude null).

    `coulomb_share` is the share of B_j that Coulomb friction replaces if it is fitted too. `load_cell_drift`
    [N*m/min] was subtracted from the torque. A lag of the torque is not among the diagnostics, because it cannot be
    told from an inertia of -B_j times the lag.
    """
    record, s = analysis.record, sums_of(analysis.record, TRANSMISSION)
    phasors, found = phasors_of_record(record), causes(record, s, TRANSMISSION)
    largest = record.settings.time_base.largest_drift_ppm if record.settings else np.inf
    clocks = drift_row(clock_drift_of(record, s, TRANSMISSION, found, largest))
    commanded = {one.label: one.commanded for one in record.groups.strata}
    rows: list[Row] = []
    for label, fit in analysis.fits.items():
        friction, meant = with_effects(s, TRANSMISSION, ("T_C",), label), commanded.get(label)
        even, odd = harmonic_shares(at_amplitude(phasors, label), (0.0, fit["B_j"], fit["J_j"]))
        rows.append(
            {
                "trial": record.name,
                "amplitude_deg": label if isinstance(label, float) else None,
                "commanded_deg": None if meant is None else round(float(np.rad2deg(meant)), 9),
                **analysis.rows(label, *LOSSES),
                **estimates_row(friction, "T_C"),
                "B_j_coulomb": friction["B_j"],
                "VAF_coulomb": friction.vaf,
                "even_harmonics": even,
                "odd_harmonics": odd,
                "coulomb_torque": friction["T_C"],
                "coulomb_damping": fit["B_j"] - friction["B_j"],
                **analysis.shared(label, *LOSSES),
                "coulomb_share": 1 - friction["B_j"] / fit["B_j"],
                **clocks,
            }
        )
    numbers = dict.fromkeys(("amplitude_deg", "commanded_deg", "VAF_held_out", *clocks), pl.Float64)
    return pl.DataFrame(rows, schema_overrides=numbers, infer_schema_length=None)


def transmission_summary(table: pl.DataFrame) -> pl.DataFrame:
    return summary_of_trials(table.filter(pl.col("amplitude_deg").is_null()), SUMMARISED)
