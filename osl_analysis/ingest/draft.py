"""Drafts of source files, of the section `walking`, and of a sample sheet, from files and their names. Texts from
files are quoted, as JSON strings, which are valid YAML. Nothing is taken as told that is not."""

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.ingest.source import NAME_OF_TIME, UNKNOWN
from osl_analysis.ingest.units import base_units, dimension, is_unit, normalised
from osl_analysis.trial import COLUMNS

MOTOR = r"\b(motor|actuator|act|output|gear|mot)\b"
COMMAND = r"\b(command|commanded|cmd|desired|des|ref|reference|target|setpoint|goal)\b"
ANGLE = r"(angle|position|pos|theta|encoder)"
SPEED = r"(velocity|vel|speed|omega)"
EFFORT = r"(torque|moment|tau|effort)"
PATTERNS = {
    "sync": (r"\bsync", ""),
    "trigger": (r"\btrig(ger)?\b", ""),
    "theta_command": (COMMAND, rf"\b({EFFORT}|{SPEED}|current|stiffness|damping)\b"),
    "theta_m": (rf"{MOTOR}.*\b{ANGLE}\b|\b{ANGLE} (m\b|{MOTOR})", COMMAND),
    "omega_m": (rf"{MOTOR}.*\b{SPEED}\b|\bomega m\b", COMMAND),
    "torque_m": (rf"{MOTOR}.*\b{EFFORT}\b|\b{EFFORT} m\b", COMMAND),
    "current": (r"\b(current|amps|iq|i q)\b", COMMAND),
    "torque": (rf"\b({EFFORT}|load ?cell)\b", rf"{COMMAND}|{MOTOR}|ground"),
    "theta": (rf"\b({ANGLE}|ankle|knee|hip|joint)\b", rf"{COMMAND}|{MOTOR}|\b{SPEED}\b"),
}
"""By column: what the words of a name contain, and what they do not. The first that fits is the guess."""
# what is guessed of a name that tells nothing, by what its unit measures
BY_UNIT = {dimension("rad"): "theta", dimension("N*m"): "torque", dimension("A"): "current"}
OTHER = rf"\b(ground|battery|supply|imu|roll|pitch|yaw|phase|current|{ANGLE}|{SPEED}|{EFFORT})\b"  # tell too little


def likely_column(channel: RecordedChannel) -> str:
    """The canonical column that a channel may be; empty where name and unit tell none. A stated or likely unit must be
    one of the column's."""
    words = words_of(" ".join(value for key, value in channel.address.items() if key != "topic"))
    unit = channel.unit or channel.likely_unit
    measured = base_units(normalised(unit)) if unit else None
    for column, (wanted, unwanted) in PATTERNS.items():
        is_level = column in ("sync", "trigger")
        fits = is_level or measured is None or measured[1] == dimension(COLUMNS[column])
        if fits and re.search(wanted, words) and not (unwanted and re.search(unwanted, words)):
            return column
    known = BY_UNIT.get(measured[1], "") if measured else ""
    unwanted = f"{COMMAND}|{OTHER}" if known == "current" else f"{COMMAND}|{OTHER}|{MOTOR}"
    return "" if re.search(unwanted, words) else known


PLAIN = {
    "theta": "ankle foot joint angle position pos theta encoder measured meas name",
    "theta_m": "actuator motor output angle position pos theta m encoder measured meas",
    "torque": "ankle foot joint torque moment tau load cell loadcell measured meas sensor",
    "current": "motor actuator current iq i q amps measured meas",
    "sync": "sync", "trigger": "trigger trig",
}  # fmt: skip
"""By column: the words of a name that leave no doubt. `theta_d` may be a command, `knee_angle` is another joint's."""


