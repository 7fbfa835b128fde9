"""Degenerate input to every fit: exact, constant, empty, one cycle, NaN, huge. The result is defined, or one sentence.

A fit either returns numbers or raises an `OslAnalysisError`; never a warning, another exception, or a NaN. What may be
infinite or NaN, because its docstring says so, stands in `STATED`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import polars as pl
import pytest
from bench_synthetic import unit_block
from conftest import ROOT
from walking_crossings import Walk, walked
from walking_synthetic import settings

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.bench.phasors import fit_sinusoid, sines_at
from osl_analysis.commands.bench import fit_settings, fit_trial
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import OslAnalysisError
from osl_analysis.protocol.stepped_sine import SteppedSineProtocol
from osl_analysis.signals import LowPass, Motion, differentiate, filtered_motion, sampling_rate
from osl_analysis.stats import regression, repeats
from osl_analysis.stats.fit_row import whiteness_row
from osl_analysis.stats.regression import linear_fit
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.crossing import Crossing, encoder_check
from osl_analysis.walking.gait import unperturbed_gait
from osl_analysis.walking.groups import selection_rows
from osl_analysis.walking.plate import Stance, find_stances
from osl_analysis.walking.platform import find_onset, trigger_edge
from osl_analysis.walking.response import fit_response, group_headline, isolate_response, response_lag
from osl_analysis.walking.second_order import fit_impedance
from osl_analysis.walking.tables import ensemble_rows, group_facts, single_facts

STATED = {
    "degrees_of_freedom": math.isinf,  # where a variance is 0
    "stance_change": math.isnan,  # where gait is like the mean at no pace
    "sd": math.isnan, "se": math.isnan, "low": math.isnan, "high": math.isnan,  # of fewer than two trials
    "mean": math.isnan,  # of none
}  # fmt: skip
Signals = tuple[Array, Array, Array]
N, RATE = 400, 100.0


def not_promised(value: Any, name: str = "") -> list[str]:
    """The places in a result that hold a number which is not finite, and which no docstring allows."""
    if is_dataclass(value):
        return [bad for f in fields(value) for bad in not_promised(getattr(value, f.name), f.name)]
    if isinstance(value, pl.DataFrame):
        return [bad for row in value.to_dicts() for bad in not_promised(row)]
    if isinstance(value, Mapping):
        return [bad for key, one in value.items() for bad in not_promised(one, str(key))]
    if isinstance(value, list | tuple):
        return [bad for one in value for bad in not_promised(one, name)]
    numbers = np.ravel(np.asarray(value)) if isinstance(value, np.ndarray | float | complex) else np.empty(0)
    allowed = STATED.get(name, lambda _: False)
    return [f"{name} = {x}" for x in numbers.tolist() if isinstance(x, float | complex) and not is_fine(x, allowed)][:1]


def is_fine(x: float | complex, allowed: Callable[[float], bool]) -> bool:
    """Whether a number is finite, or not finite in the way that its docstring states."""
    return bool(np.isfinite(x)) or (isinstance(x, float) and allowed(x))


def defined_or_refused(fit: Callable[..., Any], cases: Mapping[str, Callable[[], tuple[Any, ...]]]) -> None:
    """Call a fit with every case; warnings are errors in these tests."""
    wrong = []
    for name, made in cases.items():
        try:
            wrong += [f"{name}: {bad}" for bad in not_promised(fit(*made()))]
        except OslAnalysisError as error:
            wrong += [f"{name}: {error}"] * (not str(error).isprintable())
        except Exception as error:
            wrong.append(f"{name}: {type(error).__name__} {error}")
    assert not wrong


def spoiled(time: Array, x: Array, y: Array) -> dict[str, Signals]:
    """Time [s] and two signals (n,) each, as they should be and degenerate in every way of the issue."""
    zero, constant, row = np.zeros_like(x), np.full_like(x, 0.3), len(x) // 3
    at = np.arange(len(x)) == row
    pairs = {
        "sound": (x, y), "exact": (x, 3 * x), "zero residual": (np.rint(40 * x), 2 * np.rint(40 * x)),
        "zero y": (x, zero), "constant y": (x, constant), "zero x": (zero, y), "constant x": (constant, y),
        "both zero": (zero, zero), "both constant": (constant, constant), "one outlier": (x, np.where(at, 1e12, y)),
        "nan in y": (x, np.where(at, np.nan, y)), "nan in x": (np.where(at, np.nan, x), y),
        "inf in y": (x, np.where(at, np.inf, y)), "inf in x": (np.where(at, -np.inf, x), y),
        "all nan": (zero * np.nan, zero * np.nan), "all inf": (zero + np.inf, zero + np.inf),
    }  # fmt: skip
    for k in (1e300, 1e160, 1e-160, 1e-300, 5e-324):
        pairs |= {f"{k} y": (x, k * y), f"{k} x": (k * x, y), f"{k} both": (k * x, k * y)}
    cases = {name: (time, *pair) for name, pair in pairs.items()}
    cases |= {f"{n} samples": (time[:n], x[:n], y[:n]) for n in (0, 1, 2, 3, 10, 100)}
    cases |= {"5 exact samples": (time[:5], x[:5], 3 * x[:5]), "equal stamps": (zero, x, y)}
    two = np.where(at, time[row - 1], time)
    return cases | {
        "two equal stamps": (two, x, y),
        "huge time": (1e300 * time, x, y),
        "nan time": (np.nan * time, x, y),
    }


@cache
def signals() -> dict[str, Callable[[], Signals]]:
    """The cases of two sines with noise, four seconds at 100 Hz."""
    time = np.arange(N) / RATE
    x = 0.1 * np.sin(4 * np.pi * time) + 0.05 * np.sin(10 * np.pi * time + 1)
    y = 3 * x + 0.01 * np.random.default_rng(1).standard_normal(N)
    return {name: (lambda case=case: case) for name, case in spoiled(time, x, y).items()}


def columns(x: Array) -> dict[str, Array]:
    return {"a": x, "offset": np.ones_like(x)}


def all_of(fit: regression.LinearFit) -> tuple[Any, ...]:
    """A fit with everything that is computed from it."""
    return fit, fit.se("a"), fit.interval("a"), fit.correlation("a", "offset")


def made(time: Array, column: str, values: Array) -> Trial:
    return Trial("made", pl.DataFrame({"time": time, column: values}))


FITS_OF_SIGNALS: dict[str, Callable[[Array, Array, Array], Any]] = {
    "linear_fit": lambda t, x, y: all_of(linear_fit(y, columns(x))),
    "linear_fit of one column": lambda t, x, y: linear_fit(y, {"a": x}),
    "with_shared_error": lambda t, x, y: regression.with_shared_error(linear_fit(y, {"a": x}), np.array([0.1])),
    "fit_sinusoid": lambda t, x, y: fit_sinusoid(y, sines_at(t, 2.0)),
    "fit_sinusoid of two cycles": lambda t, x, y: fit_sinusoid(y[:100], sines_at(t[:100], 2.0)),
    "fit_sinusoid of one cycle": lambda t, x, y: fit_sinusoid(y[:50], sines_at(t[:50], 2.0)),
    "fit_impedance": lambda t, x, y: fit_impedance(Motion(x, np.roll(x, 3), np.roll(x, 11)), y),
    "score_models": lambda t, x, y: repeats.score_models(
        y, [repeats.Candidate("M1", "a", 1, x, x), repeats.Candidate("M2", "b", 2, y, y)]
    ),
    "mean_over_trials": lambda t, x, y: repeats.mean_over_trials(y, shared=True),
    "over_repeats": lambda t, x, y: repeats.over_repeats(y, [(0.0, np.inf)]),
    "over_repeats of two kinds": lambda t, x, y: repeats.over_repeats(y, kinds=np.arange(len(y)) % 2),
    "summary_row": lambda t, x, y: repeats.summary_row(pl.Series(y)),
    "whiteness_row": lambda t, x, y: whiteness_row(y),
    "LowPass": lambda t, x, y: LowPass(15)(y, RATE),
    "differentiate": lambda t, x, y: differentiate(t, y),
    "filtered_motion": lambda t, x, y: filtered_motion(t, x, y, LowPass(15)),
    "sampling_rate": lambda t, x, y: sampling_rate(t),
    "find_stances": lambda t, x, y: find_stances(t, 1e3 * np.clip(y, -1e20, 1e20), 30, 15, 0.1),
    "find_onset": lambda t, x, y: find_onset(t, np.abs(y), 0.05),
    "encoder_check": lambda t, x, y: encoder_check(made(t, "theta", y), t, x, LowPass(15)),
    "trigger_edge": lambda t, x, y: trigger_edge(made(t, "trigger", y)),
}  # fmt: skip


@pytest.mark.parametrize("name", FITS_OF_SIGNALS)
def test_a_fit_of_degenerate_signals_is_defined_or_refused_in_one_sentence(name):
    defined_or_refused(FITS_OF_SIGNALS[name], signals())


BENCH_RATE, FREQUENCIES, CYCLES = 200.0, (2.0, 5.0), 8
DEVICE = ROOT / "config/parameters/default.yaml"


@cache
def bench_angle(experiment: str) -> Array:
    """The angle (n,) [rad] that an experiment's bench drives."""
    time = np.arange(round(10 * BENCH_RATE)) / BENCH_RATE
    if experiment in ("belt", "torque_angle"):
        return np.deg2rad(5) * (np.clip((time - 1.5) / 3.5, 0, 1) - np.clip((time - 5) / 3.5, 0, 1))
    if experiment == "actuator":
        return np.cumsum(8 * np.sin(0.6 * np.pi * time)) / BENCH_RATE
    protocol, rest = SteppedSineProtocol((np.deg2rad(4),), FREQUENCIES, CYCLES), np.zeros(round(BENCH_RATE))
    return np.concatenate([rest, np.deg2rad(4) * unit_block(protocol, BENCH_RATE), rest])


