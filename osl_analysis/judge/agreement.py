"""Whether the trials of a campaign agree: repeats of a condition with one another, a condition with
the others of its arm (joint, side, controller), and all of an arm with what was commanded.

A mistyped K_d, a loose clamp or a wrong unit leaves each trial sound. Intervals decide little here:
real repeats scatter by more than the interval of one motion (5 to 60 times), so that the scatter of
the campaign's own repeats is the measure.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.judge.finding import Beyond, Finding, Grade
from osl_analysis.judge.known_findings import Rule
from osl_analysis.measured import places_of, significant, with_places
from osl_analysis.units import factors_near

Row = Mapping[str, Any]  # of `impedance.csv`, of the fit to all of a trial
Array = NDArray[np.float64]

ARM = ("joint", "side", "controller")
CONDITION = (*ARM, "K_d", "B_d", "excitation")

SMALL = {"K": 2.0, "B": 0.1, "I": 5e-3}  # SI; of a smaller estimate a share of itself is no size
# times the median scatter of conditions, which of two repeats is 0.67 of a standard deviation
MOST_SCATTERS = 6.0
FEWEST_SCATTERS = 4  # conditions with repeats from which their scatter is known
UNKNOWN_SCATTER = 3.0  # times what is needed: by how much repeats may differ where it is not
OF_PAIR = 2.0  # times: of two repeats that differ nobody knows the wrong one
MOST_HALF_WIDTHS = 2.0  # of the difference of two trials
FEWEST_OF_ARM = 3  # trials
NEEDED_OF_ARM = 0.1  # of K; what friction and a bending frame move it off a spring's line
MOST_DEVIATIONS = 6.0  # median deviations of an arm: four standard deviations
SAME_FACTOR = 0.05  # by which K/K_d and B/B_d may differ
OF_GAINS = 0.06  # by which a controller may miss what it was asked for
MOST_SPREAD = 0.02  # median deviation of K/K_d in an arm: a spring in series spreads it
CERTAIN_FACTOR = 1.2  # no torque constant is as wrong
GAIN_BESIDE_UNIT = 0.12  # by which a gain may be wrong beside a unit


def finding_on(
    trial: str, name: str, column: str, value: float, limit: float, size: str, remedy: str,
    grade: Grade = Grade.DOUBTS,
) -> Finding:  # fmt: skip
    """The finding that a number of a trial is beyond its limit, with its words and the first cause
    to look at."""
    side = "above" if value > limit else "below"
    evidence = Beyond(column, value, limit, side, name, rule=Rule(name, says=size))
    return Finding(name, "impedance", trial, grade, (evidence,), rule=Rule(name, remedy=remedy))


def disagreements(
    rows: Sequence[Row], needed: Mapping[str, float], doubtful: Collection[str] = ()
) -> list[Finding]:
    """Find the trials of a campaign that do not agree.

    Parameters
    ----------
    rows : Sequence of Row
        One per trial, with K, B, I and the ends of their intervals.
    needed : Mapping of str to float
        The change of K, B and I that matters, as a share of itself.
    doubtful : Collection of str
        Trials that are doubtful by themselves.

    Returns
    -------
    list of Finding
        Of each trial one on its repeats, else on its arm, and one on a common factor.
    """
    off_line: dict[str, Finding] = {}
    scatter_about_line: dict[str, float] = {}
    factors: list[Finding] = []
    for arm in grouped(rows, ARM):
        scatter, off = beside_line(arm)
        off_line |= {found.subject: found for found in off}
        scatter_about_line |= dict.fromkeys((row["trial"] for row in arm), scatter)
        factors += common_factor(arm)
    told = dict(off_line)
    conditions = grouped(rows, CONDITION)
    for symbol in ("I", "B", "K"):  # of one trial the last is told
        allowed = scatter_about_line if symbol == "K" else {}
        of_symbol = differing_repeats(conditions, symbol, needed[symbol], doubtful, allowed)
        for condition in of_symbol:
            meant = [found for found in condition if found.subject in off_line]
            told |= {found.subject: found for found in meant or condition}
    return [*told.values(), *factors]


def grouped(rows: Iterable[Row], columns: Sequence[str]) -> list[list[Row]]:
    """The rows with K and a stated K_d, by those that agree in these columns."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        if row.get("K_d") and row.get("K"):
            groups.setdefault(tuple(map(row.get, columns)), []).append(row)
    return list(groups.values())


