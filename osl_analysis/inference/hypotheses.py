"""All hypotheses that may explain a torque, by family.

| family | what is not as Eq. 15 has it |
|---|---|
| (none) | nothing: a second-order joint |
| path | the torque is delayed or filtered on its way to the record |
| time | stiffness, damping or inertia changes during the recording |
| speed | damping depends on speed, or there is play |
| size | stiffness depends on the angle |
| direction | stiffness or damping depends on the direction of motion |
| clipping | the largest torques are cut |
"""

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
    """All hypotheses that compete for a recording of a joint that is no leg."""
    faults = [kind(data) for kind in (*PATHS, *OTHER_FAULTS)]
    return [Nothing(data), *faults]
