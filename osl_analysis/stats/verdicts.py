"""Whether a number is what it should be: the verdict of an interval about a stated margin."""

import math


def equivalence(low: float | None, high: float | None, target: float, margin: float | None) -> str | None:
    """'equivalent', 'different' or 'undecided' that a number with this 95 % interval is target +- margin, all in one
    unit; None without an interval or margin.

    It is equivalent where the whole interval lies within target +- margin, different where the whole interval lies
    beyond it on one side, and else undecided. Two one-sided tests at 5 % ask for the 90 % interval alone (Schuirmann,
    J. Pharmacokinet. Biopharm. 15, 1987); the 95 % interval is conservative: each test is at 2.5 %."""
    if low is None or high is None or margin is None or not all(map(math.isfinite, (low, high, target, margin))):
        return None
    if target - margin <= low and high <= target + margin:
        return "equivalent"
    return "different" if high < target - margin or low > target + margin else "undecided"
