"""The words of findings: the only place where they become sentences. Nothing here decides, and
nothing reads them back.

A detail whose numbers a row does not have is left out."""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from string import Formatter
from typing import Any, NamedTuple

from osl_analysis.dictionary import own_yaml
from osl_analysis.errors import nearest
from osl_analysis.judge.causes import CAUSES, EVIDENCE, cause_of, suspected_unit
from osl_analysis.judge.finding import (
    ESTIMATES,
    AnyRow,
    Beyond,
    Finding,
    Grade,
    Remedy,
    cell_number,
)
from osl_analysis.judge.judging import MEASURED_BY
from osl_analysis.judge.moved_estimates import estimate_column
from osl_analysis.measured import significant
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.units import UNIT_FACTORS, known_factor

WORDS: dict[str, dict[str, Any]] = own_yaml(Path(__file__).with_suffix(".yaml"))


class Words(NamedTuple):
    """What a finding says to a reader."""

    says: str  # what is wrong, and what it does to the results
    size: str  # how large it is in this row; empty if not known
    remedy: str  # what to do; empty for nothing


def words_of(finding: Finding, row: AnyRow) -> Words:
    """The words on a finding about a row of its table."""
    if finding.cause in WORDS["unchecked"] and finding.grade is not Grade.DOUBTS:
        entry = WORDS["unchecked"][finding.cause]
        entry = entry.get(finding.table, entry)
        facts = Facts(row)
        remedy = entry.get(finding.remedy.value, entry.get("remedy", ""))
        return Words(filled(entry["says"], facts), "", capital(filled(remedy, facts)))
    known = WORDS["causes"].get(finding.cause)
    if known is None:  # a limit on a column that is not in EVIDENCE
        return Words(", ".join(map(beyond_said, finding.evidence)), "", "")
    remedy = known.get(finding.remedy.value) or known[Remedy.WHOLE.value]
    if finding.grade is Grade.NOTES:
        remedy = WORDS["remarks"]["within_accuracy"]
    return Words(known["says"], size_in_words(finding, row), capital(remedy))


def size_in_words(finding: Finding, row: AnyRow) -> str:
    """How large a cause is in this row: its numbers, and the estimates without it."""
    details = list[str]()
    by_friction = friction_said(row) if finding.cause == "friction" else ""
    details.append(by_friction)
    for number in finding.evidence:
        # a misfit that another cause explains is told by that cause
        if cause_of(number.column, number.value, row).name == finding.cause:
            template = WORDS["columns"].get(number.column, "")
            details.append(filled(template, Facts(row, number)))
    if not by_friction:  # which tells the estimates without it already
        details.append(without_said(finding, row))
    known = [detail for detail in dict.fromkeys(details) if detail]
    if not known:
        return ""
    return ". ".join([known[0], *map(capital, known[1:])])


def brief_remedy(cause: str) -> str:
    """What to do about a cause, in a few words; `component K_s` has those of every component."""
    phrases: Mapping[str, str] = WORDS["brief"]
    return phrases.get(cause) or phrases.get(cause.partition(" ")[0], "")


def sentence_of(words: Words, cause: str = "") -> str:
    """`cause: what is wrong: how large. What to do`."""
    said = ": ".join(filter(None, [cause, words.says, words.size]))
    return ". ".join(filter(None, [said, words.remedy]))


def finding_said(finding: Finding, row: AnyRow) -> str:
    """A finding about a row in one sentence or two, with the numbers that decided."""
    if finding.cause not in WORDS["causes"] and finding.grade is Grade.DOUBTS:
        return words_of(finding, row).says
    decided = ", ".join(map(beyond_said, finding.evidence))
    return sentence_of(words_of(finding, row), finding.cause) + (f" [{decided}]" if decided else "")


def beyond_said(one: Beyond) -> str:
    how = {"nan": "is not a number", "near": f"{one.value:.3g} is close to it"}
    return f"{one.column} {how.get(one.side, f'{one.value:.3g} is {one.side} {one.limit:g}')}"


