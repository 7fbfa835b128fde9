"""How K, B and I change with the amplitude (`impedance.difference_of`)."""

import numpy as np
import pytest
from bench_synthetic import FIVE, stepped_sine
from scipy import stats

from osl_analysis.bench.evidence import difference_of
from osl_analysis.bench.impedance import rendered_impedance


def faster_is_stiffer(motion):
    """A spring that is stiffer in faster motion, which Eq. 15 misses at each frequency in its own
    way."""
    return (200 + 20 * np.abs(motion.omega)) * motion.theta + 4 * motion.omega


def stiffness_without(record, label, left_out_hz):
    """K of an amplitude by NumPy's least squares, without the rows of one frequency."""
    groups = record.groups
    hz = np.array([stratum.frequency_hz for stratum in groups.strata])[groups.stratum]
    is_kept = groups.of(label) & (np.abs(hz - left_out_hz) > 0.1)
    edges = np.rint([groups.first, groups.stop]).astype(int).T[is_kept]
    rows = np.concatenate([np.arange(first, stop) for first, stop in edges])
    motion = record.motion
    columns = [motion.theta, motion.omega, motion.alpha, np.ones_like(motion.theta), record.time]
    X = np.stack(columns, axis=1)[rows]
    return np.linalg.lstsq(X, record.filtered_torque[rows])[0][0]


def fitted(record):
    """Eq. 15, and the labels of the smallest and the largest amplitude."""
    analysis = rendered_impedance(record)
    return analysis, *sorted(label for label in analysis.fits if label is not None)


def test_the_interval_of_a_change_is_the_jackknife_over_frequencies():
    record = stepped_sine(faster_is_stiffer, protocol=FIVE)
    analysis, smallest, largest = fitted(record)

    change = difference_of(analysis, smallest, largest)

    half_width = change.interval("K")[1] - change["K"]

    differences = [
        stiffness_without(record, largest, hz) - stiffness_without(record, smallest, hz)
        for hz in FIVE.frequencies_hz
    ]
    m = len(differences)
    se = np.sqrt((m - 1) / m * np.sum((differences - np.mean(differences)) ** 2))
    assert half_width == pytest.approx(stats.t.ppf(0.975, m - 1) * se, rel=0.03)


def test_what_is_noise_alone_has_the_freedom_of_cycles_and_frequencies():
    """Where noise and misfit are one variance, as of B here, their freedoms are added. By hand:
    six cycles at each of five frequencies have that of 25 differences at most, five units 4."""
    record = stepped_sine(
        lambda motion: 200 * motion.theta + 4 * motion.omega, noise=1.0, protocol=FIVE
    )
    analysis, smallest, largest = fitted(record)

    freedom = difference_of(analysis, smallest, largest).freedom("B")

    of_noise = min(analysis.fits[label].repeat_freedom[1] for label in (smallest, largest))
    assert 15 < of_noise <= 25
    assert freedom == pytest.approx(of_noise + 4)