def numbers(rows: Iterable[Row], column: str) -> Array:
    """A column of the rows (n,); NaN where it is empty."""
    return np.array([row.get(column) for row in rows], dtype=float)


def differing_repeats(
    conditions: Iterable[Sequence[Row]],
    symbol: str,
    needed: float,
    doubtful: Collection[str],
    scatter_about_line: Mapping[str, float],
) -> Iterator[list[Finding]]:
    """The repeats of each condition that are farther from their median than is needed, than other
    repeats of the campaign scatter, and than their intervals; of two, both.

    Two must differ by more than the trials of their arm scatter about its line, too. A doubtful
    trial beside clear ones need not differ by more than others do.
    """
    repeated = [
        rows for rows in conditions if len(rows) > 1 and np.isfinite(numbers(rows, symbol)).all()
    ]
    all_values = [numbers(rows, symbol) for rows in repeated]
    sizes = [math.hypot(np.median(values), SMALL[symbol]) for values in all_values]
    usual = UNKNOWN_SCATTER * needed
    if len(repeated) >= FEWEST_SCATTERS:
        scatters = [
            np.std(values, ddof=1) / size for values, size in zip(all_values, sizes, strict=True)
        ]
        usual = MOST_SCATTERS * float(np.median(scatters))
    for rows, values, size in zip(repeated, all_values, sizes, strict=True):
        away = values - np.median(values)
        halves = np.nan_to_num(numbers(rows, f"{symbol}_high") - numbers(rows, f"{symbol}_low")) / 2
        own = MOST_HALF_WIDTHS * np.hypot(halves, np.median(halves))
        are_doubtful = np.array([row["trial"] in doubtful for row in rows])
        shares = np.where(are_doubtful & ~are_doubtful.all(), needed, max(needed, usual))
        if len(rows) == 2:
            of_arm = MOST_DEVIATIONS * scatter_about_line.get(rows[0]["trial"], 0.0)
            away, shares = 2 * away, np.maximum(OF_PAIR * shares, of_arm)
        limits = np.maximum(shares * size, own)
        texts = ", ".join(with_places(places_of(size, 3), *values))
        yield [
            finding_on(
                name="repeats_disagree",
                trial=rows[i]["trial"],
                column=symbol,
                value=float(values[i]),
                limit=float(values[i] - away[i] + math.copysign(limits[i], away[i])),
                size=f"{symbol} {texts} of {condition_text(rows[i])}: {rows[i]['trial']}",
                remedy=first_cause(rows, i, symbol),
            )
            for i in map(int, np.flatnonzero(np.abs(away) > limits))
        ]


FIRST_CAUSES = {
    "K": "is K_d right in the sheet?",
    "B": "was the joint as warm, and is B_d right in the sheet?",
    "I": "was the same clamp or weight on it?",
}
"""What to look at first where one estimate differs."""


def first_cause(rows: Sequence[Row], i: int, symbol: str) -> str:
    """What to look at first: a gain where K and B of the i-th trial differ by one factor."""
    of_K, of_B = (numbers(rows, name)[i] / np.median(numbers(rows, name)) for name in ("K", "B"))
    if symbol == "K" and abs(of_K / of_B - 1) < SAME_FACTOR:
        return f"is the torque's gain or unit right: K and B are {of_K:.3g} times the others?"
    return FIRST_CAUSES[symbol]


