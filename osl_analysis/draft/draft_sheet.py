# SPDX-License-Identifier: Apache-2.0
"""Draft the sample sheet: which trial each recording is, by the words of its name.

Example: `K300_B2_uncompensated.csv` is a trial of `impedance` with K_d = 300, B_d = 2.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from osl_analysis.draft.likelihood import likelihoods, parted_name
from osl_analysis.ingest.raw_files import ENDINGS_OF_ANY, suffixes

FIXTURE_ALONE = r"\bfixture\b"  # in the name of a recording of the fixture without a joint
WORDS_OF_EXPERIMENTS = likelihoods()["experiments"]
OF_CAPTURES = ("plate", "static")  # experiments that need motion capture
# what a name may not tell of an experiment
NOT_TOLD = {
    "walking": "`perturbed`, true or false",
    "calibration": "`known_K`, `known_I` or `fixture`",
}
UNNAMED = "ingest_only"  # the experiment of a trial whose name tells none
# of a table of forces beside markers: `walk_grf.mot`, `forces_walk.mot`
OF_FORCES = re.compile(r"(?i)[_-](grfs?|forces?)$|^(grfs?|forces?)[_-]")

SMALLEST_K = 10.0  # N*m/rad; `K1` is the number of a file
UNPERTURBED = r"\b(unperturbed|unpert|baseline|normal|nominal|nom|level|free|no ?pert)\b"
PERTURBED = r"\b(perturb|perturbed|perturbation|pert)\b"
CONTROLLER = re.compile(
    r"(?<![A-Za-z])(un|(?:non?|without|ohne)[-_]?)?comp(?:ensated)?(?![A-Za-z])", re.IGNORECASE
)
ASK_CONTROLLER = (
    "the names tell no `controller`: write compensated, uncompensated or a name of your own, by"
    " which trials are told apart and means are made"
)

# file and name of the source file of a trial's `log` and of its capture, `mocap`
Recordings = Mapping[str, tuple[Path, str]]


class DraftedTrial(NamedTuple):
    """The cells of a trial in the sheet, and what of it the user has to decide."""

    cells: dict[str, str]
    question: str


def stem_of(path: Path) -> str:
    """The name of a file or folder without the ending of a format; `.5` of the folder `k150_b2.5`
    is none."""
    endings = (*suffixes(), *ENDINGS_OF_ANY)
    return path.stem if path.suffix.lower() in endings else path.name


def trial_name(path: Path) -> str:
    """A name for the trial of a file: that of the file without its ending, of at most 60 letters,
    with `_` for what a name may not have."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", stem_of(path)).lstrip("_.-")
    return name[:60] or "trial"


def draft_trials(
    recordings: Sequence[tuple[Path, str, bool]],
    moved: Mapping[Path, str],
    first_of: Mapping[Path, Path],
) -> list[DraftedTrial]:
    """Draft the trials that recordings are, by what the words of their names tell.

    A log and a capture of the same name are one, as are `walk_grf.mot` and `walk.trc`. A stated
    stiffness tells an impedance trial, but for one who walks.

    Parameters
    ----------
    recordings
        File or folder of each, relative to the folder of all, the name of its source file, and
        whether it comes from motion capture; in the order of the sheet.
    moved
        The experiment of a log by what moves in it, where its name tells none.
    first_of
        The first log of a trial by the second.
    """
    by_name: dict[str, dict[str, tuple[Path, str]]] = {}
    captures = {trial_name(path) for path, _, from_capture in recordings if from_capture}
    name_of: dict[Path, str] = {}
    for path, source, from_capture in sorted(recordings, key=lambda item: item[0] in first_of):
        if path in first_of:
            by_name[name_of[first_of[path]]]["log_2"] = (path, source)
            continue
        role = "mocap" if from_capture else "log"
        name = trial_name(path)
        capture_name = OF_FORCES.sub("", name)
        if role == "log" and capture_name in captures:
            name = capture_name
        free_name = name
        number = 1
        while role in by_name.get(free_name, {}):
            number += 1
            free_name = f"{name}_{number}"
        name_of[path] = free_name
        by_name.setdefault(free_name, {})[role] = (path, source)
    return [draft_trial(name, files, moved) for name, files in by_name.items()]


