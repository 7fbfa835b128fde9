"""What tells the gain of the platform's plate: body mass, other plates, who stands and walks on
them.

Over a stride the mean of all vertical forces is the weight W, whoever walks. The stance of one foot
carries the share s of it, and that of the other foot on another plate carries 1 - s.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from osl_analysis.trial import Array, Trial, plate_columns
from osl_analysis.units import si_factor
from osl_analysis.walking.poses import FREE_FALL
from osl_analysis.walking.stance import Stance, find_stances
from osl_analysis.walking.walking_settings import CrossingSettings

OPPOSITE_STEP = (0.35, 0.65)  # of a stride, between heel strikes of both feet
LARGEST_STANDING_ERROR = 0.25  # of a plate on which both feet stand; one foot carries half
PLAUSIBLE_SHARES = (0.44, 0.56)  # of the weight over a stride, for a foot of who stood there, too
LARGEST_ASYMMETRY = 0.06  # of a foot's load over a stride from half of the weight, as a share
FORCE_UNITS = ("kN", "kgf", "lbf")  # in which a plate may read
NEAR_UNIT = 0.1  # of a ratio to that of a unit
ONE_FOOT = 1.5  # weight over load, above which who stands has one foot beside the plate
LARGEST_UNSTEADINESS = 0.02  # by which walkers who speed up or slow down miss their weight


@dataclass(frozen=True)
class KnownLoads:
    """Vertical forces [N] that tell a gain; None where unknown."""

    weight: float | None = None  # by the body mass that is stated
    standing: float | None = None  # of the platform's plate, on which alone somebody stands
    standing_beside: float | None = None  # of other plates, while the platform's is empty
    stride: float | None = None  # mean over a stride, of the platform's plate
    stride_beside: float | None = None  # the same of another plate, under the other foot


@dataclass(frozen=True)
class GainCheck:
    """By what share the platform's plate reads too much, beyond what gait explains; None if nothing
    tells."""

    load_error: float | None = None
    load_judged_by: str | None = None
    load_slack: float | None = None  # what gait may explain, as a share
    # By what share who walks is heavier than who stood on the same plate, beyond what gait explains
    weight_change: float | None = None


@dataclass(frozen=True)
class GainEstimate:
    """A ratio of the plate's gain to what it is held against."""

    by: str
    ratio: float
    slack: float  # by which it may be off 1 with the right gain


def check_gain(loads: KnownLoads) -> GainCheck:
    """Judge the gain of the platform's plate by the estimate that may be off least."""
    change = weight_change(loads)
    best = min(gain_estimates(loads), key=lambda estimate: estimate.slack, default=None)
    if best is None:
        return GainCheck(weight_change=change)
    error = beyond_slack(best.ratio - 1, best.slack)
    judged_by = best.by
    unit = other_unit(best.ratio) if error else ""
    if unit:
        judged_by += f" (as of {unit} in place of N)"
    return GainCheck(error, judged_by, best.slack, change)


def other_unit(ratio: float) -> str:
    """The unit in which a plate reads so many times the newtons; empty for none."""
    for unit in FORCE_UNITS:
        if abs(ratio * si_factor(unit, "N") - 1) < NEAR_UNIT:
            return unit
    return ""


def beyond_slack(error: float, slack: float) -> float:
    """The part of an error, with its sign, beyond what its slack explains."""
    return error - float(np.clip(error, -slack, slack))


def weight_change(loads: KnownLoads) -> float | None:
    """Compare the weight over strides with that of who stood on the same plate in the static trial,
    by a share; None if nobody did."""
    for standing, stride in (
        (loads.standing, loads.stride),
        (loads.standing_beside, loads.stride_beside),
    ):
        if not standing or not stride:
            continue
        ratio = 2 * stride / standing
        if ratio < ONE_FOOT:
            return beyond_slack(ratio - 1, LARGEST_ASYMMETRY)
    return None