@cache
def asked_of(experiment: str) -> Any:
    """Settings of the shipped configuration with a short protocol, limits, and the desired impedance."""
    desired = DesiredImpedance("compensated", 300.0, 5.0) if experiment == "impedance" else None
    settings, limits = fit_settings(experiment, ROOT / "config/config.yaml")
    if experiment not in ("belt", "actuator", "torque_angle"):
        short = {"amplitudes_deg": [4], "frequencies_hz": FREQUENCIES, "cycles": CYCLES}
        own = settings["settings"]
        settings["settings"] = type(own).model_validate(own.model_dump() | short)
    return settings, limits, desired


BENCH = [name for name, facts in EXPERIMENTS.items() if facts.place == "bench"]


@pytest.mark.parametrize("experiment", BENCH)
def test_a_degenerate_bench_trial_is_fitted_or_refused_in_one_sentence(experiment, monkeypatch):
    monkeypatch.chdir(ROOT)
    x = bench_angle(experiment)
    time = np.arange(len(x)) / BENCH_RATE
    y = 300 * x + 0.05 * np.random.default_rng(1).standard_normal(len(x))
    cases = spoiled(time, x, y) | {"tiny time": (1e-300 * time, x, y)}
    cases |= {f"{k} cycles": tuple(s[: round((1 + k / 2) * BENCH_RATE)] for s in (time, x, y)) for k in (1, 2, 3)}

    def fit(t: Array, angle: Array, torque: Array) -> Any:
        moved, exerted = ("theta_m", "torque_m") if experiment == "actuator" else ("theta", "torque")
        still = {"theta_m": 0 * t} if moved == "theta" else {}
        current = 4 * np.sin(0.34 * np.pi * np.arange(len(t)) / BENCH_RATE)
        samples = pl.DataFrame({"time": t, moved: angle, exerted: torque, "current": current} | still)
        return fit_trial(experiment, Trial("made", samples), DEVICE, *asked_of(experiment)).table

    defined_or_refused(fit, {name: (lambda case=case: case) for name, case in cases.items()})


