"""A draft of the section `walking` of a configuration, from the names of markers in captures, and
from where the plates lie. What these do not tell is left to the user."""

import json
import re
from collections.abc import Sequence

import numpy as np

from osl_analysis.draft.recorded_channel import Overview, RecordedChannel
from osl_analysis.ingest.placeholders import UNKNOWN

SMALLEST_CLUSTER = 3  # markers that tell where a segment is
LEAST_STEP_N = 200.0  # by which the force on a plate changes when somebody steps on it
MUCH_NEARER = 0.5  # of the other foot's distance from the plate, for a foot that steps on it

# by segment: what the names of its markers begin with, and their codes behind an R or L in Plug-in
# Gait, OpenSim's models and Qualisys' (CAST)
SEGMENTS = {
    "platform": ("PLAT|HEXAPOD|STEWART", ""),
    "ankle_medial": (
        r"(?=.*((?<!SH)ANK|MAL)).*(MED|(^|_)M(_|MAL|$))", "MED|MMA|MMAL|MANK|TAM|AM|MM"
    ),
    # a marker called `ankle` and no more is the lateral one in all of them
    "ankle_lateral": ("(?<!SH)ANK|MAL", "LMA|LMAL|LANK|FAL|AL|LM"),
    "foot": (
        r"FOOT|SHOE|HEEL|CALC|TOE|META?\d", r"FCC|F[ML]\d?|FT\d|MT\d|MET|PM\d|HEE|CAL\d?|H"
    ),
    "shank": (
        r"SHANK|SHIN|TIB|PYLON|(?<!UP)(?<!UPPER)(?<!UPPER_)LEG",
        r"SK\d|S\d|TTC|TTB?|TB\d|SHA|HF|FAX",
    ),
}  # fmt: skip


def segment_of(label: str) -> tuple[str, str]:
    """Side, R or L, and segment of `SEGMENTS` that a marker's name tells behind the subject's;
    empty for none."""
    name = re.sub(r"[^A-Z0-9]+", "_", label.rpartition(":")[2].upper()).strip("_")
    forms: list[tuple[str, str]] = re.findall(r"^(RIGHT|LEFT|R|L)_?(.+)$", name)
    forms += [(side, rest) for rest, side in re.findall(r"^(.+)_(RIGHT|LEFT|R|L)$", name)]
    forms.append(("", name))
    for side, rest in forms:
        for segment, (begins, codes) in SEGMENTS.items():
            pattern = rf"(^|_)({begins})|^({codes})$" if side else begins
            if re.search(pattern, rest):
                return side[:1], segment
    return "", ""


def draft_walking(overviews: Sequence[Overview]) -> str:
    """The section `walking` in YAML by the captures of one laboratory; a comment where something is
    unknown, since other trials can be analysed without it. Empty unless markers are named as a
    foot's or shank's."""
    segments = segments_of(overviews)
    leg, why_leg = stepping_leg(overviews)
    clusters: dict[str, list[str]] = {segment: [] for segment in SEGMENTS}
    for label, (side, segment) in segments.items():
        if segment and (not leg or side in ("", leg)):
            clusters[segment].append(label)
    if not (clusters["foot"] or clusters["shank"]):
        return ""
    plate, why_plate = stepped_plate(overviews, clusters["platform"])
    lines = [
        "walking:  # a draft, from the names of markers: check every line",
        f"  side: {SIDES[leg]}  # the leg that steps on the platform{why_leg}",
        f"  plate: {plate or UNKNOWN}  # {why_plate}",
        "  markers:",
        *(f"    {segment}: {markers_text(segment, names)}" for segment, names in clusters.items()),
    ]
    if any(UNKNOWN in line for line in lines):
        remark = f"state what is {UNKNOWN}, and take away the `# ` of these lines:"
        lines = [f"# {line}" for line in (remark, *lines)]
    return "".join(f"{line}\n" for line in lines)


SIDES = {"R": "right", "L": "left", "": UNKNOWN}


def segments_of(overviews: Sequence[Overview]) -> dict[str, tuple[str, str]]:
    """Side and segment (`segment_of`) of each marker, by its name without the subject's, which a
    trial's column and the configuration have."""
    channels = [channel for overview in overviews for channel in overview.channels]
    labels = [channel.name for channel in channels if channel.kind == "marker"]
    return {label: segment_of(label) for label in labels}


