"""Gain selection for one pair, a grid or a trajectory of desired impedances, and the behaviour that
theory predicts."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from osl_analysis.config.impedance_trajectory import read_impedance_trajectory
from osl_analysis.errors import naming
from osl_analysis.figures import DESIRED, LINEAR_MODEL, drawn, plotted_numbers
from osl_analysis.model import compensator, drivetrain
from osl_analysis.model.compensator import Weight
from osl_analysis.model.rendered_impedance import predicted_impedance, rendering
from osl_analysis.report.text_tables import aligned
from osl_analysis.table import write_table

# frequencies of Section III-B, at which the fit of Eq. 15 is predicted
TESTED_HZ = (1.0, 2.0, 3.0, 4.0, 5.0)
DRAWN_HZ = (0.1, 10.0)  # ends of the response that is drawn of one pair
DRAWN_POINTS = 201
FAR = 0.25  # relative difference of the predicted K from K_d that is warned of
PRINTED = (  # columns of the text about several pairs
    "phase", "K_d", "B_d", "K_1", "B_1", "error", "K_predicted", "B_predicted", "faithful_to_hz",
)  # fmt: skip


def gain_table(
    K_d: ArrayLike,
    B_d: ArrayLike,
    p: drivetrain.DrivetrainParameters,
    weight: Weight,
    frequencies_hz: Sequence[float],
) -> pl.DataFrame:
    """A row per pair K_d [N*m/rad], B_d [N*m*s/rad], arrays of shape (pairs,); `results
    --columns` explains the columns.

    They are the gains at the actuator's output and at the joint (times n_T^2), the norm of Eq. 14,
    the flags of `optimal_damping`, the fit of Eq. 15 that linear theory predicts at
    `frequencies_hz`, and the stability, passivity and fidelity of the impedance (`rendering`);
    these are null where no finite B_1 is best."""
    compensator.check_request(K_d, B_d, p)
    K_d = np.asarray(K_d, dtype=float)
    B_d = np.asarray(B_d, dtype=float)
    K_1 = compensator.stiffness_gain(K_d, p)
    optimum = compensator.optimal_damping(K_d, B_d, p, weight)
    B_1 = optimum.B_1
    of_gains: dict[str, Any] = {
        "K_d": K_d,
        "B_d": B_d,
        "K_1": K_1,
        "B_1": B_1,
        "K_1_joint": K_1 * p.n_T**2,
        "B_1_joint": B_1 * p.n_T**2,
        **optimum._asdict(),
    }
    table = pl.DataFrame(of_gains).with_row_index("row")

    finite = np.flatnonzero(np.isfinite(B_1))
    fits = np.empty((len(finite), 3))
    for k, pair in enumerate(finite):
        gains = compensator.Gains(K_1[pair], B_1[pair], True)
        fits[k] = predicted_impedance(gains, p, frequencies_hz)
    rendered = rendering(K_1[finite], B_1[finite], K_d[finite], B_d[finite], p)
    behaviour = pl.DataFrame(
        {
            "row": pl.Series(finite, dtype=pl.UInt32),
            **dict(zip(("K_predicted", "B_predicted", "I_predicted"), fits.T, strict=True)),
            **rendered._asdict(),
        }
    )
    return table.join(behaviour, on="row", how="left", maintain_order="left").drop("row")


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
        return trajectory_table(trajectory, p, weight)
    K_d, B_d = np.meshgrid(stiffness, damping, indexing="ij")
    return gain_table(K_d.ravel(), B_d.ravel(), p, weight, TESTED_HZ)


def trajectory_table(
    trajectory: Path, p: drivetrain.DrivetrainParameters | None, weight: Weight
) -> pl.DataFrame:
    """The table of gains for every row of a trajectory file, `phase` first; a refusal names the
    file. `trajectory` is what the file says of itself, as synthetic. Without parameters there are
    no gains."""
    desired = read_impedance_trajectory(trajectory)
    with naming(trajectory):
        if p is None:
            no_gain = pl.lit(None, pl.Float64)
            table = pl.DataFrame({"K_d": desired.K_d, "B_d": desired.B_d})
            table = table.with_columns(K_1_joint=no_gain, B_1_joint=no_gain)
        else:
            table = gain_table(desired.K_d, desired.B_d, p, weight, TESTED_HZ)
    kind = pl.lit(desired.kind, pl.String).alias("trajectory")
    return table.select(pl.Series("phase", desired.phase), kind, pl.all())


def select_trajectory(
    trajectory: Path,
    weight: Weight,
    output: Path,
    parameters: drivetrain.FileOrNone = None,
    data: str = "",
) -> None:
    """Write the gains for every row of a trajectory (Fig. 8)."""
    p = drivetrain.known_parameters(parameters)
    write_table(trajectory_table(trajectory, p, weight), output, data)


def gains_text(table: pl.DataFrame) -> str:
    """The table as text: one pair in words, several pairs in columns."""
    if len(table) > 1:
        return columns_text(table)
    row = table.row(0, named=True)
    minima = "exactly one local minimum" if row["minima"] == 1 else f"{row['minima']} local minima"
    lines = [
        f"K_1 = {row['K_1']:.6g} N·m/rad ({row['K_1_joint']:.6g} at the joint)",
        f"B_1 = {row['B_1']:.6g} N·m·s/rad ({row['B_1_joint']:.6g} at the joint)",
        f"||W (Y - Y_d)||_2 = {row['error']:.4g} rad/(N·m)·s^-1/2; {minima} among the stable gains",
    ]
    if row["at_lower_bound"]:
        lines.append(
            "warning: the joint alone damps more than desired; B_1 is the smallest stable gain"
        )
    if row["unbounded"]:
        lines.append(
            "warning: no finite B_1 minimises Eq. 14, a locked motor would be best; lower"
            " --weight-hz"
        )
        return "\n".join(lines)

    lines.append(
        f"predicted fit over 1 to 5 Hz: K {row['K_predicted']:.4g} N·m/rad, B"
        f" {row['B_predicted']:.4g} N·m·s/rad, I {row['I_predicted']:.3g} kg·m² (friction"
        " cancelled)"
    )
    if abs(row["K_predicted"] / row["K_d"] - 1) > FAR:
        lines.append(
            f"warning: this K is far from {row['K_d']:g}: the leg renders K_d at rest; ask for more"
            " damping, or lower --weight-hz"
        )
    lines += [
        f"within 10 % of the desired impedance up to {row['faithful_to_hz']:.3g} Hz; passive",
        f"the slowest mode decays with {row['decay_rate']:.3g} 1/s; with the joint held, "
        f"{1e3 * row['delay_margin']:.3g} ms of delay in the loop make it unstable",
    ]
    return "\n".join(lines)


def columns_text(table: pl.DataFrame) -> str:
    """Several pairs as text: a line for each, behind one with the names of the columns."""
    columns = [name for name in PRINTED if name in table.columns]
    numbers = [[f"{number:.5g}" for number in row] for row in table.select(columns).iter_rows()]
    return aligned([columns, *numbers])


def plot_gains(table: pl.DataFrame, parameters: Path, output: Path) -> None:
    """Draw the response of one pair over 0.1 to 10 Hz (as Fig. 7), a grid of gains, or a trajectory
    (as Fig. 8)."""
    from osl_analysis.commands.figure import write_figure  # matplotlib takes half a second

    if len(table) == 1:
        p = drivetrain.read_parameters(parameters)
        figure = drawn("fig7", response_of_pair(table.row(0, named=True), p))
    elif "phase" in table.columns:
        figure = drawn("fig8", plotted_numbers("fig8", table))
    else:
        figure = drawn("gain_grid", table)
    write_figure(figure, [output])


def response_of_pair(row: dict[str, Any], p: drivetrain.DrivetrainParameters) -> pl.DataFrame:
    """The rows of Fig. 7 for one pair: the desired response, and that of the linear model."""
    from osl_analysis.commands.figure import response_curve

    frequency_hz = np.geomspace(*DRAWN_HZ, DRAWN_POINTS)
    desired = drivetrain.desired_admittance(row["K_d"], row["B_d"])
    rendered = drivetrain.joint_admittance(row["K_1"], row["B_1"], p, p.J_j)
    curves = [
        response_curve(DESIRED, None, frequency_hz, desired),
        response_curve(LINEAR_MODEL, "compensated", frequency_hz, rendered),
    ]
    return plotted_numbers("fig7", pl.concat(curves))