@pytest.mark.parametrize("reason", ["zero", "constant"])
@pytest.mark.parametrize("experiment", BENCH)
def test_a_dead_load_cell_is_named(experiment, reason, monkeypatch):
    monkeypatch.chdir(ROOT)
    x = bench_angle(experiment)
    moved, torque = ("theta_m", "torque_m") if experiment == "actuator" else ("theta", "torque")
    dead = np.full_like(x, 0.0 if reason == "zero" else 3.0)
    samples = {"time": np.arange(len(x)) / BENCH_RATE, "theta_m": 0 * x, "current": x, moved: x, torque: dead}
    with pytest.raises(OslAnalysisError, match=rf"made.*torque.* (stays at|is) {dead[0]:g}\b.*([Cc]heck|source file)"):
        fit_trial(experiment, Trial("made", pl.DataFrame(samples)), DEVICE, *asked_of(experiment))


CHOICES = settings(bootstrap_samples=100)
Crossings = tuple[list[Crossing], list[Crossing]]


@cache
def walks() -> Crossings:
    """Unperturbed and perturbed crossings."""
    return [walked(f"u{i}", Walk()) for i in range(4)], [walked(f"p{i}", Walk(phase=0.4)) for i in range(3)]


def spoil(crossing: Crossing, how: str) -> Crossing:
    time, theta, torque = spoiled(crossing.time, crossing.theta, crossing.torque)[how]
    return replace(crossing, time=time, theta=theta, torque=torque, plate_errors=np.zeros((0, len(time))))


