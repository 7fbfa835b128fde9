"""The numbers that the figures of walking plot."""

from collections.abc import Sequence
from pathlib import Path

import polars as pl

from osl_analysis.commands.walking import commanded, over_stance, selected_crossings
from osl_analysis.commands.walking_files import read_unperturbed_gaits
from osl_analysis.doubtful import DOUBTFUL
from osl_analysis.table import read_table, write_table
from osl_analysis.walking.gait import unperturbed_gait
from osl_analysis.walking.settings import TimingSettings
from osl_analysis.walking.tables import trajectory_points, walking_page_points


def plot_walking_page(
    *,
    crossings: Sequence[Path],
    selection: Path,
    unperturbed: Path,
    responses: Path,
    table: Path,
    settings: TimingSettings,
    output: Path,
) -> None:
    """Write the numbers that the walking page plots. `crossings` are the perturbed ones, `selection` is
    `walking_crossings.csv`, `responses` `walking_responses.csv`, `table` `walking.csv`."""
    isolated = read_table(responses, ["group", "trial", "time", "theta_deg", "torque", "torque_model"])
    doubtful = read_table(table, ["trial", DOUBTFUL]).select("trial", DOUBTFUL)
    isolated = isolated.join(doubtful, on="trial", how="left", maintain_order="left")
    chosen, gaits = selected_crossings(crossings, selection), read_unperturbed_gaits(unperturbed)
    places = {row["trial"]: row for row in read_table(selection, ["trial", "gait"]).iter_rows(named=True)}
    frames = []
    for of_group in isolated.partition_by("group", maintain_order=True):
        names, group = set(of_group["trial"]), of_group["group"][0]
        perturbed = [c for c in chosen if c.name in names]
        gait = gaits[places[perturbed[0].name]["gait"]]
        both = {"unperturbed": gait, "perturbed": unperturbed_gait(perturbed, 2)}
        points = walking_page_points(perturbed, both, of_group.drop("group"), settings.timing)
        frames.append(points.with_columns(group=pl.lit(group)))
    write_table(pl.concat(frames, how="diagonal"), output)


def plot_over_stance(
    table: Path, output: Path, stance_share: float, trajectory: Sequence[Path] = (), data: str = ""
) -> None:
    """What the figure draws: the rows of the table, and the points of the commanded trajectory."""
    rows = read_table(table, ("series", "quantity", "phase", "estimate", "low", "high"))
    for path in commanded(trajectory, data):
        rows = pl.concat([rows, trajectory_points(*over_stance(path, stance_share))], how="diagonal_relaxed")
    write_table(rows, output)
