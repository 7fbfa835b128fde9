"""Impedance from motions that are no stepped sine: bias, spread over the bound, coverage
(docs/any_excitation.md).

python benchmarks/any_excitation.py > page.md     tables of the page; about five minutes of one core

The exact joint is judged against its K, B and I, and the spread by the bound of Cramer and Rao for
the white noise of the torque in the whole motion. The drivetrain with friction has no K, B and I of
its own: it is judged against its best linear approximation under the same kind of motion, the mean
over all other trials.
"""

import sys
from copy import deepcopy
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.bench.effects import IMPEDANCE, plain_sums, with_effects
from osl_analysis.bench.gram import GroupFit
from osl_analysis.bench.record import record_of_trial
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.campaign.configuration import read_section
from osl_analysis.files import default_config
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.simulator.bench import simulate_bench_trial, true_signals
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.trial import Array, Trial
from osl_analysis.yaml_settings import read_mapping

ANALYSIS = read_section(default_config(), "dynamometer", DynamometerAnalysis)
SIMULATION = Path("config/simulation/excitations.yaml")
TRUE = {"K": 300.0, "B": 5.0, "I": 0.02}
EXACT, DRIVETRAIN, GROUP = 80, 20, 4
"""Trials of each motion with the exact joint and with the drivetrain, and trials whose mean is
taken."""
MOTIONS = {
    "multisine, 7 periods of 8 s": {"kind": "multisine", "periods": 7},
    "sweep, 56 s": {"kind": "chirp", "duration_s": 56},
    "noise, 56 s": {"kind": "noise", "duration_s": 56},
    "smoothed binary sequence, 56 s": {"kind": "prbs", "smoothing_hz": 8, "duration_s": 56},
}


def settings_of(
    motion: dict, exact: bool, bits: int = 18, noise: float = 0.05
) -> SimulationSettings:
    """The shipped simulation with one motion of many trials, an encoder of some bits and torque
    noise [N*m]."""
    content = deepcopy(read_mapping(SIMULATION))
    content["excitations"] = [{"name": "x", "rms_deg": 2, "trials": 1000} | motion]
    content["joint"] = TRUE if exact else None
    content["recorder"] = {}
    content["effects"]["joint_encoder"] = {
        "enabled": True,
        "size": 2 * np.pi / 2**bits,
        "unit": "rad",
    }
    content["effects"]["encoder_zero"] = {"enabled": True, "size": 1, "unit": "step"}
    content["effects"]["load_cell_noise"]["size"] = noise
    content["effects"]["load_cell_quantisation"]["enabled"] = False
    return SimulationSettings.model_validate(content)


def recorded(
    settings: SimulationSettings, number: int, controller: str = "compensated"
) -> tuple[Trial, Array]:
    """One trial, and the bound of K, B and I for it, (3,)."""
    p = read_parameters(settings.parameters)
    row = {
        "trial": f"t_x_{number + 1}",
        "experiment": "impedance",
        "controller": controller,
        "K_d": 300,
        "B_d": 5,
    }
    log, _ = simulate_bench_trial(row, settings, p)
    samples = {"time": log["time"], "theta": log["joint_angle"], "torque": -log["load_cell_torque"]}
    # the same on every bench
    motion, _ = true_signals(row | {"experiment": "transmission"}, settings, p)
    slope = np.linspace(-1, 1, len(motion.theta))
    X = np.column_stack([motion.theta, motion.omega, motion.alpha, np.ones_like(slope), slope])
    bound = settings.effects.load_cell_noise.size * np.sqrt(np.diag(np.linalg.inv(X.T @ X)))[:3]
    return Trial(row["trial"], pl.DataFrame(samples)), bound


