# SPDX-License-Identifier: Apache-2.0
"""Degenerate input to every fit gives numbers or an `OslAnalysisError`; never a warning, or a NaN
not in `STATED`."""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache, partial

import numpy as np
import polars as pl
import pytest
from bench_synthetic import unit_block
from conftest import white_noise
from shipped import CONFIG, DEVICE
from walking_crossings import Walk, selected, walked
from walking_synthetic import settings

from osl_analysis.base.errors import OslAnalysisError
from osl_analysis.base.trial import Trial
from osl_analysis.bench.evidence import DesiredImpedance
from osl_analysis.commands.fit import fit_trial
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.signals.filters import Motion, differentiate, sampling_rate
from osl_analysis.spectral.stepped_sine import SteppedSineProtocol
from osl_analysis.stats import repeats
from osl_analysis.stats.linear_fit import linear_fit
from osl_analysis.walking.crossing import PER_UNIT
from osl_analysis.walking.impedance_fit import fit_without_offset
from osl_analysis.walking.isolated_response import unperturbed_gait
from osl_analysis.walking.plate import find_stances
from osl_analysis.walking.tables import perturbation_row

STATED = {
    "degrees_of_freedom": math.isinf,  # where a variance is 0
    # of fewer than two trials
    "sd": math.isnan,
    "se": math.isnan,
    "low": math.isnan,
    "high": math.isnan,
    "mean": math.isnan,  # of none
}
N = 400


def not_promised(value, name=""):
    """The places in a result that hold a number which is not finite, and which no docstring
    allows."""
    if is_dataclass(value):
        return [bad for f in fields(value) for bad in not_promised(getattr(value, f.name), f.name)]
    if isinstance(value, pl.DataFrame):
        value = value.to_dicts()
    if isinstance(value, Mapping):
        return [bad for key, one in value.items() for bad in not_promised(one, str(key))]
    if isinstance(value, list | tuple):
        return [bad for one in value for bad in not_promised(one, name)]
    numbers = (
        np.ravel(np.asarray(value))
        if isinstance(value, np.ndarray | float | complex)
        else np.empty(0)
    )
    found = [x for x in numbers.tolist() if isinstance(x, float | complex) and not np.isfinite(x)]
    return [
        f"{name} = {x}"
        for x in found
        if not (isinstance(x, float) and name in STATED and STATED[name](x))
    ][:1]


def defined_or_refused(fit, cases):
    """Call a fit with every case, or with what it makes; warnings are errors in these tests."""
    wrong = []
    for name, case in cases.items():
        try:
            wrong += [
                f"{name}: {bad}" for bad in not_promised(fit(*(case() if callable(case) else case)))
            ]
        except OslAnalysisError as error:
            wrong += [f"{name}: {error}"] * (not str(error).isprintable())
        except Exception as error:
            wrong.append(f"{name}: {type(error).__name__} {error}")
    assert not wrong


def spoiled(time, x, y):
    """Time [s] and two signals (n,) each, as they should be and degenerate in every way of the
    issue."""
    row = len(x) // 3
    at = np.arange(len(x)) == row
    ways = {f"one {bad}": partial(np.where, at, bad) for bad in (1e12, np.nan, np.inf, -np.inf)}
    ways |= {
        f"all {bad}": partial(np.full_like, fill_value=bad) for bad in (0, 0.3, np.nan, np.inf)
    }
    ways |= {f"{k} times": partial(np.multiply, k) for k in (1e300, 1e160, 1e-160, 1e-300, 5e-324)}
    steps = np.rint(40 * x)
    pairs = {"sound": (x, y), "exact": (x, 3 * x), "zero residual": (steps, 2 * steps)}
    for name, way in ways.items():
        pairs |= {
            f"{name} x": (way(x), y),
            f"{name} y": (x, way(y)),
            f"{name} both": (way(x), way(y)),
        }
    cases = {name: (time, *pair) for name, pair in pairs.items()}
    cases |= {f"{n} samples": (time[:n], x[:n], y[:n]) for n in (0, 1, 2, 3, 10, 100)}
    cases |= {"5 exact samples": (time[:5], x[:5], 3 * x[:5]), "equal stamps": (0 * time, x, y)}
    cases |= {"two equal stamps": (np.where(at, time[row - 1], time), x, y)}
    return cases | {"huge time": (1e300 * time, x, y), "nan time": (np.nan * time, x, y)}