def stepped_plate(overviews: Sequence[Overview], platform: Sequence[str]) -> tuple[str, str]:
    """The plate that is stepped on, the only one, or that below the platform's markers, and what
    tells it; empty if nothing does."""
    channels = [channel for overview in overviews for channel in overview.channels]
    most = len({channel.key for channel in channels if channel.kind == "plate"})
    if most == 0:
        return "", "no plate is read; state `plate_geometry` in the source file"
    if most == 1:
        return "1", "the only one"
    below = {plate_below(overview.channels, platform) for overview in overviews} - {""}
    if len(below) == 1:
        return below.pop(), "a guess: it lies below the platform's markers"
    return "", f"of {most} force plates in this file"


def stepping_leg(overviews: Sequence[Overview]) -> tuple[str, str]:
    """The side, R or L, of the leg that steps on the platform, and what tells it for a comment: its
    foot is on the platform's plate while that is loaded, in most captures; else the only side that
    markers have, or R. Empty without a side."""
    segments = segments_of(overviews)
    of_legs = {side for side, segment in segments.values() if segment in ("foot", "shank")}
    if not {"R", "L"} <= of_legs:
        side = "".join(of_legs - {""})
        return side, ", a guess to be confirmed" if side else ""
    platform = [label for label, (_, segment) in segments.items() if segment == "platform"]
    plate, _ = stepped_plate(overviews, platform)
    steps = [foot_on_plate(overview.channels, plate) for overview in overviews]
    right, left = steps.count("R"), steps.count("L")
    if right == left:
        return "R", ", a guess to be confirmed: both have markers"
    why = f": its foot is on the plate in {max(right, left)} of {right + left} captures"
    return "R" if right > left else "L", why


def foot_on_plate(channels: Sequence[RecordedChannel], number: str) -> str:
    """The side, R or L, of the foot that is on a plate while that is loaded; empty if nobody
    steps on it, or with both feet."""
    plate = next(
        (channel for channel in channels if channel.kind == "plate" and channel.key == number), None
    )
    if plate is None or plate.corners is None or not plate.numbers.size:
        return ""
    if np.ptp(plate.numbers) < LEAST_STEP_N:
        return ""
    load = plate.numbers - plate.numbers.min()
    centre = plate.corners.mean(axis=0)
    distances: dict[str, list[float]] = {"R": [], "L": []}
    for channel in channels:
        side, segment = segment_of(channel.name)
        if segment == "foot" and side:
            positions = channel.numbers
            samples_per_frame = max(load.size // max(len(positions), 1), 1)
            of_frames = load[::samples_per_frame][: len(positions)]
            loaded = positions[: len(of_frames)][of_frames > load.max() / 2]
            # the other foot swings past the plate: its usual place would be there
            away = np.linalg.norm(loaded - centre, axis=1)
            if np.isfinite(away).any():
                distances[side].append(float(np.nanmedian(away)))
    right, left = (np.mean(distances[side] or [np.nan]) for side in "RL")
    if right < MUCH_NEARER * left:
        return "R"
    return "L" if left < MUCH_NEARER * right else ""


def plate_below(channels: Sequence[RecordedChannel], platform: Sequence[str]) -> str:
    """The number of the plate whose centre is nearest to the platform's markers, and not farther
    from them than half of its length; empty if there is none."""
    places = [
        np.nanmedian(channel.numbers, axis=0)
        for channel in channels
        if channel.kind == "marker" and channel.name in platform and channel.count
    ]
    number = ""
    smallest = float("inf")
    for plate in channels:
        if plate.corners is None or not places:
            continue
        away = float(np.linalg.norm(plate.corners.mean(axis=0) - np.mean(places, axis=0)))
        length = np.linalg.norm(np.ptp(plate.corners, axis=0))
        if away < smallest and away <= length / 2:
            number = plate.key
            smallest = away
    return number


def markers_text(segment: str, labels: Sequence[str]) -> str:
    """The markers of a segment in YAML, with what is to be checked."""
    names = [json.dumps(label) for label in labels]
    if segment.startswith("ankle"):
        if len(names) == 1:
            return f"{names[0]}  # named so"
        remark = f"one of {', '.join(names)}" if names else "none is known: named in the static?"
        return f"{UNKNOWN}  # {remark}"
    remark = "named so" if names else "none is known"
    if len(names) < SMALLEST_CLUSTER:
        names.append(UNKNOWN)
        remark = f"{remark}; a cluster has {SMALLEST_CLUSTER} or more"
    return f"[{', '.join(names)}]  # {remark}"
