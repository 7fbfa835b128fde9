"""How long to record until the intervals are as narrow as asked: cycles, periods and realisations, or seconds."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from osl_analysis.design.information import NAMES, Joint
from osl_analysis.design.plan import LAST_CYCLES, Continuous, PeriodicMultisine, Plan, SteppedSine
from osl_analysis.design.precision import Precision
from osl_analysis.spectral.equation_error import ENOUGH_REALISATIONS
from osl_analysis.stats.covariance import FEWEST_CYCLES

MOST_CYCLES, MOST_REALISATIONS, LONGEST_S = 2000, 200, 7200
"""Largest numbers that are tried; more is no experiment."""
PERIODS = (2, 3, 4, 6, 8, 12)
"""Periods of a realisation that are tried."""
SHORTEST_S = 10
"""Shortest record [s] of a motion that does not repeat itself."""


def reached(found: Precision, joint: Joint, within: Mapping[str, float]) -> bool:
    """Whether the half widths are within these shares of K, B, I, as far as there are any."""
    return all(
        found.half_width[NAMES.index(name)] <= share * abs(float(joint.values[NAMES.index(name)]))
        for name, share in within.items()
    )


def long_enough(plan: Plan, enough: Callable[[Plan], bool]) -> Plan | None:
    """The shortest plan of the same kind that is `enough`; None if no length that is tried is.

    Of a multisine, periods and realisations are chosen together, with four realisations or more: their spread is the
    only interval that has the distortion as it is.
    """
    if isinstance(plan, SteppedSine):
        cycles = smallest(
            lambda n: enough(replace(plan, cycles=(float(n),) * len(plan.frequencies_hz))),
            plan.settle_cycles + LAST_CYCLES + FEWEST_CYCLES,
            MOST_CYCLES,
        )
        return None if cycles is None else replace(plan, cycles=(float(cycles),) * len(plan.frequencies_hz))
    if isinstance(plan, Continuous):
        seconds = smallest(lambda n: enough(replace(plan, duration_s=float(n))), SHORTEST_S, LONGEST_S)
        return None if seconds is None else replace(plan, duration_s=float(seconds))
    assert isinstance(plan, PeriodicMultisine)
    return shortest_multisine(plan, enough)


def longest(plan: Plan) -> Plan:
    """The longest plan of the same kind that `long_enough` tries."""
    if isinstance(plan, SteppedSine):
        return replace(plan, cycles=(float(MOST_CYCLES),) * len(plan.frequencies_hz))
    if isinstance(plan, Continuous):
        return replace(plan, duration_s=float(LONGEST_S))
    assert isinstance(plan, PeriodicMultisine)
    return replace(plan, periods=max(PERIODS), realisations=MOST_REALISATIONS)


def shortest_multisine(plan: PeriodicMultisine, enough: Callable[[Plan], bool]) -> PeriodicMultisine | None:
    """As `long_enough`, of a multisine."""
    best: PeriodicMultisine | None = None
    for periods in PERIODS:
        found = fewest_realisations(replace(plan, periods=periods), enough)
        if found is not None and (best is None or found.record_s < best.record_s):
            best = found
    return best


def fewest_realisations(plan: PeriodicMultisine, enough: Callable[[Plan], bool]) -> PeriodicMultisine | None:
    """The plan with the fewest realisations that are `enough`; None if no number is."""
    count = smallest(lambda n: enough(replace(plan, realisations=n)), ENOUGH_REALISATIONS, MOST_REALISATIONS)
    return None if count is None else replace(plan, realisations=count)


def smallest(enough: Callable[[int], bool], first: int, last: int) -> int | None:
    """The smallest number from `first` to `last` that is enough, where every larger one is; None if `last` is not."""
    if not enough(last):
        return None
    low, high = first - 1, last
    while high - low > 1:
        middle = int(np.clip(round(np.sqrt(max(low, 1) * high)), low + 1, high - 1))
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high
