# SPDX-License-Identifier: Apache-2.0
"""What contributes to an estimate of the bench beside its own fit: what faults of the recording,
another motion, and what nobody has checked would change.

The sources have their words in `judge/words.yaml`.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl

from osl_analysis.bench.friction import DryFriction
from osl_analysis.bench.impedance import Analysis
from osl_analysis.bench.lags import Belt
from osl_analysis.bench.record import Record
from osl_analysis.dictionary.described import described_tables_by_name, table_of
from osl_analysis.inference import Family, ImpedanceInference, ModelName
from osl_analysis.stats.budget import (
    DOUBT,
    LIKELY,
    QUANTITIES,
    WITHOUT_FRICTION,
    Budget,
    Contribution,
    Row,
    budget_rows,
    floored_size,
    unknown,
)
from osl_analysis.stats.linear_fit import FALSE_ALARM
from osl_analysis.stats.rounding import significant
from osl_analysis.stats.sources import Source

# candidate models that are properties of a joint, and no faults
PROPERTIES = (
    ModelName.NONLINEAR_SPRING,
    ModelName.K_BY_SIDE,
    ModelName.DAMPING_BY_SPEED,
    ModelName.VISCOELASTIC_BRANCH,
)
ERROR_SOURCES: Mapping[Family, Source] = {
    "path": Source.TORQUE_PATH,
    "time": Source.CHANGE_OVER_TIME,
    "speed": Source.PLAY_OR_SPEED,
    "size": Source.NONLINEAR_SPRING,
    "direction": Source.PLAY_OR_SPEED,
    "clipping": Source.CLIPPED_SIGNAL,
}
"""By family of candidate models, the source."""
LARGE_DELAY = 0.05  # share of B that the half-width of a leg's delay may make before it is told


def fit_tables(name: str, *fits: tuple[Row, Mapping[str, Budget]]) -> dict[str, pl.DataFrame]:
    """The table `name` of a trial, and its rows of `budget.csv`. Each of its `fits` has a row,
    whose estimates are put beside the rest of it, and their budgets."""
    described = described_tables_by_name()[name]
    names = {**described.columns, **described.of_fits}
    rows = []
    of_budgets = []
    for row, budgets in fits:
        of_budgets += budget_rows(row, budgets)
        completed = dict(row)
        for estimate, budget in budgets.items():
            columns = budget.columns(estimate)
            columns[f"{estimate}_se_bench"] = budget.se_bench
            for column, number in columns.items():
                if column in names:  # a table need not have all of them
                    completed[column] = number
        rows.append(completed)
    return {name: table_of(rows, name), "budget": table_of(of_budgets, "budget")}


def half_width_of(name: str) -> pl.Expr:
    """Half of the interval of an estimate in a table, or of its range, as `B_range`."""
    return (pl.col(f"{name}_high") - pl.col(f"{name}_low")) / 2


def stated_models(record: Record) -> set[ModelName]:
    """The candidate models that what is stated of the bench rules out.

    A delay that was inferred, as from the beat of a held channel, rules out none. A known spring
    shows the delay, the low-pass and the frame at once.
    """
    settings = record.settings
    stated: set[ModelName] = set()
    if settings.bench_stiffness is not None:
        stated.add(ModelName.SPRING_IN_SERIES)
    if settings.calibration.tells_delay:
        stated |= {ModelName.DELAY, ModelName.LOW_PASS, ModelName.SPRING_IN_SERIES}
    taken = record.signals.taken if record.signals else ()
    for part in taken:
        for sensor in part.stream.stated.values():
            if "delay" in sensor:  # a stated 0 is a statement, too
                stated.add(ModelName.DELAY)
            if "low_pass" in sensor:
                stated.add(ModelName.LOW_PASS)
    return stated


def alternatives(
    joint: ImpedanceInference | None,
    stated: Collection[ModelName],
    k: int,
    value: float,
    without_friction: bool = False,
) -> list[Contribution]:
    """What the candidate models of Eq. 15 would make of K, B or I (k = 0, 1, 2), as Eq. 15 reads it
    or without friction, each with its probability; and what torque that none of them explains
    could, whose bound is a rectangular distribution's half-width (JCGM 100:2008, 4.3.7). None
    without candidate models.

    No change is more than the estimate itself, of this `value`: the recording does not bound it.
    A spring in series cannot be told from a joint that is series elastic, of which Eq. 15 is right,
    so that its size is not known."""
    if joint is None:
        return []
    most = floored_size(QUANTITIES[k], value)
    found: list[Contribution] = []
    of_property: list[Contribution] = []
    for each in joint.alternatives:
        # one as improbable as a false alarm makes no doubt, and has no row
        is_spring = each.name == ModelName.SPRING_IN_SERIES
        least = DOUBT if is_spring else FALSE_ALARM
        if each.name in stated or each.probability < least:
            continue
        is_property = each.name in PROPERTIES
        change = each.change_without_friction if without_friction else each.change
        size = min(float(change[k]), most) / (2 if is_property else 1)  # half of a range
        rows = of_property if is_property else found
        source = ERROR_SOURCES[each.family]
        if each.name == ModelName.VISCOELASTIC_BRANCH:
            source = Source.VISCOELASTIC
        rows.append(
            Contribution(
                source=source,
                # nothing tells a bench that yields from a series elastic joint
                standard=None if is_spring else size,
                basis="weighed",
                part="motion" if is_property else "fault",
                probability=each.probability,
                detail=each.name,
            )
        )
    if sum(each.probability for each in of_property) > LIKELY:
        found.append(of_property[0])
    bound = min(joint.unexplained[k] / np.sqrt(3), most)
    found.append(Contribution(Source.UNEXPLAINED_TORQUE, bound, basis="bound", part="fault"))
    return found


def other_stamps(analysis: Analysis, name: str) -> list[Contribution]:
    """What the other reading of undecided stamps makes of an estimate of the whole trial: the truth
    lies between both, by a rectangular distribution."""
    if analysis.other is None or name not in analysis.other.whole.names:
        return []
    bound = float(abs(analysis.other.whole[name] - analysis.whole[name]) / np.sqrt(3))
    return [Contribution(Source.UNDECIDED_TIME_STAMPS, bound, basis="bound", part="fault")]


@dataclass(frozen=True)
class Evidence:
    """What was weighed of a recording: belt, candidate models, friction, range over the motion."""

    analysis: Analysis  # Eq. 15 itself
    belt: Belt  # of a leg
    joint: ImpedanceInference | None  # of a joint: the candidate models; None: not weighed
    friction: DryFriction
    ranges: Mapping[str, tuple[float, float]]  # of estimates over amplitudes and parts of the band
    gains_are_known: bool  # and tell a wrong gain of torque over angle
    is_leg: bool  # whose drivetrain Eq. 15 is not of, and whose play is its own


def over_motion(evidence: Evidence, name: str) -> list[Contribution]:
    """Half of the range of an estimate over the motion. Half of its change from the smallest to the
    largest amplitude, beyond their noise, has a name, too: friction lowers B, and K with it; a
    stiffening spring, or backlash, changes K alone."""
    if name not in evidence.ranges:
        return []
    sizes = {Source.AMPLITUDE: np.ptp(evidence.ranges[name]) / 2}  # over frequencies, too
    fits = evidence.analysis.fits
    labels = sorted(label for label in fits if isinstance(label, float))
    if len(labels) > 1:
        small, large = fits[labels[0]], fits[labels[-1]]
        changes = {}  # 0 within the noise of both
        for each in ("K", "B"):
            change = large[each] - small[each]
            noise = np.hypot(small.half_width(each), large.half_width(each))
            changes[each] = change if abs(change) > noise else 0.0
        change = changes.get(name, 0.0)
        is_friction = change < 0 and changes["B"] < 0
        if is_friction or name == "K":
            source = Source.FRICTION if is_friction else Source.NONLINEAR_SPRING
            sizes[source] = abs(change) / 2
    return [
        Contribution(source, size, basis="measured", part="motion")
        for source, size in sizes.items()
    ]


def certain_lag(evidence: Evidence, name: str) -> list[Contribution]:
    """What the certain lag of a leg's torque takes off B and I.

    exp(-s d) = 1 - s d + (s d)^2/2 takes K d off B, and (B + K d/2) d off I, with the fitted B.
    """
    lag = evidence.belt.lag
    if lag is None or not lag.certain("lag_s") or name == "K":
        return []
    lag_s = lag["lag_s"]
    whole = evidence.analysis.whole
    by = whole["K"] * lag_s
    if name == "I":
        by = (whole["B"] + by / 2) * lag_s
    detail = f"a lag of {significant(1e3 * lag_s, 3)} ms behind the angle"
    return [
        Contribution(Source.LATE_TORQUE, abs(by), basis="measured", part="fault", detail=detail)
    ]


def has_clocks_of_several_rates(record: Record) -> bool:
    """Whether devices with stamps of their own have rates that differ, which brings them on one
    clock. The rate of a held channel is inferred from where its values change, and is no clock."""
    taken = record.signals.taken if record.signals else ()
    of_clocks = [
        stream["ppm"]
        for part, stream in zip(taken, record.streams, strict=True)
        if part.held is None and stream["ppm"] is not None
    ]
    return bool(np.ptp(of_clocks or [0.0]))


def has_stated_fixture(record: Record) -> bool:
    """Whether configuration or sheet states what turns with the joint, as nothing by a 0."""
    taken = record.signals.taken if record.signals else ()
    is_in_sheet = any("fixture" in facts for part in taken for facts in part.stream.stated.values())
    return record.settings.fixture is not None or is_in_sheet


def unchecked(evidence: Evidence, name: str) -> list[Contribution]:
    """What this recording does not tell of an estimate, by source. Only a statement, or a
    measurement by another sensor, takes a source out; what the candidate models infer does not."""
    record = evidence.analysis.record
    settings = record.settings
    K, B, I = (evidence.analysis.whole[each] for each in QUANTITIES)
    rows = []
    lag = evidence.belt.lag
    # a belt that tells the lag so badly that it may be a tenth of B
    is_untold = lag is None or K * lag.half_width("lag_s") > LARGE_DELAY * abs(B)
    if is_untold and ModelName.DELAY not in stated_models(record):
        rows.append(unknown(Source.LATE_TORQUE, "ms", B=1e-3 * K, I=1e-3 * B))
    if not settings.calibration.torque_gain and not evidence.gains_are_known:
        rows.append(unknown(Source.WRONG_GAIN, "%", K=0.01 * K, B=0.01 * B, I=0.01 * I))
    if not has_clocks_of_several_rates(record):
        rows.append(unknown(Source.CLOCKS_DISAGREE, "%", B=0.01 * B, I=0.02 * I))
    if not has_stated_fixture(record):
        rows.append(unknown(Source.FIXTURE_INERTIA, "N*m", K=1.0))
        rows.append(unknown(Source.FIXTURE_INERTIA, "kg*m^2", I=1.0))
    if evidence.joint is None:
        rows.append(unknown(Source.CHANGE_OVER_TIME, K=0.0))
        if not evidence.is_leg:
            rows.append(unknown(Source.PLAY_OR_SPEED, B=0.0, I=0.0))
    if evidence.friction.is_untold:
        rows.append(unknown(Source.FRICTION, B=0.0))
    return [of_source[name] for of_source in rows if name in of_source]


def with_other_contributions(evidence: Evidence, own: Mapping[str, Budget]) -> dict[str, Budget]:
    """The estimates of a whole trial with what another motion, a fault, and what was not checked
    would change, source by source; and, where friction is certain, those without it, and what it
    changes."""
    stated = stated_models(evidence.analysis.record)
    less = evidence.friction.without
    complete = dict(own)
    if less and "T_C" in less.names:
        complete["f_C"] = less.budget("T_C")
    for k, name in enumerate(QUANTITIES):
        common = [
            *other_stamps(evidence.analysis, name),
            *certain_lag(evidence, name),
            *unchecked(evidence, name),
        ]
        weighed = alternatives(evidence.joint, stated, k, own[name].value)
        complete[name] = own[name].plus(*over_motion(evidence, name), *weighed, *common)
        if less:
            without = WITHOUT_FRICTION[name]
            weighed = alternatives(evidence.joint, stated, k, less[name], without_friction=True)
            complete[without] = less.budget(name).plus(
                *over_motion(evidence, without), *weighed, *common
            )
            half = abs(own[name].value - less[name]) / 2
            complete[name] = complete[name].plus(
                Contribution(Source.FRICTION, half, basis="measured", part="motion")
            )
    return complete
