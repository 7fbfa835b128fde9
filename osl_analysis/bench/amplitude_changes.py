"""How K, B and I of a trial change with the amplitude of its sines."""

import numpy as np
import scipy

from osl_analysis.bench.analysis import LITTLE, Analysis
from osl_analysis.bench.record import Label
from osl_analysis.bench.regression import FEWEST_UNITS, combined, estimates_of
from osl_analysis.stats.table_rows import Row
from osl_analysis.trial import Array

CHANGING = ("K", "B")  # with the amplitude, by play, a stiffening spring or friction


def amplitudes_row(analysis: Analysis) -> Row:
    """Compare the fits to single amplitudes.

    A stiffening spring, or play, changes K with the amplitude; friction changes K and B. A change
    is reduced by the half-width of its 95 % interval, at most to 0: noise is no change. Its divisor
    has `LITTLE` added in quadrature.

    Parameters
    ----------
    analysis
        Eq. 15 of a trial, for each amplitude and for all.

    Returns
    -------
    dict
        The relative changes `K_change` and `B_change` from the smallest to the largest amplitude,
        and the lowest and the highest estimates; null for fewer than two amplitudes.
    """
    ends = [f"{name}_amplitudes_{end}" for name in CHANGING for end in ("low", "high")]
    row: Row = dict.fromkeys(("K_change", "B_change", *ends))
    labels = sorted(label for label in analysis.fits if isinstance(label, float))
    if len(labels) < 2:
        return row
    for name in CHANGING:
        of_single = [analysis.fits[label][name] for label in labels]
        row[f"{name}_amplitudes_low"] = min(of_single)
        row[f"{name}_amplitudes_high"] = max(of_single)

    smallest = labels[0]
    largest = labels[-1]
    half_widths = half_widths_of_differences(analysis, smallest, largest)
    for name in CHANGING:
        difference = analysis.fits[largest][name] - analysis.fits[smallest][name]
        half_width = float(half_widths[list(analysis.model).index(name)])
        certain = float(np.sign(difference)) * max(abs(difference) - half_width, 0.0)
        row[f"{name}_change"] = certain / float(np.hypot(analysis.whole[name], LITTLE[name]))
    return row


def half_widths_of_differences(analysis: Analysis, smallest: Label, largest: Label) -> Array:
    """Half-widths (p,) of the 95 % intervals of the differences between two amplitudes' estimates.

    If both amplitudes have the same frequencies, each frequency is left out of both in turn: what
    the model misses at both alike then is no error of the difference. Else their intervals are
    independent.
    """
    s = analysis.sums
    model = analysis.model
    small = analysis.fits[smallest]
    large = analysis.fits[largest]
    of_small = strata_by_frequency(analysis, smallest)
    of_large = strata_by_frequency(analysis, largest)
    are_paired = of_small.keys() == of_large.keys() and len(of_small) >= FEWEST_UNITS
    if not are_paired or small.repeat is None or large.repeat is None:
        half_widths = [
            [fit.interval(name)[1] - fit[name] for name in model] for fit in (small, large)
        ]
        return np.asarray(np.linalg.norm(half_widths, axis=0))

    at = s.index(list(model.values()))

    def without_stratum(label: Label, stratum: int) -> Array:
        kept = s.groups.of(label) & (s.groups.stratum != stratum)
        return estimates_of(s.over(kept), at, s.torque)

    differences = np.array(
        [
            without_stratum(largest, of_large[hz]) - without_stratum(smallest, stratum)
            for hz, stratum in of_small.items()
        ]
    )
    m = len(differences)
    apart = differences - np.mean(differences, axis=0)
    misfit = apart.T @ apart * (m - 1) / m
    noise = small.repeat + large.repeat
    never = np.full(len(model), np.inf)
    covariance, freedom = combined(noise, never, misfit, m)
    return np.asarray(scipy.special.stdtrit(freedom, 0.975) * np.sqrt(np.diag(covariance)))


def strata_by_frequency(analysis: Analysis, label: Label) -> dict[float, int]:
    """Number of each stratum of an amplitude, by its frequency to 0.1 Hz."""
    return {
        round(stratum.frequency_hz, 1): number
        for number, stratum in enumerate(analysis.sums.groups.strata)
        if stratum.label == label
    }
