"""Periods, intervals, levels of distortion and false alarms of the frequency response, on joints that are known.

Run from the repository: `python benchmarks/spectral.py [seeds]` prints the tables of `docs/frequency_response.md`.
Forty seeds take two minutes. The same seeds give the same.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from osl_analysis.model.compensator import PAPER_WEIGHT, Controller, belt_response, select_gains
from osl_analysis.model.multisine import odd_multisine
from osl_analysis.model.parameters import read_parameters
from osl_analysis.signals import LowPass
from osl_analysis.spectral.periods import PeriodicMotion, Realisation, periodic_motion
from osl_analysis.spectral.response import (
    SecondOrder,
    fit_by_power,
    fit_structure,
    lines_of_periods,
    lines_of_record,
    periodic_response,
    record_spectrum,
)
from osl_analysis.trial import Array

RATE, PERIOD, BAND, LOW_PASS = 250.0, 8.0, (0.5, 6.0), LowPass(15)
K, B, I = 200.0, 4.0, 0.05
Signals = tuple[Array, Array]
P = read_parameters(Path(__file__).parents[1] / "config/parameters/default.yaml")
GAINS = select_gains("compensated", 300.0, 5.0, P, PAPER_WEIGHT)


def motion(seed: int, realisations: int, periods: int, rms_deg: float = 2.0, ppm: float = 30.0) -> Array:
    """theta, omega, alpha (3, n) of realisations one after another, each with a transient period that is ramped."""
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
    belt = belt_response(theta, RATE, Controller(GAINS, P, 0.1), P)
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


def coverage(name: str, make: Callable[[int], Signals], seeds: int, truth: Sequence[float] | None = None) -> None:
    """A row: spread of K, B and I, and how many intervals hold the truth, by default the mean of all estimates."""
    lines = (lines_of_periods(found(make(seed)).realisations, LOW_PASS) for seed in range(seeds))
    fits = [fit_by_power(SecondOrder(), one, (K, B)) for one in lines]
    estimates = np.array([fit.estimates[:3] for fit in fits])
    true = estimates.mean(axis=0) if truth is None else np.asarray(truth)
    inside = [[low <= x <= high for (low, high), x in zip(map(f.interval, "KBI"), true, strict=True)] for f in fits]
    spread = ", ".join(f"{100 * x:.2g}" for x in estimates.std(axis=0) / true)
    held = ", ".join(f"{100 * x:.0f}" for x in np.mean(inside, axis=0))
    print(f"| {name} | {fits[0].interval_method} | {spread} | {held} |")


def false_alarms(name: str, lines_of: Callable[[int], object], seeds: int) -> None:
    """A row: how often a second-order joint fails the test of Eq. 15."""
    p = [fit_structure(SecondOrder(), lines_of(seed), (K, B))[1]["misfit_p"] for seed in range(seeds)]  # type: ignore[arg-type]
    print(f"| {name} | {100 * np.mean(np.array(p) < 0.05):.1f} |")


def levels(seeds: int) -> None:
    """Rows: the odd level in decibel about that of all seeds together, from so many realisations."""
    every = [r for s in range(8) for r in found(with_friction(500 + s, 8, 2)).realisations]
    of_all = periodic_response(every)[1]
    for count in (1, 4, 8):
        made = [periodic_response(found(with_friction(seed, count, 2)).realisations)[1] for seed in range(seeds)]
        odd = 20 * np.log10([one["odd"] / of_all["odd"] for one in made])
        print(f"| {count} | {odd.mean():+.1f} ± {odd.std():.1f} |")
    beside = 20 * np.log10(of_all["detection"] / of_all["distortion"])
    even = 20 * np.log10(max(of_all["even"], 1e-9) / of_all["odd"])
    print(f"\nDetection lines over excited lines {beside:+.1f} dB, even over odd {even:+.0f} dB")


def periods(seeds: int) -> None:
    """Rows: the largest error of the period."""
    for bits in (18, 14):
        for ppm in (0.0, 100.0):
            true = PERIOD / (1 + 1e-6 * ppm)
            errors = [abs(found(exact(seed, 1, 4, bits, ppm)).period / true - 1) for seed in range(seeds)]
            print(f"| {bits} | {ppm:g} | {1e6 * max(errors):.2f} |")


def coarse(seed: int) -> list[Realisation]:
    """Periods whose rounding to 14 bits repeats."""
    made = found(exact(seed, 1, 4, 14, 0.0)).realisations
    return [replace(one, steps=(2 * np.pi / 2**14, None)) for one in made]


def noise_record(seed: int) -> Signals:
    """40 s of noise of 0.5 to 6 Hz, made as a multisine of a long period, and its torque."""
    rng, seconds = np.random.default_rng([seed, 2]), 40.0
    f = np.arange(60, 720) / 120.0
    w, size = 2 * np.pi * f, np.deg2rad(2) * rng.rayleigh(size=len(f)) / np.sqrt(len(f))
    turn = np.outer(np.arange(round(seconds * RATE)) / RATE, w) + rng.uniform(0, 2 * np.pi, len(f))
    theta, omega, alpha = np.cos(turn) @ size, -np.sin(turn) @ (size * w), -np.cos(turn) @ (size * w**2)
    return rounded(theta, 18, rng), K * theta + B * omega + I * alpha + 0.05 * rng.standard_normal(len(theta))


def main(seeds: int) -> None:
    """Print all tables."""
    print("| bits | mismatch of clocks, ppm | largest error, ppm |\n| --- | --- | --- |")
    periods(min(seeds, 20))
    print("\n| record | interval from | SD of K, B, I, % | held, % |\n| --- | --- | --- | --- |")
    truth = (K, B, I)
    coverage("exact joint, 1 realisation of 4 periods", lambda seed: exact(seed, 1, 4), seeds, truth)
    coverage("exact joint, 1 of 2", lambda seed: exact(seed, 1, 2), seeds, truth)
    coverage("exact joint, 4 of 2", lambda seed: exact(seed, 4, 2), seeds, truth)
    coverage("exact joint, 14 bits, clocks alike", lambda seed: exact(seed, 1, 4, 14, 0.0), seeds, truth)
    for count in (1, 2, 4, 8):
        coverage(f"drivetrain with friction, {count} of 2", lambda seed, n=count: with_friction(seed, n, 2), seeds)
    print("\n| realisations | odd level, dB |\n| --- | --- |")
    levels(min(seeds, 20))
    print("\n| record | false alarms, % |\n| --- | --- |")
    for count in (7, 4, 2):
        lines = lambda seed, n=count: lines_of_periods(found(exact(seed, 1, n)).realisations, LOW_PASS)  # noqa: E731
        false_alarms(f"{count} periods", lines, seeds)
    false_alarms("4 periods, 14 bits, clocks alike", lambda seed: lines_of_periods(coarse(seed), LOW_PASS), seeds)
    false_alarms(
        "40 s of noise, local polynomial",
        lambda seed: lines_of_record(record_spectrum(*noise_record(seed), RATE, LOW_PASS.cutoff_hz), LOW_PASS),
        seeds,
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