def gain_estimates(loads: KnownLoads) -> Iterator[GainEstimate]:
    """All estimates of the gain of the platform's plate, the more direct ones first."""
    if loads.standing and loads.weight:
        ratio = loads.standing / loads.weight
        if abs(ratio - 1) < LARGEST_STANDING_ERROR:
            yield GainEstimate("the body mass of who stands on it", ratio, slack=0.0)
    share = known_share(loads)
    if loads.stride and loads.stride_beside and share is not None:
        by_this = loads.standing or loads.stride / share
        by_other = loads.stride_beside / (1 - share)
        ratio = by_this / by_other
        yield GainEstimate("another plate, by strides", ratio, LARGEST_UNSTEADINESS)
    if loads.stride and loads.weight:
        ratio = 2 * loads.stride / loads.weight
        yield GainEstimate("the body mass of who walks over it", ratio, LARGEST_ASYMMETRY)
    if loads.stride and loads.stride_beside:
        ratio = loads.stride / loads.stride_beside
        yield GainEstimate("another plate, by both feet", ratio, 2 * LARGEST_ASYMMETRY)


def known_share(loads: KnownLoads) -> float | None:
    """The share of the weight under the foot on the platform, by a plate on which somebody also
    stands, whatever its gain."""
    share = None
    if loads.standing and loads.stride:
        share = loads.stride / loads.standing
    elif loads.standing_beside and loads.stride_beside:
        share = 1 - loads.stride_beside / loads.standing_beside
    low, high = PLAUSIBLE_SHARES
    return share if share is not None and low < share < high else None


def weight_of(body_mass_kg: float | None) -> float | None:
    """Weight [N]; None if the body mass is not known."""
    return None if body_mass_kg is None else body_mass_kg * float(np.linalg.norm(FREE_FALL))


def stride_time(frames: Array, foot: Array, stance: Stance) -> float | None:
    """Time [s] from the foot's swing before a stance to that after it, each at its middle.

    Parameters
    ----------
    frames : Array
        (n,) [s].
    foot : Array
        A point of it (n, 3) [m], NaN where it was not seen.

    Returns
    -------
    float or None
        None where either swing is not seen as a whole.
    """
    speed = np.linalg.norm(np.gradient(foot[:, :2], frames, axis=0), axis=1)
    middles = []
    for end in (stance.heel_strike, stance.toe_off + stance.duration):
        rows = (frames >= end - stance.duration) & (frames <= end)
        swing = speed[rows]
        if not len(swing) or not np.isfinite(swing).all():
            return None
        over_half = np.maximum(swing - swing.max() / 2, 0.0)
        is_whole = frames[0] <= end - stance.duration and frames[-1] >= end
        if not is_whole or over_half[0] or over_half[-1]:
            return None
        middles.append(float(np.average(frames[rows], weights=over_half)))
    return middles[1] - middles[0]


def stride_load(time: Array, force: Array, stance: Stance, stride_s: float) -> float:
    """Mean [N] over a stride of a vertical force (n,) that acts in one stance of it."""
    inside = (time >= stance.heel_strike) & (time <= stance.toe_off)
    return float(np.trapezoid(force[inside], time[inside]) / stride_s)


def stride_load_beside(
    trial: Trial, stance: Stance, stride_s: float, settings: CrossingSettings
) -> float | None:
    """Mean vertical force [N] over a stride of the other foot, on other plates; None if no stance
    is seen half a stride before or after the platform's."""
    loads = []
    for plate in trial.provenance.get("plates", []):
        column = plate_columns(plate["plate"], "force")[2]
        if plate["plate"] == settings.plate or column not in trial.columns:
            continue
        time, force = trial.signals(column)
        is_bare = np.abs(force - np.median(force)) < settings.load_off_n
        if not is_bare.any():  # noise of tens of newtons
            continue
        force = force - np.mean(force[is_bare])
        for step in find_stances(
            time, force, settings.load_on_n, settings.load_off_n, settings.shortest_stance_s
        ):
            apart = abs(step.heel_strike - stance.heel_strike) / stride_s
            if OPPOSITE_STEP[0] < apart < OPPOSITE_STEP[1]:
                loads.append(stride_load(time, force, step, stride_s))
    return float(np.mean(loads)) if loads else None
