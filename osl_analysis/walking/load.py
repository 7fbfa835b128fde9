"""How the foot loads the plate: its share of the weight, and where centre of pressure and foot lie."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.trial import Array
from osl_analysis.walking.cluster import GRAVITY
from osl_analysis.walking.events import Stance
from osl_analysis.walking.plate import PlateWrench

PRESSED = 100.0
"""Vertical force [N] from which there is a centre of pressure."""
SINGLE_SUPPORT = (0.2, 0.8)
"""Phases of stance in which one foot carries the body."""


@dataclass(frozen=True)
class Load:
    """Ground reaction on the foot in a crossing, n samples.

    force: vertical force (n,) [N].
    left: centre of pressure (n,) [m] to the left of the ankle, along its axis; 0 while the force is below 100 N.
    """

    force: Array
    left: Array


def load_on_foot(reaction: PlateWrench, centre: Array, ankle: Array, axis: Array) -> Load:
    """Load from the reaction about the plate's centre (n, 3) [m], the ankle (n, 3) [m] and its axis (n, 3), which
    points to the left, all in laboratory axes."""
    vertical = reaction.force[:, 2]
    up = np.array([0.0, 0.0, 1.0])
    pressed = vertical > PRESSED
    pressure = centre + np.cross(up, reaction.moment) / np.where(pressed, vertical, 1.0)[:, None]
    return Load(vertical, np.where(pressed, np.sum((pressure - ankle) * axis, axis=1), 0.0))


def load_of_weight(time: Array, vertical: Array, stance: Stance, body_mass: float | None) -> float | None:
    """Mean vertical force (n,) [N] in single support, as a share of the weight; None if the mass [kg] is unknown."""
    if body_mass is None:
        return None
    phase = (time - stance.heel_strike) / stance.duration
    inside = (phase >= SINGLE_SUPPORT[0]) & (phase <= SINGLE_SUPPORT[1])
    return float(vertical[inside].mean() / (body_mass * np.linalg.norm(GRAVITY)))