def words_of(name: str) -> str:
    """The words of a name in small letters: `JointAngle_deg` is `joint angle deg`."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return " ".join(re.findall(r"[a-z]+|\d+", parted.casefold()))


def draft_source(overview: Overview, name: str, named: bool = False) -> str:
    """A source file for the file `name`, in which the user still has to name the channels. named: a channel that is the
    only one like a canonical column, and whose unit is known, has this column's name. Those that are like none are
    comments."""
    lines = [
        f"format: {overview.format}",
        f"description: {json.dumps(f'Drafted from {name}; complete it.')}",
        *(f"{key}: {json.dumps(value)}" for key, value in overview.settings.items()),
    ]
    if not FORMATS[overview.format].is_capture:
        return "\n".join([*lines, *log_lines(overview, named)]) + "\n"
    # all markers; analog channels and model outputs as comments, for the user to name; so is a walking section
    labels = [json.dumps(c.address["label"]) for c in overview.channels if c.kind == "marker"]
    lines += ["markers: all", f"# or some: markers: [{', '.join(dict.fromkeys(labels))}]"]
    for key, kinds in (("analogs", ("analog", "device")), ("outputs", ("model output",))):
        channels = [c for c in overview.channels if c.kind in kinds]
        lines += [f"# {key}:"] if channels else []
        lines += [f"# {channel_line(number, channel)}" for number, channel in enumerate(channels, start=1)]
    return "\n".join([*lines, *(f"# {line}" for line in draft_walking(overview))]) + "\n"


def guessed_lines(draft: str) -> list[str]:
    """The lines of a drafted source file that give a channel the name of a column by a guess."""
    return [line.strip() for line in draft.splitlines() if "# guessed" in line and not line.startswith("#")]


def log_lines(overview: Overview, named: bool) -> Iterator[str]:
    """Every channel but the clock, for the user to name; topics without messages and empty arrays are left out."""
    time: Any = overview.settings.get("time", {})
    clock = next((time[key] for key in ("column", "variable", "field", "channel") if key in time), "")
    listed = overview.channels if overview.drafted is None else overview.drafted
    yield from (f"# {text}" for text in (*overview.open, overview.draft_note) if text)
    if clock == NAME_OF_TIME:
        yield "# time: name its column and unit, or state the rate of the rows instead, as {rate: 1000}"
    if any(c.likely_unit and not c.unit for c in listed if clock in c.address.values()):
        yield "# time: its unit is guessed from its name or from the rate of its readings: check it"
    yield (
        "# give each signal that you need its canonical name instead of NAME_n, "
        f"state what is {UNKNOWN}, delete the rest"
    )
    yield f"# canonical names: {', '.join(column for column in COLUMNS if column != 'time')}"
    yield "channels:"
    channels = [c for c in listed if not clock or clock not in c.address.values()]
    yield from channel_lines(
        [c for c in channels if "topic" not in c.address or ("field" in c.address and c.count)], named
    )


def channel_lines(channels: Sequence[RecordedChannel], named: bool = False) -> Iterator[str]:
    """An entry per channel. Of more than eight, those that are like no canonical column by name and unit are comments.
    named: an entry has its column's name where only this channel is like it and its name leaves no doubt. One that may
    be another quantity, as a command or another joint's angle, is left to the user."""
    guesses = [likely_column(channel) for channel in channels]
    times = Counter(guesses)
    comment_others = any(guesses) and (named or len(channels) > 8)
    for number, (channel, guess) in enumerate(zip(channels, guesses, strict=True), start=1):
        name = " ".join(value for key, value in channel.address.items() if key != "topic")
        words, unit = words_of(name).split(), words_of(channel.likely_unit).split()
        if unit and not channel.unit and words[-len(unit) :] == unit:  # the words of its unit do not count
            words = words[: -len(unit)]
        certain = bool(words) and set(words) <= set(PLAIN.get(guess, "").split())
        line = channel_line(number, channel, guess, named and times[guess] == 1 and certain)
        yield f"# {line}" if comment_others and not guess else line


def channel_line(number: int, channel: RecordedChannel, guess: str = "", sure: bool = False) -> str:
    """One entry under `channels`; `guess` is the canonical column that it may be, or if that is `sure` is."""
    stated, is_guessed = channel.unit or channel.likely_unit, bool(channel.likely_unit and not channel.unit)
    unit = stated if stated and is_unit(stated) else UNKNOWN
    sure = sure and bool(guess) and unit != UNKNOWN
    said = [("guessed from its name" + ";" * is_guessed) if sure else f"{guess}?"] * bool(guess)
    said += [f"no known unit: {json.dumps(channel.unit)}"] * (bool(channel.unit) and unit == UNKNOWN)
    said += ["the unit is guessed: check it"] * is_guessed
    entry = ", ".join(f"{key}: {json.dumps(value)}" for key, value in {**channel.address, "unit": unit}.items())
    comment = f"  # {' '.join(said)}" if said else ""
    return f"  {guess if sure else f'NAME_{number}'}: {{{entry}}}{comment}"


