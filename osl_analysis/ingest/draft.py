"""Drafts of source files, of the section `walking`, and of a sample sheet, from files and their names. Texts from
files are quoted as JSON, which is valid YAML. Nothing is taken as told that is not."""

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.ingest.source import NAME_OF_TIME, UNKNOWN
from osl_analysis.ingest.units import base_units, dimension, is_unit, normalised
from osl_analysis.measured import factor_of
from osl_analysis.trial import COLUMNS

COMPUTED = "computed from the current, no measured torque"
MOTOR = r"\b(motor|actuator|act|output|gear|mot)\b"
COMMAND = r"\b(command|commanded|cmd|desired|des|ref|reference|target|setpoint|goal)\b"
ANGLE = r"(angle|position|pos|theta|encoder)"
SPEED = r"(velocity|vel|speed|omega)"
EFFORT = r"(torque|moment|tau|effort)"
PATTERNS = {
    "sync": (r"\bsync", "", "sync"),
    "trigger": (r"\btrig(ger)?\b", "", "trigger trig"),
    "theta_command": (COMMAND, rf"\b({EFFORT}|{SPEED}|current|stiffness|damping)\b", ""),
    "theta_m": (
        rf"{MOTOR}.*\b{ANGLE}\b|\b{ANGLE} (m\b|{MOTOR})",
        COMMAND,
        "actuator motor output angle position pos theta m encoder measured meas",
    ),
    "omega_m": (rf"{MOTOR}.*\b{SPEED}\b|\bomega m\b", COMMAND, ""),
    "torque_m": (rf"{MOTOR}.*\b{EFFORT}\b|\b{EFFORT} m\b", COMMAND, ""),
    "current": (r"\b(current|amps|iq|i q)\b", COMMAND, "motor actuator current iq i q amps measured meas"),
    "torque": (
        rf"\b({EFFORT}|load ?cell)\b",
        rf"{COMMAND}|{MOTOR}|ground",
        "ankle foot joint torque moment tau load cell loadcell measured meas sensor",
    ),
    "theta": (
        rf"\b({ANGLE}|ankle|knee|hip|joint)\b",
        rf"{COMMAND}|{MOTOR}|\b{SPEED}\b",
        "ankle foot joint angle position pos theta encoder measured meas name",
    ),
}
"""By column: what the words of a name contain, and what they do not; and the words of a name that leave no doubt:
`theta_d` may be a command, `knee_angle` is another joint's. The first that fits is the guess."""


def likely_column(channel: RecordedChannel) -> str:
    """The canonical column that a channel may be; empty where name and unit tell none. A stated or likely unit must be
    one of the column's; where the name tells nothing, what the unit measures is the guess."""
    words = words_of(" ".join(value for key, value in channel.address.items() if key != "topic"))
    unit = channel.unit or channel.likely_unit
    _, measured = (base_units(normalised(unit)) if unit else None) or (1.0, "")
    for column, (wanted, unwanted, _) in PATTERNS.items():
        fits = column in ("sync", "trigger") or not measured or measured == dimension(COLUMNS[column])
        if fits and re.search(wanted, words) and not (unwanted and re.search(unwanted, words)):
            return column
    known = {dimension("rad"): "theta", dimension("N*m"): "torque", dimension("A"): "current"}.get(measured, "")
    tell_too_little = rf"\b(ground|battery|supply|imu|roll|pitch|yaw|phase|current|{ANGLE}|{SPEED}|{EFFORT})\b"
    unwanted = f"{COMMAND}|{tell_too_little}" + f"|{MOTOR}" * (known != "current")
    return "" if re.search(unwanted, words) else known


