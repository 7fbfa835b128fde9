"""What crossings of a simulated campaign differ in by plan: direction, desired impedance, timing, person, session."""

from typing import Annotated, Literal

from pydantic import Field

from osl_analysis.simulator.effect import NotNegative, Positive
from osl_analysis.yaml_settings import Settings

Direction = Literal["up", "down"]
StatedColumn = Literal["K_d", "B_d", "direction", "subject", "session", "side", "group", "body_mass_kg"]


class Subject(Settings):
    """A person. What is left out is that of the gait laboratory's settings."""

    name: str
    """Name, as the sample sheet and the capture give it."""
    body_mass_kg: Positive | None = None
    """Body mass [kg]."""
    stance_s: Positive | None = None
    """Duration [s] of stance."""


class Conditions(Settings):
    """Lists of which each crossing gets one entry. An empty list leaves the settings of the gait laboratory.

    In n successive crossings, n being the number of combinations, each combination of direction, K_d, B_d and
    stance_phase occurs once, in a random order. Subjects and sessions follow each other in equal blocks.
    """

    directions: Annotated[tuple[Direction, ...], Field(min_length=1)] = ("up",)
    """Directions in which the platform turns: `up` (toes up, dorsiflexion) or `down`."""
    K_d: tuple[Positive, ...] = ()
    """Largest desired stiffness [N*m/rad]; the whole trajectory is scaled."""
    B_d: tuple[NotNegative, ...] = ()
    """Largest desired damping [N*m*s/rad]; the whole trajectory is scaled."""
    stance_phases: tuple[Annotated[float, Field(ge=0, lt=1)], ...] = ()
    """Mean phase of stance at which the ramp is commanded. It scatters as `perturbation.stance_phase` does."""
    subjects: tuple[Subject, ...] = ()
    """Persons who walk."""
    sessions: Annotated[int, Field(ge=1)] = 1
    """Number of sessions of each person. In each the markers of the leg are attached anew (`marker_placement`)."""
    side: Literal["left", "right"] = "right"
    """Side that the sheet states if `stated` has it. The simulated leg is the right one, whatever is stated."""
    stated: tuple[StatedColumn, ...] = ()
    """Columns of the sample sheet that state the condition of a crossing. Without them the sheet leaves it unsaid."""
