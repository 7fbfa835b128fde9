# SPDX-License-Identifier: Apache-2.0
"""What a 95 % interval promises, by the method that made it (`interval_method` of a result table).

One interval makes one promise: whoever prints an interval looks its promise up here.
"""

from collections.abc import Iterable, Mapping

REPEATS = "repeats"
BLOCKS = "blocks"
CYCLES = "cycles"
BETWEEN_TRIALS = "between trials"

PROMISES: Mapping[str, str] = {
    REPEATS: "the same motion, started alike, again",
    BLOCKS: "noise and misfit of this recording; usually wider than repeats, and no bound",
    CYCLES: "further cycles of this recording",
    BETWEEN_TRIALS: "the mean over n trials, by the scatter between them",
}
"""What an interval holds in 95 % of cases, by its method."""
RANGE_PROMISE = "over amplitudes and parts of the band; it holds two other motions of three"
"""What a range of K, B or I is, from the lowest to the highest estimate."""


def promise_texts(methods: Iterable[str | None]) -> list[str]:
    """The promise of each method that is among some, as `repeats: the same motion, …`."""
    present = set(methods)
    return [f"{method}: {promise}" for method, promise in PROMISES.items() if method in present]
