"""Overground gait: the ankle moment from plate and markers, beside the laboratory's own.

It is quasi-static: without the foot's weight and inertia. Plug-in Gait stores the ankle's centre
(TIO) and a point to its left on the tibia's mediolateral axis (TIL) as markers. Without them the
axis is the line through both malleoli, or a level one through the lateral malleolus, across the
foot from heel to toe or across its way. Which of its points is taken does not matter: the moment
about a line is the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from osl_analysis.errors import InputError, listing
from osl_analysis.plates import plate_axes
from osl_analysis.trial import Array, Trial, marker_columns
from osl_analysis.walking.ankle import VERTICAL, ankle_torque
from osl_analysis.walking.plate import (
    recorded_corners,
    recorded_plate,
    recorded_wrench,
    wrench_reader,
)
from osl_analysis.walking.poses import Mask, marker_tracks
from osl_analysis.walking.setup_checks import body_mass
from osl_analysis.walking.stance import Stance, find_stances
from osl_analysis.walking.walking_settings import OvergroundAnalysis

SIDES = ("left", "right")
CURVES = ("time_s", "phase", "moment", "reference_moment")  # (n,) each, of a row

SHORTEST_CONTACT_S = 0.3
LARGEST_STANDING_SPEED = 0.5  # [m/s] of a marker on the ground; none in the air is so slow
LOWEST_PERCENT = 2.0  # of a marker's track over a plate, in which it is at its lowest
LARGEST_STANDING_HEIGHT_M = 0.05  # above that
STRIDE_S = 0.75  # before and after a frame, over which its way is read
SHORTEST_STRIDE_M = 0.3  # that has a direction
FEWEST_FRAMES = 3
FEWEST_OVER_PLATE = 0.5  # of the contact, in which the ankle is over the plate
FEWEST_RESTING = 0.1  # of the contact, in which a marker of the foot rests on the plate


@dataclass(frozen=True)
class Foot:
    """The markers of a foot in n frames."""

    time: Array  # (n,) [s]
    ankle: Array  # point (n, 3) [m] of the ankle's axis
    axis: Array  # its unit vector (n, 3) to the left
    axis_from: str  # the markers that both are from
    points: Array  # all its markers (n, m, 3) [m]
    is_whole: bool  # whether heel and toe are among them

    def standing_on(self, corners: Array) -> Mask:
        """Which markers (n, m) rest on a plate: slow, and low above its surface.

        A plate may stand higher than the floor, or slope.
        """
        is_over = over(self.points, corners)
        height = (self.points - corners.mean(axis=0)) @ plate_axes(corners)[:, 2]
        speed = np.linalg.norm(np.gradient(self.points, self.time, axis=0), axis=2)
        stands = np.zeros_like(is_over)
        for marker in np.flatnonzero(is_over.any(axis=0)):
            rows = is_over[:, marker]
            lowest = np.percentile(height[rows, marker], LOWEST_PERCENT)
            stands[:, marker] = rows & (height[:, marker] < lowest + LARGEST_STANDING_HEIGHT_M)
        return np.asarray(stands & (speed < LARGEST_STANDING_SPEED))


@dataclass(frozen=True)
class StanceMoment:
    """The ankle moment over one stance; None where it is excluded or has no reference."""

    frames: int | None = None
    peak_moment: float | None = None
    peak_phase: float | None = None
    correlation: float | None = None
    slope: float | None = None
    reference_peak: float | None = None
    moment_at_peak: float | None = None  # at the peak of the reference
    # `CURVES`
    time_s: Array | None = None
    phase: Array | None = None
    moment: Array | None = None  # [N*m/kg]
    reference_moment: Array | None = None  # [N*m/kg]; NaN without one

    def columns(self) -> dict[str, Any]:
        return dict(vars(self))


@dataclass(frozen=True)
class Contact:
    """One stance of a foot over a plate: a row of `ankle_moment.csv`."""

    trial: str
    body_mass_kg: float
    side: str
    plate: int
    heel_strike_s: float
    toe_off_s: float
    axis_from: str
    moment: StanceMoment
    excluded: str | None  # why it is not used

    @property
    def duration(self) -> float:
        return self.toe_off_s - self.heel_strike_s

    def row(self) -> dict[str, Any]:
        return {
            "trial": self.trial,
            "body_mass_kg": self.body_mass_kg,
            "side": self.side,
            "plate": self.plate,
            "heel_strike_s": self.heel_strike_s,
            "toe_off_s": self.toe_off_s,
            "axis_from": self.axis_from,
            **self.moment.columns(),
            "excluded": self.excluded,
        }


def overground_contacts(
    trial: Trial, settings: OvergroundAnalysis, sheet_mass: float | None = None
) -> list[Contact]:
    """Compute the ankle moment of every stance of a foot over a plate, by side and plate.

    Parameters
    ----------
    sheet_mass : float, optional
        Body mass [kg] in the trial's row of the sheet.

    Returns
    -------
    list of Contact
        Moments in N*m/kg, plantarflexion positive.

    Raises
    ------
    InputError
        A plate was not zeroed, or the recording has no body mass, ankle, plate or stance.
    """
    plates = [int(facts["plate"]) for facts in trial.provenance.get("plates", [])]
    for plate in plates:
        check_zero(trial, plate, settings)
    mass = body_mass(trial, sheet_mass, settings.body_mass_kg)
    if mass is None:
        raise InputError(
            f"trial {trial.name}: the recording states no body mass; state body_mass_kg in the"
            " sheet, or overground.body_mass_kg in the configuration"
        )
    markers = {side: foot_markers(trial, side, settings) for side in SIDES}
    feet = {side: foot for side, foot in markers.items() if foot is not None}
    if not plates:
        raise InputError(
            f"trial {trial.name}: no force plate; state it in the source file, of a C3D under"
            " `plate_geometry`, of an export under `plates`"
        )
    if not feet:
        prefixes = sorted(
            {
                column.removeprefix("marker_").partition(":")[0]
                for column in trial.columns
                if column.startswith("marker_") and ":" in column
            }
        )
        remedy = "name one under overground.lateral_malleolus in the configuration"
        if prefixes:
            remedy += (
                f", with its prefix (there are {listing(prefixes)}), as '{prefixes[0]}:?ANK', and"
                " likewise medial_malleolus, heel and toe"
            )
        raise InputError(f"trial {trial.name}: no marker of an ankle; {remedy}")

    time = next(iter(feet.values())).time
    contacts: list[Contact] = []
    for plate in plates:
        wrench = wrench_reader(*recorded_wrench(trial, plate), time)(0.0)
        load = settings.load_on_n
        for stance in find_stances(time, wrench[:, 2], load, load, SHORTEST_CONTACT_S):
            contacts += contacts_of_stance(trial, plate, feet, wrench, stance, mass, settings)
    if not contacts:
        raise InputError(
            f"trial {trial.name}: no foot stands on a plate with its ankle over it; check the"
            f" plates' corners and channels, or lower load_on_n from {settings.load_on_n:g} N"
        )
    contacts = without_long_contacts(contacts, settings.longest_contact)
    return sorted(contacts, key=lambda contact: (contact.side, contact.plate))


def check_zero(trial: Trial, plate: int, settings: OvergroundAnalysis) -> None:
    """Refuse a plate that reads a pull in most of the recording.

    A foot cannot pull; an offset of the other sign looks like a person who stands.
    """
    reading = float(np.median(recorded_wrench(trial, plate)[1][:, 2]))
    if reading < -settings.largest_zero_n:
        raise InputError(
            f"trial {trial.name}: force plate {plate} reads {reading:.0f} N in most of the"
            f" recording, expected more than {-settings.largest_zero_n:g} N, because a foot"
            " cannot pull: the plate was not zeroed, has reached its limit, or has the other"
            " sign; record again, or remove the plate from `plates` in the source file"
        )


def foot_markers(trial: Trial, side: str, settings: OvergroundAnalysis) -> Foot | None:
    """Read the markers of a foot; None where the recording has none that show its ankle."""
    lateral = first_marker(trial, side, settings.lateral_malleolus)
    medial = first_marker(trial, side, settings.medial_malleolus)
    heel = first_marker(trial, side, settings.heel)
    toe = first_marker(trial, side, settings.toe)
    plug_in = [first_marker(trial, side, ("?TIO",)), first_marker(trial, side, ("?TIL",))]

    axis_markers = None
    for candidates in (plug_in, [lateral, medial], [lateral, heel, toe], [lateral]):
        if all(candidates):
            axis_markers = candidates
            break
    if axis_markers is None:
        return None

    foot = [name for name in (lateral, medial, heel, toe) if name]
    time, points = marker_tracks(trial, list(dict.fromkeys([*axis_markers, *foot])))
    if len(axis_markers) == 2:
        axis = points[:, 1] - points[:, 0]
        if axis_markers != plug_in and side == "left":
            axis = -axis  # the medial malleolus of the left leg is to the right
        axis_from = " to ".join(axis_markers)
    elif len(axis_markers) == 3:
        axis = np.cross(VERTICAL, points[:, 2] - points[:, 1])
        axis_from = f"{lateral}, across {heel} to {toe}"
    else:
        axis = np.cross(VERTICAL, stride(time, points[:, 0]))
        axis_from = f"{lateral}, across its way"
    unit = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    return Foot(time, points[:, 0], unit, axis_from, points, bool(heel and toe))


def first_marker(trial: Trial, side: str, names: Sequence[str]) -> str:
    """The first marker that was seen, with L or R for `?`; empty for none."""
    for name in names:
        spelled = name.replace("?", side[0].upper())
        column = marker_columns(spelled)[0]
        if column in trial.columns and trial.samples[column].is_finite().any():
            return spelled
    return ""


def stride(time: Array, point: Array) -> Array:
    """Way (n, 3) [m] of a point (n, 3) [m] from 0.75 s before a frame to 0.75 s after it.

    NaN if it is shorter than 0.3 m.
    """
    seen = np.isfinite(point).all(axis=1)
    way = np.empty_like(point)
    for axis in range(3):
        coordinate = point[seen, axis]
        after = np.interp(time + STRIDE_S, time[seen], coordinate)
        before = np.interp(time - STRIDE_S, time[seen], coordinate)
        way[:, axis] = after - before
    way[np.hypot(way[:, 0], way[:, 1]) < SHORTEST_STRIDE_M] = np.nan
    return way


def over(points: Array, corners: Array) -> Mask:
    """Which points (..., 3) are over a plate, seen from above: on one side of every edge.

    A NaN point is not.
    """
    edges = np.roll(corners, -1, axis=0) - corners
    from_corner = points[..., None, :] - corners
    turn = edges[:, 0] * from_corner[..., 1] - edges[:, 1] * from_corner[..., 0]
    return np.asarray((turn > 0).all(axis=-1) | (turn < 0).all(axis=-1))


def contacts_of_stance(
    trial: Trial,
    plate: int,
    feet: Mapping[str, Foot],
    wrench: Array,
    stance: Stance,
    mass: float,
    settings: OvergroundAnalysis,
) -> list[Contact]:
    """One contact with a plate, for each foot on it; the wrench (n, 6) is in the feet's frames."""
    time = next(iter(feet.values())).time
    corners = recorded_corners(trial, plate)
    inside = (time > stance.heel_strike) & (time < stance.toe_off)
    rests = {side: np.any(foot.standing_on(corners), axis=1) for side, foot in feet.items()}
    resting_share = {side: float(rested[inside].mean()) for side, rested in rests.items()}
    stated_foot = recorded_plate(trial, plate).get("foot")

    contacts = []
    for side in sides_on_plate(feet, corners, inside, resting_share, stated_foot):
        foot = feet[side]
        other = "right" if side == "left" else "left"
        excluded = None
        other_share = resting_share.get(other, 0.0)
        standing_share = whole_foot_share(foot, rests[side], inside)
        if stated_foot is None and other_share > FEWEST_RESTING:
            excluded = (
                f"the {other} foot stands on the same plate in {100 * other_share:.0f} % of the"
                " contact"
            )
        elif standing_share < settings.fewest_standing:
            excluded = (
                f"heel and toe rest on the plate in {100 * standing_share:.0f} % of the contact: a"
                " second foot"
            )

        moment = ankle_torque(wrench, corners.mean(axis=0), foot.ankle, foot.axis) / mass
        used = inside & np.isfinite(moment) & (wrench[:, 2] > settings.load_on_n)
        reference = np.full_like(moment, np.nan)
        reference_column = f"reference_ankle_moment_{side}"
        if reference_column in trial.columns:
            reference = trial.arrays(reference_column)[1]
            has_reference = np.isfinite(reference)
            if has_reference[used].sum() >= FEWEST_FRAMES:
                used &= has_reference
        if excluded is None and used.sum() < FEWEST_FRAMES:
            excluded = (
                f"the markers of the ankle's axis, {foot.axis_from}, are hidden or do not move on"
            )
        stance_moment = StanceMoment()
        if excluded is None:
            phase = stance.phase(time)
            stance_moment = moment_over_stance(
                time[used], phase[used], moment[used], reference[used]
            )
        contacts.append(
            Contact(
                trial.name,
                body_mass_kg=mass,
                side=side,
                plate=plate,
                heel_strike_s=stance.heel_strike,
                toe_off_s=stance.toe_off,
                axis_from=foot.axis_from,
                moment=stance_moment,
                excluded=excluded,
            )
        )
    return contacts


