"""Recordings as a draft describes them, and pairs of logs that two recorders wrote of one trial."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from osl_analysis.draft.draft_sheet import is_fixture_alone, stem_of
from osl_analysis.draft.draft_source import guesses_of
from osl_analysis.draft.likelihood import Guess, correlation
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel
from osl_analysis.errors import listing

SHORTEST = 0.5  # of the longer log; one that is shorter is of another trial
LEAST_COMMON = 0.3  # correlation of a torque with angle and velocity of its trial; of others 0.1


@dataclass(frozen=True)
class Described:
    """A recording of a folder, and the source file that it shares with others like it."""

    file: Path  # relative to the folder
    overview: Overview
    guesses: Sequence[Guess]
    source: str

    @property
    def torque_sign(self) -> int:
        """1 or -1, if a torque is surely told, and its sign; else 0."""
        return next(
            (each.sign for each in self.guesses if each.is_sure and each.column == "torque"), 0
        )

    @property
    def tells(self) -> tuple[bool, int, bool, int]:
        """How much it tells: whether a joint turns, whose spring has the torque's sign, and no
        fixture alone; channels; that sign; and channels that may be signals, or whether its markers
        tell which axis points up."""
        details = sum(not guess.why_not for guess in self.guesses)
        details += "axes" in self.overview.settings
        turns = not is_fixture_alone(self.file)
        return turns, len(self.overview.channels), self.torque_sign != 0, details

    @property
    def likely(self) -> dict[str, RecordedChannel]:
        """Its channels by the columns that they are taken for."""
        return {guess.column: guess.channel for guess in self.guesses}


def second_logs(logs: Sequence[Described]) -> tuple[dict[Path, Path], dict[str, str]]:
    """Pair logs by name and by what they hold.

    Returns
    -------
    seconds
        File with the torque, by that with the angle: their names differ by a word.
    questions
        Why others are not paired, by the files.
    """
    likely = {log.file: log.likely for log in logs}
    halves = [file for file in likely if len(likely[file].keys() & {"theta", "torque"}) == 1]
    alike: dict[object, list[Path]] = {}
    for file in halves:
        for name in names_but_a_word(file):
            alike.setdefault(name, []).append(file)
    partners = {
        file: {
            other
            for name in names_but_a_word(file)
            for other in alike[name]
            if ("theta" in likely[other]) != ("theta" in likely[file])
        }
        for file in halves
    }
    seconds = {}
    questions = {}
    for file, others in partners.items():
        group = {file}.union(others, *(partners[other] for other in others))
        why = "the other file of the trial is missing, or one of several"
        if len(group) == 2:
            first, second = sorted(group, key=lambda each: "torque" in likely[each])
            why = why_no_pair(likely[first], likely[second])
            if not why:
                seconds[first] = second
        if why and len({"theta" in likely[half] for half in halves}) == 2:
            questions[listing([str(each) for each in sorted(group)])] = why
    return seconds, questions


def names_but_a_word(file: Path) -> list[object]:
    """Folder and words of a file's name, all of them and without one that is no number or date."""
    words = re.split(r"[\W_]+", stem_of(file))
    names: list[object] = [(file.parent, *words)]
    for place, word in enumerate(words):
        if not re.search(r"\d", word):
            names.append((file.parent, *words[:place], *words[place + 1 :]))
    return names


def why_no_pair(
    angles: Mapping[str, RecordedChannel], torques: Mapping[str, RecordedChannel]
) -> str:
    """Why two logs, by likely columns, are of different trials; empty if they may be of one."""
    theta, torque = angles["theta"], torques["torque"]
    if theta.times is None or torque.times is None:
        return ""
    shorter_s, longer_s = sorted([theta.times[-1], torque.times[-1]])
    if shorter_s < SHORTEST * longer_s:
        return f"one lasts {longer_s:.4g} s, and the other {shorter_s:.4g}"
    if angles.keys() & torques.keys() - {""}:
        return ""  # what both recorded aligns them
    follows = correlation(theta, torque), correlation(theta, torque, of_speed=True)
    if np.hypot(*follows) < LEAST_COMMON:
        return "the torque does not follow the angle, if both begin at one instant"
    return ""


def with_common_guesses(log: Described, second: Described) -> list[Described]:
    """Both logs of a trial with what their channels are, by the channels of both."""
    guesses = guesses_of(log.overview, second.overview)
    count = len(log.guesses)
    return [replace(log, guesses=guesses[:count]), replace(second, guesses=guesses[count:])]
