"""The tables of docs/design_of_experiments.md: achieved over predicted standard deviation of K, B
and I.

    python benchmarks/design.py study [trials]          stepped sine: trials of the Monte Carlo
    study python benchmarks/design.py multisine [trials]      odd multisine: exact joint, Coulomb
    friction

The study simulates its trials, brings them on a time base, finds their protocol, filters and fits
them; it knows nothing of the prediction. Trials of a multisine are simulated in memory and fitted
to the lines of their periods.
"""

import sys
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import polars as pl
import study

from osl_analysis.bench.precision import (
    KBI,
    Distortion,
    PeriodicMultisine,
    Sensors,
    SteppedSine,
    precision,
)
from osl_analysis.signals import LowPass
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.spectral.periods import Realisation, lines_of, period_spectra
from osl_analysis.trial import Array

STUDIED = ("second order", "second order, 250 Hz", "second order, 14 bits", "drivetrain")
RATE_HZ = 1000.0
JOINT = np.array([300.0, 5.0, 0.02])
PLAN = PeriodicMultisine(8.0, (0.5, 6.0), float(np.deg2rad(2)), 4, 4)
SENSORS = Sensors(RATE_HZ, 0.05)
Torque = Callable[[JointMotion], Array]


def studied(experiment: str, trials: int) -> Iterator[str]:
    """Rows of a table: an experiment of the study."""
    of, found = study.studied(experiment), pl.DataFrame(study.rows_of(experiment, range(trials)))
    effects, bench, rate_hz = of.simulation.effects, of.analysis, of.simulation.dynamometer.rate_hz
    sensors = Sensors(
        rate_hz,
        effects.load_cell_noise.value,
        torque_step=effects.load_cell_quantisation.value,
        encoder_step=effects.joint_encoder.value,
        drift=effects.load_cell_drift.value / 60,
    )
    amplitudes, cycles = (
        np.deg2rad(bench.amplitudes_deg).tolist(),
        (float(bench.cycles),) * len(bench.frequencies_hz),
    )
    plan = SteppedSine(tuple(amplitudes), bench.frequencies_hz, cycles, bench.settle_cycles)
    predicted = precision(plan, JOINT, sensors, bench.low_pass).columns["se"]
    for name, expected in zip(KBI, predicted, strict=True):
        row = found.filter(pl.col("quantity") == name)
        yield line(experiment, name, float(expected), (row["value"] - row["truth"]).to_numpy())


def line(label: str, name: str, predicted: float, errors: Array) -> str:
    """A row of a table, from the errors (n,) of as many trials, whose ratio has a standard error of
    its own."""
    ratio = float(np.std(errors, ddof=1)) / predicted
    return (
        f"| {label} | {name} | {predicted:.3g} | {ratio:.2f} ±"
        f" {ratio / np.sqrt(2 * len(errors)):.2f} |"
    )


def multisine_trials(torque_of: Torque, trials: int, first: int) -> Array:
    """Estimates (trials, 3) of trials whose realisations all differ, numbered from `first`."""
    rng, low_pass, found = np.random.default_rng(first), LowPass(15.0, 4), []
    for trial in range(trials):
        numbers = range(first + trial * PLAN.realisations, first + (trial + 1) * PLAN.realisations)
        made = [realisation(number, torque_of, rng) for number in numbers]
        found.append(fitted_lines(made, low_pass))
    return np.array(found)


def fitted_lines(made: Sequence[Realisation], low_pass: LowPass) -> Array:
    """K, B and I (3,) by least squares on the excited lines, which weigh by their power behind the
    filter."""
    frequency, excited = made[0].frequency_hz, lines_of(made).excited
    s, weight = 2j * np.pi * frequency[excited], low_pass.gain(frequency[excited])
    theta, torque = (
        weight * np.array([one.mean_lines[k][excited] for one in made]) for k in (0, 1)
    )
    X = np.array([(theta * s**power).ravel() for power in range(3)]).T
    rows, y = (
        np.vstack([X.real, X.imag]),
        np.concatenate([torque.ravel().real, torque.ravel().imag]),
    )
    return np.asarray(np.linalg.lstsq(rows, y, rcond=None)[0])


def realisation(number: int, torque_of: Torque, rng: np.random.Generator) -> Realisation:
    """One realisation, after a transient period, read by a noisy load cell."""
    motion, samples = PLAN.motion(number), round(PLAN.period_s * RATE_HZ)
    n = samples * (PLAN.periods + 1) + 1
    period = np.arange(samples) / RATE_HZ
    moved = JointMotion(*(np.resize(motion.angle(period, k), n) for k in range(3)))
    torque = torque_of(moved) + SENSORS.torque_noise * rng.standard_normal(n)
    lines = int(3 * PLAN.period_s * PLAN.band_hz[1])
    theta, tau = (
        period_spectra(y, float(samples), float(samples), PLAN.periods, lines)
        for y in (moved.theta, torque)
    )
    return Realisation(PLAN.period_s, np.array([theta, tau]), 0.0)


def exact(m: JointMotion) -> Array:
    """Eq. 15."""
    return np.asarray(JOINT @ [m.theta, m.omega, m.alpha])


def rubbing(friction: float) -> Torque:
    """The exact joint with Coulomb friction [N*m]."""
    return lambda m: exact(m) + friction * np.sign(m.omega)


def multisines(trials: int) -> Iterator[str]:
    """Rows of the table of multisines, whose friction is stated."""
    low_pass = LowPass(15.0, 4)
    for friction in (0.0, 0.02, 0.5):
        found = multisine_trials(rubbing(friction), trials, 1)
        predicted = precision(PLAN, JOINT, SENSORS, low_pass, Distortion(friction)).columns["se"]
        for k, name in enumerate(KBI):
            yield line(
                f"exact joint, friction {friction:g} N·m stated", name, predicted[k], found[:, k]
            )


if __name__ == "__main__":
    number = int(sys.argv[2]) if len(sys.argv) > 2 else 60
    print("| trials | | predicted SD | achieved over predicted |\n|---|---|---|---|")
    rows = (
        multisines(number)
        if sys.argv[1] == "multisine"
        else (r for one in STUDIED for r in studied(one, number))
    )
    for text in rows:
        print(text, flush=True)
