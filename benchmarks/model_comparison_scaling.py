"""Time of the comparison of belt models over many trials, beside refitting to all others for every trial.

Run from the repository: `python benchmarks/model_comparison_scaling.py`. The trials are synthetic load-unload cycles of
10 s. Times are those of the processor, on one thread. The exponent is that of the time between two numbers of trials.
"""

import os
import time
from collections.abc import Callable
from itertools import pairwise

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS"), "1")

import numpy as np

from osl_analysis.bench.linear_rivals import BELT_MODELS, Fold, belt_fold, fit_folds, fold_residual, held_out_residuals
from osl_analysis.bench.model_comparison import comparison_summary, scores_by_trial
from osl_analysis.figures import model_comparison

TRIALS = (10, 30, 100, 300, 1000)
MOST_REFITTED = 30
"""Largest number of trials for which the alternative is not too slow."""


def cycle(number: int) -> Fold:
    """A belt that is loaded and unloaded once, with hysteresis, stiffening and noise, at 1 kHz."""
    rng = np.random.default_rng(number)
    x = 0.09 * (1 - np.abs(np.linspace(-1, 1, 10_000)))
    side = np.where(np.arange(x.size) < x.size // 2, 1.0, -1.0)
    torque = rng.normal(300, 3) * x + 100 * x**2 + 0.25 * side + rng.normal(0, 0.05, x.size)
    return belt_fold(x, torque)


def refitted(folds: list[Fold]) -> list[list[np.ndarray]]:
    """The alternative: every model fitted anew to all other trials."""
    return [
        [fold_residual(f, fit_folds([other for other in folds if other is not f], terms)) for f in folds]
        for terms in BELT_MODELS.values()
    ]


def seconds(run: Callable[[], object]) -> float:
    """Processor time [s] of one call."""
    start = time.process_time()
    run()
    return time.process_time() - start


def main() -> None:
    """Print times, exponents, and how far the two ways differ."""
    rows: list[tuple[int, float, float, float, float | None]] = []
    for count in TRIALS:
        folds = {f"belt_{k}": cycle(k) for k in range(count)}
        once = [held_out_residuals(list(folds.values()), terms) for terms in BELT_MODELS.values()]
        left_out = seconds(lambda f=folds: [held_out_residuals(list(f.values()), t) for t in BELT_MODELS.values()])
        whole = seconds(lambda f=folds: scores_by_trial("belt", f, BELT_MODELS))
        scores = scores_by_trial("belt", folds, BELT_MODELS)
        drawn = seconds(lambda s=scores: model_comparison.draw(model_comparison.points(s)) and comparison_summary(s))
        again = seconds(lambda f=folds: refitted(list(f.values()))) if count <= MOST_REFITTED else None
        if count == MOST_REFITTED:
            pairs = zip(once, refitted(list(folds.values())), strict=True)
            apart = max(float(np.max(np.abs(a - b))) for one, two in pairs for a, b in zip(one, two, strict=True))
        rows.append((count, left_out, whole, drawn, again))
    print("trials   left-out fits   all scores   summary and figure   refitting to all others")
    for count, left_out, whole, drawn, again in rows:
        print(f"{count:6}{left_out:14.3f} s{whole:11.2f} s{drawn:19.2f} s" + (f"{again:22.2f} s" if again else ""))
    for (n, *one), (m, *two) in pairwise(rows):
        powers = [np.log(b / a) / np.log(m / n) for a, b in zip(one, two, strict=True) if a and b]
        print(f"exponents from {n} to {m}: " + ", ".join(f"{power:.2f}" for power in powers))
    print(f"largest difference of a held-out residual at {MOST_REFITTED} trials: {apart:.1e} N*m")


if __name__ == "__main__":
    main()
