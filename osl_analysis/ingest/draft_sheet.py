"""A draft of a sample sheet: which recordings are one trial, and what each is, as far as the names of the files tell.

Nothing is taken as told that is not: a trial that no name describes is `ingest_only`, and is listed for the user.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from osl_analysis.ingest.likely_signal import words_of

EXPERIMENTS = {
    "torque_angle": r"torque angle|quasi ?static|\bslow\b",
    "plate": r"\b(plate|unloaded|empty|bare)\b",
    "static": r"\b(static|standing|stand|calibration|calib|cal|pose)\b",
    "walking": r"\b(walk|walking|cross|crossing|perturb|perturbed|perturbation|pert|unperturbed|unpert|gait)\b",
    "belt": r"\bbelt\b",
    "transmission": r"\b(transmission|trans|drivetrain)\b",
    "actuator": r"\b(actuator|motor)\b",
    "impedance": r"\b(impedance|imp|stiffness|multisine|chirp|sines?|compensated|uncompensated|comp)\b|\bk d? ?\d",
}
"""By experiment: what the words of a file's name contain. The first that fits is the guess."""
UNPERTURBED = r"\b(unperturbed|unpert|baseline|normal|level|free|no ?pert)\b"
PERTURBED = r"\b(perturb|perturbed|perturbation|pert)\b"
BETWEEN = "(?<![A-Za-z])"
STIFFNESS = re.compile(rf"{BETWEEN}K_?d?[_=-]?(\d{{1,4}}(?:\.\d+)?)", re.IGNORECASE)
DAMPING = re.compile(rf"{BETWEEN}B_?d?[_=-]?(\d{{1,3}}(?:\.\d+)?)", re.IGNORECASE)
CONTROLLER = re.compile(rf"{BETWEEN}(un|non[-_]?)?comp(?:ensated)?(?![A-Za-z])", re.IGNORECASE)
UNNAMED = "ingest_only"
"""The experiment of a trial whose name tells none."""


@dataclass(frozen=True)
class Recorded:
    """One recording that can be read."""

    path: Path
    """Its file or folder, relative to the folder of the recordings."""
    source: str
    """Name of the source file that describes it."""
    is_capture: bool
    """Whether it comes from motion capture."""


@dataclass
class DraftedTrial:
    """A row of a drafted sheet, and what of it the user has to decide."""

    cells: dict[str, str]
    open: list[str] = field(default_factory=list)


def draft_trials(recordings: Sequence[Recorded]) -> list[DraftedTrial]:
    """The trials that recordings are: a log and a capture of the same name are one. Sorted by name."""
    several: dict[str, list[Recorded]] = {}
    for one in sorted(recordings, key=lambda recorded: recorded.path.as_posix()):
        several.setdefault(free_name(trial_name(one.path), one, several), []).append(one)
    return [drafted(name, files) for name, files in several.items()]


def trial_name(path: Path) -> str:
    """A name for the trial of a file: that of the file without its ending, with `_` for what a name may not have."""
    stem = path.stem if path.suffix else path.name
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", stem).lstrip("_.-")[:90] or "trial"


def free_name(name: str, one: Recorded, taken: Mapping[str, list[Recorded]]) -> str:
    """The name itself where no other file of this kind has it, else with a number."""
    number, free = 1, name
    while any(other.is_capture == one.is_capture for other in taken.get(free, ())):
        number += 1
        free = f"{name}_{number}"
    return free


def drafted(name: str, files: Sequence[Recorded]) -> DraftedTrial:
    """The row of one trial."""
    cells = {"trial": name}
    for one in files:
        role = "mocap" if one.is_capture else "log"
        cells |= {role: one.path.as_posix(), f"{role}_source": one.source}
    trial = DraftedTrial(cells)
    words = words_of(name.replace("_", " "))
    experiment = next((known for known, wanted in EXPERIMENTS.items() if re.search(wanted, words)), UNNAMED)
    if experiment == UNNAMED:
        trial.open.append(f"experiment: the name tells none; it stands as {UNNAMED}, which is not analysed")
    cells["experiment"] = experiment
    if experiment == "impedance":
        state_impedance(name, trial)
    if experiment == "walking":
        state_perturbed(words, trial)
    return trial


def state_impedance(name: str, trial: DraftedTrial) -> None:
    """K_d, B_d and the controller, where the name has them."""
    for column, pattern in (("K_d", STIFFNESS), ("B_d", DAMPING)):
        found = pattern.search(name)
        if found:
            trial.cells[column] = found[1]
        else:
            trial.open.append(f"{column}: the name has none; empty, nothing is compared with it")
    controller = CONTROLLER.search(name)
    if controller:
        trial.cells["controller"] = "uncompensated" if controller[1] else "compensated"


def state_perturbed(words: str, trial: DraftedTrial) -> None:
    """Whether a crossing is perturbed, where the name says so."""
    for pattern, said in ((UNPERTURBED, "false"), (PERTURBED, "true")):
        if re.search(pattern, words):
            trial.cells["perturbed"] = said
            return
    trial.open.append("perturbed: the name does not tell; write true or false")