def without_names(cause: str, row: AnyRow, table: str) -> dict[str, str]:
    """What a reader calls K, B and I without a cause in a table. Certain friction is a column of
    the regression beside the cause, and no part of the damping."""
    names = {symbol: estimate_column(table, symbol) for symbol in ESTIMATES}
    has_fault = cause in CAUSES and CAUSES[cause].without.get("B") == "B_without"
    if has_fault and row.get(f"{names['B']}_viscous") is not None:
        names["B"] += " without friction"
    return names


def without_said(finding: Finding, row: AnyRow) -> str:
    """The estimates of the same fit with this cause as a column of the regression, where they are
    better than the recorded ones."""
    texts = list[str]()
    for name, symbol in without_names(finding.cause, row, finding.table).items():
        value, low, high = (finding.without.get(f"{name}{end}") for end in ("", "_low", "_high"))
        if name in finding.untold:
            texts.append(f"nothing of {symbol} is told")
        elif low is None or high is None:
            continue
        elif value is not None and abs(high + low - 2 * value) <= 1e-3 * (high - low):
            texts.append(f"{symbol} {value:.4g} ± {significant(high - value)}")
        else:  # the range of rivals that cannot be told apart
            ends = dict.fromkeys([significant(low, 3), significant(high, 3)])
            texts.append(f"{symbol} {' to '.join(ends)}")
    return f"with it in the fit {', '.join(texts)}" if texts else ""


def capital(text: str) -> str:
    # a symbol keeps its case
    return text if re.match(r"\w_", text) else text[:1].upper() + text[1:]


@cache
def printed(text: str) -> str:
    """A text with units, symbols, powers and minus signs as the page sets them; empty for the unit
    1."""
    for pattern, sign in WORDS["signs"].items():
        text = re.sub(pattern, sign, text)
    return "" if text == "1" else text


def check_words(cause: str) -> Words:
    """What is wrong with a recording that does not pass a check of this cause, and what to do."""
    entry = WORDS["causes"][cause]
    return Words(entry["says"], "", entry["remedy"])


def misfit_words(cause: str, **facts: Any) -> Words:
    """What explains the residuals of all predictions."""
    entry = WORDS["misfits"][cause]
    return Words(entry["says"].format(**facts), "", entry["remedy"])


def as_if_said(parts: Sequence[Mapping[str, Any]]) -> str:
    """By how much components differ, as `K_s were 9.8 % (± 0.4 % by the scatter of trials) less`,
    from their rows."""
    said = []
    for row in parts:
        off, half = (100 * one / abs(row["value"]) for one in (row["change"], 2 * row["change_se"]))
        way = "more" if off > 0 else "less"
        said.append(
            f"{row['component']} were {abs(off):.2g} % (± {half:.1g} % by the scatter of trials)"
            f" {way}"
        )
    return " or ".join(said)


class Number(float):
    """A number shown with some significant digits, times a factor: `~2*1e3`, `~+2` with its
    sign."""

    def __format__(self, spec: str) -> str:
        if not spec.startswith("~"):
            return super().__format__(spec)
        digits, _, factor = spec.removeprefix("~").partition("*")
        text = significant(self * float(factor or 1), abs(int(digits)))
        return f"+{text}" if digits.startswith("+") and self * float(factor or 1) > 0 else text


class Facts(dict[str, Any]):
    """The cells of a row that are filled, by column, and the number that a finding is about."""

    def __init__(self, row: AnyRow, evidence: Beyond | None = None) -> None:
        super().__init__()
        self.row = row
        self.evidence = evidence
        for name, cell in row.items():
            if isinstance(cell, int | float):
                self[name] = Number(cell)
            elif cell is not None:
                self[name] = cell


def value_in_text(name: str, facts: Facts) -> Any:
    """What stands for a name in braces: a cell of the row, something about the evidence
    (`OF_EVIDENCE`), or what is computed from the row (`COMPUTED`).

    Raises
    ------
    KeyError
        The row lacks a number that it needs.
    """
    if name in facts:
        return facts[name]
    if name in OF_EVIDENCE and facts.evidence is not None:
        return OF_EVIDENCE[name](facts.evidence, facts.row)
    return COMPUTED[name](facts)


