"""Values that nothing on a bench or a walkway can reach: a wrong unit, a wrong scale, or a damaged recording.

The bounds are far above what a good recording holds, and above what a slip by a factor of a thousand gives in most
channels: such a slip is judged by the fits and the quality checks, which can name its cause.
"""

import numpy as np

from osl_analysis.columns import unit_of
from osl_analysis.errors import InputError
from osl_analysis.ingest.recording import Recording

LARGEST = {
    "m": 1e3,  # no laboratory is a kilometre long
    "rad": 1e6,  # 160 000 turns
    "rad/s": 1e5,  # a million turns per minute
    "N": 1e6,  # the weight of a hundred tonnes
    "N*m": 1e7,  # N*mm called N*m on a plate stays below, which the centre of pressure tells better
    "A": 1e5,
    "V": 1e6,  # counts of a converter of 16 bits called V stay below
    "N*m/rad": 1e8,
    "N*m*s/rad": 1e8,
    "N*m/kg": 1e6,
}
"""Largest size of a value in its SI unit, by kind of quantity."""


def check_sizes(recording: Recording) -> None:
    """Refuse values beyond `LARGEST`, and infinite ones. NaN, which is a value that was not seen, passes.

    Raises
    ------
    InputError
        The message names the column, the first such value, its time, how many there are, and the remedy.
    """
    time = recording.samples["time"].to_numpy()
    for column in recording.columns:
        bound, values = LARGEST[unit_of(column)], recording.samples[column].to_numpy()
        if np.fmax.reduce(values, initial=0.0) > bound or np.fmin.reduce(values, initial=0.0) < -bound:
            beyond = np.abs(values) > bound
            row = int(np.argmax(beyond))
            raise InputError(
                f"{column} is {values[row]:.4g} {unit_of(column)} at {time[row]:.3f} s, and beyond ±{bound:g} in "
                f"{beyond.sum()} of {np.count_nonzero(~np.isnan(values))} samples: nothing here can be so large; "
                "correct its unit or scale in the source file, or repair the recording"
            )
