"""A draft of a sample sheet: which recordings are one trial, and what each is, as far as the names of the files tell.

Nothing is taken as told that is not: a trial that no name describes is `ingest_only`, and is listed for the user.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from osl_analysis.ingest.likely_signal import words_of

EXPERIMENTS = {
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
UNPERTURBED = r"\b(unperturbed|unpert|baseline|normal|level|free|no ?pert)\b"
PERTURBED = r"\b(perturb|perturbed|perturbation|pert)\b"
BETWEEN, END = "(?<![A-Za-z])", r"(?=$|[_\s-]|[.,](?!\d)|[BbKk]_?d?[_=-]?\d)"
STIFFNESS = re.compile(rf"{BETWEEN}K_?d?[_=-]?(\d+(?:\.\d+)?){END}", re.IGNORECASE)
DAMPING = re.compile(rf"{BETWEEN}B_?d?[_=-]?(\d+(?:\.\d+)?){END}", re.IGNORECASE)
CONTROLLER = re.compile(rf"{BETWEEN}(un|non[-_]?)?comp(?:ensated)?(?![A-Za-z])", re.IGNORECASE)
SOFTEST = 10.0
"""Smallest stiffness [N*m/rad] that a name is taken to state: `k1` is a number of a file."""
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
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", own_name(path)).lstrip("_.-")[:90] or "trial"


def own_name(path: Path) -> str:
    """The name of a file without its ending, or of a folder."""
    return path.stem if path.suffix else path.name


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
    trial, said = DraftedTrial(cells), own_name(files[0].path)
    told = experiments_in(said)
    cells["experiment"] = told[0] if len(told) == 1 else UNNAMED
    if cells["experiment"] == UNNAMED:
        what = f"the name may tell {' or '.join(told)}" if told else "the name tells none"
        trial.open.append(f"experiment: {what}; it stands as {UNNAMED}, which is not analysed")
    if cells["experiment"] == "impedance":
        state_impedance(said, trial)
    if cells["experiment"] == "walking":
        state_perturbed(words_of(said.replace("_", " ")), trial)
    return trial


def experiments_in(name: str) -> list[str]:
    """The experiments that a name may tell. A stated stiffness tells an impedance trial, but for one who walks."""
    words = words_of(name.replace("_", " "))
    told = [known for known, wanted in EXPERIMENTS.items() if re.search(wanted, words)]
    stiff = "walking" not in told and stated(STIFFNESS, name, SOFTEST) is not None
    return [*told, *["impedance"] * (stiff and "impedance" not in told)]


def stated(pattern: re.Pattern[str], name: str, smallest: float = 0.0) -> str | None:
    """The one number that a name has behind a letter, as text; None without one, with several, or with a small one."""
    found = set(pattern.findall(name))
    return next((text for text in found if float(text) >= smallest), None) if len(found) == 1 else None


def state_impedance(name: str, trial: DraftedTrial) -> None:
    """K_d, B_d and the controller, where the name has them."""
    for column, number in (("K_d", stated(STIFFNESS, name, SOFTEST)), ("B_d", stated(DAMPING, name))):
        if number is not None:
            trial.cells[column] = number
        else:
            trial.open.append(f"{column}: the name does not tell; empty, nothing is compared with it")
    controller = CONTROLLER.search(name)
    if controller:
        trial.cells["controller"] = "uncompensated" if controller[1] else "compensated"


def state_perturbed(words: str, trial: DraftedTrial) -> None:
    """Whether a crossing is perturbed, where the name says so."""
    for pattern, said in ((UNPERTURBED, "false"), (PERTURBED, "true")):
        if re.search(pattern, words):
            trial.cells["perturbed"] = said
            return
    trial.cells["experiment"] = UNNAMED
    trial.open.append(f"perturbed: the name does not tell; it stands as {UNNAMED}: write walking, and true or false")
