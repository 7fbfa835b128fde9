# SPDX-License-Identifier: Apache-2.0
"""What contributes to an estimate of the bench beside its own fit: what faults of the recording,
another motion, and what nobody has checked would change.

The sources have their words in `judge/findings.yaml`.
"""

from collections.abc import Collection, Mapping

import numpy as np
import polars as pl

from osl_analysis.bench.impedance import Analysis
from osl_analysis.bench.record import Record
from osl_analysis.dictionary.described import described_tables_by_name, table_of
from osl_analysis.inference import ImpedanceInference
from osl_analysis.stats.budget import LIKELY, Budget, Contribution, Row, budget_rows

VISCOELASTIC = "viscoelastic branch"
# candidate models that are properties of a joint, and no faults
PROPERTIES = ("nonlinear spring", "K by side", "damping by speed", VISCOELASTIC)
ERROR_SOURCES = {
    "path": "torque_path",
    "time": "change_over_time",
    "speed": "play_or_speed",
    "size": "nonlinear_spring",
    "direction": "play_or_speed",
    "clipping": "clipped_signal",
}
"""By family of candidate models, the source."""
LEAST_PROBABILITY = 0.005  # of a candidate model that has a row: 40 of them do not make a doubt


def fit_tables(name: str, *fits: tuple[Row, Mapping[str, Budget]]) -> dict[str, pl.DataFrame]:
    """The table `name` of a trial, and its rows of `budget.csv`. Each of its `fits` has a row,
    whose estimates are put beside the rest of it, and their budgets."""
    described = described_tables_by_name()[name]
    names = {**described.columns, **described.of_fits}
    rows = []
    of_budgets = []
    for row, budgets in fits:
        of_budgets += budget_rows(row, budgets)
        for estimate, budget in budgets.items():
            row = {**row, **budget.columns(estimate)}
            if f"{estimate}_se_bench" in names:
                row[f"{estimate}_se_bench"] = budget.se_bench
        rows.append(row)
    return {name: table_of(rows, name), "budget": table_of(of_budgets, "budget")}


def stated_models(record: Record) -> set[str]:
    """The candidate models that what is stated of the bench rules out. A known spring shows the
    delay, the low-pass and the frame at once."""
    settings = record.settings
    stated = set[str]()
    if any(each["delay_s"] for each in record.streams):
        stated.add("delay")
    if settings.bench_stiffness is not None:
        stated.add("spring in series")
    if settings.calibration.tells_delay:
        stated.update(("delay", "low-pass", "spring in series"))
    taken = record.signals.taken if record.signals else ()
    if any("low_pass" in facts for part in taken for facts in part.stream.stated.values()):
        stated.add("low-pass")
    return stated


def alternatives(
    joint: ImpedanceInference | None, stated: Collection[str], k: int
) -> list[Contribution]:
    """What the candidate models of Eq. 15 would make of K, B or I (k = 0, 1, 2), each with its
    probability, and what torque that none of them explains could, whose bound is a rectangular
    distribution's half-width (JCGM 100:2008, 4.3.7)."""
    if joint is None:
        return []
    found: list[Contribution] = []
    of_property: list[Contribution] = []
    for each in joint.alternatives:
        if each.name in stated or each.probability < LEAST_PROBABILITY:
            continue
        is_property = each.name in PROPERTIES
        rows = of_property if is_property else found
        rows.append(
            Contribution(
                source="viscoelastic" if each.name == VISCOELASTIC else ERROR_SOURCES[each.family],
                standard=float(each.change[k] / (2 if is_property else 1)),  # half of a range
                basis="weighed",
                part="motion" if is_property else "fault",
                probability=each.probability,
                detail=each.name,
            )
        )
    if sum(each.probability for each in of_property) > LIKELY:
        found.append(of_property[0])
    bound = float(joint.unexplained[k] / np.sqrt(3))
    found.append(Contribution("unexplained_torque", bound, basis="bound", part="fault"))
    return found


def other_stamps(analysis: Analysis, name: str) -> list[Contribution]:
    """What the other reading of undecided stamps makes of an estimate of the whole trial: the truth
    lies between both, by a rectangular distribution."""
    if analysis.other is None or name not in analysis.other.whole.names:
        return []
    moved = abs(analysis.other.whole[name] - analysis.whole[name])
    bound = float(moved / np.sqrt(3))
    return [Contribution("undecided_time_stamps", bound, basis="bound", part="fault")]