def sides_on_plate(
    feet: Mapping[str, Foot],
    corners: Array,
    inside: Mask,
    resting_share: Mapping[str, float],
    stated_foot: str | None,
) -> list[str]:
    """The feet on a plate: the stated one, else those over it, else the one that rests there."""
    if stated_foot is not None:
        return [stated_foot] if stated_foot in feet else []
    over_plate = [
        side
        for side, foot in feet.items()
        if over(foot.ankle, corners)[inside].mean() > FEWEST_OVER_PLATE
    ]
    if over_plate:
        return over_plate
    largest = max(FEWEST_RESTING, *resting_share.values())
    return [side for side in feet if resting_share[side] == largest]


def whole_foot_share(foot: Foot, rests: Mask, inside: Mask) -> float:
    """Share of the contact in which heel or toe rest on the plate; 1 where it is not known."""
    whole = inside & np.isfinite(foot.points).all(axis=(1, 2))
    if not foot.is_whole or not whole.any():
        return 1.0
    return float(np.mean(rests[whole]))


def moment_over_stance(time: Array, phase: Array, moment: Array, reference: Array) -> StanceMoment:
    """Summarise a moment (n,), and compare it with the reference (n,) if that is known."""
    peak = int(np.argmax(moment))
    summary = StanceMoment(
        frames=len(moment),
        peak_moment=float(moment[peak]),
        peak_phase=float(phase[peak]),
        time_s=time,
        phase=phase,
        moment=moment,
        reference_moment=reference,
    )
    if not np.isfinite(reference).all():
        return summary
    reference_peak = int(np.argmax(reference))
    return replace(
        summary,
        correlation=float(np.corrcoef(moment, reference)[0, 1]),
        slope=float(moment @ reference / (moment @ moment)),
        reference_peak=float(reference[reference_peak]),
        moment_at_peak=float(moment[reference_peak]),
    )


def without_long_contacts(contacts: Sequence[Contact], longest: float) -> list[Contact]:
    """Exclude contacts that last `longest` times the median of the others."""
    used = [contact for contact in contacts if contact.excluded is None]
    checked = []
    for contact in contacts:
        other_durations = [other.duration for other in used if other is not contact]
        usual = float(np.median(other_durations or [contact.duration]))
        if contact.excluded is None and contact.duration > longest * usual:
            reason = (
                f"a contact of {contact.duration:.2f} s where others last {usual:.2f} s: a second"
                " foot, or a plate off zero"
            )
            contact = replace(contact, moment=StanceMoment(), excluded=reason)
        checked.append(contact)
    return checked
