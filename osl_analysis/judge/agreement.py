# SPDX-License-Identifier: Apache-2.0
"""Whether the trials of a campaign agree: repeats of a condition with one another, a condition with
the others of its arm (joint, side, controller), and all of an arm with what was commanded.

A mistyped K_d, a loose clamp or a wrong unit leaves each trial sound. Intervals decide little here:
real repeats scatter by more than the interval of one motion (5 to 60 times), so that the scatter of
the campaign's own repeats is the measure.
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

MOST_SCATTERS = 7.0  # times the median standard deviation of conditions, from the median of one
UNKNOWN_SCATTER = 3.0  # times what is needed: by how much repeats may differ where it is not
FEWEST = 3  # conditions with repeats, or trials of an arm, from which their scatter is known
MOST_HALF_WIDTHS = 2.0  # of the difference of two trials
MOST_BESIDE = 0.1  # of K; what friction, a bending frame and a gain move it
MOST_DEVIATIONS = 6.0  # median deviations of an arm: four standard deviations
MOST_OF_GAINS = K_UNLIKE_SHEET.high - 1  # by which a controller may miss what was asked


def disagreements(rows: Iterable[FitRow], needed: Mapping[str, float]) -> list[Finding]:
    """Find the trials of a campaign that do not agree.

    Parameters
    ----------
    rows : Iterable of Row
        One per trial, with K, B, I, the ends of their intervals, and its `DOUBTS`.
    needed : Mapping of str to float
        The change of K, B and I that matters, as a share of itself.

    Returns
    -------
    list of Finding
        One on K of a trial beside its repeats, else beside its arm, which is about all of the
        trial: it may be of another condition. Without it, those on B and I; and on a common factor.
    """
    comparable = [row for row in rows if row.get("K_d") and row.get("K")]
    told: dict[str, Finding] = {}  # on K, by trial
    others: list[Finding] = []
    scatters: dict[str, float] = {}  # of the arm, by trial
    for arm in grouped(comparable, ARM):
        scatter, off_line = beside_line(arm)
        told |= off_line
        scatters |= dict.fromkeys([row["trial"] for row in arm], scatter)
        others += common_factor(arm, needed)
    repeats = [rows for rows in grouped(comparable, CONDITION_OF_REPEATS) if len(rows) > 1]
    for of_condition in differing_repeats(repeats, "K", needed["K"], scatters):
        of_line = {trial: of_condition[trial] for trial in of_condition if trial in told}
        told |= of_line or of_condition
    for symbol in "BI":
        for of_condition in differing_repeats(repeats, symbol, needed[symbol], {}):
            others += [of_condition[trial] for trial in of_condition if trial not in told]
    return [*told.values(), *others]


def grouped(rows: Iterable[FitRow], columns: Sequence[str]) -> list[list[FitRow]]:
    """The rows by those that agree in these columns."""
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
    """The finding that an estimate of a trial is beside what is `expected` by more than `most`.
    One on K is about all of the trial."""
    difference = row[symbol] - expected
    side = "above" if difference > 0 else "below"
    limit = expected + math.copysign(most, difference)
    evidence = (Beyond(symbol, row[symbol], limit, side, UNLIKE),)
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
    repeats: Iterable[Sequence[FitRow]], symbol: str, needed: float, of_arm: Mapping[str, float]
) -> Iterator[dict[str, Finding]]:
    """The repeats of each condition, by trial, that are farther from their median than is needed,
    than other repeats of the campaign scatter, and than their intervals; of two, both.

    Two must differ by more than the trials of their arm scatter about its line (`of_arm`), too. A
    doubtful estimate beside clear ones need not differ by more than others do.
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
            shares = np.maximum(shares, MOST_DEVIATIONS * of_arm.get(rows[0]["trial"], 0.0))
        halves = half_widths(rows, symbol)
        most = np.maximum(shares * size, MOST_HALF_WIDTHS * np.hypot(halves, np.median(halves)))
        median = float(np.median(values))
        texts = ", ".join(to_places(places_of(size, 3), *values))
        said = f"{symbol} {texts} of {condition_text(rows[0])}"
        found = {}
        for row, limit in zip(rows, most.tolist(), strict=True):
            if abs(row[symbol] - median) > limit:
                size_text = f"{said}: {row['trial']}"
                found[row["trial"]] = finding_on(row, symbol, median, limit, size_text)
        yield found


def beside_line(arm: Sequence[FitRow]) -> tuple[float, dict[str, Finding]]:
    """How the trials of an arm scatter about its line, as a median deviation, and the one, by its
    name, whose K is farthest from what the others, as a spring K_d in series with another one, let
    expect."""
    rows = [row for row in arm if row["K"] > 0]
    if len(rows) < FEWEST:
        return 0.0, {}
    K_d = column_numbers(rows, "K_d")
    K = column_numbers(rows, "K")
    expected, scatters = np.transpose([by_others(K_d, K, i) for i in range(len(K))])
    shares = np.maximum(MOST_BESIDE, MOST_DEVIATIONS * scatters)
    most = np.maximum(shares * expected, MOST_HALF_WIDTHS * half_widths(rows, "K"))
    excess = np.abs(K - expected) / most
    worst = int(np.argmax(excess))
    row = rows[worst]
    by_line = float(expected[worst])
    size = (
        f"K {significant(row['K'], 3)} of {condition_text(row)}, where the other trials let expect"
        f" {significant(by_line, 3)} N*m/rad"
    )
    found = {row["trial"]: finding_on(row, "K", by_line, float(most[worst]), size)}
    return float(np.median(scatters)), found if excess[worst] > 1 else {}


def by_others(K_d: Array, K: Array, i: int) -> tuple[float, float]:
    """K [N*m/rad] that the other trials let expect of the i-th, and the median deviation by which
    they are beside their line themselves, as a share.

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
    """The factor that K/K_d and B/B_d of an arm share, to what is needed of them: a gain, or a unit
    of the torque, which is a doubt. A spring in series would spread K/K_d."""
    rows = [row for row in arm if row.get("B_d") and row.get("B")]
    if len(rows) < FEWEST:
        return
    of_K = column_numbers(rows, "K") / column_numbers(rows, "K_d")
    B = np.array([row.get("B_viscous") or row["B"] for row in rows])
    factor = np.median(of_K)
    factor_of_B = np.median(B / column_numbers(rows, "B_d"))
    spread = np.median(np.abs(of_K / factor - 1))
    is_common = abs(factor_of_B / factor - 1) < needed["B"] and spread < needed["K"]
    if not is_common or abs(factor - 1) < MOST_OF_GAINS:
        return
    units = factors_near(factor, ["torque"], MOST_BESIDE)
    said = f"K is {factor:.3g} times K_d, and B {factor_of_B:.3g} times B_d"
    size = "; ".join([said, *units])
    grade = Grade.DOUBTS if units else Grade.NOTES
    for row in rows:
        evidence = (Beyond("K", row["K"], row["K_d"], "above", FACTOR),)
        yield Finding(FACTOR, "impedance", row["trial"], grade, evidence, size=size)
