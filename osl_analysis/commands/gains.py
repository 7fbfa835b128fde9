"""Gain selection for one pair, a grid or a trajectory of desired impedances, and the behaviour that theory predicts."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from osl_analysis.commands.bench import rows_json
from osl_analysis.commands.figure import draw_table
from osl_analysis.config.shared_choices import read_impedance_trajectory
from osl_analysis.errors import InputError, UnreachableImpedanceError
from osl_analysis.figures import drawing_of
from osl_analysis.files import atomic_path
from osl_analysis.model import compensator
from osl_analysis.model.compensator import Weight
from osl_analysis.model.drivetrain import desired_admittance, joint_admittance
from osl_analysis.model.parameters import DrivetrainParameters, FileOrNone, known_parameters, read_parameters
from osl_analysis.table import write_table

TESTED_HZ = (1.0, 2.0, 3.0, 4.0, 5.0)  # frequencies of Section III-B, at which the fit of Eq. 15 is predicted


def gain_table(
    K_d: ArrayLike, B_d: ArrayLike, p: DrivetrainParameters, weight: Weight, frequencies_hz: Sequence[float]
) -> pl.DataFrame:
    """A row per pair K_d [N*m/rad], B_d [N*m*s/rad], arrays of shape (pairs,); `describe-tables` has the columns.

    They are the gains at the actuator's output and at the joint (times n_T^2), the norm of Eq. 14, the flags of
    `optimal_damping`, the fit of Eq. 15 that linear theory predicts at `frequencies_hz`, and the stability, passivity
    and fidelity of the impedance (`rendering`); these are null where no finite B_1 is best.
    """
    compensator.check_request(K_d, B_d, p)
    K_d, B_d = (np.asarray(v, dtype=float) for v in (K_d, B_d))
    K_1, optimum = compensator.stiffness_gain(K_d, p), compensator.optimal_damping(K_d, B_d, p, weight)
    B_1, finite = optimum["B_1"], np.isfinite(optimum["B_1"])
    at_joint = {"K_1_joint": K_1 * p.n_T**2, "B_1_joint": B_1 * p.n_T**2}
    table = pl.DataFrame({"K_d": K_d, "B_d": B_d, "K_1": K_1, "B_1": B_1} | at_joint | optimum)
    gains = [compensator.Gains(k, b, True) for k, b in zip(K_1[finite], B_1[finite], strict=True)]
    fits = [compensator.predicted_impedance(one, p, frequencies_hz) for one in gains]
    columns: dict[str, Any] = {f"{name}_predicted": [fit[k] for fit in fits] for k, name in enumerate("KBI")}
    rendered = compensator.rendering(K_1[finite], B_1[finite], K_d[finite], B_d[finite], p)
    columns |= {"decay_rate": rendered["decay_rate"], "delay_margin": rendered["delay_margin"]}
    columns |= {"passive": [True] * len(fits), **{n: rendered[n] for n in ("positive_real", "faithful_to_hz")}}
    behaviour = pl.DataFrame(columns).with_columns(row=pl.Series(np.flatnonzero(finite), dtype=pl.UInt32))
    return table.with_row_index("row").join(behaviour, on="row", how="left", maintain_order="left").drop("row")


def requested_gains(
    stiffness: Sequence[float], damping: Sequence[float], trajectory: Path | None, weight: Weight, parameters: Path
) -> pl.DataFrame:
    """The gains for every row of a trajectory file, or for every combination of K_d [N*m/rad] and B_d [N*m*s/rad]."""
    p = read_parameters(parameters)
    if trajectory is not None:
        return trajectory_table(trajectory, p, weight)
    K_d, B_d = (v.ravel() for v in np.meshgrid(stiffness, damping, indexing="ij"))
    return gain_table(K_d, B_d, p, weight, TESTED_HZ)


def trajectory_table(trajectory: Path, p: DrivetrainParameters | None, weight: Weight) -> pl.DataFrame:
    """The table of gains for every row of a trajectory file, `phase` first; a refusal names the file. `trajectory` is
    what the file says of itself, as synthetic. Without parameters there are no gains."""
    desired = read_impedance_trajectory(trajectory)
    try:
        if p is None:
            none = dict.fromkeys(("K_1_joint", "B_1_joint"), pl.lit(None, pl.Float64))
            table = pl.DataFrame({"K_d": desired.K_d, "B_d": desired.B_d}).with_columns(**none)
        else:
            table = gain_table(desired.K_d, desired.B_d, p, weight, TESTED_HZ)
    except UnreachableImpedanceError as error:
        raise UnreachableImpedanceError(f"{trajectory}: {error}") from error
    kind = pl.lit(desired.kind, pl.String).alias("trajectory")
    return table.select(pl.Series("phase", desired.phase), kind, pl.all())


def select_trajectory(trajectory: Path, weight: Weight, output: Path, parameters: FileOrNone = None) -> None:
    """Write the gains for every row of a trajectory (Fig. 8)."""
    write_table(trajectory_table(trajectory, known_parameters(parameters), weight), output)


def write_gains(table: pl.DataFrame, output: Path) -> None:
    if output.suffix == ".csv":
        write_table(table, output)
    elif output.suffix == ".json":
        with atomic_path(output) as temporary:
            temporary.write_text(rows_json(table) + "\n", encoding="utf-8")
    else:
        raise InputError(f"{output}: gains are written as .csv or .json; choose one of these suffixes")


def gains_text(table: pl.DataFrame) -> str:
    """The table as text: one pair in words, several pairs in columns."""
    if len(table) > 1:
        printed = ("phase", "K_d", "B_d", "K_1", "B_1", "error", "K_predicted", "B_predicted", "faithful_to_hz")
        columns = [c for c in printed if c in table.columns]
        rows = [columns, *([f"{v:.5g}" for v in row] for row in table.select(columns).rows())]
        return "\n".join("".join(f"{cell:>15}" for cell in row) for row in rows)
    row = table.row(0, named=True)
    minima = "exactly one local minimum" if row["minima"] == 1 else f"{row['minima']} local minima"
    lines = [
        f"K_1 = {row['K_1']:.6g} N·m/rad ({row['K_1_joint']:.6g} at the joint)",
        f"B_1 = {row['B_1']:.6g} N·m·s/rad ({row['B_1_joint']:.6g} at the joint)",
        f"||W (Y - Y_d)||_2 = {row['error']:.4g} rad/(N·m)·s^-1/2; {minima} among the stable gains",
    ]
    if row["at_lower_bound"]:
        lines.append("warning: the joint alone damps more than desired; B_1 is the smallest stable gain")
    if row["unbounded"]:
        lines.append("warning: no finite B_1 minimises Eq. 14, a locked motor would be best; lower --weight-hz")
    else:
        lines += [
            f"predicted fit over 1 to 5 Hz: K {row['K_predicted']:.4g} N·m/rad, B {row['B_predicted']:.4g} N·m·s/rad, "
            f"I {row['I_predicted']:.3g} kg·m² (friction cancelled)",
            f"within 10 % of the desired impedance up to {row['faithful_to_hz']:.3g} Hz; passive",
            f"the slowest mode decays with {row['decay_rate']:.3g} 1/s; with the joint held, "
            f"{1e3 * row['delay_margin']:.3g} ms of delay in the loop make it unstable",
        ]
    return "\n".join(lines)


def plot_gains(table: pl.DataFrame, parameters: Path, output: Path) -> None:
    """Draw the response of one pair over 0.1 to 10 Hz (as Fig. 7), the gains of a grid, or those of a trajectory (as
    Fig. 8)."""
    if len(table) == 1:
        from osl_analysis.figures.frequency import DESIRED, FIG7, LINEAR_MODEL, response_curve  # matplotlib: 0.5 s
        from osl_analysis.figures.names import completed

        p, row, f = read_parameters(parameters), table.row(0, named=True), np.geomspace(0.1, 10, 201)
        curves = (
            (DESIRED, None, desired_admittance(row["K_d"], row["B_d"])),
            (LINEAR_MODEL, "compensated", joint_admittance(row["K_1"], row["B_1"], p, p.J_j)),
        )
        frames = [response_curve(curve, name, f, Y(2j * np.pi * f), (None, None)) for curve, name, Y in curves]
        draw_table("fig7", completed(pl.concat(frames), FIG7.columns), [output])
    elif "phase" in table.columns:
        draw_table("fig8", drawing_of("fig8").points(table), [output])
    else:
        draw_table("gain_grid", table, [output])
