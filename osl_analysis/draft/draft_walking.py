# SPDX-License-Identifier: Apache-2.0
"""Draft the section `walking` of a configuration, from names of markers and places of plates.

A fact that neither states is a question to the user.
"""

import re
from collections.abc import Sequence

import numpy as np

from osl_analysis.base.errors import quoted
from osl_analysis.base.yaml_settings import UNKNOWN
from osl_analysis.draft.likelihood import likelihoods
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel
from osl_analysis.ingest.quality import FEWEST_MARKERS

SIDES = {"R": "right", "L": "left", "": UNKNOWN}
SEGMENTS = likelihoods()["segments"]


def segment_of(label: str) -> tuple[str, str]:
    """Side, R or L, and segment of `SEGMENTS` that a marker's name tells behind the subject's;
    empty for none."""
    name = re.sub(r"[^A-Z0-9]+", "_", label.rpartition(":")[2].upper()).strip("_")
    forms: list[tuple[str, str]] = re.findall(r"^(RIGHT|LEFT|R|L)_?(.+)$", name)
    forms += [
        (side, segment_name) for segment_name, side in re.findall(r"^(.+)_(RIGHT|LEFT|R|L)$", name)
    ]
    forms.append(("", name))
    for side, segment_name in forms:
        for segment, (begins, codes) in SEGMENTS.items():
            is_letter = len(side) == 1  # which may belong to the word, as in LEG
            pattern = rf"(^|_)({begins})|^({codes})$" if is_letter else begins
            if re.search(pattern, segment_name):
                return side[:1], segment
    return "", ""


def with_side(label: str, labels: Sequence[str]) -> tuple[str, str]:
    """Side and segment of a marker, of whose side its mirror image tells where its name does not:
    `RMIDFOOT` beside `LMIDFOOT`."""
    side, segment = segment_of(label)
    if segment and not side:
        subject, sign, name = label.rpartition(":")
        for letter, opposite_letter in (("R", "L"), ("L", "R")):
            if name.startswith(letter) and f"{subject}{sign}{opposite_letter}{name[1:]}" in labels:
                return letter, segment
    return side, segment


def draft_walking(overviews: Sequence[Overview], is_needed: bool) -> tuple[str, list[str]]:
    """The section `walking` in YAML by the captures of one laboratory; a comment where something is
    unknown, unless a trial needs it. And what the user has to decide."""
    channels = [channel for overview in overviews for channel in overview.channels]
    labels = [channel.name for channel in channels if channel.kind == "marker"]
    segments = {label: with_side(label, labels) for label in labels}
    platform = [label for label, (_, segment) in segments.items() if segment == "platform"]
    plate, why_plate = stepped_plate(channels, platform)
    sides = {side for side, segment in segments.values() if segment in ("foot", "shank")} - {""}
    leg = min(sides, key="RL".index, default="")
    clusters: dict[str, list[str]] = {segment: [] for segment in SEGMENTS}
    for label, (side, segment) in segments.items():
        if segment and (not leg or side in ("", leg)):
            clusters[segment].append(label)
    questions = []
    if len(sides) > 1:
        questions.append("`walking.side`: both legs have markers; does the right one step on it?")
    lines = [
        "walking:  # a draft, from the names of markers: check every line",
        f"  side: {SIDES[leg]}  # the leg that steps on the platform, a guess",
        f"  plate: {plate or UNKNOWN}  # {why_plate}",
        "  markers:",
        *(f"    {segment}: {markers_text(segment, names)}" for segment, names in clusters.items()),
        "",
    ]
    text = "\n".join(lines)
    if UNKNOWN in text:
        questions.append(
            f"the section `walking`: replace each {UNKNOWN} by a marker's name, a number or a side;"
            " if its lines are comments and somebody walks, take away their `# `"
        )
        if not is_needed:
            text = text.replace("\n", "\n# ").removesuffix("# ")
            text = f"# as long as no trial walks; else take away the `# ` of these lines:\n# {text}"
    return text, questions


def stepped_plate(channels: Sequence[RecordedChannel], platform: Sequence[str]) -> tuple[str, str]:
    """The number of the plate that is stepped on, and what tells it: the only one, or that whose
    centre is nearest to the platform's markers. Empty if none is."""
    plates = {channel.key: channel for channel in channels if channel.kind == "plate"}
    if len(plates) == 1:
        return next(iter(plates)), "the only one"
    places = [
        np.nanmedian(channel.numbers, axis=0)
        for channel in channels
        if channel.kind == "marker" and channel.name in platform and channel.count
    ]
    if not (plates and places):
        return "", f"of {len(plates)} force plates"
    away = {
        key: np.linalg.norm(plate.numbers.mean(axis=0) - np.mean(places, axis=0))
        for key, plate in plates.items()
    }
    return min(away, key=lambda key: away[key]), "a guess: the nearest to the platform's markers"


def markers_text(segment: str, labels: Sequence[str]) -> str:
    """The markers of a segment in YAML, with what is to be checked."""
    names = [*map(quoted, labels)]
    if segment.startswith("ankle"):
        among = f"one of {', '.join(names)}" if names else "none is known: named in the static?"
        return names[0] if len(names) == 1 else f"{UNKNOWN}  # {among}"
    if len(names) < FEWEST_MARKERS:
        names.append(UNKNOWN)
    return f"[{', '.join(names)}]  # {FEWEST_MARKERS} or more"