def filled(template: str, facts: Facts) -> str:
    """A text with its numbers; empty where one is not known."""
    values: dict[str, Any] = {}
    for _, name, _, _ in Formatter().parse(template):
        if not name:  # a part of the text without braces
            continue
        try:
            values[name] = value_in_text(name, facts)
        except KeyError:
            return ""
    return template.format(**values)


def percent(value: float) -> str:
    return f"{significant(100 * abs(value))} %"


def factor_said(evidence: Beyond, row: AnyRow) -> str:
    name = suspected_unit(evidence.column, evidence.value, row)
    signals: Sequence[str] = EVIDENCE[evidence.column].of
    size = next((UNIT_FACTORS[of][name] for of in UNIT_FACTORS if name in UNIT_FACTORS[of]), 1.0)
    if not name:
        name, size = known_factor(evidence.value, signals)
    return f", {size:.3g} is the factor {name}" if name else ""


OF_EVIDENCE: dict[str, Callable[[Beyond, AnyRow], str]] = {
    "percent": lambda one, _: percent(one.value),
    "value": lambda one, _: significant(one.value, 3),
    "moves": lambda one, _: (
        f"{'rises' if one.value > 0 else 'falls'} by {100 * abs(one.value):.0f} %"
    ),
    "symbol": lambda one, _: one.column.removesuffix("_ratio").removesuffix("_high"),
    "rubs": lambda one, row: friction_said(row) or f"it is {percent(one.value)} of the damping",
    "factor": factor_said,
    # a frame that yields lowers K, and hardly to a half
    "frame": lambda one, _: (
        " (state `bench_stiffness` in the configuration if the bench's frame yields)"
        * (0.5 < one.value < 1)
    ),
}


def friction_said(row: AnyRow) -> str:
    """Friction's part of the damping, in units of the result; empty if not known."""
    B, f_C = ("B_j", "T_C") if "B_j_viscous" in row else ("B", "f_C")
    damping, viscous, friction, share = (
        cell_number(row, one) for one in (B, f"{B}_viscous", f_C, "coulomb_share")
    )
    if damping is not None and viscous is not None and friction is not None:
        without, all_of_it = significant(viscous, 3), significant(damping, 3)
        return (
            f"{B} is {without} N*m*s/rad without friction and {all_of_it} with it, friction is"
            f" {friction:.2g} N*m"
        )
    if damping is not None and share:
        return (
            f"friction makes {significant(share * damping)} N*m*s/rad of {B} ="
            f" {significant(damping, 3)}"
        )
    return ""


def late_said(facts: Facts) -> str:
    """How late a signal is, or would have to be, and its effect on the estimates."""
    row = facts.row
    lag, of_damping, of_inertia = (
        cell_number(row, name) for name in ("lag_s", "lag_share", "lag_inertia_share")
    )
    shares = [f"B by {percent(of_damping)}"] if of_damping is not None else []
    shares += (
        [f"{'J_j' if 'J_j' in row else 'I'} by {percent(of_inertia)}"]
        if of_inertia is not None
        else []
    )
    if lag is None or not shares:
        return ""
    signal, size = "the angle" if lag < 0 else "the torque", f"{significant(1e3 * abs(lag), 3)} ms"
    return f"{signal} is late by {size}, which moves {' and '.join(shares)}"


def loop_said(facts: Facts) -> str:
    """How late a torque would make the energy lost depend on the speed."""
    behind, lost = facts["late_s"], facts["energy_lost"]
    taken = 1e3 * behind * facts["energy_per_ms"]  # off the energy lost [J]
    if taken <= 0:
        return ""
    share = 100 * taken / abs(lost + taken)
    return (
        f"a torque late by {1e3 * behind:.2g} ms would make it so, and take {share:.0f} % off the"
        " energy lost"
    )


