"""Impedance over several trials of one condition, as over the realisations of a random excitation."""

import numpy as np
import polars as pl

from osl_analysis.doubtful import counted, doubtful_row
from osl_analysis.stats.repeats import summary_row

SAME_MOTION = 0.15
"""Largest relative difference of band, period and size of motions that are realisations of one."""
QUANTITIES = ("K", "B", "I")
"""Estimates that are averaged."""
SAME = ("joint", "side", "controller", "K_d", "B_d", "group", "excitation")
"""Columns in which the trials of one row agree, as far as the table of fits has them."""
TEXT = ("joint", "side", "controller", "group", "excitation", "quantity", "interval_method")
"""Columns of text."""
NUMBERS = ("band_low_hz", "band_high_hz", "n", "mean", "sd", "se", "low", "high", "n_doubtful", "n_left_out")
"""Columns of numbers beside the condition."""


def alike(trials: pl.DataFrame) -> list[pl.DataFrame]:
    """The trials of one condition, apart where their motions differ in band, period or size, in their order."""
    kinds: list[list[int]] = []
    numbers = [name for name in ("band_high_hz", "period_s", "theta_rms_deg") if name in trials.columns]
    values = trials.select(numbers).fill_null(0.0).to_numpy()
    for row, own in enumerate(values):
        near = (kind for kind in kinds if np.allclose(values[kind[0]], own, rtol=SAME_MOTION))
        found = next(near, None)
        if found is None:
            kinds.append([row])
        else:
            found.append(row)
    return [trials[kind] for kind in kinds]


def repeated_trials_table(impedance: pl.DataFrame) -> pl.DataFrame:
    """A row per condition and motion with two trials or more, and quantity, with Student's interval over the trials.

    Each trial counts with its fit to all of its motion. The interval contains everything that differs from trial to
    trial, as the distortion that friction makes of another realisation of a random motion; the intervals of the single
    trials may not. Doubtful fits are left out where half of the trials or more are sound.
    """
    whole = impedance.filter(pl.col("amplitude_deg").is_null())
    keys = [name for name in SAME if name in whole.columns]
    rows = []
    for key, trials in ((key, part) for key, same in whole.group_by(keys, maintain_order=True) for part in alike(same)):
        if len(trials) < 2:
            continue
        used = counted(trials)
        band = {"band_low_hz": trials["band_low_hz"].min(), "band_high_hz": trials["band_high_hz"].max()}
        left_out = {**doubtful_row(trials), "n_left_out": len(trials) - len(used)}
        said = {**dict(zip(keys, key, strict=True)), **band}
        rows += [{**said, "quantity": name, **summary_row(used[name]), **left_out} for name in QUANTITIES]
    if rows:
        return pl.DataFrame(rows, infer_schema_length=None)
    columns = (*keys, "quantity", "interval_method", *NUMBERS)
    return pl.DataFrame(schema={name: pl.String() if name in TEXT else pl.Float64() for name in columns})
