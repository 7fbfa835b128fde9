# SPDX-License-Identifier: Apache-2.0
"""Recordings as a draft describes them, and pairs of logs that two recorders wrote of one trial."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path

import numpy as np

from osl_analysis.base.errors import listing
from osl_analysis.draft.draft_sheet import is_fixture_alone, stem_of
from osl_analysis.draft.draft_source import guesses_of
from osl_analysis.draft.likelihood import Guess, correlation
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel

PARTS = {"theta", "torque"}  # of which each log of a pair has one
MOST_APART = 2  # words of which one of two names has each
NAME_BOTH = "name both files of a trial as `log` and `log_2`"
MISSING = f"the file with the other of angle and torque is missing: copy it, or {NAME_BOTH}"
SEVERAL = f"one of several files may be the other one of these: {NAME_BOTH}"
SHORTEST = 0.5  # of the longer log; one that is shorter is of another trial
LEAST_COMMON = 0.3  # correlation of a torque with angle and velocity of its trial; of others 0.1


@dataclass
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


def pair_logs(recordings: Sequence[Described]) -> tuple[dict[Path, Path], list[tuple[str, str]]]:
    """Pair logs by name and by what they hold; the channels of a pair are guessed from both.

    Returns
    -------
    first_of
        File with the angle, by that with the torque: words of their names and folders are the same
        but for one, which is no number.
    questions
        Why others are not paired, and which files.
    """
    logs = {each.file: each for each in recordings if not each.overview.is_capture}
    angles = {file for file, log in logs.items() if {*log.likely} & PARTS == {"theta"}}
    torques = {file for file, log in logs.items() if {*log.likely} & PARTS == {"torque"}}
    alike = names_alike(angles, torques)
    uses = Counter(chain.from_iterable(alike))
    first_of = {}
    questions = [(MISSING, str(file)) for file in sorted(angles | torques) if not uses[file]]
    several = [str(file) for file in sorted(uses) if uses[file] > 1]
    if several:
        questions.append((SEVERAL, listing(several)))
    for angle, torque in alike:
        if uses[angle] > 1 or uses[torque] > 1:
            continue
        why = why_no_pair(logs[angle].likely, logs[torque].likely)
        if why:
            questions.append((f"{why}: {NAME_BOTH}", f"{angle} and {torque}"))
            continue
        first_of[torque] = angle
        guesses = guesses_of(logs[angle].overview, logs[torque].overview)
        count = len(logs[angle].guesses)
        logs[angle].guesses = guesses[:count]
        logs[torque].guesses = guesses[count:]
    return first_of, questions if angles and torques else []


def names_alike(angles: Set[Path], torques: Set[Path]) -> list[tuple[Path, Path]]:
    """Pairs of files whose words, of name and folders, are the same but for `MOST_APART`, none of
    which has a digit."""
    words = {
        file: {*re.split(r"[\W_]+", f"{file.parent}/{stem_of(file)}")} for file in angles | torques
    }
    pairs = []
    for angle, torque in product(sorted(angles), sorted(torques)):
        differing = words[angle] ^ words[torque]
        if len(differing) <= MOST_APART and not re.search(r"\d", " ".join(differing)):
            pairs.append((angle, torque))
    return pairs


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
