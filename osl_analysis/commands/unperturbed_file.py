"""The file of the unperturbed crossings on their common grid of stance phase."""

from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.crossing_file import PLATE_ERROR
from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.walking.perturbation import PHASES, NormalGait


def write_normal_gait(normal: NormalGait, path: Path) -> None:
    """Write unperturbed crossings: a row per crossing and phase."""
    n = len(PHASES)
    frame = pl.DataFrame(
        {
            "trial": [name for name in normal.names for _ in range(n)],
            "stance_s": np.repeat(normal.stance, n),
            "phase": np.tile(PHASES, len(normal.names)),
            "theta": normal.theta.ravel(),
            "torque": normal.torque.ravel(),
            **{f"{PLATE_ERROR}{i}": error.ravel() for i, error in enumerate(normal.plate_errors)},
        }
    )
    with atomic_path(path) as temporary:
        frame.write_parquet(temporary)


def read_normal_gait(path: Path) -> NormalGait:
    """Read what `write_normal_gait` wrote."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; run the step 'average-unperturbed' first")
    try:
        frame = pl.read_parquet(path)
        names = frame["trial"].unique(maintain_order=True).to_list()
        theta, torque, stance = (frame[c].to_numpy().reshape(len(names), -1) for c in ("theta", "torque", "stance_s"))
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(f"{path}: not unperturbed gait ({str(error).splitlines()[0]}); write it again") from error
    errors = frame.select(pl.col(f"^{PLATE_ERROR}.*$")).to_numpy().T.reshape(-1, *theta.shape)
    return NormalGait(tuple(names), theta, torque, stance[:, 0], errors)