def words_of(name: str) -> str:
    """The words of a name in small letters: `JointAngle_deg` is `joint angle deg`."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return " ".join(re.findall(r"[a-z]+|\d+", parted.casefold()))


def draft_source(overview: Overview, name: str, named: bool = False) -> str:
    """A source file for the file `name`, in which the user still has to name the channels. named: those that are the
    only one like a canonical column, and whose unit is known, have its name, and those like none are comments."""
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
        lines += [f"# {key}:"] * bool(channels)
        lines += [f"# {channel_line(number, channel)}" for number, channel in enumerate(channels, start=1)]
    return "\n".join([*lines, *(f"# {line}" for line in draft_walking(overview))]) + "\n"


def guessed_lines(draft: str) -> list[str]:
    """The lines of a drafted source file that give a channel the name of a column by a guess."""
    return [line.strip() for line in draft.splitlines() if "# guessed" in line and not line.startswith("#")]


def log_lines(overview: Overview, named: bool) -> Iterator[str]:
    """An entry for every channel but the clock, for the user to name; topics without messages and empty arrays are left
    out. Of more than eight, those that are like no canonical column by name and unit are comments. named: an entry has
    its column's name where only this channel is like it and its name leaves no doubt. One that may be another quantity,
    as a command or another joint's angle, is left to the user."""
    time: Any = overview.settings.get("time", {})
    clock = next((time[key] for key in ("column", "variable", "field", "channel") if key in time), "")
    listed = overview.channels if overview.drafted is None else overview.drafted
    yield from (f"# {text}" for text in overview.open)
    if clock == NAME_OF_TIME:
        yield "# time: name its column and unit, or state the rate of the rows instead, as {rate: 1000}"
    if any(c.likely_unit and not c.unit for c in listed if clock in c.address.values()):
        yield "# time: its unit is guessed from its name or from the rate of its readings: check it"
    todo = f"give each signal that you need its canonical name instead of NAME_n, state what is {UNKNOWN}"
    yield f"# {todo}, delete the rest"
    yield f"# canonical names: {', '.join(column for column in COLUMNS if column != 'time')}"
    yield "channels:"
    channels = [c for c in listed if not clock or clock not in c.address.values()]
    channels = [c for c in channels if "topic" not in c.address or ("field" in c.address and c.count)]
    guesses = [likely_column(channel) for channel in channels]
    currents = [c for c, guess in zip(channels, guesses, strict=True) if guess == "current"]
    for k, (channel, guess) in enumerate(zip(channels, guesses, strict=True)):
        if guess in ("torque", "torque_m") and (said := made_of(channel, currents)):
            channels[k], guesses[k] = replace(channel, note=said), ""
    comment_others = any(guesses) and (named or len(channels) > 8)
    for number, (channel, guess) in enumerate(zip(channels, guesses, strict=True), start=1):
        name = " ".join(value for key, value in channel.address.items() if key != "topic")
        words, unit = words_of(name).split(), words_of(channel.likely_unit).split()
        if unit and not channel.unit and words[-len(unit) :] == unit:  # the words of its unit do not count
            words = words[: -len(unit)]
        certain = bool(words) and guess != "" and set(words) <= set(PATTERNS[guess][2].split())
        line = channel_line(number, channel, guess, named and guesses.count(guess) == 1 and certain)
        yield f"# {line}" if comment_others and not guess else line


def made_of(channel: RecordedChannel, currents: Sequence[RecordedChannel]) -> str:
    """Of which current a torque is a constant times, in words; empty of none: that is no torque that was measured."""
    for current in currents:
        none = np.empty(0)
        y, x = (none if one.numbers is None else one.numbers for one in (channel, current))
        if (factor := factor_of(y, x)) is not None:
            name = json.dumps(list(current.address.values())[-1])
            return f"{name} times {factor:.4g}, to within rounding: {COMPUTED}"
    return ""


def channel_line(number: int, channel: RecordedChannel, guess: str = "", sure: bool = False) -> str:
    """One entry under `channels`; `guess` is the canonical column that it may be, or if that is `sure` is."""
    stated, is_guessed = channel.unit or channel.likely_unit, bool(channel.likely_unit and not channel.unit)
    unit = stated if stated and is_unit(stated) else UNKNOWN
    sure = sure and bool(guess) and unit != UNKNOWN
    said = [("guessed from its name" + ";" * is_guessed) if sure else f"{guess}?"] * bool(guess)
    said += [channel.note] * channel.note.endswith(COMPUTED)
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
    plates = [channel for channel in overview.channels if channel.kind == "plate"]
    loaded = [one for one in plates if (one.load or 0.0) > 100.0]
    own = [c.centre for c in overview.channels if c.centre and c.address.get("label") in clusters["platform"]]
    plate = (
        "1" if len(plates) == 1 else f"{UNKNOWN}  # of {len(plates)} force plates in this file: the one on the platform"
    )
    if len(plates) > 1 and loaded:
        guess, why = max(loaded, key=lambda one: one.load or 0.0), "the one with the load"
        if own and len(loaded) > 1:
            guess = min(loaded, key=lambda one: float(np.linalg.norm(np.subtract(one.centre, np.mean(own, axis=0)))))
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
    "static": r"(?<!quasi )\b(static|standing|stand|calibration|calib)\b",
    "walking": r"\b(walk|walking|cross|crossing|perturb|perturbed|perturbation|pert|unperturbed|unpert|gait)\b",
    "belt": r"\bbelt\b",
    "transmission": r"\b(transmission|drivetrain)\b",
    "actuator": r"\b(actuator|motor)\b",
    "impedance": r"\b(impedance|imp|stiffness|multisine|chirp|sines?)\b",
}
"""By experiment: what the words of a file's name contain. A name that tells several tells none."""
UNNAMED = "ingest_only"  # the experiment of a trial whose name tells none


