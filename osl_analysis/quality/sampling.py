"""How regularly the channels of a trial were sampled."""

import numpy as np
import polars as pl

from osl_analysis.quality.finding import Finding, not_applicable, worst
from osl_analysis.trial import Array

GAP = 1.5  # median steps, beyond which a step is a gap and no jitter
TOO_FEW = "no channel has three samples"


def sampling_steps(samples: pl.DataFrame) -> dict[str, Array]:
    """Steps [s] of every way in which the trial was sampled, (n - 1,) each, by the first channel sampled so."""
    time, found, seen = samples["time"].to_numpy(), {}, set()
    for column in samples.columns:
        present = samples[column].is_not_null().to_numpy()
        if column == "time" or present.sum() < 3 or (pattern := present.tobytes()) in seen:
            continue
        seen.add(pattern)
        found[column] = np.diff(time[present])
    return found


def check_rate(steps: dict[str, Array]) -> Finding:
    """Lowest median rate [Hz]."""
    if not steps:
        return not_applicable(TOO_FEW)
    rates = {column: 1 / float(np.median(step)) for column, step in steps.items()}
    slowest = min(rates, key=lambda column: rates[column])
    others = ", ".join(f"{column} {rate:.6g} Hz" for column, rate in rates.items())
    return Finding(rates[slowest], others)


def check_jitter(steps: dict[str, Array]) -> Finding:
    """RMS deviation of the steps from their median [%]."""
    found = {}
    for column, step in steps.items():
        relative = step / np.median(step)
        regular = relative[relative < GAP]
        found[column] = 100 * float(np.sqrt(((regular - 1) ** 2).mean()))
    return worst(found, TOO_FEW)


def check_gap(steps: dict[str, Array]) -> Finding:
    """Longest step beyond the median one [s]; 0 where no sample is missing."""
    found = {}
    for column, step in steps.items():
        usual = float(np.median(step))
        found[column] = float(step.max()) - usual if step.max() > GAP * usual else 0.0
    return worst(found, TOO_FEW)
