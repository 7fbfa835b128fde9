"""The sample sheet of a simulated campaign, and the condition that each trial of the gait laboratory has by plan."""

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.sheet import JOINT, SHEET_COLUMNS, ImpedanceTrajectory, SheetRows, read_impedance_trajectory
from osl_analysis.errors import InputError
from osl_analysis.simulator.settings import SimulationSettings, Subject, stream


@dataclass(frozen=True)
class Condition:
    """What a trial of the gait laboratory is by plan. None: as the settings of the gait laboratory have it."""

    perturbed: bool = False
    direction: str = "up"
    K_d: float | None = None  # Largest desired stiffness [N*m/rad]
    B_d: float | None = None  # Largest desired damping [N*m*s/rad]
    stance_phase: float | None = None  # Mean phase of stance at which the ramp is commanded
    subject: Subject | None = None

    @property
    def person(self) -> str | None:
        """Name of the person, if the campaign names persons."""
        return self.subject.name if self.subject else None

    @property
    def sign(self) -> float:
        return 1.0 if self.direction == "up" else -1.0

    def desired(self, path: Path) -> ImpedanceTrajectory:
        """The desired impedance of a file, scaled to this condition's."""
        found = read_impedance_trajectory(path)
        K_d = found.K_d if self.K_d is None else found.K_d * (self.K_d / found.K_d.max())
        B_d = found.B_d if self.B_d is None else found.B_d * (self.B_d / (found.B_d.max() or 1.0))
        return replace(found, K_d=K_d, B_d=B_d)


def condition_of(row: Mapping[str, Any], settings: SimulationSettings) -> Condition:
    """The condition of a row of the sample sheet: what it states of direction, K_d and B_d, else by its name, which has
    a place in a random order of all combinations. Subjects share the trials of an experiment."""
    trial, lists = str(row["trial"]), settings.experiments.conditions
    choices = (lists.directions, *(values or (None,) for values in (lists.K_d, lists.B_d, lists.stance_phases)))
    combinations = list(itertools.product(*choices))
    found = re.search(r"\d+$", trial)
    number = int(found.group()) - 1 if found else 0
    block, place = divmod(number, len(combinations))
    order = stream(settings.seed, f"{trial.rstrip('0123456789')}{block}", "condition").permutation(len(combinations))
    drawn = dict(zip(("direction", "K_d", "B_d", "stance_phase"), combinations[order[place]], strict=True))
    stated = {name: row[name] for name in ("direction", "K_d", "B_d") if row.get(name) is not None}
    trials, people = max(getattr(settings.experiments, row["experiment"]), 1), lists.subjects or (None,)
    subject = people[number % trials * len(people) // trials]
    return Condition(**drawn | stated, perturbed=bool(row.get("perturbed")), subject=subject)


def plan_trials(settings: SimulationSettings) -> SheetRows:
    """One row per trial, in the columns of `sheet.py`. The same settings give the same plan. Whether a crossing is
    perturbed depends on the seed and its name, not on the number of crossings."""
    wanted, found, planned = settings.experiments, dict[str, dict[str, Any]](), list[tuple[str, str, dict[str, Any]]]()
    for experiment, digits in (("belt", 2), ("transmission", 1), ("actuator", 1), ("torque_angle", 1)):
        planned += [(experiment, f"{experiment}_{i + 1:0{digits}d}", {}) for i in range(getattr(wanted, experiment))]
    for controller, K_d, B_d in itertools.product(wanted.controllers, wanted.K_d, wanted.B_d):
        name = f"impedance_K{K_d:g}_B{B_d:.1f}_{controller}"
        moved = [f"{name}_{one.name}_{k + 1}" for one in settings.excitations for k in range(one.trials)] or [name]
        planned += [("impedance", t, {"controller": controller, "K_d": K_d, "B_d": B_d}) for t in moved]
    for experiment, digits in (("static", 1), ("plate", 2), ("walking", 2)):
        planned += [(experiment, f"{experiment}_{i + 1:0{digits}d}", {}) for i in range(getattr(wanted, experiment))]
    for experiment, trial, more in planned:
        facts = EXPERIMENTS[experiment]
        files = facts.simulated_files(trial)  # crossings also have the leg's log
        sources = {f"{role}_source": getattr(facts, role) for role in files}
        if settings.recorder.torque_node is not None and facts.place == "bench":
            sources["log_source"] = f"{facts.log}_nodes"
        if trial in found:
            raise InputError(
                f"the plan has two trials '{trial}': K_d and B_d of experiments are too close for names of their own; "
                "remove one of them"
            )
        if experiment == "walking":
            more["perturbed"] = bool(stream(settings.seed, trial, "perturbed").random() < wanted.perturbed_share)
        row = {"trial": trial, "experiment": experiment, "joint": JOINT, **files, **sources, **more}
        stated = {} if facts.place == "bench" else stated_in_sheet(row, settings)
        found[trial] = dict.fromkeys(SHEET_COLUMNS) | row | stated
    return found


def stated_in_sheet(row: Mapping[str, Any], settings: SimulationSettings) -> dict[str, object]:
    """What the sheet says of the condition of a trial of the gait laboratory: what the settings ask for in `stated`."""
    condition, lists = condition_of(row, settings), settings.experiments.conditions
    found: dict[str, object] = {"subject": condition.person, "side": lists.side}
    found["body_mass_kg"] = condition.subject.body_mass_kg if condition.subject else None
    if row["experiment"] == "walking":
        parts = [condition.direction] + [f"K{value:g}" for value in [condition.K_d] if value]
        parts += [f"{phase:.0%}".removesuffix("%") for phase in [condition.stance_phase] if phase]
        found |= {"K_d": condition.K_d, "B_d": condition.B_d, "group": "_".join(parts)}
        found["direction"] = condition.direction if row["perturbed"] else None
    return {name: found[name] for name in lists.stated if name in found}
