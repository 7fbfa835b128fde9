"""Periods and levels of distortion of the frequency response, on joints that are known.

Run from the repository: `python benchmarks/spectral.py [seeds]` prints the tables of
`docs/frequency_response.md`. Forty seeds take two minutes. The same seeds give the same.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from osl_analysis.model.compensator import PAPER_WEIGHT, Controller, belt_responses, select_gains
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.model.multisine import odd_multisine
from osl_analysis.signals import LowPass
from osl_analysis.spectral.periods import PeriodicMotion, Realisation, periodic_motion
from osl_analysis.spectral.response import periodic_response
from osl_analysis.trial import Array

RATE, PERIOD, BAND, LOW_PASS = 250.0, 8.0, (0.5, 6.0), LowPass(15)
K, B, I = 200.0, 4.0, 0.05
Signals = tuple[Array, Array]
P = read_parameters(Path(__file__).parents[1] / "config/parameters/default.yaml")
GAINS = select_gains("compensated", 300.0, 5.0, P, PAPER_WEIGHT)


def motion(
    seed: int, realisations: int, periods: int, rms_deg: float = 2.0, ppm: float = 30.0
) -> Array:
    """theta, omega, alpha (3, n) of realisations one after another, each with a transient period
    that is ramped."""
    parts = []
    t = np.arange(round((periods + 1) * PERIOD * RATE)) / RATE * (1 + 1e-6 * ppm)
    for number in range(realisations):
        sine = odd_multisine(PERIOD, BAND, np.deg2rad(rms_deg), 7, 1000 * seed + number)
        parts.append(np.array([sine.angle(t, d) for d in range(3)]) * np.minimum(t, 1.0))
    return np.hstack(parts)


def exact(seed: int, realisations: int, periods: int, bits: int = 18, ppm: float = 30.0) -> Signals:
    """Angle of an encoder and torque, with 0.05 N*m of noise, of a second-order joint."""
    rng = np.random.default_rng([seed, 1])
    theta, omega, alpha = motion(seed, realisations, periods, ppm=ppm)
    noise = 0.05 * rng.standard_normal(len(theta))
    return rounded(theta, bits, rng), K * theta + B * omega + I * alpha + noise


def with_friction(seed: int, realisations: int, periods: int) -> Signals:
    """The same of the compensated drivetrain with its friction (K_d = 300, B_d = 5)."""
    rng = np.random.default_rng([seed, 1])
    theta, omega, alpha = motion(seed, realisations, periods)
    belt = belt_responses(theta, RATE, [(Controller(GAINS, P, 0.1), P)])[0]
    torque = belt + P.B_j * omega + P.J_j * alpha + 0.05 * rng.standard_normal(len(theta))
    return rounded(theta, 18, rng), torque


def rounded(theta: Array, bits: int, rng: np.random.Generator) -> Array:
    """The angle as an encoder of so many bits, with its zero anywhere, reads it."""
    step = 2 * np.pi / 2**bits
    return np.asarray(np.round(theta / step + rng.uniform()) * step)


def found(signals: Signals) -> PeriodicMotion:
    """The periods of a record."""
    periodic = periodic_motion(*signals, RATE, LOW_PASS.cutoff_hz)
    assert periodic is not None
    return periodic


def odd_level(realisations: Sequence[Realisation]) -> float:
    """RMS of the odd distortion over the lines [N*m/rad]."""
    return float(np.sqrt(np.mean(np.square(periodic_response(realisations)["odd_level"]))))


def levels(seeds: int) -> None:
    """Rows: the odd level in decibel about that of all seeds together, from so many
    realisations."""
    of_all = odd_level(
        [r for s in range(8) for r in found(with_friction(500 + s, 8, 2)).realisations]
    )
    for count in (1, 4, 8):
        made = [
            odd_level(found(with_friction(seed, count, 2)).realisations) for seed in range(seeds)
        ]
        odd = 20 * np.log10(np.array(made) / of_all)
        print(f"| {count} | {odd.mean():+.1f} ± {odd.std():.1f} |")


def periods(seeds: int) -> None:
    """Rows: the largest error of the period."""
    for bits in (18, 14):
        for ppm in (0.0, 100.0):
            true = PERIOD / (1 + 1e-6 * ppm)
            errors = [
                abs(found(exact(seed, 1, 4, bits, ppm)).period / true - 1) for seed in range(seeds)
            ]
            print(f"| {bits} | {ppm:g} | {1e6 * max(errors):.2f} |")


def main(seeds: int) -> None:
    """Print all tables."""
    print("| bits | mismatch of clocks, ppm | largest error, ppm |\n| --- | --- | --- |")
    periods(min(seeds, 20))
    print("\n| realisations | odd level, dB |\n| --- | --- |")
    levels(min(seeds, 20))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
