# SPDX-License-Identifier: Apache-2.0
"""Find the trials of a campaign that do not agree with the others.

Repeats of a condition are compared with their median, a condition with the other conditions of its
arm (joint, side, controller), and the whole arm with what was commanded. A mistyped K_d, a loose
clamp or a wrong unit leaves each single trial sound.

Within an arm 1/K = slope/K_d + compliance, a spring K_d in series with another one; the line is by
medians (Theil, 1950; Sen, 1968). Real repeats scatter 5 to 60 times wider than the interval of one
motion. So the measure is the scatter of the campaign's own repeats.

Example: of four trials with K_d = 90 and K = 89.8, 90.1, 90.3 and 60.0 the last has a finding.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.base.units import factors_near
from osl_analysis.judge.findings import Finding
from osl_analysis.judge.rules import K_UNLIKE_SHEET, Beyond, Grade
from osl_analysis.stats.budget import floored_size
from osl_analysis.stats.doubts import DOUBTS, doubts_about
from osl_analysis.stats.rounding import places_of, significant, to_places
from osl_analysis.stats.sources import Source

FitRow = Mapping[str, Any]  # of `impedance.csv`, of the fit to all of a trial

ARM = ("joint", "side", "controller")
CONDITION_OF_REPEATS = (*ARM, "K_d", "B_d", "excitation")

UNLIKE = Source.UNLIKE_OTHER_TRIALS
FACTOR = Source.COMMON_FACTOR

MOST_SCATTERS = 7.0  # median standard deviations of conditions, from the median of one condition
# times the needed accuracy: by how much repeats may differ where their scatter is unknown
UNKNOWN_SCATTER = 3.0
FEWEST = 3  # conditions with repeats, or trials of an arm, from which their scatter is known
MOST_HALF_WIDTHS = 2.0  # of the difference of two trials
MOST_OFF_LINE = 0.1  # share of K by which friction, a bending frame or a gain moves it
MOST_DEVIATIONS = 6.0  # median deviations of an arm: four standard deviations
MOST_OF_GAINS = K_UNLIKE_SHEET.high - 1  # share by which a controller may miss what was commanded


def disagreements(rows: Iterable[FitRow], needed: Mapping[str, float]) -> list[Finding]:
    """Find the trials of a campaign that do not agree.

    Parameters
    ----------
    rows : Iterable of Row
        One per trial, with K, B, I, the ends of their intervals, and its `DOUBTS`.
    needed : Mapping of str to float
        The change of K, B and I that matters, as a share of the estimate.

    Returns
    -------
    list of Finding
        A finding on K where a trial differs from its repeats, else where it differs from its arm.
        It is about the whole trial, which may be of another condition. A trial without one may
        have findings on B and I. An arm may have a common factor.
    """
    comparable = [row for row in rows if row.get("K_d") and row.get("K")]
    on_K: dict[str, Finding] = {}  # by trial; at most one each
    further: list[Finding] = []
    scatters: dict[str, float] = {}  # of the arm, by trial
    for arm in grouped(comparable, ARM):
        scatter, farthest = findings_off_line(arm)
        on_K |= farthest
        scatters |= dict.fromkeys([row["trial"] for row in arm], scatter)
        further += common_factor(arm, needed)
    repeats = [rows for rows in grouped(comparable, CONDITION_OF_REPEATS) if len(rows) > 1]
    for differing in differing_repeats(repeats, "K", needed["K"], scatters):
        differing_from_line = {trial: differing[trial] for trial in differing if trial in on_K}
        on_K |= differing_from_line or differing
    for symbol in "BI":
        for differing in differing_repeats(repeats, symbol, needed[symbol], {}):
            further += [differing[trial] for trial in differing if trial not in on_K]
    return [*on_K.values(), *further]


def grouped(rows: Iterable[FitRow], columns: Sequence[str]) -> list[list[FitRow]]:
    """The rows, grouped by equal cells in these columns."""
    groups: dict[tuple[Any, ...], list[FitRow]] = {}
    for row in rows:
        groups.setdefault(tuple(map(row.get, columns)), []).append(row)
    return list(groups.values())


def column_numbers(rows: Iterable[FitRow], column: str) -> Array:
    """A column of the rows (n,); NaN where it is empty."""
    return np.array([row.get(column) for row in rows], dtype=float)


def half_widths(rows: Sequence[FitRow], symbol: str) -> Array:
    """Half-widths of the intervals of an estimate (n,); 0 where it has none."""
    return (
        np.nan_to_num(
            column_numbers(rows, f"{symbol}_high") - column_numbers(rows, f"{symbol}_low")
        )
        / 2
    )


def finding_on(row: FitRow, symbol: str, expected: float, most: float, size: str) -> Finding:
    """The finding that an estimate differs from what is `expected` by more than `most`.

    A finding on K is about the whole trial.
    """
    difference = row[symbol] - expected
    side = "above" if difference > 0 else "below"
    limit = expected + math.copysign(most, difference)
    evidence = (Beyond(symbol, row[symbol], limit, UNLIKE, side),)
    estimates = () if symbol == "K" else (symbol,)
    return Finding(
        UNLIKE, "impedance", row["trial"], evidence=evidence, estimates=estimates, size=size
    )


def condition_text(row: FitRow) -> str:
    """The condition of a trial."""
    return ", ".join(
        f"{name} {row[name]}" for name in CONDITION_OF_REPEATS[2:5] if row.get(name) is not None
    )


def differing_repeats(
    repeats: Iterable[Sequence[FitRow]],
    symbol: str,
    needed: float,
    scatter_of_arm: Mapping[str, float],
) -> Iterator[dict[str, Finding]]:
    """Yield the repeats of each condition that are far from their median, by trial; of two, both.

    Far is farther than the needed accuracy, the scatter of other repeats of the campaign, and the
    intervals. Two repeats must also differ by more than the trials of their arm scatter about its
    line (`scatter_of_arm`). A doubtful estimate among clear ones is not compared with the scatter.
    """
    conditions = []
    for rows in repeats:
        values = column_numbers(rows, symbol)
        if np.isfinite(values).all():
            conditions.append((rows, values, floored_size(symbol, float(np.median(values)))))
    usual = UNKNOWN_SCATTER * needed
    if len(conditions) >= FEWEST:
        scatters = [np.std(values, ddof=1) / size for _, values, size in conditions]
        usual = max(needed, MOST_SCATTERS * float(np.median(scatters)))
    for rows, values, size in conditions:
        are_doubtful = np.array([bool(doubts_about(row[DOUBTS], [symbol])) for row in rows])
        shares = np.where(are_doubtful & ~are_doubtful.all(), needed, usual)
        if len(rows) == 2:
            shares = np.maximum(shares, MOST_DEVIATIONS * scatter_of_arm.get(rows[0]["trial"], 0.0))
        halves = half_widths(rows, symbol)
        most = np.maximum(shares * size, MOST_HALF_WIDTHS * np.hypot(halves, np.median(halves)))
        median = float(np.median(values))
        texts = ", ".join(to_places(places_of(size, 3), *values))
        values_text = f"{symbol} {texts} of {condition_text(rows[0])}"
        findings = {}
        for row, limit in zip(rows, most.tolist(), strict=True):
            if abs(row[symbol] - median) > limit:
                size_text = f"{values_text}: {row['trial']}"
                findings[row["trial"]] = finding_on(row, symbol, median, limit, size_text)
        yield findings


def findings_off_line(arm: Sequence[FitRow]) -> tuple[float, dict[str, Finding]]:
    """The scatter of an arm's trials about its line, and the finding on the trial farthest from it.

    The scatter is a median deviation, as a share of K. The finding is by the trial's name; none if
    its K is as the other trials let expect.
    """
    rows = [row for row in arm if row["K"] > 0]
    if len(rows) < FEWEST:
        return 0.0, {}
    K_d = column_numbers(rows, "K_d")
    K = column_numbers(rows, "K")
    expected, scatters = np.transpose([by_others(K_d, K, i) for i in range(len(K))])
    shares = np.maximum(MOST_OFF_LINE, MOST_DEVIATIONS * scatters)
    most = np.maximum(shares * expected, MOST_HALF_WIDTHS * half_widths(rows, "K"))
    excess = np.abs(K - expected) / most
    worst = int(np.argmax(excess))
    row = rows[worst]
    by_line = float(expected[worst])
    size = (
        f"K {significant(row['K'], 3)} of {condition_text(row)}, where the other trials let expect"
        f" {significant(by_line, 3)} N*m/rad"
    )
    findings = {row["trial"]: finding_on(row, "K", by_line, float(most[worst]), size)}
    return float(np.median(scatters)), findings if excess[worst] > 1 else {}


def by_others(K_d: Array, K: Array, i: int) -> tuple[float, float]:
    """K [N*m/rad] of the i-th trial as the others let expect, and their own scatter.

    The scatter is their median deviation from their line, as a share of K.

    The line 1/K = slope/K_d + compliance has the median of all slopes between trials (Theil, 1950;
    Sen, 1968); of two conditions, or with a negative compliance, it goes through 0.
    """
    x = 1 / np.delete(K_d, i)
    y = 1 / np.delete(K, i)
    slope = np.median(y / x)
    compliance = 0.0
    if len(np.unique(x)) > 2:
        slope_of_all = scipy.stats.theilslopes(y, x).slope
        intercept = np.median(y - slope_of_all * x)
        if intercept > 0:
            slope = slope_of_all
            compliance = intercept
    expected = 1 / (slope / K_d[i] + compliance)
    return expected, float(np.median(np.abs((slope * x + compliance) / y - 1)))


def common_factor(arm: Sequence[FitRow], needed: Mapping[str, float]) -> Iterator[Finding]:
    """Yield findings where K/K_d and B/B_d of an arm have one factor in common.

    They agree to the needed accuracy. The cause is a gain, or a unit of the torque, which is a
    doubt. A spring in series would not do so: it spreads K/K_d.
    """
    rows = [row for row in arm if row.get("B_d") and row.get("B")]
    if len(rows) < FEWEST:
        return
    ratios_of_K = column_numbers(rows, "K") / column_numbers(rows, "K_d")
    B = np.array([row.get("B_viscous") or row["B"] for row in rows])
    factor = np.median(ratios_of_K)
    factor_of_B = np.median(B / column_numbers(rows, "B_d"))
    spread = np.median(np.abs(ratios_of_K / factor - 1))
    is_common = abs(factor_of_B / factor - 1) < needed["B"] and spread < needed["K"]
    if not is_common or abs(factor - 1) < MOST_OF_GAINS:
        return
    units = factors_near(factor, ["torque"], MOST_OFF_LINE)
    values_text = f"K is {factor:.3g} times K_d, and B {factor_of_B:.3g} times B_d"
    size = "; ".join([values_text, *units])
    grade = Grade.DOUBTS if units else Grade.NOTES
    for row in rows:
        evidence = (Beyond("K", row["K"], row["K_d"], FACTOR, "above"),)
        yield Finding(FACTOR, "impedance", row["trial"], grade, evidence, size=size)
