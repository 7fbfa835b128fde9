"""The tables of docs/design_of_experiments.md: achieved over predicted standard deviation of K, B and I.

    python benchmarks/design.py study [trials]          stepped sine: trials of the Monte Carlo study
    python benchmarks/design.py multisine [trials]      odd multisine: exact joint, Coulomb friction, drivetrain

The study simulates its trials, brings them on a time base, finds their protocol, filters and fits them; it knows
nothing of the prediction. Trials of a multisine are simulated in memory and fitted by `spectral.response`.
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.campaign.configuration import Config, read_config
from osl_analysis.commands.study import study_inputs
from osl_analysis.model.compensator import compensated_gains
from osl_analysis.signals import LowPass
from osl_analysis.simulator.bench import drivetrain_effects
from osl_analysis.simulator.drivetrain import simulate_drivetrain
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.spectral.periods import Realisation, period_spectra
from osl_analysis.spectral.response import SecondOrder, fit_by_power, lines_of_periods, periodic_response
from osl_analysis.study import bench as study_bench
from osl_analysis.study.bench import StudyInputs
from osl_analysis.study.precision import (
    KBI,
    Distortion,
    PeriodicMultisine,
    Sensors,
    SteppedSine,
    precision,
)
from osl_analysis.trial import Array

STUDIED = ("second order", "second order, 250 Hz", "second order, 14 bits", "linear drivetrain", "drivetrain")
RATE_HZ = 1000.0
JOINT = np.array([300.0, 5.0, 0.02])
PLAN = PeriodicMultisine(8.0, (0.5, 6.0), float(np.deg2rad(2)), 4, 4)
SENSORS = Sensors(RATE_HZ, 0.05)
EARLIER = 16
"""Realisations of the other trial, whose distortion is stated."""
Torque = Callable[[JointMotion], Array]


def inputs_of(config: Config) -> StudyInputs:
    """What the study's batches get from the configuration."""
    return study_inputs(config.study, config.dynamometer, config.actuator, config.walking, config.sources)


def studied(experiment: str, inputs: StudyInputs, trials: int) -> Iterator[str]:
    """Rows of a table: an experiment of the study."""
    study, effects, bench = inputs.study, inputs.simulation.effects, inputs.analysis["dynamometer"]
    names = [f"{experiment}_{k:05d}" for k in range(trials)]
    rows = study_bench.study_rows(study_bench.studied(experiment, inputs), names)
    found = pl.DataFrame(rows, infer_schema_length=None)
    found = found.filter(pl.col("estimator") == "filtered")
    cycles = (float(study.cycles),) * len(bench.frequencies_hz)
    amplitudes = tuple(np.deg2rad(study.amplitudes_deg).tolist())
    sensors = Sensors(
        250.0 if "250 Hz" in experiment else RATE_HZ,
        effects.load_cell_noise.value,
        torque_step=effects.load_cell_quantisation.value,
        encoder_step=2 * np.pi / 2**14 if "14 bits" in experiment else effects.joint_encoder.value,
        drift=effects.load_cell_drift.value / 60,
    )
    plan = SteppedSine(amplitudes, bench.frequencies_hz, cycles, bench.settle_cycles)
    predicted = precision(plan, JOINT, sensors, bench.low_pass).columns["se"]
    for name, expected in zip(KBI, predicted, strict=True):
        row = found.filter(pl.col("quantity") == name)
        yield line(experiment, name, float(expected), (row["value"] - row["truth"]).to_numpy())


def line(label: str, name: str, predicted: float, errors: Array) -> str:
    """A row of a table, from the errors (n,) of as many trials, whose ratio has a standard error of its own."""
    ratio = float(np.std(errors, ddof=1)) / predicted
    return f"| {label} | {name} | {predicted:.3g} | {ratio:.2f} ± {ratio / np.sqrt(2 * len(errors)):.2f} |"


