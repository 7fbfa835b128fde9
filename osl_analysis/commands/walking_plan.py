"""How many perturbed crossings to record, from the results of a pilot."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.walking_files import read_crossing
from osl_analysis.errors import InputError
from osl_analysis.table import read_table
from osl_analysis.trial import Array
from osl_analysis.walking import walking_settings as choices
from osl_analysis.walking.groups import ALL, SEPARATOR
from osl_analysis.walking.planned_turn import PlannedTurn, half_widths, scatter_of_one

# turn of a platform in studies of walking [rad], its duration [s], and its phase of stance
USUAL_TURN = (float(np.deg2rad(5.0)), 0.08, 0.4)
BEFORE_ONSET_S = 0.02  # where the platform still rests
AFTER_ONSET_S = 1.0  # by when it has turned
RISE_SHARE = 0.506  # of a minimum-jerk ramp's duration, that it needs from 10 to 90 % of its turn


def pilot_turn(folder: Path) -> tuple[float, float, float]:
    """Tell how the platform turned in the perturbed crossings that a campaign uses.

    Parameters
    ----------
    folder : Path
        Results of the campaign.

    Returns
    -------
    turn, duration, phase : float
        Medians of the turns [rad], of their durations [s] as a minimum-jerk ramp, and of their
        onsets as shares of stance; without any turn `USUAL_TURN`.
    """
    table = read_table(folder / "tables/walking_crossings.csv", ["trial", "reason"])
    turns: list[tuple[float, float, float]] = []
    for name in table.filter(pl.col("perturbed"), pl.col("reason").is_null())["trial"]:
        crossing = read_crossing(folder / f"crossings/{name}.parquet")
        if crossing.onset is None or crossing.platform is None or crossing.turn is None:
            continue
        ramp_s = ramp_duration(crossing.time, crossing.platform, crossing.onset)
        if ramp_s > 0:
            phase = float(crossing.stance.phase(np.array(crossing.onset)))
            turns.append((abs(crossing.turn), ramp_s, phase))
    turn, duration, phase = np.median(turns or [USUAL_TURN], axis=0).tolist()
    return turn, duration, phase


def ramp_duration(time: Array, platform: Array, onset: float) -> float:
    """Duration of a turn [s] from its rise time, for samples (n,) of its angle [rad]."""
    is_turning = (time >= onset - BEFORE_ONSET_S) & (time <= onset + AFTER_ONSET_S)
    time = time[is_turning]
    angle = np.abs(platform[is_turning] - platform[is_turning][0])
    begins_s = float(time[np.argmax(angle >= 0.1 * angle.max())])
    ends_s = float(time[np.argmax(angle >= 0.9 * angle.max())])
    return (ends_s - begins_s) / RISE_SHARE


def requested_turn(
    folder: Path,
    turn_deg: float | None,
    ramp_ms: float | None,
    phase: float | None,
    stiffness: float,
    damping: float,
    inertia: float,
) -> PlannedTurn:
    """The turn that is stated, and where it is not, that of the pilot.

    Parameters
    ----------
    folder : Path
        Results of the pilot.
    turn_deg : float or None
        Size [deg].
    ramp_ms : float or None
        Duration [ms].
    phase : float or None
        Onset, as a share of stance.
    stiffness, damping, inertia : float
        The expected K, B and I of the joint.
    """
    joint = (stiffness, damping, inertia)
    if turn_deg is None or ramp_ms is None or phase is None:
        pilot = PlannedTurn(*pilot_turn(folder), joint)
        return PlannedTurn(
            turn=pilot.turn if turn_deg is None else float(np.deg2rad(turn_deg)),
            ramp_s=pilot.ramp_s if ramp_ms is None else 1e-3 * ramp_ms,
            phase=pilot.phase if phase is None else phase,
            joint=joint,
        )
    return PlannedTurn(float(np.deg2rad(turn_deg)), 1e-3 * ramp_ms, phase, joint)


def turn_text(planned: PlannedTurn) -> str:
    """The turn and the joint that a plan assumes."""
    K, B, I = planned.joint
    return (
        f"assumed: a turn of {np.rad2deg(planned.turn):.3g} deg in {1e3 * planned.ramp_s:.3g} ms at"
        f" {100 * planned.phase:.3g} % of stance, a joint of K {K:g} N·m/rad, B {B:g} N·m·s/rad, I"
        f" {I:g} kg·m²"
    )


def plan_text(table: pl.DataFrame) -> str:
    """The half-widths by number of crossings, as lines."""
    lines = ["n perturbed  unperturbed  K ± [N·m/rad]  B ± [N·m·s/rad]  I ± [kg·m²]"]
    for row in table.iter_rows(named=True):
        numbers = f"{row['K']:>13.3g}  {row['B']:>15.2g}  {row['I']:>11.2g}"
        lines.append(f"{row['n']:>11}  {row['n_unperturbed']:>11}  {numbers}  {row['gait']}")
    return "\n".join(lines)


def draw_plan(table: pl.DataFrame, plot: Path) -> None:
    """Draw the half-widths by number of crossings."""
    from osl_analysis.figures.walking_figures import draw_half_widths

    draw_half_widths(table).savefig(plot)


def planned_crossings(
    folder: Path,
    counts: Sequence[int],
    planned: PlannedTurn,
    both: bool,
    settings: choices.WalkingAnalysis,
) -> pl.DataFrame:
    """Plan the number of perturbed crossings.

    Parameters
    ----------
    folder : Path
        Results of a campaign, whose unperturbed crossings tell the scatter.
    counts : Sequence of int
        Numbers of perturbed crossings.
    planned : PlannedTurn
    both : bool
        Whether the platform turns in both directions.
    settings : WalkingAnalysis

    Returns
    -------
    polars.DataFrame
        Expected halves of the 95 % intervals of K, B and I, by gait and count, for as many
        unperturbed crossings as the campaign has.

    Raises
    ------
    InputError
        The campaign uses no unperturbed crossing.
    """
    selection = folder / "tables/walking_crossings.csv"
    table = read_table(selection, ["trial", "gait", "reason"])
    used = table.filter(~pl.col("perturbed"), pl.col("reason").is_null())
    names_by_gait: dict[str, list[str]] = {}
    for name, cell in used.select("trial", "gait").iter_rows():
        for gait in (cell or ALL).split(SEPARATOR):
            names_by_gait.setdefault(gait, []).append(name)
    frames = []
    for gait, names in names_by_gait.items():
        walked = [read_crossing(folder / f"crossings/{name}.parquet") for name in names]
        scatter = scatter_of_one(walked, planned, settings)
        expected = half_widths(scatter, counts, len(walked), both)
        frames.append(expected.select(pl.lit(gait).alias("gait"), pl.all()))
    if not frames:
        raise InputError(
            f"{selection}: no unperturbed crossing is used; record some, or see its column reason"
        )
    return pl.concat(frames)
