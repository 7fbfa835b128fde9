"""The words of findings: the only place where they become sentences. Nothing here decides whether
something is a doubt, and nothing reads the words back. A remedy may depend on the numbers.

The sentences stand in `findings.yaml`, with names in braces for numbers. A name is a column of the
row that the finding is about, or one of `OF_EVIDENCE` or `COMPUTED`. A detail whose numbers the row
does not have is left out.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from string import Formatter
from typing import Any

from osl_analysis.errors import nearest
from osl_analysis.judge.causes import NEAR_STATED, cause_of, suspected_unit
from osl_analysis.judge.finding import (
    AnyRow,
    Beyond,
    Finding,
    Remedy,
    Words,
    cell_number,
)
from osl_analysis.judge.known_findings import EVIDENCE, FINDINGS, KnownFinding
from osl_analysis.judge.moved_estimates import leaves_torque
from osl_analysis.judge.unchecked import MEASURED_BY, weight_by_rest
from osl_analysis.measured import significant
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.rounding import decimal_places, with_places
from osl_analysis.units import UNIT_FACTORS, known_factor

SYMMETRIC_SHARE = 1e-3  # of an interval's width: a middle this near to the estimate is the estimate

SMALL_FACTOR = 2.0  # between units; other devices and gains are as far off, so it must be met well
NEAR_LARGE_FACTOR = 0.08  # relative difference from a larger one

RENDERED_OF_K_D = (0.66, 1.06)
"""Shares of K_d that the shipped ankle renders, beside its friction: a belt of 770 N*m/rad in
series leaves 0.66 of 400 N*m/rad. Of another device it is an assumption, and said to be one."""


def words_of(finding: Finding, row: AnyRow) -> Words:
    """Put a finding into words.

    Parameters
    ----------
    finding : Finding
    row : AnyRow
        The row of its table that it is about, or other numbers that its sentences show.
    """
    kind = FINDINGS.get(finding.name)
    if kind is None:  # a limit on a column that is not in EVIDENCE
        return Words(evidence_text(finding), "", "")
    if finding.table in kind.in_table:
        kind = replace(kind, **kind.in_table[finding.table])
    remedy = remedy_that_helps(kind, finding.remedy)
    cells = Cells(row)
    return Words(filled(kind.says, cells), size_text(finding, row), capital(filled(remedy, cells)))


def remedy_that_helps(kind: KnownFinding, remedy: Remedy) -> str:
    """The remedy of a finding where only so much of its trial is doubtful."""
    others = {
        Remedy.ALONE: kind.without_amplitudes,
        Remedy.AMPLITUDE: kind.of_amplitude,
        Remedy.FREQUENCY: kind.of_frequency,
        Remedy.DOUBTED: kind.if_doubtful,
    }
    return others.get(remedy) or kind.remedy


def size_text(finding: Finding, row: AnyRow) -> str:
    """How large a cause is in this row: its numbers, and the estimates without it."""
    details: list[str] = []
    by_friction = friction_text(row) if finding.name == "friction" else ""
    details.append(by_friction)
    for number in finding.evidence:
        # a misfit that another cause explains is told by that cause
        if cause_of(number, row).name != finding.name:
            continue
        if number.column in EVIDENCE:
            says = EVIDENCE[number.column].on_side(number.side).says
            details.append(filled(says, Cells(row, number)))
    if not by_friction:  # which tells the estimates without it already
        details.append(estimates_without_cause(finding))
    details = [detail for detail in dict.fromkeys(details) if detail]
    if not details:
        return ""
    return ". ".join([details[0], *map(capital, details[1:])])


def sentence_of(words: Words, cause: str = "") -> str:
    """`cause: what is wrong: how large. What to do`, without the parts that are empty."""
    problem = ": ".join(filter(None, [cause, words.says, words.size]))
    return ". ".join(filter(None, [problem, words.remedy]))


def finding_text(finding: Finding, row: AnyRow) -> str:
    """A finding about a row in one sentence or two, with the numbers that decided."""
    words = words_of(finding, row)
    if finding.name not in FINDINGS:
        return words.says
    sentence = sentence_of(words, finding.cause)
    if not finding.evidence:
        return sentence
    return f"{sentence} [{evidence_text(finding)}]"


def evidence_text(finding: Finding) -> str:
    """The numbers that decided, each with its limit."""
    return ", ".join(beyond_text(number) for number in finding.evidence)


def beyond_text(number: Beyond) -> str:
    if number.side == "nan":
        return f"{number.column} is not a number"
    if number.side == "near":
        return f"{number.column} {number.value:.3g} is close to it"
    return f"{number.column} {number.value:.3g} is {number.side} {number.limit:g}"


def estimates_without_cause(finding: Finding) -> str:
    """The estimates of the same fit with this cause as a column of the regression, where they are
    better than the recorded ones."""
    texts: list[str] = []
    for estimate in finding.without:
        name, value = estimate.recorded, estimate.value
        if not estimate.is_told:
            texts.append(f"{name} not identifiable")
        elif estimate.low is None or estimate.high is None:
            continue
        elif value is not None and is_symmetric(value, estimate.low, estimate.high):
            texts.append(f"{name} {value:.4g} ± {significant(estimate.high - value)}")
        else:  # the range of rivals that cannot be told apart
            ends = dict.fromkeys([significant(estimate.low, 3), significant(estimate.high, 3)])
            texts.append(f"{name} {' to '.join(ends)}")
    return f"with it in the model {', '.join(texts)}" if texts else ""


def is_symmetric(value: float, low: float, high: float) -> bool:
    """Whether an estimate is the middle of its interval."""
    return abs(high + low - 2 * value) <= SYMMETRIC_SHARE * (high - low)


def capital(text: str) -> str:
    """A text that begins with a capital letter; a symbol, as `f_C`, keeps its case."""
    return text if re.match(r"\w_", text) else text[:1].upper() + text[1:]


class Number(float):
    """A number shown with some significant digits, times a factor: `~2*1e3`, `~+2` with its
    sign."""

    def __format__(self, spec: str) -> str:
        if not spec.startswith("~"):
            return super().__format__(spec)
        digits, _, factor = spec.removeprefix("~").partition("*")
        value = self * float(factor or 1)
        text = significant(value, abs(int(digits)))
        return f"+{text}" if digits.startswith("+") and value > 0 else text


class Cells:
    """The cells of a row that are filled, by column, and the number that a finding is about.

    A name that is not among them raises KeyError, whereupon `filled` leaves the detail out."""

    def __init__(self, row: AnyRow, evidence: Beyond | None = None) -> None:
        self.row = row
        self.evidence = evidence

    def __contains__(self, name: str) -> bool:
        return self.row.get(name) is not None

    def __getitem__(self, name: str) -> Any:
        cell = self.row.get(name)
        if cell is None:
            raise KeyError(name)
        return Number(cell) if isinstance(cell, int | float) else cell


def value_in_text(name: str, cells: Cells) -> Any:
    """What stands for a name in braces: a cell of the row, something about the evidence
    (`OF_EVIDENCE`), or what is computed from the row (`COMPUTED`).

    Raises
    ------
    KeyError
        The row lacks a number that it needs.
    """
    if name in cells:
        return cells[name]
    if name in OF_EVIDENCE and cells.evidence is not None:
        return OF_EVIDENCE[name](cells.evidence, cells.row)
    return COMPUTED[name](cells)


def filled(template: str, cells: Cells) -> str:
    """A text with its numbers; empty where one is not known."""
    values: dict[str, Any] = {}
    for _, name, _, _ in Formatter().parse(template):
        if not name:  # a part of the text without braces
            continue
        try:
            values[name] = value_in_text(name, cells)
        except KeyError:
            return ""
    return template.format(**values)


# What a number of evidence says, by its name in `findings.yaml`.


def percent(value: float) -> str:
    return f"{significant(100 * abs(value))} %"


def rises_or_falls(number: Beyond, _: AnyRow) -> str:
    return "rises" if number.value > 0 else "falls"


def symbol_of_ratio(number: Beyond, _: AnyRow) -> str:
    """The symbol of an estimate whose ratio to a known value, or upper end, is beyond its limit."""
    return number.column.removesuffix("_ratio").removesuffix("_high")


def unexplained_of(number: Beyond, _: AnyRow) -> str:
    """How far torque that nothing explains could move the estimate of a column."""
    estimate = number.column.removesuffix("_unexplained_share")
    return f"it could move {estimate} by up to {percent(number.value)}"


def explained(_: Beyond, row: AnyRow) -> str:
    """What explains a torque, or comes nearest to it."""
    explanations = row.get("explanations")
    if leaves_torque(row):
        return f"{explanations}: what comes nearest, and leaves more than noise"
    return f"explained by {explanations}"


def friction_of_damping(number: Beyond, row: AnyRow) -> str:
    return friction_text(row) or f"it is {percent(number.value)} of the damping"


def unit_factor_text(number: Beyond, row: AnyRow) -> str:
    """Which units a ratio to a known value suggests; empty for none."""
    name = suspected_unit(number.column, number.value, row)
    factor = 1.0
    if name:
        for factors in UNIT_FACTORS.values():
            if name in factors:
                factor = factors[name]
                break
    else:
        size = max(abs(number.value), 1 / abs(number.value))
        near = NEAR_LARGE_FACTOR if size > SMALL_FACTOR else NEAR_STATED
        name, factor = known_factor(number.value, EVIDENCE[number.column].signals, near)
    return f", {factor:.3g} is the factor {name}" if name else ""


def frame_text(number: Beyond, _: AnyRow) -> str:
    """A remark on a bench whose frame yields, which lowers K, and hardly to a half."""
    if not 0.5 < number.value < 1:
        return ""
    return " (state `bench_stiffness` in the configuration if the bench's frame yields)"


def more_or_less(number: Beyond, row: AnyRow) -> str:
    """By how much something is above or below what it should be."""
    return f"{percent(abs(number.value))} {'more' if number.value > 0 else 'less'}"


OF_EVIDENCE: Mapping[str, Callable[[Beyond, AnyRow], str]] = {
    "percent": lambda number, _: percent(number.value),
    "value": lambda number, _: significant(number.value, 3),
    "rises_or_falls": rises_or_falls,
    "symbol": symbol_of_ratio,
    "friction_in_damping": friction_of_damping,
    "unit_factor": unit_factor_text,
    "yielding_frame": frame_text,
    "deviation": more_or_less,
    "unexplained": unexplained_of,
    "explained": explained,
}


def friction_text(row: AnyRow) -> str:
    """Friction's part of the damping, in units of the result; empty if not known."""
    B, f_C = ("B_j", "T_C") if "B_j_viscous" in row else ("B", "f_C")
    damping = rounded_cell(row, B)
    viscous = rounded_cell(row, f"{B}_viscous")
    friction = rounded_cell(row, f_C)
    share = cell_number(row, "coulomb_share")
    if viscous and friction:
        return f"{B} {damping}, viscous part {viscous} N*m*s/rad, friction {friction} N*m"
    if damping and share:
        by_friction = significant(share * float(damping))
        return f"friction makes {by_friction} N*m*s/rad of {B} = {damping}"
    return ""


