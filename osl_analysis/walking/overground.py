"""Overground gait: the ankle moment from plate and markers, beside the laboratory's own where the
recording has one.

It is quasi-static: without the foot's weight and inertia. Plug-in Gait stores the ankle's centre
(TIO) and a point to its left on the tibia's mediolateral axis (TIL) as markers. Without them the
axis is the line through both malleoli, or a level one through the lateral malleolus, across the
foot from heel to toe or across its way. Which of its points is taken does not matter: the moment
about a line is the same."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, Trial, marker_columns
from osl_analysis.walking import plate as plates
from osl_analysis.walking.bodies import Mask, marker_tracks
from osl_analysis.walking.crossing import body_mass
from osl_analysis.walking.settings import OvergroundAnalysis

SIDES = ("left", "right")
# (n,) each, of a row of `overground_rows`
CURVES = ("time_s", "phase", "moment", "reference_moment")


@dataclass(frozen=True)
class Foot:
    """The markers of a foot in n frames."""

    time: Array  # (n,) [s]
    ankle: Array  # point (n, 3) [m] of the ankle's axis
    axis: Array  # its unit vector (n, 3) to the left
    axis_from: str  # the markers that both are from
    points: Array  # all its markers (n, m, 3) [m]
    whole: bool  # whether heel and toe are among them

    def standing(self) -> Mask:
        """Which markers (n, m) rest on the ground: slower than 0.5 m/s, as no foot in the air is,
        and low."""
        height = self.points[..., 2]
        slow = np.linalg.norm(np.gradient(self.points, self.time, axis=0), axis=2) < 0.5
        return np.asarray(slow & (height < np.nanpercentile(height, 2, axis=0) + 0.05))


def foot_markers(trial: Trial, side: str, settings: OvergroundAnalysis) -> Foot | None:
    """The markers of a foot; None where the recording has none that show its ankle."""

    def first(names: tuple[str, ...]) -> str:
        """The first marker that was seen; empty for none."""
        spelled = [name.replace("?", side[0].upper()) for name in names]
        there = [name for name in spelled if marker_columns(name)[0] in trial.columns]
        return next(
            (name for name in there if trial.samples[marker_columns(name)[0]].is_finite().any()), ""
        )

    named = settings.lateral_malleolus, settings.medial_malleolus, settings.heel, settings.toe
    found = lateral, _, heel, toe = [first(names) for names in named]
    plug_in = [first(("?TIO",)), first(("?TIL",))]
    used = next(
        (names for names in (plug_in, found[:2], [lateral, heel, toe], [lateral]) if all(names)),
        None,
    )
    if used is None:
        return None
    time, points = marker_tracks(trial, list(dict.fromkeys([*used, *filter(None, found)])))
    if len(used) == 2:
        sign = -1 if used != plug_in and side == "left" else 1
        axis, said = sign * (points[:, 1] - points[:, 0]), " to ".join(used)
    else:
        forward = points[:, 2] - points[:, 1] if len(used) == 3 else stride(time, points[:, 0])
        axis, said = (
            np.cross([0.0, 0.0, 1.0], forward),
            f"{lateral}, across {' to '.join(used[1:]) or 'its way'}",
        )
    unit = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    return Foot(time, points[:, 0], unit, said, points, bool(heel and toe))


def stride(time: Array, point: Array) -> Array:
    """Way (n, 3) [m] of a point (n, 3) [m] from 0.75 s before a frame to 0.75 s after it; NaN if
    shorter than 0.3 m."""
    seen, after, before = np.isfinite(point).all(axis=1), time + 0.75, time - 0.75
    ways = [
        np.interp(after, time[seen], one) - np.interp(before, time[seen], one)
        for one in point[seen].T
    ]
    return np.where(np.hypot(ways[0], ways[1]) < 0.3, np.nan, ways).T


def over(points: Array, corners: Array) -> Mask:
    """Which points (..., 3) are over a plate, seen from above: on the same side of each edge; a NaN
    point is not."""
    edges, away = np.roll(corners, -1, axis=0) - corners, points[..., None, :] - corners
    turn = edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0]
    return np.asarray((turn > 0).all(axis=-1) | (turn < 0).all(axis=-1))


def overground_rows(
    trial: Trial, settings: OvergroundAnalysis, sheet_mass: float | None = None
) -> list[dict[str, Any]]:
    """Rows of `ankle_moment.csv`: every stance of a foot over a plate, in order of side and plate,
    and its `CURVES`; moments in N*m/kg, plantarflexion positive. `sheet_mass` is the body mass [kg]
    in the trial's row of the sheet."""
    numbers = [int(plate["plate"]) for plate in trial.provenance.get("plates", [])]
    for number in numbers:
        # a foot cannot pull; an offset of the other sign looks like a person who stands
        reading = float(np.median(plates.recorded_wrench(trial, number)[1][:, 2]))
        if reading < -settings.largest_zero_n:
            raise InputError(
                f"trial {trial.name}: force plate {number} reads {reading:.0f} N in most of the"
                f" recording, expected more than {-settings.largest_zero_n:g} N, because a foot"
                " cannot pull: the plate was not zeroed, has reached its limit, or has the other"
                " sign; record again, or remove the plate from `plates` in the source file"
            )
    mass, load = body_mass(trial, sheet_mass, settings.body_mass_kg), settings.load_on_n
    if mass is None:
        raise InputError(
            f"trial {trial.name}: the recording states no body mass; state body_mass_kg in the"
            " sheet, or overground.body_mass_kg in the configuration"
        )
    feet = {side: foot for side in SIDES if (foot := foot_markers(trial, side, settings))}
    if not feet or not numbers:
        absent = (
            "marker of an ankle; name one under overground.lateral_malleolus in the configuration"
        )
        raise InputError(
            f"trial {trial.name}: no"
            f" {absent if numbers else 'force plate; map it in the source file'}"
        )
    rows, time = list[dict[str, Any]](), next(iter(feet.values())).time
    for number in numbers:
        wrench = plates.wrench_reader(*plates.recorded_wrench(trial, number), time)(0.0)
        for stance in plates.find_stances(time, wrench[:, 2], load, load, 0.3):
            rows += contact_rows(trial, number, feet, wrench, stance, mass, settings)
    if not rows:
        raise InputError(
            f"trial {trial.name}: no foot stands on a plate with its ankle over it; check the"
            f" plates' corners and channels, or lower load_on_n from {load:g} N"
        )
    contacts = {
        k: row["toe_off_s"] - row["heel_strike_s"]
        for k, row in enumerate(rows)
        if row["excluded"] is None
    }
    for k, contact in contacts.items():
        others = [one for other, one in contacts.items() if other != k] or [contact]
        if contact > settings.longest_contact * np.median(others):
            said = f"a contact of {contact:.2f} s where others last {np.median(others):.2f} s: "
            rows[k] |= stance_results([], f"{said}a second foot, or a plate off zero")
    return sorted(rows, key=lambda row: (row["side"], row["plate"]))


