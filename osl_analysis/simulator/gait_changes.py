"""What makes some crossings differ from the others: less load, a slower walk, a second foot on the plate."""

import math
from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field

from osl_analysis.simulator.effect import NotNegative, Positive
from osl_analysis.simulator.sensors import stream
from osl_analysis.yaml_settings import Settings

Percent = Annotated[float, Field(gt=-50, lt=100)]


class StepChange(Settings):
    """A change of some crossings, by name or by chance. What is left out stays as it is."""

    of: Literal["all", "perturbed", "unperturbed"] | tuple[str, ...] = "all"
    """Crossings that can have it: a kind, or a list of their names."""
    share: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Share of these that have it, drawn for each crossing."""
    load: Positive = 1.0
    """Factor of the ground reaction and of the ankle's torque, at the same angle: the leg's equilibrium follows."""
    amplitude: Positive = 1.0
    """Factor of the ankle's angle, its torque and the ground reaction."""
    slower_percent: Percent = 0.0
    """Extension [%] of the whole gait cycle."""
    after_window_percent: Percent = 0.0
    """Extension [%] of stance, after the 100 ms that follow the onset. Only perturbed crossings have it."""
    second_foot_percent: NotNegative = 0.0
    """Largest load [% of the body weight] of the other foot, which stands on the plate at mid-stance."""
    overhang_mm: Annotated[float, Field(ge=0, lt=90)] = 0.0
    """Width [mm] of the foot that is beside the plate and is carried by the floor. The foot is 90 mm wide."""

    @property
    def factors(self) -> dict[str, float]:
        """The factors by name."""
        return {"load": self.load, "amplitude": self.amplitude}

    def concerns(self, trial: str, perturbed: bool) -> bool:
        """Whether a crossing can have the change."""
        if isinstance(self.of, tuple):
            return trial in self.of
        return self.of == "all" or (self.of == "perturbed") == perturbed


def change_of(trial: str, seed: int, perturbed: bool, changes: Iterable[StepChange]) -> StepChange:
    """All changes of one crossing in one: factors multiply, the rest adds up."""
    found = [
        change
        for i, change in enumerate(changes)
        if change.concerns(trial, perturbed) and stream(seed, trial, f"change{i}").random() < change.share
    ]
    factors = {name: math.prod(c.factors[name] for c in found) for name in ("load", "amplitude")}
    terms = ("slower_percent", "after_window_percent", "second_foot_percent", "overhang_mm")
    sums = {name: sum(getattr(c, name) for c in found) for name in terms}
    return StepChange(of=(trial,), **factors, **sums)
