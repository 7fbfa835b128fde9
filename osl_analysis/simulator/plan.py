"""The sample sheet of a simulated campaign, and the condition that each trial of the gait laboratory has by plan."""

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.sheet import JOINT, SHEET_COLUMNS, SheetRows
from osl_analysis.errors import InputError
from osl_analysis.simulator.settings import SimulationSettings, Subject, stream


@dataclass(frozen=True)
class Condition:
    """What a trial of the gait laboratory is by plan. None: as the settings of the gait laboratory have it."""

    perturbed: bool = False
    direction: str = "up"
    subject: Subject | None = None

    @property
    def person(self) -> str | None:
        """Name of the person, if the campaign names persons."""
        return self.subject.name if self.subject else None

    @property
    def sign(self) -> float:
        return 1.0 if self.direction == "up" else -1.0


def condition_of(row: Mapping[str, Any], settings: SimulationSettings) -> Condition:
    """The condition of a row of the sample sheet: the direction that it states, else by its name, which has a place in
    a random order of all directions. Subjects share the trials of an experiment."""
    trial, lists = str(row["trial"]), settings.experiments.conditions
    found = re.search(r"\d+$", trial)
    number = int(found.group()) - 1 if found else 0
    block, place = divmod(number, len(lists.directions))
    name = f"{trial.rstrip('0123456789')}{block}"
    order = stream(settings.seed, name, "condition").permutation(len(lists.directions))
    trials, people = max(getattr(settings.experiments, row["experiment"]), 1), lists.subjects or (None,)
    subject = people[number % trials * len(people) // trials]
    return Condition(bool(row.get("perturbed")), row.get("direction") or lists.directions[order[place]], subject)


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
        if facts.place != "bench":
            condition, lists = condition_of(row, settings), wanted.conditions
            row["subject"] = condition.person
            row["direction"] = condition.direction if len(lists.directions) > 1 and condition.perturbed else None
        found[trial] = dict.fromkeys(SHEET_COLUMNS) | row
    return found
