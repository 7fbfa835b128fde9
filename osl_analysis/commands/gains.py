"""Gain selection for a trajectory of desired impedances (Fig. 8)."""

from pathlib import Path

import polars as pl

from osl_analysis.errors import InputError, UnreachableImpedanceError
from osl_analysis.model.compensator import admittance_error, compensated_gains
from osl_analysis.parameters import read_parameters
from osl_analysis.table_file import write_table

def one_pair(K_d: float, B_d: float, parameters: Path) -> dict[str, float]:
    """Gains for one desired impedance: K_1, B_1 at the actuator's output, both times n_T^2, and the norm of Eq. 14.

    Raises
    ------
    UnreachableImpedanceError
        No gains render it.
    """
    p = read_parameters(parameters)
    gains = compensated_gains(K_d, B_d, p)
    return {
        "K_d": K_d,
        "B_d": B_d,
        "K_1": gains.K_1,
        "B_1": gains.B_1,
        "K_1_joint": gains.K_1 * p.n_T**2,
        "B_1_joint": gains.B_1 * p.n_T**2,
        "error": admittance_error(K_d, B_d, gains.K_1, gains.B_1, p),
    }


TRAJECTORY_COLUMNS = ("phase", "K_d", "B_d")


def read_trajectory(path: Path) -> pl.DataFrame:
    """A desired-impedance trajectory: CSV with `phase` (0 to 1), `K_d` [N*m/rad], `B_d` [N*m*s/rad], # comments.

    Raises
    ------
    InputError
        The file is missing, lacks a column, or holds something that is not a number.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such impedance trajectory; correct `impedance_trajectory` in the configuration")
    try:
        table = pl.read_csv(path, comment_prefix="#")
    except pl.exceptions.PolarsError as error:
        raise InputError(f"{path}: not a CSV table ({str(error).splitlines()[0]}); write {TRAJECTORY_COLUMNS}") from error
    for column in TRAJECTORY_COLUMNS:
        if column not in table.columns:
            raise InputError(f"{path}: no column '{column}'; it has {', '.join(table.columns)}")
        if not table[column].dtype.is_numeric() or table[column].null_count():
            raise InputError(f"{path}: column '{column}' must hold a number in every row, in SI units")
    return table


def select_trajectory(trajectory: Path, parameters: Path, output: Path) -> None:
    """Gains for every row of a trajectory: K_1 and B_1 at the actuator's output, and both times n_T^2.

    Raises
    ------
    UnreachableImpedanceError
        A row asks for the impossible; names the row.
    """
    p, rows = read_parameters(parameters), []
    for number, (phase, K_d, B_d) in enumerate(read_trajectory(trajectory).select(TRAJECTORY_COLUMNS).rows(), start=1):
        try:
            gains = compensated_gains(K_d, B_d, p)
        except UnreachableImpedanceError as error:
            raise UnreachableImpedanceError(f"{trajectory}: row {number} (phase {phase:g}): {error}") from error
        rows.append({"phase": phase, "K_d": K_d, "B_d": B_d, "K_1": gains.K_1, "B_1": gains.B_1})
    scaled = (pl.col("K_1", "B_1") * p.n_T**2).name.suffix("_joint")
    write_table(pl.DataFrame(rows).with_columns(scaled), output)