@cache
def signals():
    time = np.arange(N) / 100.0
    x = 0.1 * np.sin(4 * np.pi * time) + 0.05 * np.sin(10 * np.pi * time + 1)
    return spoiled(time, x, 3 * x + 0.01 * white_noise(N, 1))


def asked(y, x):
    """A fit with everything that is computed from it."""
    fit = linear_fit(y, {"a": x, "offset": np.ones_like(x)})
    one = linear_fit(y, {"a": x})
    shared = one.with_known_error("known", np.array([0.1]))
    return fit, fit.se("a"), fit.interval("a"), one, shared


FITS_OF_SIGNALS = {
    "linear_fit": lambda t, x, y: asked(y, x),
    "fit_impedance": lambda t, x, y: fit_without_offset(
        Motion(x, np.roll(x, 3), np.roll(x, 11)), y
    ),
    "summary_row": lambda t, x, y: repeats.summary_row(pl.DataFrame({"y": y}), "y"),
    "differentiate": lambda t, x, y: differentiate(t, y),
    "sampling_rate": lambda t, x, y: sampling_rate(t),
    "find_stances": lambda t, x, y: find_stances(t, 1e3 * np.clip(y, -1e20, 1e20), 30, 15, 0.1),
}


@pytest.mark.parametrize("name", FITS_OF_SIGNALS)
def test_a_fit_of_degenerate_signals_is_defined_or_refused_in_one_sentence(name):
    defined_or_refused(FITS_OF_SIGNALS[name], signals())


BENCH_RATE = 200.0
FREQUENCIES = (2.0, 5.0)
CYCLES = 8


@cache
def bench_angle(experiment):
    """The angle (n,) [rad] that an experiment's bench drives."""
    time = np.arange(round(10 * BENCH_RATE)) / BENCH_RATE
    if experiment in ("belt", "torque_angle"):
        return np.deg2rad(5) * (np.clip((time - 1.5) / 3.5, 0, 1) - np.clip((time - 5) / 3.5, 0, 1))
    if experiment == "actuator":
        return np.cumsum(8 * np.sin(0.6 * np.pi * time)) / BENCH_RATE
    protocol = SteppedSineProtocol((np.deg2rad(4),), FREQUENCIES, CYCLES)
    rest = np.zeros(round(BENCH_RATE))
    return np.concatenate([rest, np.deg2rad(4) * unit_block(protocol, BENCH_RATE), rest])


@cache
def asked_of(experiment):
    """The shipped configuration with a short protocol, and the desired impedance."""
    desired = DesiredImpedance("compensated", 300.0, 5.0) if experiment == "impedance" else None
    short = {"amplitudes_deg": [4], "frequencies_hz": FREQUENCIES, "cycles": CYCLES}
    bench = CONFIG.dynamometer
    bench = type(bench).model_validate(bench.model_dump() | short)
    return CONFIG.model_copy(update={"dynamometer": bench}), desired


def bench_fit(experiment, t, angle, torque):
    """The table of a trial of these signals on a device whose current changes."""
    moved, exerted = ("theta_m", "torque_m") if experiment == "actuator" else ("theta", "torque")
    current = 4 * np.sin(0.34 * np.pi * np.arange(len(t)) / BENCH_RATE)
    samples = {"time": t, "theta_m": 0 * t, moved: angle, exerted: torque, "current": current}
    table = fit_trial(
        experiment,
        Trial("made", pl.DataFrame(samples)),
        DEVICE,
        *asked_of(experiment),
    ).table
    described = described_tables_by_name()[EXPERIMENTS[experiment].tables[0].name]
    unknown = {*table.columns} - {*described.columns} - {*described.of_fits}
    assert not unknown, f"{unknown} have no line in the dictionary"
    return table


