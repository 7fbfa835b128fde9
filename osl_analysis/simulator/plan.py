"""The sample sheet of a simulated campaign."""

import itertools
from collections import Counter

import pandas as pd

from osl_analysis.errors import InputError
from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.sheet import COLUMNS, JOINT
from osl_analysis.simulator.conditions import stated_columns
from osl_analysis.simulator.sensors import stream
from osl_analysis.simulator.settings import SimulationSettings

TWO_NODES = "_nodes"
"""Ending of the name of a bench's source file if two nodes record."""

PlannedRow = dict[str, object]


def plan_trials(settings: SimulationSettings) -> pd.DataFrame:
    """One row per trial, in the columns of `sheet.py`. The same settings give the same plan.

    Whether a crossing is perturbed depends on the seed and its name, not on the number of crossings.
    """
    return pd.DataFrame(planned_rows(settings), columns=list(COLUMNS)).astype(COLUMNS)


def planned_rows(settings: SimulationSettings) -> list[PlannedRow]:
    """The rows of the plan, each with what it states.

    Raises
    ------
    InputError
        Two trials have the same name.
    """
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
    rows = [planned_row(name, "belt") for name in numbered("belt", wanted.belt, 2)]
    rows += [planned_row(name, "transmission") for name in numbered("transmission", wanted.transmission, 1)]
    rows += [planned_row(name, "actuator") for name in numbered("actuator", wanted.actuator, 1)]
    rows += [planned_row(name, "torque_angle") for name in numbered("torque_angle", wanted.torque_angle, 1)]
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
    rows = [planned_row(name, "static") for name in numbered("static", wanted.static, 1)]
    rows += [planned_row(name, "plate") for name in numbered("plate", wanted.plate, 2)]
    for name in numbered("walking", wanted.walking, 2):
        perturbed = stream(settings.seed, name, "perturbed").random() < wanted.perturbed_share
        rows.append(planned_row(name, "walking") | {"perturbed": bool(perturbed)})
    return [row | stated_columns(row, settings) for row in rows]


def planned_row(trial: str, experiment: str) -> PlannedRow:
    """One row of the sheet, with the files that the simulator records in this experiment."""
    facts = EXPERIMENTS[experiment]
    files = facts.simulated_files(trial)
    sources = {f"{role}_source": getattr(facts, role) for role in files}
    return {"trial": trial, "experiment": experiment, "joint": JOINT, **files, **sources}


def numbered(stem: str, count: int, digits: int) -> list[str]:
    """Names from 1 on, with at least `digits` digits."""
    return [f"{stem}_{i:0{digits}d}" for i in range(1, count + 1)]
