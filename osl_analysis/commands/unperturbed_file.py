"""The file of unperturbed gait, which the walking jobs share: Parquet, a row per gait, crossing and phase."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.walking_files import PLATE_ERROR, plate_error_columns
from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.refusal import check_not_refused
from osl_analysis.walking.unperturbed import PHASES, UnperturbedGait


def write_unperturbed_gaits(gaits: Mapping[str, UnperturbedGait], path: Path) -> None:
    """Write the unperturbed crossings of each gait, by its name: a row per crossing and phase."""
    n = len(PHASES)
    frames = [
        pl.DataFrame(
            {
                "gait": [name] * (n * len(gait.names)),
                "trial": [trial for trial in gait.names for _ in range(n)],
                "stance_s": np.repeat(gait.stance, n),
                "phase": np.tile(PHASES, len(gait.names)),
                "theta": gait.theta.ravel(),
                "torque": gait.torque.ravel(),
                **{f"{PLATE_ERROR}{i}": error.ravel() for i, error in enumerate(gait.plate_errors)},
            }
        )
        for name, gait in gaits.items()
    ]
    with atomic_path(path) as temporary:
        pl.concat(frames).write_parquet(temporary)


def read_unperturbed_gaits(path: Path) -> dict[str, UnperturbedGait]:
    """Read what `write_unperturbed_gaits` wrote: gaits with fewer crossings than the least are not among them."""
    check_not_refused(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; run the step 'average-unperturbed' first")
    try:
        whole = pl.read_parquet(path)
        return {
            str(frame["gait"][0]): gait_from_frame(frame) for frame in whole.partition_by("gait", maintain_order=True)
        }
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(
            f"{path}: not unperturbed gait ({str(error).splitlines()[0]}); delete it and run the step "
            "'average-unperturbed'"
        ) from error


def gait_from_frame(frame: pl.DataFrame) -> UnperturbedGait:
    """The gait whose rows `write_unperturbed_gaits` wrote."""
    names = frame["trial"].unique(maintain_order=True).to_list()
    theta, torque, stance = (frame[c].to_numpy().reshape(len(names), -1) for c in ("theta", "torque", "stance_s"))
    errors = plate_error_columns(frame).reshape(-1, *theta.shape)
    return UnperturbedGait(tuple(names), theta, torque, stance[:, 0], errors)
