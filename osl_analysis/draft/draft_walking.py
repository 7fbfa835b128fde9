"""A draft of the section `walking` of a configuration, from the names of markers in captures, and
from where the plates lie. What these do not tell is left to the user."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.draft.overview import Overview, RecordedChannel
from osl_analysis.ingest.placeholders import UNKNOWN
from osl_analysis.trial import Array

SMALLEST_CLUSTER = 3  # markers that tell where a segment is
LEAST_STEP_N = 200.0  # by which the force on a plate changes when somebody steps on it
MUCH_NEARER = 0.5  # of the other foot's distance from the plate, for a foot that steps on it


@dataclass(frozen=True)
class SegmentNames:
    """Names of a segment's markers.

    Attributes
    ----------
    begins
        What they begin with.
    codes
        Their codes behind an R or L in Plug-in Gait, OpenSim's models and Qualisys' (CAST).
    """

    begins: str
    codes: str = ""


SEGMENTS = {
    "platform": SegmentNames("PLAT|HEXAPOD|STEWART"),
    "ankle_medial": SegmentNames(
        r"(?=.*((?<!SH)ANK|MAL)).*(MED|(^|_)M(_|MAL|$))", "MED|MMA|MMAL|MANK|TAM|AM|MM"
    ),
    # a marker called `ankle` and no more is the lateral one in all of them
    "ankle_lateral": SegmentNames("(?<!SH)ANK|MAL", "LMA|LMAL|LANK|FAL|AL|LM"),
    "foot": SegmentNames(
        r"FOOT|SHOE|HEEL|CALC|TOE|META?\d", r"FCC|F[ML]\d?|FT\d|MT\d|MET|PM\d|HEE|CAL\d?|H"
    ),
    "shank": SegmentNames(
        r"SHANK|SHIN|TIB|PYLON|(?<!UP)(?<!UPPER)(?<!UPPER_)LEG",
        r"SK\d|S\d|TTC|TTB?|TB\d|SHA|HF|FAX",
    ),
}


def segment_of(label: str) -> tuple[str, str]:
    """Side, R or L, and segment of `SEGMENTS` that a marker's name tells behind the subject's;
    empty for none."""
    name = re.sub(r"[^A-Z0-9]+", "_", label.rpartition(":")[2].upper()).strip("_")
    forms: list[tuple[str, str]] = re.findall(r"^(RIGHT|LEFT|R|L)_?(.+)$", name)
    forms += [(side, rest) for rest, side in re.findall(r"^(.+)_(RIGHT|LEFT|R|L)$", name)]
    forms.append(("", name))
    for side, rest in forms:
        for segment, names in SEGMENTS.items():
            pattern = rf"(^|_)({names.begins})" if side else names.begins
            is_coded = bool(side) and re.fullmatch(names.codes, rest) is not None
            if is_coded or re.search(pattern, rest):
                return side[:1], segment
    return "", ""


def draft_walking(overviews: Sequence[Overview]) -> list[str]:
    """Lines of YAML: the section `walking` by the captures of one laboratory. None unless markers
    are named as a foot's or shank's."""
    segments = segments_of(overviews)
    leg = stepping_leg(overviews)
    clusters: dict[str, list[str]] = {segment: [] for segment in SEGMENTS}
    for label, (own_side, segment) in segments.items():
        if segment and (not leg.side or own_side in ("", leg.side)):
            clusters[segment].append(label)
    if not (clusters["foot"] or clusters["shank"]):
        return []
    side = {"R": "right", "L": "left", "": UNKNOWN}[leg.side]
    plate = stepped_plate(overviews, clusters["platform"])
    lines = [
        "walking:  # a draft, from the names of markers: check every line",
        f"  side: {side}  # the leg that steps on the platform{leg.why}",
        f"  plate: {plate.number or UNKNOWN}  # {plate.why}",
        "  markers:",
    ]
    for segment, found in clusters.items():
        lines.append(f"    {segment}: {markers_text(segment, found)}")
    return lines


def segments_of(overviews: Sequence[Overview]) -> dict[str, tuple[str, str]]:
    """Side and segment (`segment_of`) of each marker, by its name without the subject's, which a
    trial's column and the configuration have."""
    markers = [channel for one in overviews for channel in one.channels if channel.kind == "marker"]
    return {label: segment_of(label) for label in [one.name or one.key for one in markers]}


@dataclass(frozen=True)
class SteppedPlate:
    """The plate on the platform, and what tells it; empty if nothing does."""

    number: str
    why: str


def stepped_plate(overviews: Sequence[Overview], platform: Sequence[str]) -> SteppedPlate:
    """Tell the plate that is stepped on: the only one, or that below the platform's markers."""
    counts = [sum(one.kind == "plate" for one in overview.channels) for overview in overviews]
    most = max(counts, default=0)
    if most == 0:
        return SteppedPlate("", "no plate is read; state `plate_geometry` in the source file")
    if most == 1:
        return SteppedPlate("1", "the only one")
    below = {plate for overview in overviews if (plate := plate_below(overview.channels, platform))}
    if len(below) == 1:
        return SteppedPlate(below.pop(), "a guess: it lies below the platform's markers")
    return SteppedPlate("", f"of {most} force plates in this file")


