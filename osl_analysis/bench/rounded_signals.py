"""What the steps of a sensor do to a signal that repeats itself.

Rounding is no noise where a motion repeats itself: every cycle has the same errors. They are drawn
with other zeros of the sensor (Widrow and Kollar, Quantization Noise, 2008).
"""

from collections.abc import Iterator

import numpy as np

from osl_analysis.inference.rounding_errors import noise_before_rounding, share_left_by_noise
from osl_analysis.signals import LowPass
from osl_analysis.trial import Array

# times to come to a level, in multiples of a rounded signal's last step: exponentially 2, least
# jerk 2.3
STEPS_TO_LEVEL = 3.0
LARGEST_PART_OF_LEVEL = 0.45  # of the time at a level, in which the joint comes to it, or leaves it
STANDING_SPEED = 0.1  # share of the SD of the speed below which a joint stands
# share of the parts of 50 samples that hold noise alone above the frequencies of the motion
QUIETEST_SHARE = 0.3
SAMPLES_OF_PART = 50
MOST_NOISE = (
    0.1  # steps^2; with more, less than a fiftieth of the variance that cycles repeat is left
)
# share of the power at a few levels above which a motion steps between these (sines 0.05, steps
# 0.2)
LEVELS_SHARE = 0.15
# range [steps] of the drawn sizes of a sine: less varies too little if samples keep step with it
SIZES_OF_SINE = 0.5
DRAWS = (np.arange(17) + 0.5) / 17 - 0.5  # shifts of an encoder's zero and of sizes, in steps
ORDER_OF_SIZES = 5 * np.arange(17) % 17  # other than that of zeros, so that both spread evenly


def before_rounding(read: Array, step: float) -> Array:
    """Reconstruct a signal (n,) before its rounding to steps.

    It is halfway between two steps where it goes from one to the next. It comes to a level, and
    leaves it, in `STEPS_TO_LEVEL` times the time of the adjacent step.
    """
    changes = np.flatnonzero(np.abs(np.diff(read)) > 0.3 * step)
    rises, dwell, level = np.diff(read)[changes] > 0, np.diff(changes), read[changes + 1]
    # levels at which the signal turns back
    turns = np.flatnonzero(rises[1:] != rises[:-1])
    dwells = np.r_[np.inf, dwell, np.inf]
    before, at_level, after = dwells[turns], dwells[turns + 1], dwells[turns + 2]
    longest = LARGEST_PART_OF_LEVEL * at_level
    come = changes[turns] + 0.5 + np.minimum(STEPS_TO_LEVEL * before, longest)
    leave = changes[turns + 1] + 0.5 - np.minimum(STEPS_TO_LEVEL * after, longest)

    place = np.r_[0, changes + 0.5, come, leave, len(read) - 1]
    halfway = (read[changes] + level) / 2
    value = np.r_[read[0], halfway, level[turns], level[turns], read[-1]]
    order = np.argsort(place)
    return np.asarray(np.interp(np.arange(len(read)), place[order], value[order]))


def repeated_share_of(fitted: Array, step: float | None, density: float, rate_hz: float) -> float:
    """Share of a rounding error that all cycles repeat.

    Rounding of slow motion is not white, and fast motion is no noise: third differences take
    off what is slower than some samples, and in the quietest parts the motion is at a level.

    Parameters
    ----------
    fitted : Array (m,)
        The raw signal in the fitted rows.
    step : float or None
        Its resolution.
    density : float
        Density of its noise, in its unit squared per Hz.
    rate_hz : float
        Sampling rate [Hz].
    """
    if not step or not (step**2):
        return 0.0
    jumps = np.diff(fitted, 3) ** 2 / 20  # 20: variance of the third difference of white noise
    starts = np.arange(0, len(jumps) - 1, SAMPLES_OF_PART)
    quiet = float(np.quantile(np.add.reduceat(jumps, starts) / SAMPLES_OF_PART, QUIETEST_SHARE))
    variance = min(density * rate_hz / 2, quiet)
    noise = noise_before_rounding(variance / step**2)
    return share_left_by_noise(noise) if noise < MOST_NOISE else 0.0


def drawn_roundings(
    raw: Array,
    smooth: Array,
    omega: Array,
    step: float,
    share: float,
    rate_hz: float,
    quick: LowPass,
    is_sine: bool,
) -> Iterator[Array]:
    """Draw the rounding errors (n,) of a signal for other zeros of its sensor.

    Motions that return to the same places, levels and sines, vary in size, too: levels, whose
    errors are independent, by the concentration of power in single levels. In steps between few
    levels the errors depend on how the joint reaches a level, which every step repeats and nobody
    knows. Draws then alternate between two signals: the one behind a quicker filter, whose levels
    ring by some steps (alone it accuses sound steps), and the reconstruction before the encoder
    (alone it makes I too certain).

    Parameters
    ----------
    raw, smooth : Array (n,)
        The signal as it was read, and behind the fit's filter.
    omega : Array (n,)
        Velocity of the joint [rad/s].
    step : float
        Resolution of the signal.
    share : float
        `repeated_share_of` it.
    rate_hz : float
        Sampling rate [Hz].
    quick : LowPass
        A quicker filter.
    is_sine : bool
        Whether the motion is a stepped sine.
    """
    is_standing = np.abs(omega) < STANDING_SPEED * float(np.std(omega))
    # raw, since levels of the filtered signal ring by many steps of 18 bits
    place = raw - raw.mean()
    _, level = np.unique(np.rint(place[is_standing] / step), return_inverse=True)
    at_levels = float(np.linalg.norm(np.bincount(level, place[is_standing] ** 2)))
    concentration = at_levels / max(float(place @ place), step**2)
    signals = [smooth]
    if concentration > LEVELS_SHARE:
        signals = [quick(raw, rate_hz), before_rounding(raw, step)]

    in_steps = [(signal - signal.mean()) / step for signal in signals]
    largest = float(np.abs(in_steps).max())
    spread = max(concentration, SIZES_OF_SINE if is_sine else 0.0)
    sizes = spread * DRAWS[ORDER_OF_SIZES] / largest
    for k, (zero, size) in enumerate(zip(DRAWS, sizes, strict=True)):
        true = in_steps[k % len(in_steps)] * (1 + size)
        true += zero
        true -= np.rint(true)  # in place: new memory takes as long as the arithmetic
        true *= share * step
        yield true