def draft_walking(overview: Overview) -> list[str]:
    """Lines of YAML, which stand as comments below the draft of a source file. What names do not tell is UNKNOWN. None
    unless markers are named as a platform's and as a foot's or shank's."""

    def containing(word: str, among: Sequence[str]) -> list[str]:
        """The labels that contain a pattern; the name of the subject before a colon does not count."""
        return [label for label in among if re.search(word, label.rpartition(":")[2].upper())]

    labels = list(dict.fromkeys(c.address["label"] for c in overview.channels if c.kind == "marker"))
    ankle = containing("ANK|MALL?", labels)
    malleoli = {"ankle_medial": containing(r"MED|(^|_)M(_|MAL|$)", ankle)}
    malleoli["ankle_lateral"] = containing(r"LAT|(^|_)L(_|MAL|$)", ankle)
    free = [name for name in labels if not any(name in names for names in malleoli.values())]
    clusters = {
        "foot": containing(r"FOOT|SHOE|HEEL|CALC|TOE|META?\d", free),
        "shank": containing(r"SHANK|SHIN|TIB|PYLON|LEG", free),
        "platform": containing(r"PLAT|HEXAPOD|STEWART", free),
    }
    if not clusters["platform"] or not (clusters["foot"] or clusters["shank"]):
        return []
    # the plate on the platform: with load, on which somebody stepped; of several with load the nearest to the markers
    plates, plate = [channel for channel in overview.channels if channel.kind == "plate"], "1"
    loaded = [one for one in plates if (one.load or 0.0) > 100.0]
    own = [
        c for c in overview.channels if c.kind == "marker" and c.address["label"] in clusters["platform"] and c.centre
    ]
    if len(plates) != 1:
        plate = f"{UNKNOWN}  # of {len(plates)} force plates in this file: the one on the platform"
    if len(plates) > 1 and loaded:
        guess, why = max(loaded, key=lambda one: one.load or 0.0), "the one with the load"
        if own and len(loaded) > 1:
            place = np.mean([marker.centre for marker in own], axis=0)
            guess = min(loaded, key=lambda one: float(np.linalg.norm(np.asarray(one.centre) - place)))
            why = "with load the one that is nearest to the platform's markers"
        plate = f"{guess.address['plate']}  # a guess, to be confirmed: of {len(plates)} force plates {why}"
    lines = [
        "Draft of the section `walking` of the configuration, guessed from the names of markers. Check every line.",
        "walking:",
        "  side: UNKNOWN  # left or right: the leg that steps on the platform",
        f"  plate: {plate}",
        "  markers:",
    ]
    for key, names in clusters.items():
        lines.append(f"    {key}: {json.dumps(names)}{'  # UNKNOWN: a cluster has 3 or more' * (len(names) < 3)}")
    for key, names in malleoli.items():
        several = f"one of {', '.join(json.dumps(name) for name in names)}" if names else "named in the static trial"
        lines.append(f"    {key}: {json.dumps(names[0]) if len(names) == 1 else f'UNKNOWN  # {several}'}")
    return lines


WORDS_OF_EXPERIMENTS = {
    "torque_angle": r"\b(torque angle|quasi ?static)\b",
    "plate": r"\b(plate|unloaded)\b",
    "static": r"\b(static|standing|stand|calibration|calib)\b",
    "walking": r"\b(walk|walking|cross|crossing|perturb|perturbed|perturbation|pert|unperturbed|unpert|gait)\b",
    "belt": r"\bbelt\b",
    "transmission": r"\b(transmission|drivetrain)\b",
    "actuator": r"\b(actuator|motor)\b",
    "impedance": r"\b(impedance|imp|stiffness|multisine|chirp|sines?)\b",
}
"""By experiment: what the words of a file's name contain. A name that tells several tells none."""
CROSSINGS = {
    "false": r"\b(unperturbed|unpert|baseline|normal|level|free|no ?pert)\b",
    "true": r"\b(perturb|perturbed|perturbation|pert)\b",
}
"""By the cell `perturbed`: what the words of a crossing's name contain. The first that fits counts."""
BETWEEN = "(?<![A-Za-z])"  # what stands before a letter or a word of a name
UNNAMED = "ingest_only"  # the experiment of a trial whose name tells none


