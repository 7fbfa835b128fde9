"""Logs of two recorders of one trial: of names that differ by one word, of which one has an angle
and the other a torque."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from osl_analysis.draft.draft_sheet import stem_of
from osl_analysis.draft.likelihood import Guess, guessed_columns, with_documented_unit
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel
from osl_analysis.errors import listing
from osl_analysis.ingest.likely_clock import unwrapped

SHORTEST = 0.5  # of the longer log; one that is shorter is of another trial
LEAST_COMMON = 0.3  # share of the torque's variance that follows a motion; of another one's 0.1
COARSE_HZ = 50.0  # rate at which motion and torque are compared, without noise of derivatives


@dataclass(frozen=True)
class Log:
    """A log of one recorder, and what its channels may be."""

    file: Path
    overview: Overview
    guesses: Sequence[Guess]

    def has(self, column: str) -> bool:
        """Whether a channel is taken for a column."""
        return any(guess.column == column for guess in self.guesses)

    @property
    def channels(self) -> list[RecordedChannel]:
        """Its channels with their times [s] from its first row on."""
        clock = self.overview.clock
        signals = [with_documented_unit(one) for one in self.overview.drafted if one.count]
        if clock is None:
            return signals
        readings, _ = unwrapped(clock.numbers)
        times = (readings - readings[0]) * clock.base[0]
        return [replace(signal, times=times) for signal in signals]


def paired_logs(logs: Sequence[Log]) -> tuple[list[tuple[Log, Log]], list[tuple[str, str]]]:
    """Pair logs by name and by what they hold.

    Returns
    -------
    pairs
        With the angle and with the torque, whose guesses are made from both.
    questions
        Question and file of those that may belong together, and are not paired.
    """
    angles = [log for log in logs if log.has("theta") and not log.has("torque")]
    torques: dict[tuple[object, ...], dict[Path, Log]] = {}
    for log in logs:
        if log.has("torque") and not log.has("theta"):
            for rest in names_but_a_word(log.file):
                torques.setdefault(rest, {})[log.file] = log
    partners = {
        angle.file: {
            file: log
            for rest in names_but_a_word(angle.file)
            for file, log in torques.get(rest, {}).items()
        }
        for angle in angles
    }
    uses = Counter(file for found in partners.values() for file in found)
    pairs = []
    questions = []
    for angle in angles:
        found = partners[angle.file]
        names = f"{angle.file} and {listing([str(file) for file in found])}"
        if len(found) != 1 or max(uses[file] for file in found) > 1:
            why = "several files may be a trial's other one" if found else ""
        else:
            first, second = with_common_guesses(angle, *found.values())
            why = why_no_pair(first, second)
            if not why:
                pairs.append((first, second))
        if why:
            questions.append((f"{why}: if they are one trial, name `log` and `log_2`", names))
    alone = [log for log in angles if not partners[log.file]]
    alone += [log for found in torques.values() for log in found.values() if not uses[log.file]]
    if pairs:
        lack = "no file with the other of angle and torque belongs to it: copy it, or exclude it"
        questions += [(lack, str(file)) for file in dict.fromkeys(log.file for log in alone)]
    return pairs, questions


def names_but_a_word(file: Path) -> list[tuple[object, ...]]:
    """Folder and words of a file's name, all of them and without one."""
    words = re.split(r"[\W_]+", stem_of(file))
    return [(file.parent, *words[:place], *words[place + 1 :]) for place in range(len(words) + 1)]


def with_common_guesses(angle: Log, torque: Log) -> tuple[Log, Log]:
    """Both logs with what their channels are, by all of them."""
    guesses = guessed_columns([*angle.channels, *torque.channels])
    count = len(angle.channels)
    return replace(angle, guesses=guesses[:count]), replace(torque, guesses=guesses[count:])


def why_no_pair(angle: Log, torque: Log) -> str:
    """Why two logs are of different trials, in words; empty if they may be of one."""
    theta = next(guess.channel for guess in angle.guesses if guess.column == "theta")
    load = next(guess.channel for guess in torque.guesses if guess.column == "torque")
    if theta.times is None or load.times is None:
        return ""
    ends_s = [float(theta.times[-1]), float(load.times[-1])]
    if min(ends_s) < SHORTEST * max(ends_s):
        return f"they last {ends_s[0]:.4g} and {ends_s[1]:.4g} s"
    if angle.has("sync") and torque.has("sync"):
        return ""
    time = np.arange(0.0, min(ends_s), 1 / COARSE_HZ)
    motion = np.interp(time, theta.times, np.nan_to_num(theta.numbers))
    omega = np.gradient(motion)
    X = np.column_stack([motion, omega, np.gradient(omega), np.ones_like(time)])
    y = np.interp(time, load.times, np.nan_to_num(load.numbers))
    left = y - X @ np.linalg.lstsq(X, y)[0]
    if np.var(left) > (1 - LEAST_COMMON) * np.var(y):
        return "the torque does not follow the angle, if both begin at one instant"
    return ""
