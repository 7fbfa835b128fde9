"""The lines of the periods of trials as a table, and realisations of one motion in several trials."""

from collections.abc import Mapping, Sequence

import numpy as np
import polars as pl

from osl_analysis.spectral.lines import PERIODS_AGREE
from osl_analysis.spectral.realisations import Realisation, with_common_lines
from osl_analysis.trial import Array

SIZES_AGREE = 0.1
"""Largest difference between the sizes of two motions, and of their lines, that are realisations of one condition, as a
share. Friction weighs more in a smaller motion."""
NUMBERS = (
    "period_s", "rate_hz", "start_s", "theta_step", "torque_step", "theta_re", "theta_im", "torque_re", "torque_im",
)  # fmt: skip
LINES: dict[str, type[pl.DataType]] = {
    "trial": pl.String,
    **dict.fromkeys(("realisation", "period", "line"), pl.Int64),
    **dict.fromkeys(NUMBERS, pl.Float64),
}
"""Columns of the lines of the periods of a trial."""


def lines_frame(trial: str, realisations: Sequence[Realisation]) -> pl.DataFrame:
    """A row per realisation, period and line."""
    frames = []
    for number, one in enumerate(realisations):
        period, line = (index.ravel() for index in np.indices(one.theta.shape))
        theta, torque = one.theta.ravel(), one.torque.ravel()
        columns: dict[str, object] = {
            "trial": trial, "realisation": number, "period": period, "line": line, "period_s": one.period,
            "rate_hz": one.rate_hz, "start_s": one.start,
            "theta_step": one.steps[0], "torque_step": one.steps[1], "theta_re": theta.real, "theta_im": theta.imag,
            "torque_re": torque.real, "torque_im": torque.imag,
        }  # fmt: skip
        frames.append(pl.DataFrame(columns, schema=LINES))
    return pl.concat(frames)


def realisations_from(lines: pl.DataFrame) -> list[Realisation]:
    """The realisations of one trial that `lines_frame` wrote."""
    made = []
    for rows in lines.partition_by("realisation", maintain_order=True):
        shape = (rows["period"].n_unique(), rows["line"].n_unique())
        theta, torque = (
            (rows[f"{name}_re"].to_numpy() + 1j * rows[f"{name}_im"].to_numpy()).reshape(shape)
            for name in ("theta", "torque")
        )
        period, rate_hz, start, *steps = rows.select("period_s", "rate_hz", "start_s", "theta_step", "torque_step").row(
            0
        )
        made.append(Realisation(period, rate_hz, theta, torque, start, (steps[0], steps[1])))
    return made


def alike(first: Realisation, second: Realisation) -> bool:
    """Whether two motions differ in their phases only: the same period, and lines of the same size."""
    if abs(first.period - second.period) > PERIODS_AGREE * first.period:
        return False
    one, two = map(sizes, with_common_lines([first, second]))
    return bool(np.linalg.norm(one - two) <= SIZES_AGREE * np.linalg.norm(one))


def sizes(one: Realisation) -> Array:
    """Amplitudes [rad] of the angle's lines, without the mean."""
    return np.asarray(np.abs(one.theta.mean(axis=0)[1:]))


def pooled(trials: Mapping[str, Sequence[Realisation]]) -> list[dict[str, list[Realisation]]]:
    """Trials of one condition, each by name with its realisations, sorted by motions that are alike; two or more each.

    A trial whose own realisations differ is with those that are like its first one.
    """
    groups: list[dict[str, list[Realisation]]] = []
    for name, made in trials.items():
        for group in groups:
            if alike(next(iter(group.values()))[0], made[0]):
                group[name] = list(made)
                break
        else:
            groups.append({name: list(made)})
    return [group for group in groups if len(group) > 1]