@dataclass(frozen=True)
class Recorded:
    """One recording that can be read."""

    path: Path  # its file or folder, relative to the folder of the recordings
    source: str  # name of the source file that describes it
    is_capture: bool  # whether it comes from motion capture


@dataclass
class DraftedTrial:
    """A row of a drafted sheet, and what of it the user has to decide."""

    cells: dict[str, str]
    open: list[str] = field(default_factory=list)


def trial_name(path: Path) -> str:
    """A name for the trial of a file: that of the file without its ending, with `_` for what a name may not have."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", path.stem if path.suffix else path.name).lstrip("_.-")[:90] or "trial"


def draft_trials(recordings: Sequence[Recorded]) -> list[DraftedTrial]:
    """The trials that recordings are, by what the words of their names tell: a log and a capture of the same name
    are one. Sorted by name. A stated stiffness tells an impedance trial, but for one who walks. `k1` states none: it is
    a number of a file."""
    several: dict[str, list[Recorded]] = {}
    for one in sorted(recordings, key=lambda recorded: recorded.path.as_posix()):
        number, name = 1, trial_name(one.path)
        free = name
        while any(other.is_capture == one.is_capture for other in several.get(free, ())):
            number += 1
            free = f"{name}_{number}"
        several.setdefault(free, []).append(one)
    trials = []
    for name, files in several.items():
        path = files[0].path
        cells, said, still_open = {"trial": name}, path.stem if path.suffix else path.name, list[str]()
        for one in files:
            role = "mocap" if one.is_capture else "log"
            cells |= {role: one.path.as_posix(), f"{role}_source": one.source}
        words, numbers = words_of(said.replace("_", " ")), {}
        for column, letter, smallest in (("K_d", "K", 10.0), ("B_d", "B", 0.0)):
            behind = r"(?=$|[_\s-]|[.,](?!\d)|[BbKk]_?d?[_=-]?\d)"
            found = set(re.findall(rf"{BETWEEN}{letter}_?d?[_=-]?(\d+(?:\.\d+)?){behind}", said, re.IGNORECASE))
            if len(found) == 1 and float(*found) >= smallest:
                (numbers[column],) = found
        told = [known for known, wanted in WORDS_OF_EXPERIMENTS.items() if re.search(wanted, words)]
        told += ["impedance"] * ("K_d" in numbers and not {"walking", "impedance"} & {*told})
        experiment = cells["experiment"] = told[0] if len(told) == 1 else UNNAMED
        if experiment == UNNAMED:
            what = f"the name may tell {' or '.join(told)}" if told else "the name tells none"
            still_open.append(f"experiment: {what}; it stands as {UNNAMED}, which is not analysed")
        elif experiment == "impedance":
            for column in ("K_d", "B_d"):
                if column not in numbers:
                    still_open.append(f"{column}: the name does not tell; empty, nothing is compared with it")
            cells |= numbers
            controller = re.search(rf"{BETWEEN}(un|non[-_]?)?comp(?:ensated)?(?![A-Za-z])", said, re.IGNORECASE)
            if controller:
                cells["controller"] = "uncompensated" if controller[1] else "compensated"
        elif experiment == "walking":
            crossing = next((cell for cell, wanted in CROSSINGS.items() if re.search(wanted, words)), None)
            if crossing is None:
                cells["experiment"] = UNNAMED
                remedy = "write walking, and true or false"
                still_open.append(f"perturbed: the name does not tell; it stands as {UNNAMED}: {remedy}")
            else:
                cells["perturbed"] = crossing
        trials.append(DraftedTrial(cells, still_open))
    return trials