def rounded_cell(row: AnyRow, name: str) -> str:
    """An estimate of a row as tables round it, by its interval; empty for none."""
    value = cell_number(row, name)
    if value is None:
        return ""
    low, high = cell_number(row, f"{name}_low"), cell_number(row, f"{name}_high")
    return with_places(decimal_places(value, low, high), value)[0]


# What is computed from a row, by its name in `findings.yaml`.


def lag_text(cells: Cells) -> str:
    """How late a signal is, or would have to be, and its effect on the estimates."""
    row = cells.row
    lag_s = cell_number(row, "lag_s")
    share_of_damping = cell_number(row, "lag_share")
    share_of_inertia = cell_number(row, "lag_inertia_share")
    effects = []
    if share_of_damping is not None:
        effects.append(f"B by {percent(share_of_damping)}")
    if share_of_inertia is not None:
        inertia = "J_j" if "J_j" in row else "I"
        effects.append(f"{inertia} by {percent(share_of_inertia)}")
    if lag_s is None or not effects:
        return ""
    signal = "the angle" if lag_s < 0 else "the torque"
    lag_ms = significant(1e3 * abs(lag_s), 3)
    return f"{signal} is late by {lag_ms} ms, which moves {' and '.join(effects)}"


def late_remedy(cells: Cells) -> str:
    """What to state of a late channel; nothing where the size of the cause tells it."""
    if "certain_lag_s" in cells:
        return ""
    lag_s = cell_number(cells.row, "lag_s")
    if lag_s is None:
        return "measure the delay by a known spring (`calibration`), and state it"
    signal = "angle" if lag_s < 0 else "torque"
    return (
        f"add {significant(1e3 * abs(lag_s), 3)} ms to the `delay` of the {signal} in the source"
        " file, or state its `low_pass` there"
    )


