"""The sample sheet of a simulated campaign."""

import itertools
from collections import Counter

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.sheet import JOINT, SHEET_COLUMNS, SheetRows
from osl_analysis.errors import InputError
from osl_analysis.simulator.settings import SimulationSettings, stream

TWO_NODES = "_nodes"  # Ending of the name of a bench's source file if two nodes record
PlannedRow = dict[str, object]


def plan_trials(settings: SimulationSettings) -> SheetRows:
    """One row per trial, in the columns of `sheet.py`. The same settings give the same plan. Whether a crossing is
    perturbed depends on the seed and its name, not on the number of crossings."""
    return {str(row["trial"]): dict.fromkeys(SHEET_COLUMNS) | row for row in planned_rows(settings)}


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
    """The trials in the gait laboratory. Crossings also have the leg's log."""
    wanted = settings.experiments
    rows = numbered("static", wanted.static, 1) + numbered("plate", wanted.plate, 2)
    for row in numbered("walking", wanted.walking, 2):
        perturbed = stream(settings.seed, str(row["trial"]), "perturbed").random() < wanted.perturbed_share
        rows.append(row | {"perturbed": bool(perturbed)})
    return rows


def planned_row(trial: str, experiment: str) -> PlannedRow:
    """One row of the sheet, with the files that the simulator records in this experiment."""
    facts = EXPERIMENTS[experiment]
    files = facts.simulated_files(trial)
    sources = {f"{role}_source": getattr(facts, role) for role in files}
    return {"trial": trial, "experiment": experiment, "joint": JOINT, **files, **sources}


def numbered(experiment: str, count: int, digits: int) -> list[PlannedRow]:
    """Rows of an experiment, whose names count from 1 on with at least `digits` digits."""
    return [planned_row(f"{experiment}_{i:0{digits}d}", experiment) for i in range(1, count + 1)]
