"""The sample sheet of a simulated campaign, and the condition that each trial of the gait laboratory has by plan."""

import itertools
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.shared_choices import ImpedanceTrajectory, read_impedance_trajectory
from osl_analysis.config.sheet import JOINT, SHEET_COLUMNS
from osl_analysis.errors import InputError
from osl_analysis.simulator.settings import Conditions, Direction, SimulationSettings, Subject, stream

FACTS = ("direction", "K_d", "B_d", "stance_phase", "session")


@dataclass(frozen=True)
class Condition:
    """What a trial of the gait laboratory is by plan. None: as the settings of the gait laboratory have it."""

    perturbed: bool = False
    direction: Direction = "up"
    K_d: float | None = None  # Largest desired stiffness [N*m/rad]
    B_d: float | None = None  # Largest desired damping [N*m*s/rad]
    stance_phase: float | None = None  # Mean phase of stance at which the ramp is commanded
    subject: Subject | None = None
    session: int = 1
    later_subject: bool = False  # Whether the person is not the first of the campaign

    def body_mass(self, nominal: float) -> float:
        """Body mass [kg] of the person, or the nominal one."""
        return (self.subject and self.subject.body_mass_kg) or nominal

    def stance(self, nominal: float) -> float:
        """Duration [s] of the person's stance, or the nominal one."""
        return (self.subject and self.subject.stance_s) or nominal

    def facts(self) -> dict[str, object]:
        """The condition for the truth's file."""
        person = self.subject.name if self.subject else None
        return {name: getattr(self, name) for name in FACTS} | {"subject": person}

    @property
    def sign(self) -> float:
        """1 if the platform turns the toes up, -1 if down."""
        return 1.0 if self.direction == "up" else -1.0

    def desired(self, path: Path) -> ImpedanceTrajectory:
        """The desired impedance of a file, scaled to this condition's."""
        found = read_impedance_trajectory(path)
        K_d = found.K_d if self.K_d is None else found.K_d * (self.K_d / found.K_d.max())
        B_d = found.B_d if self.B_d is None else found.B_d * (self.B_d / (found.B_d.max() or 1.0))
        return replace(found, K_d=K_d, B_d=B_d)