UNCERTAIN_LAG_SHARE = 0.2  # of a lag: a wider half-interval may be of a spring that loses energy


def calibration_text(cells: Cells) -> str:
    """What a known spring or inertia tells of the bench's lag or gain, and what to state."""
    assert cells.evidence is not None
    if cells.evidence.column == "certain_lag_s":
        return calibrated_lag_text(cells)
    gain = cells["gain"]
    half = cells["gain_high"] - gain
    error = f"torque over angle is {100 * (gain - 1):+.3g} ± {100 * half:.2g} % off"
    rival = ""
    if "known_K" in cells and "fixture" not in cells:
        weight = (gain - 1) * cells["known_K"]
        rival = f" or a fixture weighs {weight:+.2g} N*m: state it (`fixture`) and run again, else"
    return (
        f"{error},{rival} divide the torque's `scale` by {gain:.5g} and write `{cells['to_state']}`"
    )


def calibrated_lag_text(cells: Cells) -> str:
    to_state = cells["to_state"]
    lag_s = cells["lag_s"]
    half_s = cells["lag_s_high"] - lag_s
    explanations = cells.row.get("explanations") or "delay"
    is_early = lag_s < 0  # which no load cell is
    if is_early or half_s > UNCERTAIN_LAG_SHARE * lag_s:
        remedy = "as with a spring that loses energy: measure it with a known inertia"
    elif explanations != "delay":
        remedy = (
            f"or otherwise distorted ({explanations}), which gives another I: write the `low_pass`"
            f" of its data sheet, or else `delay: {1e3 * lag_s:.3g} ms`, and calibrate again"
        )
    else:
        remedy = f"add {1e3 * lag_s:.3g} ms to its `delay` and write `{to_state}`"
    way = "early" if is_early else "late"
    return f"the torque is {way} by {1e3 * abs(lag_s):.3g} ± {1e3 * half_s:.2g} ms, {remedy}"


