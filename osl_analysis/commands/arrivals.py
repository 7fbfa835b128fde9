"""Recordings that arrive in a folder: which of them are complete, and which were examined before."""

import json
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from osl_analysis.commands.new_campaign import recordings_in
from osl_analysis.files import atomic_path
from osl_analysis.formats.bag_folder import recorded_files

QUIET_S = 4.0
"""A recording is complete if nothing was written to it for this long [s]."""
LONGEST_QUIET_S = 20.0
"""The same for one that paused before [s]."""
WRITING = re.compile(r"^flags:\s*\d*[12]$", re.MULTILINE)
"""How Linux says that a file is open for writing: the last digit of its flags."""

State = tuple[int, int]
"""Size [bytes] and date of the last change [ns] of all files of a recording."""


@dataclass
class Arrivals:
    """Which recordings in a folder are complete and new."""

    folder: Path
    seen: dict[str, State] = field(default_factory=dict)
    """Recordings that were examined, by their path in the folder."""
    growing: dict[str, tuple[State, float]] = field(default_factory=dict)
    """Those that are not, with the time [s] since which they have been as they are."""
    pauses: dict[str, float] = field(default_factory=dict)
    """The longest time [s] between two changes of a recording that was seen to grow."""

    def complete(self, now: float) -> list[tuple[Path, State]]:
        """Recordings that are new, or other than when they were examined, and rest: they have not changed for
        `QUIET_S`, or twice as long as they paused before, and no process writes to them.

        The caller enters them in `seen` once they are examined.
        """
        found = []
        for path in recordings_in(self.folder):
            name, state = path.relative_to(self.folder).as_posix(), state_of(path)
            if state is None or self.seen.get(name) == state:
                continue
            before, since = self.growing.get(name, (None, now))
            if before != state:
                grew = before is not None or name in self.seen
                self.pauses[name] = max(self.pauses.get(name, 0.0), now - since if grew else 0.0)
                since = now
            self.growing[name] = (state, since)
            quiet = min(max(QUIET_S, 2 * self.pauses.get(name, 0.0)), LONGEST_QUIET_S)
            if before == state and now - since >= quiet and not is_written(path):
                found.append((path, state))
        return found


def state_of(path: Path) -> State | None:
    """Size and date of a recording, of all files of one that is a folder; None if it is gone or empty."""
    try:
        states = [file.stat() for file in recorded_files(path)]
    except OSError:
        return None
    size = sum(state.st_size for state in states)
    return (size, max(state.st_mtime_ns for state in states)) if size else None


def is_written(path: Path) -> bool:
    """Whether a process of this machine has a file of a recording open, as far as the system tells (Linux)."""
    files = {str(file.resolve()) for file in recorded_files(path)}
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        with suppress(OSError):  # it is closed again, or belongs to somebody else
            flags = link.parents[1] / "fdinfo" / link.name
            if os.readlink(link) in files and WRITING.search(flags.read_text()):
                return True
    return False


def read_notes(path: Path) -> dict[str, State]:
    """The recordings that were examined before; none without notes, or with damaged ones."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {str(name): (int(size), int(date)) for name, (size, date) in content.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}


def write_notes(path: Path, seen: Mapping[str, State]) -> None:
    """Note what was examined, so that a restart does not repeat it."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(seen, indent=1) + "\n", encoding="utf-8")
