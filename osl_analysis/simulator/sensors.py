"""Common parts of the simulated sensors of a bench: random numbers, constant errors, rounding, 1/f noise."""

import zlib

import numpy as np

from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.trial import Array


def stream(seed: int, trial: str, effect: str) -> np.random.Generator:
    """Random generator of one effect in one trial. It depends on the seed and these two names, and on nothing else.

    A trial that is simulated alone therefore equals the same trial in a campaign. Switching one effect off leaves
    the random numbers of the others as they were.
    """
    return np.random.default_rng([seed, zlib.crc32(trial.encode()), zlib.crc32(effect.encode())])


def bench_errors(trial: str, settings: SimulationSettings) -> dict[str, float]:
    """The errors that are constant in one bench trial: clock start [s], load-cell offset [N*m] and drift [N*m/min].

    If `encoder_zero` is enabled, also the zero of the joint's encoder [rad].
    """
    effects, seed = settings.effects, settings.seed
    zero = effects.encoder_zero.value * effects.joint_encoder.value * stream(seed, trial, "encoder_zero").uniform(-1, 1)
    return {
        "clock_start_s": float(stream(seed, trial, "clock_start").integers(20, 2000)),
        "load_cell_offset": effects.load_cell_offset.value * stream(seed, trial, "load_cell_offset").standard_normal(),
        "load_cell_drift": effects.load_cell_drift.value * stream(seed, trial, "load_cell_drift").standard_normal(),
        **({"encoder_zero": float(zero)} if effects.encoder_zero.enabled else {}),
    }


def rounded_to(signal: Array, step: float) -> Array:
    """The signal rounded to the nearest multiple of `step` [unit of the signal]. With step 0 it is not rounded."""
    return np.rint(signal / step) * step if step else signal


def flicker(size: float, n: int, draws: np.random.Generator) -> Array:
    """1/f noise (n,), even in time, whose standard deviation in a decade of frequency is `size`.

    A power density of size^2/(ln 10 f) has the variance size^2 in each decade, for any sampling rate.
    """
    line = np.arange(n // 2 + 1)
    white = draws.standard_normal((2, len(line)))
    spectrum = size * n / 2 * (white[0] + 1j * white[1]) / np.sqrt(np.log(10) * np.maximum(line, 1))
    spectrum[0] = 0
    return np.fft.irfft(spectrum, n)