LONGEST_DELAY_S = 0.02  # of a controller; a longer one is not what takes damping off


def damping_gap_text(cells: Cells) -> str:
    """How far B is from the gains' prediction; a delay explains less, and never more."""
    measured = significant(cells["B"], 3)
    predicted = significant(cells["B_predicted"], 3)
    delay_s = cells["B_gap_s"]
    text = f"B is {measured} N*m*s/rad and not {predicted}"
    if 0 < delay_s < LONGEST_DELAY_S:
        text += f", which a delay of {significant(1e3 * delay_s)} ms would explain"
    return text


def unknown_gains(cells: Cells) -> str:
    """Why the gains of a trial's controller are not known."""
    controller = cells.row.get("controller")
    if controller is None:
        return "no controller is stated"
    if controller not in CONTROLLERS:
        suggestion = nearest(str(controller), CONTROLLERS)
        return f"the gains of controller '{controller}' are not known{suggestion}"
    absent = [name for name in ("K_d", "B_d") if cells.row.get(name) is None]
    verb = "is" if len(absent) == 1 else "are"
    return f"{' and '.join(absent)} {verb} not stated"


def gains_unseen(cells: Cells) -> str:
    """Which gains of torque over angle the stated stiffness would not show."""
    ratio = cell_number(cells.row, "K_over_K_d")
    if ratio is None:
        return "no stiffness is known, so a wrong gain would not show"
    low, high = RENDERED_OF_K_D
    return (
        f"K is {ratio:.3g} times K_d. Assumed that {low:g} to {high:g} of it are rendered, as by"
        f" the shipped ankle, the gain may be off by a factor of {ratio / high:.2f} to"
        f" {ratio / low:.2f}"
    )


def told_delay(cells: Cells) -> str:
    """How well a recording tells the delay between angle and torque by itself."""
    told_s = cell_number(cells.row, "delay_told_s")
    if told_s is None:
        return "This recording would not show it"
    return f"From the recording it is known to {significant(1e3 * told_s)} ms"


def ratio_to_file(cells: Cells) -> str:
    """How many times the parameter file's value a component trial measures."""
    for quantity in MEASURED_BY.values():
        if f"{quantity}_ratio" in cells:
            return significant(cells[f"{quantity}_ratio"], 3)
    raise KeyError("the row has no ratio to the parameter file")


def gain_remedy(cells: Cells) -> str:
    """What to do about a wrong gain; what the fixture weighs comes first, unless it is stated."""
    correct = "correct the `scale` of torque or angle in the source file"
    if cells.row.get("fixture"):
        return correct
    return f"state the fixture first (`fixture`), then {correct}"


COMPUTED: Mapping[str, Callable[[Cells], Any]] = {
    "gain_remedy": gain_remedy,
    "zero_deg": lambda cells: Number(math.degrees(-cells["offset"] / cells["K"])),
    "K_by_rest": lambda cells: Number(weight_by_rest(cells.row)),
    "lag": lag_text,
    "late_remedy": late_remedy,
    "calibration": calibration_text,
    "damping_gap": damping_gap_text,
    "gains_unseen": gains_unseen,
    "unknown_gains": unknown_gains,
    "delay_told": told_delay,
    "ratio_to_file": ratio_to_file,
}