def multisine_trials(torque_of: Torque, trials: int, first: int) -> Array:
    """Estimates (trials, 3) of trials whose realisations all differ, numbered from `first`."""
    rng, low_pass, found = np.random.default_rng(first), LowPass(15.0, 4), []
    for trial in range(trials):
        numbers = range(first + trial * PLAN.realisations, first + (trial + 1) * PLAN.realisations)
        lines = lines_of_periods([realisation(number, torque_of, rng) for number in numbers], low_pass)
        fit = fit_by_power(SecondOrder(), lines, (300.0, 5.0))
        found.append([fit[name] for name in KBI])
    return np.array(found)


def realisation(number: int, torque_of: Torque, rng: np.random.Generator) -> Realisation:
    """One realisation, after a transient period, read by a noisy load cell."""
    motion, samples = PLAN.motion(number), round(PLAN.period_s * RATE_HZ)
    n = samples * (PLAN.periods + 1) + 1
    period = np.arange(samples) / RATE_HZ
    moved = JointMotion(*(np.resize(motion.angle(period, k), n) for k in range(3)))
    torque = torque_of(moved) + SENSORS.torque_noise * rng.standard_normal(n)
    lines = int(3 * PLAN.period_s * PLAN.band_hz[1])
    theta, tau = (period_spectra(y, float(samples), float(samples), PLAN.periods, lines) for y in (moved.theta, torque))
    return Realisation(PLAN.period_s, RATE_HZ, np.array([theta, tau]), 0.0)


def exact(m: JointMotion) -> Array:
    """Eq. 15."""
    return np.asarray(JOINT @ [m.theta, m.omega, m.alpha])


def rubbing(friction: float) -> Torque:
    """The exact joint with Coulomb friction [N*m]."""
    return lambda m: exact(m) + friction * np.sign(m.omega)


def seen_before(torque_of: Torque) -> dict[str, Distortion]:
    """What another trial, of `EARLIER` realisations, showed of the distortion, in words."""
    rng = np.random.default_rng(7)
    earlier = [realisation(100_000 + r, torque_of, rng) for r in range(EARLIER)]
    response, _ = periodic_response(earlier)
    frequency, angle = response["frequency_hz"], np.deg2rad(response["angle_deg"])
    density = (frequency, 0.5 * (response["odd_level"] * angle) ** 2 / float(np.min(np.diff(frequency))))
    return {"no distortion stated": Distortion(), "level of another trial": Distortion(earlier=density)}


def multisines(inputs: StudyInputs, trials: int) -> Iterator[str]:
    """Rows of the table of multisines: friction is stated, or another trial showed the level."""
    low_pass = LowPass(15.0, 4)
    for friction in (0.0, 0.02, 0.5):
        found = multisine_trials(rubbing(friction), trials, 1)
        predicted = precision(PLAN, JOINT, SENSORS, low_pass, Distortion(coulomb=friction)).columns["se"]
        for k, name in enumerate(KBI):
            yield line(f"exact joint, friction {friction:g} N·m stated", name, predicted[k], found[:, k])
    gains = compensated_gains(inputs.study.K_d, inputs.study.B_d, inputs.p)
    effects = drivetrain_effects(inputs.simulation, gains)
    commands = np.array([[gains.K_1], [gains.B_1], [0.0]])

    def drivetrain(m: JointMotion) -> Array:
        leg = simulate_drivetrain(RATE_HZ, m.theta, m.omega, commands, effects, inputs.p)
        return leg["belt_torque"] + inputs.p.B_j * m.omega + inputs.p.J_j * m.alpha

    found = multisine_trials(drivetrain, trials, 1)
    for words, stated in seen_before(drivetrain).items():
        predicted = precision(PLAN, JOINT, SENSORS, low_pass, stated).columns["se"]
        for k, name in enumerate(KBI):
            yield line(f"drivetrain, {words}", name, predicted[k], found[:, k])


if __name__ == "__main__":
    number = int(sys.argv[2]) if len(sys.argv) > 2 else 60
    given = inputs_of(read_config(Path("config/config.yaml")))
    print("| trials | | predicted SD | achieved over predicted |\n|---|---|---|---|")
    if sys.argv[1] == "multisine":
        for text in multisines(given, number):
            print(text, flush=True)
    else:
        for one in STUDIED:
            for text in studied(one, given, number):
                print(text, flush=True)