def trial_name(path: Path) -> str:
    """A name for the trial of a file: that of the file without its ending, with `_` for what a name may not have."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", path.stem if path.suffix else path.name).lstrip("_.-")[:90] or "trial"


def draft_trials(recordings: Iterable[tuple[Path, str, bool]]) -> list[tuple[dict[str, str], list[str]]]:
    """The trials that recordings are, by what the words of their names tell: the cells of each in a sheet, and what of
    it the user has to decide. recordings: file or folder of each, relative to the folder of all, the name of its source
    file, and whether it comes from motion capture. A log and a capture of the same name are one. Sorted by name. A
    stated stiffness tells an impedance trial, but for one who walks. `k1` states none: it is a number of a file."""
    several: dict[str, dict[str, tuple[Path, str]]] = {}
    for path, source, is_capture in sorted(recordings, key=lambda recorded: recorded[0].as_posix()):
        number, name, role = 1, trial_name(path), "mocap" if is_capture else "log"
        free = name
        while role in several.get(free, ()):
            number += 1
            free = f"{name}_{number}"
        several.setdefault(free, {})[role] = path, source
    trials = []
    for name, files in several.items():
        path = next(iter(files.values()))[0]
        cells, said, still_open = {"trial": name}, path.stem if path.suffix else path.name, list[str]()
        for role, (file, source) in files.items():
            cells |= {role: file.as_posix(), f"{role}_source": source}
        words, numbers, begin = words_of(said.replace("_", " ")), {}, "(?<![A-Za-z])"
        for column, letter, smallest in (("K_d", "K", 10.0), ("B_d", "B", 0.0)):
            behind = r"(?=$|[_\s-]|[.,](?!\d)|[BbKk]_?d?[_=-]?\d)"
            found = set(re.findall(rf"{begin}{letter}_?d?[_=-]?(\d+(?:\.\d+)?){behind}", said, re.IGNORECASE))
            if len(found) == 1 and float(*found) >= smallest:
                (numbers[column],) = found
        told = [known for known, wanted in WORDS_OF_EXPERIMENTS.items() if re.search(wanted, words)]
        told += ["impedance"] * ("K_d" in numbers and not {"walking", "impedance"} & {*told})
        experiment = told[0] if len(told) == 1 else UNNAMED
        if experiment == UNNAMED:
            what = f"the name may tell {' or '.join(told)}" if told else "the name tells none"
            still_open.append(f"experiment: {what}; it stands as {UNNAMED}, which is not analysed")
        elif experiment == "impedance":
            for column in ("K_d", "B_d"):
                if column not in numbers:
                    still_open.append(f"{column}: the name does not tell; empty, nothing is compared with it")
            cells |= numbers
            controller = re.search(rf"{begin}(un|non[-_]?)?comp(?:ensated)?(?![A-Za-z])", said, re.IGNORECASE)
            if controller:
                cells["controller"] = "uncompensated" if controller[1] else "compensated"
        elif experiment == "walking":
            if re.search(r"\b(unperturbed|unpert|baseline|normal|level|free|no ?pert)\b", words):
                cells["perturbed"] = "false"
            elif re.search(r"\b(perturb|perturbed|perturbation|pert)\b", words):
                cells["perturbed"] = "true"
            else:
                experiment, remedy = UNNAMED, "write walking, and true or false"
                still_open.append(f"perturbed: the name does not tell; it stands as {UNNAMED}: {remedy}")
        trials.append((cells | {"experiment": experiment}, still_open))
    return trials