def draft_trial(name: str, files: Recordings, moved: Mapping[Path, str]) -> DraftedTrial:
    """Draft one trial."""
    path = next(iter(files.values()))[0]
    stem = stem_of(path)
    words = parted_name(stem)
    impedance_cells = stated_impedance(stem)
    cells = {"trial": name, "experiment": UNNAMED}
    for role, (file, source) in files.items():
        cells[role] = file.as_posix()
        cells[f"{role}_source"] = source
    telling = experiments_in(words, files, "K_d" in impedance_cells)
    if not telling and "mocap" not in files and path in moved:
        cells["experiment"] = moved[path]
        question = f"to be confirmed, guessed from the signals: experiment {moved[path]}"
        return DraftedTrial(cells, question)

    controller = CONTROLLER.search(stem)
    if controller:
        impedance_cells["controller"] = "uncompensated" if controller[1] else "compensated"
    cells_by_experiment = {
        "walking": {"perturbed": stated_perturbation(words)},
        "calibration": {"fixture": "alone" if is_fixture_alone(path) else ""},
        "impedance": impedance_cells,
    }
    experiment = telling[0] if telling else ""
    experiment_cells = cells_by_experiment.get(experiment, {})
    problem = ""
    if not telling:
        possible = ", ".join(possible_experiments(files)[::-1])
        problem = (
            f"experiment: the name tells none, write one of {possible}, and see that the source"
            " file names the channels that it needs"
        )
    elif len(telling) > 1:
        problem = f"experiment: the name may tell {' or '.join(telling)}, write which"
    elif not all(experiment_cells.values()):
        lacking = NOT_TOLD[experiment]
        problem = f"the name does not tell {lacking}: write it, and experiment {experiment}"
    if problem:
        question = f"{problem}; it stands as {UNNAMED}, which is not analysed"
        return DraftedTrial(
            {**cells, **(impedance_cells if "impedance" in telling else {})}, question
        )
    cells["experiment"] = experiment
    if experiment == "walking":
        cells["body_mass_kg"] = ""  # may be filled in: it tells a wrong gain of the plate
    is_open = experiment == "impedance" and not controller
    return DraftedTrial({**cells, **experiment_cells}, ASK_CONTROLLER if is_open else "")


def is_fixture_alone(path: Path) -> bool:
    """Whether a file's name tells a recording of the fixture without a joint."""
    return bool(re.search(FIXTURE_ALONE, parted_name(stem_of(path))))


def stated_perturbation(words: str) -> str:
    """Whether a name tells a perturbed crossing, `true` or `false`; empty if it does not say."""
    if re.search(UNPERTURBED, words):
        return "false"
    return "true" if re.search(PERTURBED, words) else ""


def stated_impedance(name: str) -> dict[str, str]:
    """K_d and B_d as a name states them, once each: `K300_B2.5`."""
    cells = {}
    behind = r"(?=$|[_\s-]|[.,](?!\d)|[BbKk]_?d?[_=-]?\d)"
    for column, letter, smallest in (("K_d", "K", SMALLEST_K), ("B_d", "B", 0.0)):
        pattern = rf"(?<![A-Za-z]){letter}_?d?[_=-]?(\d+(?:\.\d+)?){behind}"
        numbers = set(re.findall(pattern, name, re.IGNORECASE))
        if len(numbers) == 1:
            number = numbers.pop()
            if float(number) >= smallest:
                cells[column] = number
    return cells


def possible_experiments(files: Recordings) -> list[str]:
    """What a trial of these files can be: a log alone is of a bench, a capture alone of a
    walkway."""
    if "log" not in files:
        return [*OF_CAPTURES, "walking"]
    return [name for name in WORDS_OF_EXPERIMENTS if "mocap" in files or name not in OF_CAPTURES]


def experiments_in(words: str, files: Recordings, states_K: bool) -> list[str]:
    """The experiments that a name tells by its words or a stiffness."""
    possible = possible_experiments(files)
    telling = [name for name in possible if re.search(WORDS_OF_EXPERIMENTS[name], words)]
    is_other = "walking" in telling or "impedance" in telling
    if states_K and "impedance" in possible and not is_other:
        telling.append("impedance")
    if not telling and "mocap" in files and stated_perturbation(words):
        telling.append("walking")
    return telling
