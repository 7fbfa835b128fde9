# SPDX-License-Identifier: Apache-2.0
"""Prior weights of the inference, fitted on one half of the recordings of `causes.py` and reported
on the other.

Run from the repository: `python benchmarks/weights.py`. Each recording without stated gains is
fitted once, and its candidate models' predictions are weighed by each set of numbers of a grid, in
a quarter of an hour on one core. A half has every second motion of each cause
and size. The best set names most causes rightly, less `COST` for each sound recording that it
accuses; of equal ones it is the set nearest to the present.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import causes
import numpy as np
import planted

from osl_analysis.bench.budgets import ERROR_SOURCES, PROPERTIES
from osl_analysis.inference import weighing
from osl_analysis.inference.candidate_models import EQ_15, ModelAtValue
from osl_analysis.inference.weighing import Predicted
from osl_analysis.judge.known_findings import FINDINGS
from osl_analysis.stats.budget import DOUBT, FLOOR

NAMES = ("PRIOR_SOUND", "PRIOR_FRICTION", "INEXACTNESS")
GRID = ((0.9, 0.95, 0.98, 0.995), (0.2, 0.5, 0.8), (0.1, 0.2, 0.3))
COST = 10  # causes rightly named, which one accused sound recording outweighs
PRESENT = tuple(getattr(weighing, name) for name in NAMES)


@dataclass(frozen=True)
class Weighed:
    """What the inference weighs of a recording; nothing where it refuses or only one may be."""

    cause: str
    half: int
    fits: Sequence[Predicted]
    freedom: float


def predictions_of(cause: planted.Cause, size: float, motion: str, seed: int) -> Any:
    """The arguments of `weigh` in the fit of a recording; None if it weighs nothing."""
    with mock.patch.object(weighing, "weigh", wraps=weighing.weigh) as weigh:
        causes.fitted(cause, size, motion, seed, False)
    return weigh.call_args and weigh.call_args.args


def without_signals(fit: Predicted) -> Predicted:
    """A prediction without the columns of its candidate, of which each has megabytes."""
    return replace(fit, candidate=ModelAtValue(fit.model, np.empty((3, 0)), np.empty(0)))


def recordings() -> Iterator[Weighed]:
    """What is weighed of each recording, half by half."""
    sizes = ("–", *causes.SIZES)
    for cause in (*planted.SOUND, *planted.CAUSES):
        for place, motion in enumerate(cause.motions):
            for large in (True, False):
                for at, size, seed, gains in causes.cases(cause, motion, False, large):
                    found = None if gains else predictions_of(cause, size, motion, seed)
                    if found is not None and at != "1":
                        fits, freedom = found
                        half = (place + sizes.index(at) + seed) % 2
                        slim = [without_signals(fit) for fit in fits]
                        yield Weighed(cause.name, half, slim, freedom)


def named(recording: Weighed) -> str | None:
    """The finding of the source that is named, by the accuracies that the configuration states."""
    weighed, best_sound = weighing.weigh(recording.fits, recording.freedom)
    sound_with = {fit.has_friction: fit for fit in recording.fits if fit.model is EQ_15}
    needed = np.hypot(best_sound.impedance, [*FLOOR.values()]) * [*causes.ACCURACY.values()]
    of_sources: dict[str, float] = {}
    for fit, weight in weighed:
        change = np.abs(fit.impedances - sound_with[fit.has_friction].impedance).max(axis=0)
        if fit.model is not EQ_15 and fit.model.name not in PROPERTIES and np.any(change > needed):
            source = ERROR_SOURCES[fit.model.family]
            of_sources[source] = of_sources.get(source, 0.0) + weight
    if sum(of_sources.values()) <= DOUBT:
        return None
    return FINDINGS[max(of_sources, key=lambda name: of_sources[name])].title


def counts(found: Sequence[Weighed], numbers: Sequence[float]) -> tuple[int, int]:
    """How many sound recordings are accused, and how many causes are rightly named, by numbers."""
    right = {cause.name: cause.right for cause in (*planted.SOUND, *planted.CAUSES)}
    sound = {cause.name for cause in planted.SOUND}
    with mock.patch.multiple(weighing, **dict(zip(NAMES, numbers, strict=True))):
        verdicts = [(recording.cause, named(recording)) for recording in found]
    accused = sum(cause in sound and name is not None for cause, name in verdicts)
    return accused, sum(name in right[cause] for cause, name in verdicts)


def distance(numbers: Sequence[float]) -> float:
    """Of log odds from the present numbers."""
    steps = [
        math.log(x / (1 - x)) - math.log(y / (1 - y)) for x, y in zip(numbers, PRESENT, strict=True)
    ]
    return math.hypot(*steps)


def main() -> None:
    every = list(recordings())
    header = ("fitted on", *NAMES, "its accused, right, n", "other half's", "now there")
    lines = []
    for half in (0, 1):
        own, other = ([one for one in every if one.half == side] for side in (half, 1 - half))
        of_sets = {numbers: counts(own, numbers) for numbers in itertools.product(*GRID)}
        best = min(of_sets, key=lambda x: (COST * of_sets[x][0] - of_sets[x][1], distance(x)))
        results = [of_sets[best], counts(other, best), counts(other, PRESENT)]
        sizes = (len(own), len(other), len(other))
        cells = [f"{a}, {right}, {n}" for (a, right), n in zip(results, sizes, strict=True)]
        lines.append((f"half {half + 1}", *best, *cells))
    print(causes.markdown(header, lines))


if __name__ == "__main__":
    main()