def calibration_said(facts: Facts) -> str:
    assert facts.evidence is not None
    state = facts["to_state"]
    if facts.evidence.column == "certain_lag_s":
        lag, half = facts["lag_s"], facts["lag_s_high"] - facts["lag_s"]
        what = f"write `delay: {1e3 * lag:.3g} ms` more for it and `{state}`"
        if half > 0.2 * lag:  # or early, which no load cell is
            what = "which a spring that loses energy shows too, so measure it with a known inertia"
        elif (rivals := facts.get("explanations") or "delay") != "delay":
            what = (
                f"or what else would make it so ({rivals}), by which I is another one: write the"
                " `low_pass` that its"
            )
            what += (
                f" path has by the data sheet, or `delay: {1e3 * lag:.3g} ms` if it has none, and"
                " calibrate again"
            )
        return f"the torque is late by {1e3 * lag:.3g} ± {1e3 * half:.2g} ms, {what}"
    gain, half = facts["gain"], facts["gain_high"] - facts["gain"]
    off = f"torque over angle is {100 * (gain - 1):+.3g} ± {100 * half:.2g} % off"
    return f"{off}, divide the torque's `scale` by {gain:.5g} and write `{state}`"


def damping_gap_said(facts: Facts) -> str:
    """How far B is from the gains' prediction; a delay explains less, and never more."""
    B, given, late = facts["B"], facts["B_predicted"], facts["B_gap_s"]
    off = f"B is {significant(B, 3)} N*m*s/rad and not {significant(given, 3)}"
    return (
        f"{off}, which a delay of {significant(1e3 * late)} ms would explain"
        if 0 < late < 0.02
        else off
    )


def reaction_said(facts: Facts) -> str:
    """What sets in within the window of a perturbation, and K without it."""
    said, with_reflex = f"it is like {facts['reaction']}", filled("{with_reflex}", facts)
    return ". ".join(filter(None, [said, capital(with_reflex)]))


def unknown_gains(facts: Facts) -> str:
    row = facts.row
    controller = row.get("controller")
    if controller is None:
        return "no controller is stated"
    if controller not in CONTROLLERS:
        return (
            f"the gains of controller '{controller}' are not"
            f" known{nearest(str(controller), CONTROLLERS)}"
        )
    absent = [name for name in ("K_d", "B_d") if row.get(name) is None]
    return f"{' and '.join(absent)} {'is' if len(absent) == 1 else 'are'} not stated"


COMPUTED: Mapping[str, Callable[[Facts], str]] = {
    "late": late_said,
    "loop": loop_said,
    "known": calibration_said,
    "gap": damping_gap_said,
    "like": reaction_said,
    "unknown_gains": unknown_gains,
    "late_or_early": lambda facts: "late" if facts["certain_theta_m_lag_s"] > 0 else "early",
    "theta_m_ms": lambda facts: f"{1e3 * abs(facts['certain_theta_m_lag_s']):.2g}",
    "of_file": lambda facts: significant(
        next(facts[f"{one}_ratio"] for one in MEASURED_BY.values() if f"{one}_ratio" in facts), 3
    ),
    "moment_short": lambda facts: significant(
        100 * facts["moment_error_half"] * facts["moment_K_per_percent"]
    ),
    "with_reflex": lambda facts: (
        f"with a reflex of {facts['reflex_gain']:.2g} N*m*s/rad, {facts['reflex_delay_ms']:.0f} ms"
        f" late, K would be {facts['K_with_reflex']:.3g} ({facts['K_with_reflex_low']:.3g} to"
        f" {facts['K_with_reflex_high']:.3g}) N*m/rad"
    ),
    "reflex_remedy": lambda facts: (
        f"set walking.window_s to {facts['longer_window_s']:g} if stance allows"
        if "longer_window_s" in facts
        else "record more crossings"
    ),
    "slope_B": lambda facts: " to ".join(
        map(
            significant,
            sorted(facts[f"hidden_slope_{end}"] * facts["B_per_slope"] for end in ("low", "high")),
        )
    ),
}