def spoiled_crossings(how: str, which: str) -> Crossings:
    gait, perturbed = walks()
    if which != "perturbed":
        gait = [spoil(c, how) for c in gait]
    return gait, perturbed if which == "gait" else [spoil(c, how) for c in perturbed]


@cache
def crossings() -> dict[str, Callable[[], Crossings]]:
    """Spoiled signals of the unperturbed, the perturbed or all crossings; equal, exact, few crossings; no stance."""
    gait, perturbed = walks()
    exact = walked("u0", Walk(noise=0.0)), walked("u0", Walk(phase=0.4, noise=0.0))
    same = replace(gait[0], onset=perturbed[0].onset, turn=0.08)
    ways = [how for how in spoiled(gait[0].time, gait[0].theta, gait[0].torque) if "160" not in how]
    cases = {
        f"{which}: {how}": (lambda how=how, which=which: spoiled_crossings(how, which))
        for which in ("all", "perturbed")
        for how in ways
    }
    return cases | {
        "no response": lambda: ([gait[0]] * 4, [same] * 3),
        "equal crossings": lambda: ([gait[0]] * 4, [perturbed[0]] * 3),
        "exact": lambda: ([exact[0]] * 4, [exact[1]] * 3),
        "no gait": lambda: ([], perturbed),
        "one unperturbed": lambda: (gait[:1], perturbed),
        "two unperturbed": lambda: (gait[:2], perturbed),
        "one perturbed": lambda: (gait, perturbed[:1]),
        "no stance": lambda: ([replace(c, stance=Stance(0.3, 0.3)) for c in gait], perturbed),
    }


def response(gait: list[Crossing], perturbed: list[Crossing], stance: Any = "own") -> Any:
    return isolate_response(perturbed[0], unperturbed_gait(gait, 2), CHOICES, stance)


def single(gait: list[Crossing], perturbed: list[Crossing]) -> tuple[Any, ...]:
    """One perturbation's fit, lag and doubts."""
    isolated = response(gait, perturbed)
    fit = fit_response(isolated)
    return fit, response_lag(isolated), single_facts(isolated, fit)


def headline(gait: list[Crossing], perturbed: list[Crossing]) -> tuple[Any, ...]:
    """A group's rows and doubts."""
    found = group_headline(perturbed, unperturbed_gait(gait, 2), CHOICES)
    return ensemble_rows(found.ensemble, found.resampled), group_facts(found)


FITS_OF_CROSSINGS: dict[str, Callable[[list[Crossing], list[Crossing]], Any]] = {
    "unperturbed_gait": lambda gait, perturbed: unperturbed_gait(gait, 3),
    "isolate_response, matched": lambda gait, perturbed: response(gait, perturbed, "matched"),
    "fit_response": single,
    "group_headline": headline,
    "selection_rows": lambda gait, perturbed: selection_rows([*gait, *perturbed], [], CHOICES),
}


@pytest.mark.parametrize("name", FITS_OF_CROSSINGS)
def test_degenerate_crossings_are_fitted_or_refused_in_one_sentence(name):
    defined_or_refused(FITS_OF_CROSSINGS[name], crossings())
