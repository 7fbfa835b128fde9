"""All hypotheses that may explain a torque, by family.

| family | what is not as Eq. 15 has it |
|---|---|
| (none) | nothing: a second-order joint, or a drivetrain of higher order |
| path | the torque is delayed or filtered on its way to the record |
| time | stiffness, damping or inertia changes during the recording |
| speed | damping depends on speed, or there is play |
| size | stiffness depends on the angle |
| direction | stiffness or damping depends on the direction of motion |
| clipping | the largest torques are cut |
"""

import numpy as np
import scipy

from osl_analysis.inference.hypothesis import Candidate, Hypothesis, Search
from osl_analysis.inference.path_hypotheses import Delay, LowPass, SeriesSpring
from osl_analysis.inference.shape_hypotheses import (
    ByDirection,
    ChangeAtOnce,
    ChangeOverTime,
    Clipping,
    DampingBySpeed,
    Hardening,
    Play,
    StiffnessBySide,
)
from osl_analysis.inference.whitening import Whitened


class Nothing(Hypothesis):
    """Eq. 15 alone."""

    family = ""
    name = "nothing"

    def candidates(self, search: Search) -> list[Candidate]:
        return [self.plain()]


class Drivetrain(Hypothesis):
    """A joint rendered by a drivetrain whose actuator is not recorded: Eq. 9 in powers of s.

    Its K, B and I are those of Eq. 15 fitted to the torque of the linear drivetrain in this motion:
    what jerk and snap add, projected on angle, velocity and acceleration before any whitening.
    """

    family = ""
    name = "drivetrain"

    def candidates(self, search: Search) -> list[Candidate]:
        spectra = self.data.spectra
        columns = self.data.higher_motion
        in_time = scipy.fft.irfft(spectra.derivatives * spectra.roll_off, spectra.working_rows)
        rows = spectra.fitted(in_time)
        rows = rows - rows.mean(axis=1, keepdims=True)
        projection = np.linalg.lstsq(rows[:3].T, rows[3:].T)[0]
        matrix = np.hstack([self.data.impedance_matrix, projection])
        return [Candidate(self, columns, self.data.torque, impedance_matrices=(matrix,))]


SOUND: tuple[type[Hypothesis], ...] = (Nothing,)
PATHS: tuple[type[Hypothesis], ...] = (Delay, LowPass, SeriesSpring)
OTHER_FAULTS: tuple[type[Hypothesis], ...] = (
    ChangeOverTime,
    ChangeAtOnce,
    DampingBySpeed,
    Hardening,
    StiffnessBySide,
    ByDirection,
    Play,
    Clipping,
)


def hypotheses_for(data: Whitened) -> list[Hypothesis]:
    """All hypotheses that compete for a recording.

    Of a drivetrain none is a fault: it delays and filters the torque by itself, and its friction
    changes more than most faults do.
    """
    kinds = (*SOUND, *PATHS, *OTHER_FAULTS)
    if data.spectra.actuator_spectrum is not None:
        kinds = SOUND
    elif data.spectra.signals.has_drivetrain:
        kinds = (*SOUND, Drivetrain)
    return [kind(data) for kind in kinds]
