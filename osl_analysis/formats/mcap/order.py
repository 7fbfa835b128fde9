"""The order in which the messages of a channel were recorded, where clocks cannot be trusted.

A recorder writes messages in the order in which it gets them. A tool may have sorted or merged the file by log time
since; if the clock had been set back while recording, the messages of before and after are then interleaved. The
sequence numbers, where the recorder or the publisher writes them, still tell.
"""

import numpy as np
from numpy.typing import NDArray

from osl_analysis.formats.messages.leaves import Indices

MOST_RESTARTS = 10
"""Times that sequence numbers may go back in a file that is in the order of recording: its publisher was restarted."""


def recording_order(log_time: Indices, sequence: NDArray[np.uint32]) -> Indices | None:
    """Indices that put a channel's messages in the order of recording, (n,); None where the file has them in it.

    `log_time` [ns] and `sequence` are given in the order of the file. The sequence numbers decide if each is its own
    and they go back often, or if they explain log times that go back; else the order of the file does.
    """
    backwards = int((sequence[1:] < sequence[:-1]).sum())
    if not backwards:
        return None
    numbers = sequence.astype(np.int64)
    if np.unique(numbers).size < numbers.size:
        return None
    by_number = np.argsort(numbers, kind="stable")
    if backwards > MOST_RESTARTS:
        return by_number
    in_order, explained = (np.diff(log_time) >= 0).all(), (np.diff(log_time[by_number]) >= 0).all()
    return by_number if explained and not in_order else None


def missing_numbers(sequence: NDArray[np.uint32]) -> int:
    """How many sequence numbers are missing between the first and the last; 0 where they are no such numbers.

    They count messages if each is its own and most rise by one.
    """
    if (sequence[1:] - sequence[:-1] == 1).all():  # most files
        return 0
    steps = np.diff(np.sort(sequence.astype(np.int64), kind="stable"))  # fast where they rise
    if (steps == 1).all() or (steps == 0).any() or np.median(steps) != 1:
        return 0
    return int((steps - 1).sum())