def exact_row(label: str, settings: SimulationSettings) -> str:
    """Bias [%], RMS error over the bound, and coverage of K, B and I over the trials of one
    motion."""
    errors, bounds, inside, alone = [], [], [], []
    for number in range(EXACT):
        trial, bound = recorded(settings, number)
        fit = fit_of(trial)
        errors.append([fit[name] - true for name, true in TRUE.items()])
        bounds.append(bound)
        inside.append([covers(fit, name, true) for name, true in TRUE.items()])
        alone.append([repeats(fit, name, true) for name, true in TRUE.items()])
    error, size = np.array(errors), np.array(list(TRUE.values()))
    over = np.sqrt(np.mean(error**2, axis=0)) / np.mean(bounds, axis=0)
    bias, spread = 100 * error.mean(axis=0) / size, 100 * error.std(axis=0, ddof=1) / size
    cells = [listed(bias, ".4f"), listed(spread, ".4f"), listed(over, ".2f")]
    cells += [listed(100 * np.mean(each, axis=0), ".0f") for each in (inside, alone)]
    return f"| {label} | {' | '.join(cells)} |"


def fit_of(trial: Trial) -> GroupFit:
    """Eq. 15 of a trial."""
    return with_effects(plain_sums(record_of_trial(trial, ANALYSIS), IMPEDANCE), IMPEDANCE)


def covers(fit: GroupFit, name: str, true: float) -> bool:
    """Whether the interval of one estimate holds a value."""
    low, high = fit.interval(name)
    return bool(low <= true <= high)


def repeats(fit: GroupFit, name: str, true: float) -> bool:
    """Whether two standard errors of repeats alone hold a value; where nothing repeats, the
    interval."""
    se = fit.repeat_se(name)
    return covers(fit, name, true) if se is None else abs(fit[name] - true) < 2 * se


def listed(values: Array, form: str) -> str:
    """Numbers for a cell."""
    return ", ".join(format(value, form) for value in values)


def drivetrain_row(label: str, motion: dict, controller: str) -> str:
    """Mean and spread of K, B and I over trials, and coverage of the intervals of one, by noise
    alone, and of four."""
    settings = settings_of(motion, exact=False)
    fits = []
    for number in range(DRIVETRAIN):
        fits.append(fit_of(recorded(settings, number, controller)[0]))
    values = np.array([[fit[name] for name in TRUE] for fit in fits])
    others = (values.sum(axis=0) - values) / (DRIVETRAIN - 1)
    single = [
        [covers(fit, n, others[i, k]) for k, n in enumerate(TRUE)] for i, fit in enumerate(fits)
    ]
    noise = [
        [repeats(fit, n, others[i, k]) for k, n in enumerate(TRUE)] for i, fit in enumerate(fits)
    ]
    means = []
    for first in range(0, DRIVETRAIN, GROUP):
        own = np.arange(DRIVETRAIN) // GROUP == first // GROUP
        intervals = [over_repeats(values[own, k]) for k in range(3)]
        rest = values[~own].mean(axis=0)
        means.append([r.low <= rest[k] <= r.high for k, r in enumerate(intervals)])
    numbers = (values.mean(axis=0), values.std(axis=0, ddof=1))
    cells = [f"{K:.2f}, {B:.3f}, {I:.4f}" for K, B, I in numbers]
    cells += [listed(100 * np.mean(each, axis=0), ".0f") for each in (single, noise, means)]
    return f"| {label}, {controller} | {' | '.join(cells)} |"


def page() -> None:
    """Print the tables."""
    print(f"## Exact joint, {EXACT} trials of each motion\n")
    print(
        "| motion | bias of K, B, I, % | SD, % | RMS error over bound | coverage, % | coverage by"
        " repeats alone, % |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for label, motion in MOTIONS.items():
        print(exact_row(label, settings_of(motion, exact=True)), flush=True)
    first = next(iter(MOTIONS.values()))
    print(
        exact_row(
            "multisine, 14 bits, 0.01 N·m", settings_of(first, exact=True, bits=14, noise=0.01)
        ),
        flush=True,
    )
    print(f"\n## Drivetrain with friction, {DRIVETRAIN} trials of each motion\n")
    print("| motion | mean K, B, I | SD | coverage, % | by repeats alone, % | mean of four, % |")
    print("| --- | --- | --- | --- | --- | --- |")
    for controller in ("compensated", "uncompensated"):
        for label in list(MOTIONS)[:3:2]:
            motion = MOTIONS[label] | ({"periods": 5} if "period" in label else {"duration_s": 40})
            print(drivetrain_row(label.split(",")[0], motion, controller), flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        EXACT = DRIVETRAIN = int(sys.argv[1])
    page()
