# SPDX-License-Identifier: Apache-2.0
"""Crossings by formula, with a turn up or down, for tests of groups: their files, and every job on
them."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from walking_synthetic import RATE, bump, settings

from osl_analysis.base.table import read_table, write_table
from osl_analysis.commands import walking, walking_summary
from osl_analysis.commands.tables import gather, judge_table
from osl_analysis.judge.limits import Limits
from osl_analysis.walking.crossing import PER_UNIT, Crossing
from osl_analysis.walking.groups import selection_rows
from osl_analysis.walking.plate import Stance
from osl_analysis.walking.plate_inertia import NO_CORRECTION
from osl_analysis.walking.plate_lag import PlateTiming
from osl_analysis.walking.walking_settings import WalkingAnalysis

LEAD = 0.045
RISE = 0.018
TURN = 0.087
"""The turn is an error function, at rest to 0.02 % at the onset, `LEAD` [s] before its middle; its
size is 5 deg."""


@dataclass(frozen=True)
class Walk:
    """A way to make a crossing."""

    phase: float | None = None  # onset of the perturbation as a share of stance; None: unperturbed
    sign: int = 1  # 1 toes up, -1 toes down
    impedance: tuple[float, float, float] = (340.0, 5.0, 0.03)
    gait: float = 1.0  # factor of angle and torque of the gait
    stance: float = 0.72  # duration [s]
    common: float = 0.0  # torque [N*m] that follows a turn in either direction
    noise: float = 0.4  # size [N*m] of the slow deviations of the torque


def crossing(
    name: str,
    onset: float | None = None,
    stance: float = 0.72,
    impedance: tuple[float, float, float] = (340.0, 5.0, 0.03),
    turn: float = TURN,
    gait: float = 1.0,
) -> Crossing:
    """A crossing by formula, the same wherever its name is another one."""
    time = 0.3 + np.arange(-30, round(stance * RATE) + 30) / RATE
    phase = (time - 0.3) / stance
    theta = gait * (0.2 * np.sin(5 * phase) - 0.1 * phase**2)
    torque = gait * 90 * np.sin(np.pi * phase) ** 2 * (1 + phase)
    if onset is not None:
        d, v, a = turn * bump(time, onset + LEAD, RISE)
        theta = theta + d
        torque = torque + impedance[0] * d + impedance[1] * v + impedance[2] * a
    span = Stance(0.3, 0.3 + stance)
    no_change = np.zeros((len(PER_UNIT), len(time)))
    turned = None if onset is None else turn
    force = 700 * np.clip(np.sin(np.pi * np.clip(phase, 0, 1)) * 1.15, 0, 0.95)
    load = np.array([force, 0 * time, 0 * time])
    return Crossing(name, time, theta, torque, load, span, onset, 0.0, no_change, turn=turned)


def selected(
    crossings: Sequence[Crossing], chosen: WalkingAnalysis
) -> dict[str, dict[str, object]]:
    """Rows of `walking_crossings.csv` of crossings of which the sheet says nothing else."""
    return selection_rows(
        crossings, {}, chosen, {c.name: {"perturbed": c.onset is not None} for c in crossings}
    )


def walked(name: str, walk: Walk) -> Crossing:
    """A crossing with its own slow deviations, which its name determines."""
    random = np.random.default_rng(zlib.crc32(name.encode()))
    stance = walk.stance * (1 + 0.01 * random.standard_normal())
    onset = None
    if walk.phase is not None:
        onset = 0.3 + walk.phase * walk.stance + 0.003 * random.standard_normal()
    plain = crossing(name, onset, stance, walk.impedance, turn=walk.sign * TURN, gait=walk.gait)
    torque = plain.torque.copy()
    if onset is not None:
        torque += walk.common * bump(plain.time, onset + LEAD, RISE)[0]
    size = walk.noise * random.standard_normal()
    torque += size * np.sin(2 * np.pi * (2 * plain.time + random.random()))
    return replace(plain, torque=torque)


@dataclass(frozen=True)
class Tables:
    """The tables of a campaign, by name."""

    folder: Path

    def __getitem__(self, name: str) -> pl.DataFrame:
        return read_table(self.folder / f"{name}.csv")

    def estimate(
        self, group: str, quantity: str = "K", estimator: str = "ensemble"
    ) -> dict[str, Any]:
        """One row of the summary."""
        rows = self["summary"].filter(group=group, quantity=quantity, estimator=estimator)
        return rows.row(0, named=True)


def run_jobs(
    folder: Path,
    perturbed: Sequence[str],
    unperturbed: Sequence[str],
    chosen: WalkingAnalysis,
    sheet: Mapping[str, Mapping[str, object]] | None = None,
    limits: Limits | None = None,
    limits_of_groups: Limits | None = None,
) -> Tables:
    """Every job from the crossings in a folder to the summary. `sheet` has their conditions, in its
    order."""
    names = [*perturbed, *unperturbed]
    sheet = sheet or {name: {"perturbed": name in perturbed} for name in names}
    file_of = {name: folder / f"crossings/{name}.parquet" for name in names}
    turned = [file_of[name] for name in perturbed]
    at_rest = [file_of[name] for name in unperturbed]
    selection = folder / "selection.csv"
    gait = folder / "gait.json"
    table = folder / "walking.csv"

    if not (folder / "plate.json").exists():
        walking.write_model(NO_CORRECTION, folder / "plate.json")
        walking.write_model(PlateTiming({}, {}), folder / "timing.json")
    walking.select_crossings([*turned, *at_rest], chosen, selection, sheet)
    walking.average_unperturbed(at_rest, selection, chosen.fewest_unperturbed, gait)
    fits = [folder / f"fits/{name}.csv" for name in perturbed]
    for file, fit in zip(turned, fits, strict=True):
        walking.fit_perturbation(file, selection, gait, chosen, fit)
    of_fits, of_groups = folder / "_walking.parquet", folder / "_walking_groups.parquet"
    write_table(judge_table("walking", limits or Limits(), fits), of_fits)
    write_table(gather(fits, "walking", [of_fits]), table)
    walking_summary.summarise_perturbations(
        walking_summary.SummaryFiles(
            table=table,
            crossings=turned,
            selection=selection,
            unperturbed=gait,
            plate=folder / "plate.json",
            timing=folder / "timing.json",
        ),
        settings=chosen,
        sheet=sheet,
        places={name: {"joint": "ankle", "side": row.get("side")} for name, row in sheet.items()},
        has_drivetrain=True,
        outputs=walking_summary.SummaryOutputs(
            summary=folder / "walking_summary.csv",
            responses=folder / "responses.csv",
            groups=folder / "walking_groups.csv",
            budget=folder / "budget.csv",
        ),
    )
    name, rows = "walking_groups", [folder / "walking_groups.csv"]
    judged = judge_table(name, limits_of_groups or Limits(), rows, [folder / "budget.csv"])
    write_table(judged, of_groups)
    write_table(gather(rows, name, [of_groups]), folder / "groups.csv")
    summary = walking_summary.tabulate_groups(
        folder / "walking_summary.csv", table, [of_fits, of_groups]
    )
    write_table(summary, folder / "summary.csv")
    return Tables(folder)


def campaign(
    folder: Path,
    walks: Mapping[str, Walk],
    cells: Mapping[str, Mapping[str, object]] | None = None,
    **choices: Any,
) -> Tables:
    """Write crossings and run every job on them. `cells` are conditions in the sheet, by trial,
    also of trials that it excludes."""
    sheet = dict(cells or {})
    for name, walk in walks.items():
        walking.write_crossing(walked(name, walk), folder / f"crossings/{name}.parquet")
        sheet[name] = {"perturbed": walk.phase is not None, **sheet.get(name, {})}
    perturbed = [name for name, walk in walks.items() if walk.phase is not None]
    unperturbed = [name for name, walk in walks.items() if walk.phase is None]
    return run_jobs(folder, perturbed, unperturbed, settings(**choices), sheet)


def several(prefix: str, count: int, walk: Walk, **changes: Any) -> dict[str, Walk]:
    """So many crossings of one kind, by name."""
    return {f"{prefix}{k}": replace(walk, **changes) for k in range(count)}
