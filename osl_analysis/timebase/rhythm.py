"""The rate of a device that samples evenly, behind a host that stamps late and loses samples.

The stamp of sample k is t = start + k step + wait. Its message waited; a lost sample changes no other stamp. The
spectrum of the stamps, |mean exp(2 pi i f t)|, therefore has a line at the device's own rate 1/step. At the rate of the
samples that are left, which is lower, it has none, even where samples are lost at regular intervals. Counting by steps
fails there: the mean step is longer everywhere, and a wait of half a step hides the long steps.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.trial import Array

BLOCKS = (16, 128)
"""Samples of which only the promptest is used: it waited least. The longer blocks are for waits of several steps."""
FEWEST_PROMPT = 60
"""Promptest samples below which no line stands out."""
LOWEST, HIGHEST = 0.998, 1.1
"""Where the line is sought, in rates of the samples that are left: up to one sample in ten is lost."""
BINS = 6
"""Bins per step into which stamps are sorted for the spectrum; the line is refined from the stamps themselves."""
STANDS_OUT = 6.0
"""Height of the line over the median of the spectrum. Of 100 000 frequencies of noise the highest reaches 4."""
REFINED = (0.5, 0.1, 0.02)
"""Half-widths of three searches around the line, in cycles over the record."""
ENDS = 200
"""Samples at either end of the record whose promptest shows how many ticks have passed."""


def missing_by_rhythm(stamps: Array) -> int | None:
    """Samples missing between the ends of a record, by its stamps (n,) [s]; None where no line stands out.

    Steps of the device between the promptest samples at both ends, less the samples between them.
    """
    step = next(filter(None, (device_step(stamps, block) for block in BLOCKS)), None)
    if step is None:
        return None
    late = stamps / step - np.arange(len(stamps))
    ends = min(ENDS, len(stamps) // 4)
    return max(round(float(late[-ends:].min() - late[:ends].min())), 0)


def device_step(stamps: Array, block: int) -> float | None:
    """Step [s] of the device, by the promptest stamp of each `block` of them; None where no line stands out."""
    duration = float(stamps[-1] - stamps[0])
    prompt = stamps[promptest(stamps, block)] - stamps[0]
    if len(prompt) < FEWEST_PROMPT:
        return None
    rate = (len(stamps) - 1) / duration
    size = scipy.fft.next_fast_len(int(2 * duration * rate * BINS) + 2)
    histogram = np.bincount((prompt * rate * BINS).astype(np.intp), minlength=size)
    frequency = np.arange(size // 2 + 1) * BINS * rate / size
    near = (frequency > LOWEST * rate) & (frequency < HIGHEST * rate)
    height = np.abs(scipy.fft.rfft(histogram.astype(np.float64)))[near]
    if height.max() < STANDS_OUT * float(np.median(height)):
        return None
    line = float(frequency[near][np.argmax(height)])
    for width in REFINED:
        tried = line + width / duration * np.linspace(-1, 1, 11)
        line = float(tried[np.argmax([abs(np.exp(2j * np.pi * f * prompt).sum()) for f in tried])])
    return 1 / line


def promptest(stamps: Array, block: int) -> NDArray[np.intp]:
    """Row of the sample in each block that lies lowest over the mean line of the stamps (n,) [s]."""
    blocks, n = len(stamps) // block, len(stamps)
    line = (stamps[-1] - stamps[0]) / (n - 1) * np.arange(blocks * block)
    lowest = (stamps[: blocks * block] - line).reshape(blocks, block).argmin(axis=1)
    return np.asarray(np.arange(blocks) * block + lowest)