def condition_of(row: Mapping[str, object], settings: SimulationSettings) -> Condition:
    """The condition of a row of the sample sheet: by its name, and by what it states of direction, K_d and B_d."""
    trial, lists = str(row["trial"]), settings.experiments.conditions
    drawn = drawn_condition(trial, settings.seed, lists)
    # subjects and sessions share the trials of the row's experiment
    trials = max(int(getattr(settings.experiments, str(row["experiment"]))), 1)
    people = lists.subjects or (None,)
    block = (number_of(trial) - 1) % trials * len(people) * lists.sessions // trials
    direction: Direction = "down" if str(row.get("direction")) == "down" else "up"
    return replace(
        drawn,
        perturbed=is_stated(row.get("perturbed")) and bool(row["perturbed"]),
        direction=direction if is_stated(row.get("direction")) else drawn.direction,
        K_d=float(str(row["K_d"])) if is_stated(row.get("K_d")) else drawn.K_d,
        B_d=float(str(row["B_d"])) if is_stated(row.get("B_d")) else drawn.B_d,
        subject=people[block // lists.sessions],
        session=block % lists.sessions + 1,
        later_subject=block >= lists.sessions,
    )


def drawn_condition(trial: str, seed: int, lists: Conditions) -> Condition:
    """Direction, desired impedance and timing of a trial: a place in a random order of all combinations."""
    combinations = list(
        itertools.product(lists.directions, lists.K_d or (None,), lists.B_d or (None,), lists.stance_phases or (None,))
    )
    block, place = divmod(number_of(trial) - 1, len(combinations))
    stem = trial.rstrip("0123456789")
    order = stream(seed, f"{stem}{block}", "condition").permutation(len(combinations))
    direction, K_d, B_d, phase = combinations[order[place]]
    return Condition(direction=direction, K_d=K_d, B_d=B_d, stance_phase=phase)


def stated_columns(row: Mapping[str, object], settings: SimulationSettings) -> dict[str, object]:
    """The columns of the sample sheet that state the condition of a row, as far as `stated` has them."""
    lists = settings.experiments.conditions
    if not lists.stated:
        return {}
    condition = condition_of(row, settings)
    person = condition.subject.name if condition.subject else None
    facts: dict[str, object] = {"subject": person, "session": str(condition.session), "side": lists.side}
    facts["body_mass_kg"] = condition.subject.body_mass_kg if condition.subject else None
    if row["experiment"] == "walking":
        timing = condition.stance_phase
        parts = [condition.direction, *(f"K{v:g}" for v in [condition.K_d] if v), *(f"{t:.0%}" for t in [timing] if t)]
        facts |= {"K_d": condition.K_d, "B_d": condition.B_d, "group": "_".join(parts).replace("%", "")}
        facts |= {"direction": condition.direction if row.get("perturbed") else None}
    return {name: facts[name] for name in lists.stated if name in facts}


def number_of(trial: str) -> int:
    """The number at the end of a trial's name; 1 without one."""
    found = re.search(r"\d+$", trial)
    return int(found.group()) if found else 1


def is_stated(value: object) -> bool:
    """Whether a cell of the sample sheet has a value."""
    return value is not None and str(value) not in ("", "nan", "<NA>")


TWO_NODES = "_nodes"  # Ending of the name of a bench's source file if two nodes record
PlannedRow = dict[str, object]


def plan_trials(settings: SimulationSettings) -> pd.DataFrame:
    """One row per trial, in the columns of `sheet.py`. The same settings give the same plan. Whether a crossing is
    perturbed depends on the seed and its name, not on the number of crossings."""
    return pd.DataFrame(planned_rows(settings), columns=list(SHEET_COLUMNS)).astype(SHEET_COLUMNS)


def planned_rows(settings: SimulationSettings) -> list[PlannedRow]:
    """The rows of the plan, each with what it states."""
    rows = [*bench_plan(settings), *laboratory_plan(settings)]
    names = [str(row["trial"]) for row in rows]
    twice = next((name for name, count in Counter(names).items() if count > 1), None)
    if twice:
        raise InputError(
            f"the plan has two trials '{twice}': K_d and B_d of experiments are too close for names of their own; "
            "remove one of them"
        )
    return rows


def bench_plan(settings: SimulationSettings) -> list[PlannedRow]:
    """The trials on the benches; the source file is another one where two nodes record."""
    wanted = settings.experiments
    rows = numbered("belt", wanted.belt, 2) + numbered("transmission", wanted.transmission, 1)
    rows += numbered("actuator", wanted.actuator, 1) + numbered("torque_angle", wanted.torque_angle, 1)
    for controller, K_d, B_d in itertools.product(wanted.controllers, wanted.K_d, wanted.B_d):
        name = f"impedance_K{K_d:g}_B{B_d:.1f}_{controller}"
        moved = [f"{name}_{end}" for excitation in settings.excitations for end in excitation.trial_endings] or [name]
        asked = {"controller": controller, "K_d": K_d, "B_d": B_d}
        rows += [planned_row(trial, "impedance") | asked for trial in moved]
    if settings.recorder.torque_node is not None:
        rows = [row | {"log_source": f"{row['log_source']}{TWO_NODES}"} for row in rows]
    return rows


def laboratory_plan(settings: SimulationSettings) -> list[PlannedRow]:
    """The trials in the gait laboratory, with what the sheet states of their condition. Crossings also have the leg's
    log."""
    wanted = settings.experiments
    rows = numbered("static", wanted.static, 1) + numbered("plate", wanted.plate, 2)
    for row in numbered("walking", wanted.walking, 2):
        perturbed = stream(settings.seed, str(row["trial"]), "perturbed").random() < wanted.perturbed_share
        rows.append(row | {"perturbed": bool(perturbed)})
    return [row | stated_columns(row, settings) for row in rows]


def planned_row(trial: str, experiment: str) -> PlannedRow:
    """One row of the sheet, with the files that the simulator records in this experiment."""
    facts = EXPERIMENTS[experiment]
    files = facts.simulated_files(trial)
    sources = {f"{role}_source": getattr(facts, role) for role in files}
    return {"trial": trial, "experiment": experiment, "joint": JOINT, **files, **sources}


def numbered(experiment: str, count: int, digits: int) -> list[PlannedRow]:
    """Rows of an experiment, whose names count from 1 on with at least `digits` digits."""
    return [planned_row(f"{experiment}_{i:0{digits}d}", experiment) for i in range(1, count + 1)]