@dataclass(frozen=True)
class SteppingLeg:
    """The side, R or L, of the leg that steps on the platform; empty without one. And what tells
    it, for a comment."""

    side: str
    why: str = ""


def stepping_leg(overviews: Sequence[Overview]) -> SteppingLeg:
    """Tell the leg by whose foot is on the platform's plate while it is loaded, in most captures;
    else by the only side that markers have, or R."""
    segments = segments_of(overviews)
    of_legs = {side for side, segment in segments.values() if segment in ("foot", "shank")}
    sides = sorted(of_legs - {""})
    if len(sides) < 2:
        side = "".join(sides)
        return SteppingLeg(side, ", a guess to be confirmed" if side else "")
    platform = [label for label, (_, segment) in segments.items() if segment == "platform"]
    plate = stepped_plate(overviews, platform).number
    steps = [foot_on_plate(overview.channels, segments, plate) for overview in overviews]
    counts = {side: steps.count(side) for side in sides}
    if counts["R"] == counts["L"]:
        return SteppingLeg("R", ", a guess to be confirmed: both have markers")
    side = max(counts, key=lambda side: counts[side])
    of_all = sum(counts.values())
    return SteppingLeg(side, f": its foot is on the plate in {counts[side]} of {of_all} captures")


def foot_on_plate(
    channels: Sequence[RecordedChannel], segments: Mapping[str, tuple[str, str]], plate: str
) -> str:
    """The side, R or L, of the foot that is on a plate while it is loaded; empty if nobody steps on
    it, or with both feet."""
    of_plate = next((one for one in channels if one.kind == "plate" and one.key == plate), None)
    if of_plate is None or of_plate.corners is None or of_plate.numbers is None:
        return ""
    change = of_plate.numbers - of_plate.numbers.min(initial=np.inf)
    if not change.max(initial=0.0) > LEAST_STEP_N:
        return ""
    distances: dict[str, list[float]] = {"R": [], "L": []}
    for channel in channels:
        side, segment = segments.get(channel.name or channel.key, ("", ""))
        if segment != "foot" or not side or channel.numbers is None:
            continue
        samples_per_frame = max(len(change) // max(len(channel.numbers), 1), 1)
        load = change[::samples_per_frame][: len(channel.numbers)]
        is_loaded = load > change.max() / 2
        places = channel.numbers[: len(load)][is_loaded] - of_plate.corners.mean(axis=0)
        distance = np.linalg.norm(places, axis=1)
        if np.isfinite(distance).any():
            distances[side].append(float(np.nanmedian(distance)))
    if not (distances["R"] and distances["L"]):
        return ""
    right, left = np.mean(distances["R"]), np.mean(distances["L"])
    if min(right, left) > MUCH_NEARER * max(right, left):
        return ""
    return "R" if right < left else "L"


def plate_below(channels: Sequence[RecordedChannel], platform: Sequence[str]) -> str:
    """The number of the plate whose centre is nearest to the platform's markers, and not farther
    from them than half of its length; empty if there is none."""
    places: list[Array] = []
    for channel in channels:
        is_of_platform = (channel.name or channel.key) in platform
        if channel.kind == "marker" and is_of_platform and channel.numbers is not None:
            seen = channel.numbers[np.isfinite(channel.numbers).all(axis=1)]
            if len(seen):
                places.append(np.median(seen, axis=0))
    if not places:
        return ""
    middle = np.mean(places, axis=0)
    distances: Mapping[str, float] = {
        channel.key: float(np.linalg.norm(channel.corners.mean(axis=0) - middle))
        for channel in channels
        if channel.corners is not None
    }
    lengths = {
        channel.key: float(np.linalg.norm(np.ptp(channel.corners, axis=0)))
        for channel in channels
        if channel.corners is not None
    }
    nearest = min(distances, key=lambda number: distances[number], default="")
    if nearest and distances[nearest] <= lengths[nearest] / 2:
        return nearest
    return ""


def markers_text(segment: str, found: Sequence[str]) -> str:
    """The markers of a segment in YAML, with what is to be checked."""
    names = [json.dumps(name) for name in found]
    if segment.startswith("ankle"):
        if len(names) == 1:
            return f"{names[0]}  # named so"
        remark = "none is known: named in the static trial?"
        if names:
            remark = f"one of {', '.join(names)}"
        return f"{UNKNOWN}  # {remark}"
    remark = "named so" if names else "none is known"
    if len(names) < SMALLEST_CLUSTER:
        names.append(UNKNOWN)
        remark = f"{remark}; a cluster has {SMALLEST_CLUSTER} or more"
    return f"[{', '.join(names)}]  # {remark}"