def beside_line(arm: Sequence[Row]) -> tuple[float, list[Finding]]:
    """How the trials of an arm scatter about its line, as a median deviation, and the one whose K
    is farthest from what the others, as a spring K_d in series with another one, let expect."""
    used = [row for row in arm if stiffness(row) > 0]
    if len(used) < FEWEST_OF_ARM:
        return 0.0, []
    K_d, K = numbers(used, "K_d"), np.array([stiffness(row) for row in used])
    expected, scatters = np.transpose([by_others(K_d, K, i) for i in range(len(K))])
    halves = np.nan_to_num(numbers(used, "K_high") - numbers(used, "K_low")) / 2 / K
    limits = np.maximum(
        np.maximum(NEEDED_OF_ARM, MOST_DEVIATIONS * scatters), MOST_HALF_WIDTHS * halves
    )
    away = K / expected - 1
    i = int(np.argmax(np.where(np.abs(away) > limits, np.abs(away), 0)))
    found = finding_on(
        name="unlike_its_arm",
        trial=used[i]["trial"],
        column="K",
        value=float(K[i]),
        limit=float(expected[i] * (1 + math.copysign(limits[i], away[i]))),
        size=f"K {significant(K[i], 3)} of {condition_text(used[i])}, where the other trials let"
        f" expect {significant(expected[i], 3)} N*m/rad",
        remedy=FIRST_CAUSES["K"],
    )
    return float(np.median(scatters)), [found] * bool(abs(away[i]) > limits[i])


def stiffness(row: Row) -> float:
    """K of a trial [N*m/rad], without friction where that is told."""
    return float(row.get("K_without_friction") or row["K"])


def by_others(K_d: Array, K: Array, i: int) -> tuple[float, float]:
    """K [N*m/rad] that the other trials let expect of the i-th, and the median deviation by which
    they are beside their line themselves, as a share.

    The line 1/K = a/K_d + c has the median of all slopes (Theil, 1950; Sen, 1968); of two
    conditions, or with a negative c, it goes through 0.
    """
    x, y = 1 / np.delete(K_d, i), 1 / np.delete(K, i)
    a, c = np.median(y / x), 0.0
    first, second = np.nonzero(x[:, None] < x)
    if len(np.unique(x)) > 2:
        slope = np.median((y[second] - y[first]) / (x[second] - x[first]))
        compliance = np.median(y - slope * x)
        if compliance > 0:
            a, c = slope, compliance
    return 1 / (a / K_d[i] + c), float(np.median(np.abs((a * x + c) / y - 1)))


def common_factor(arm: Sequence[Row]) -> Iterator[Finding]:
    """The factor that K/K_d and B/B_d of an arm share: a gain or a unit of the torque."""
    used = [row for row in arm if row.get("B_d") and row.get("B")]
    if len(used) < FEWEST_OF_ARM:
        return
    of_K = numbers(used, "K") / numbers(used, "K_d")
    of_B = np.array([row.get("B_viscous") or row["B"] for row in used]) / numbers(used, "B_d")
    factor, factor_of_B = float(np.median(of_K)), float(np.median(of_B))
    spread = np.median(np.abs(of_K / factor - 1))
    is_common = abs(factor_of_B / factor - 1) < SAME_FACTOR and spread < MOST_SPREAD
    if not is_common or abs(factor - 1) < OF_GAINS:
        return
    is_possible_gain = 1 / CERTAIN_FACTOR < factor < CERTAIN_FACTOR
    units = factors_near(factor, ["torque"], GAIN_BESIDE_UNIT)
    fitting = "; units that fit: " * bool(units) + "; ".join(units)
    for row in used:
        yield finding_on(
            name="common_factor",
            trial=row["trial"],
            column="K",
            value=row["K"],
            limit=row["K_d"] * (1 + math.copysign(OF_GAINS, factor - 1)),
            size=f"K is {factor:.3g} times K_d, and B {factor_of_B:.3g} times B_d{fitting}",
            remedy="is the torque's gain or unit right, or the motor's torque constant?",
            grade=Grade.NOTES if is_possible_gain else Grade.DOUBTS,
        )


def condition_text(row: Row) -> str:
    """The condition of a trial."""
    return ", ".join(f"{name} {row[name]}" for name in CONDITION[2:5] if row.get(name) is not None)