def contact_rows(
    trial: Trial,
    number: int,
    feet: Mapping[str, Foot],
    wrench: Array,
    stance: plates.Stance,
    mass: float,
    settings: OvergroundAnalysis,
) -> Iterator[dict[str, Any]]:
    """Rows of one contact with a plate, of the wrench (n, 6) in the frames of the `feet`, one for
    each foot on it."""
    time, corners = next(iter(feet.values())).time, plates.recorded_corners(trial, number)
    of_foot = plates.recorded_plate(trial, number).get("foot")
    inside = (time > stance.heel_strike) & (time < stance.toe_off)
    rests = {
        side: np.any(foot.standing() & over(foot.points, corners), axis=1)
        for side, foot in feet.items()
    }
    share = {side: float(rested[inside].mean()) for side, rested in rests.items()}
    on_plate = [
        side for side, foot in feet.items() if over(foot.ankle, corners)[inside].mean() > 0.5
    ]
    on_plate = on_plate or [side for side in feet if share[side] == max(0.1, *share.values())]
    for side in on_plate if of_foot is None else [of_foot] * (of_foot in feet):
        foot, other, excluded = feet[side], SIDES[side == "left"], None
        whole = inside & np.isfinite(foot.points).all(axis=(1, 2))
        own = float(np.mean(rests[side][whole])) if foot.whole and whole.any() else 1.0
        if of_foot is None and share.get(other, 0.0) > 0.1:
            excluded = (
                f"the {other} foot stands on the same plate in {100 * share[other]:.0f} % of the"
                " contact"
            )
        elif own < settings.fewest_standing:
            excluded = (
                f"heel and toe rest on the plate in {100 * own:.0f} % of the contact: a second foot"
            )
        row = {"trial": trial.name, "body_mass_kg": mass, "side": side, "plate": number}
        row |= {
            "heel_strike_s": stance.heel_strike,
            "toe_off_s": stance.toe_off,
            "axis_from": foot.axis_from,
        }
        moment = plates.ankle_torque(wrench, corners.mean(axis=0), foot.ankle, foot.axis) / mass
        loaded, reference = wrench[:, 2] > settings.load_on_n, np.full_like(moment, np.nan)
        used = inside & np.isfinite(moment) & loaded
        if (column := f"reference_ankle_moment_{side}") in trial.columns:
            reference = trial.arrays(column)[1]
            used &= np.isfinite(reference) | (np.isfinite(reference[used]).sum() < 3)
        if excluded is None and used.sum() < 3:
            excluded = (
                f"the markers of the ankle's axis, {foot.axis_from}, are hidden or do not move on"
            )
        curves = (time, stance.phase(time), moment, reference)
        yield row | stance_results([values[used] for values in curves], excluded)


def stance_results(curves: list[Array], excluded: str | None) -> dict[str, Any]:
    """The columns of a stance from its `CURVES`, null where it is excluded, or what is compared
    without a reference."""
    compared = ("correlation", "slope", "reference_peak", "moment_at_peak")
    known = dict[str, Any].fromkeys(("frames", "peak_moment", "peak_phase", *compared, *CURVES))
    known["excluded"] = excluded
    if excluded is None:
        _, phase, moment, reference = curves
        peak, last = int(np.argmax(reference)), int(np.argmax(moment))
        known |= {
            "frames": len(moment),
            "peak_moment": float(moment[last]),
            "peak_phase": float(phase[last]),
        }
        known |= dict(zip(CURVES, curves, strict=True))
        if np.isfinite(reference).all():
            known["correlation"] = float(np.corrcoef(moment, reference)[0, 1])
            known["slope"] = float(moment @ reference / (moment @ moment))
            known |= {
                "reference_peak": float(reference[peak]),
                "moment_at_peak": float(moment[peak]),
            }
    return known