BENCH = [name for name, facts in EXPERIMENTS.items() if facts.place == "bench"]


@pytest.mark.parametrize("experiment", BENCH)
def test_a_degenerate_bench_trial_is_fitted_or_refused(experiment, in_root):
    x = bench_angle(experiment)
    time = np.arange(len(x)) / BENCH_RATE
    y = 300 * x + 0.05 * white_noise(len(x), 1)
    cases = spoiled(time, x, y) | {"tiny time": (1e-300 * time, x, y)}
    for name in ("sound", "one nan x", "two equal stamps"):  # which are fitted as any recording
        del cases[name]
    for cycles in (1, 2, 3):
        rows = round((1 + cycles / 2) * BENCH_RATE)
        cases[f"{cycles} cycles"] = time[:rows], x[:rows], y[:rows]

    defined_or_refused(partial(bench_fit, experiment), cases)


@pytest.mark.parametrize("level", [0, 3])
@pytest.mark.parametrize("experiment", BENCH)
def test_a_dead_load_cell_is_named(experiment, level, in_root):
    x = bench_angle(experiment)
    with pytest.raises(OslAnalysisError, match=rf"made.*torque.* {level} "):
        bench_fit(experiment, np.arange(len(x)) / BENCH_RATE, x, np.full_like(x, level))


CHOICES = settings()


@cache
def walks():
    return [walked(f"u{i}", Walk()) for i in range(4)], [
        walked(f"p{i}", Walk(phase=0.4)) for i in range(3)
    ]


def spoil(crossings, how):
    found = []
    for one in crossings:
        time, theta, torque = spoiled(one.time, one.theta, one.torque)[how]
        changes = np.zeros((len(PER_UNIT), len(time)))
        found.append(replace(one, time=time, theta=theta, torque=torque, changes=changes))
    return found


@cache
def crossings():
    """Spoiled signals of the perturbed or all crossings; equal, exact, few crossings; no stance."""
    gait, perturbed = walks()
    same = replace(gait[0], onset=perturbed[0].onset, turn=0.08)
    cases = {
        "no response": ([gait[0]] * 4, [same] * 3),
        "equal crossings": ([gait[0]] * 4, [perturbed[0]] * 3),
        "exact": (
            [walked("u0", Walk(noise=0.0))] * 4,
            [walked("u0", Walk(phase=0.4, noise=0.0))] * 3,
        ),
        "no gait": ([], perturbed),
        "two unperturbed": (gait[:2], perturbed),
        "one perturbed": (gait, perturbed[:1]),
    }
    for how in spoiled(gait[0].time, gait[0].theta, gait[0].torque):
        # what is usual, or as another one; and what is shorter than any stance
        usual = ("sound", "1e-160", "1e+160", "1e-300", "1e+300", "10", "2 s", "3 s", "5 e")
        if not how.startswith(usual):
            cases[f"all: {how}"] = lambda how=how: (spoil(gait, how), spoil(perturbed, how))
            cases[f"perturbed: {how}"] = lambda how=how: (gait, spoil(perturbed, how))
    return cases


def single(gait, perturbed):
    """One perturbation's fit and doubts."""
    return perturbation_row(perturbed[0], unperturbed_gait(gait, 2), CHOICES)


def selection(gait, perturbed):
    return selected([*gait, *perturbed], CHOICES)


@pytest.mark.parametrize("fit", [single, selection])
def test_degenerate_crossings_are_fitted_or_refused_in_one_sentence(fit):
    defined_or_refused(fit, crossings())
