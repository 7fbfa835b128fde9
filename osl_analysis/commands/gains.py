# SPDX-License-Identifier: Apache-2.0
"""Gain selection for one pair, a grid or a trajectory of desired impedances, and the behaviour that
theory predicts."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from osl_analysis.base.errors import naming
from osl_analysis.config.impedance_trajectory import read_impedance_trajectory
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.model import compensator, drivetrain
from osl_analysis.model.compensator import Weight
from osl_analysis.report.typography import aligned

# frequencies of Section III-B, at which the fit of Eq. 15 is predicted
TESTED_HZ = range(1, 6)
# columns of what theory predicts, null where no finite B_1 is best
BEHAVIOUR = ("K_predicted", "B_predicted", "delay_margin", "passive_delay")
PRINTED = (  # columns of the text
    "phase", "K_d", "B_d", "K_1", "B_1", "error", "K_predicted", "B_predicted", "delay_margin",
    "passive_delay",
)  # fmt: skip
# share of K_d by which the predicted K may be off before the table warns; a choice
FAR_FROM_K_D = 0.25


def is_at_lower_bound(table: pl.DataFrame) -> pl.Series:
    return table["at_lower_bound"]


def is_unbounded(table: pl.DataFrame) -> pl.Series:
    return table["unbounded"]


def is_far_from_K_d(table: pl.DataFrame) -> pl.Series:
    return (table["K_predicted"] / table["K_d"] - 1).abs() > FAR_FROM_K_D


WARNINGS: Sequence[tuple[Callable[[pl.DataFrame], pl.Series], str]] = (
    (
        is_at_lower_bound,
        "the joint alone damps more than desired; B_1 is the smallest stable gain",
    ),
    (
        is_unbounded,
        "no finite B_1 minimises Eq. 14, a locked motor would be best; lower --weight-hz",
    ),
    (
        is_far_from_K_d,
        "the predicted K is far from K_d, which is rendered at rest; ask for more damping, or lower"
        " --weight-hz",
    ),
)
"""Which rows of the table (n,) a warning is about."""


def gain_table(
    K_d: ArrayLike,
    B_d: ArrayLike,
    p: drivetrain.DrivetrainParameters,
    weight: Weight,
) -> pl.DataFrame:
    """A row per pair K_d [N*m/rad], B_d [N*m*s/rad], arrays of shape (pairs,); `results
    --columns` explains the columns.

    They are the gains at the actuator's output and at the joint (times n_T^2), the norm of Eq. 14,
    the flags of `optimal_damping`, the fit of Eq. 15 that linear theory predicts at
    `TESTED_HZ`, and the delays that stability and passivity of the impedance bear; these are
    null where no finite B_1 is best."""
    rows = []
    for K, B in zip(np.asarray(K_d).tolist(), np.asarray(B_d).tolist(), strict=True):
        optimum = compensator.optimal_damping(K, B, p, weight)
        K_1 = float(compensator.stiffness_gain(K, p))
        B_1 = optimum.B_1
        row = {
            "K_d": K,
            "B_d": B,
            "K_1": K_1,
            "B_1": B_1,
            "K_1_joint": K_1 * p.n_T**2,
            "B_1_joint": B_1 * p.n_T**2,
            **optimum._asdict(),
            **dict.fromkeys(BEHAVIOUR),
        }
        if not optimum.unbounded:
            predicted = drivetrain.predicted_impedance(K_1, B_1, p, TESTED_HZ)
            row["K_predicted"], row["B_predicted"] = predicted
            row["delay_margin"] = drivetrain.delay_margin(K_1, B_1, p)
            row["passive_delay"] = drivetrain.passive_delay(K_1, B_1, p)
        rows.append(row)
    types = dict.fromkeys(BEHAVIOUR, pl.Float64)
    return pl.DataFrame(rows, schema_overrides=types, infer_schema_length=None)


def requested_gains(
    stiffness: Sequence[float],
    damping: Sequence[float],
    trajectory: Path | None,
    weight: Weight,
    parameters: Path,
) -> pl.DataFrame:
    """The gains for every row of a trajectory file, or for every combination of K_d [N*m/rad] and
    B_d [N*m*s/rad]."""
    p = drivetrain.read_parameters(parameters)
    if trajectory is not None:
        return select_trajectory(trajectory, weight, parameters)
    K_d, B_d = np.meshgrid(stiffness, damping, indexing="ij")
    return gain_table(K_d.ravel(), B_d.ravel(), p, weight)


def select_trajectory(
    trajectory: Path, weight: Weight, parameters: Path | None = None
) -> pl.DataFrame:
    """The table of gains for every row of a trajectory file (Fig. 8), `phase` first; a refusal
    names the file. `trajectory` is what the file says of itself, as synthetic. Without parameters
    there are no gains."""
    p = drivetrain.known_parameters(parameters)
    desired = read_impedance_trajectory(trajectory)
    with naming(trajectory):
        if p is None:
            no_gain = pl.lit(None, pl.Float64)
            table = pl.DataFrame({"K_d": desired.K_d, "B_d": desired.B_d})
            table = table.with_columns(K_1_joint=no_gain, B_1_joint=no_gain)
        else:
            table = gain_table(desired.K_d, desired.B_d, p, weight)
    kind = pl.lit(desired.kind, pl.String).alias("trajectory")
    return table.select(pl.Series("phase", desired.phase), kind, pl.all())


def gains_text(table: pl.DataFrame) -> str:
    """The table as text: the columns of one pair below each other with their units, several pairs
    in lines; then warnings, each with the number of pairs that it is about."""
    columns = [name for name in PRINTED if name in table.columns]
    pairs = table.select(columns).iter_rows()
    rows = [columns, *(["none" if x is None else f"{x:.5g}" for x in pair] for pair in pairs)]
    if len(table) == 1:
        units = described_tables_by_name()["gains"].columns
        rows = [[name, text, units[name].unit] for name, text in zip(*rows, strict=True)]
    text = aligned(rows)
    for is_warned, warning in WARNINGS:
        number = is_warned(table).sum()
        if number:
            text += f"warning, {number} of {len(table)}: {warning}\n"
    return text
