"""Force plates: their raw channels, and the centre of pressure, which lies on the plate while somebody stands on it."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from osl_analysis.columns import plate_columns
from osl_analysis.plate_surface import beside, plate_axes
from osl_analysis.quality.checks import Check, CheckResult, Examined, not_applicable
from osl_analysis.trial import Array, Trial

PRESSED = 100.0
"""Vertical force [N] from which a plate has a centre of pressure; below, noise and a moving platform shift it."""
FEWEST_PRESSED = 10  # fewest samples under load from which a plate is judged
OFTEN = 95.0  # percentile of the distances that is judged: the first and last samples of a stance are inexact
ROLLS = 0.02  # way [m] of the centre of pressure under a rolling foot, at least
NO_LOAD = "no plate is stood on"
NO_WALKER = "nobody stands on a plate"


@dataclass(frozen=True)
class PlateRecord:
    """What one plate recorded. force, moment: (n, 3) [N, N*m]; corners: (4, 3) [m], all in laboratory axes at rest."""

    number: int
    corners: Array
    force: Array
    moment: Array

    @cached_property
    def pressure_centre(self) -> Array:
        """Centre of pressure (k, 2) [m] from the plate's centre along its edges, in the samples under load."""
        axes = plate_axes(self.corners)
        normal = axes[:, 2]
        vertical = self.force @ normal
        loaded = vertical > PRESSED
        point = np.cross(normal, self.moment[loaded]) / vertical[loaded, None]
        return np.asarray(point @ axes[:, :2])

    def outside(self, pressure_centre: Array) -> float:
        """Distance [m] of the 5 % of points (k, 2) that lie furthest outside the plate; 0 inside."""
        return float(np.percentile(beside(pressure_centre, self.corners), OFTEN))


def plates_of(trial: Trial) -> Iterator[PlateRecord]:
    """The plates of a trial whose corners and columns are known."""
    for plate in trial.provenance.get("plates", []):
        number = int(plate["plate"])
        columns = [*plate_columns(number, "force"), *plate_columns(number, "moment")]
        if not set(columns) <= set(trial.samples.columns):
            continue
        values = trial.sampled(*columns).select(columns).to_numpy()
        yield PlateRecord(number, np.array(plate["corners"], dtype=float), values[:, :3], values[:, 3:])


def measure_pressure_centre(examined: Examined) -> CheckResult:
    """Largest distance [m] by which a centre of pressure lies outside its plate under load."""
    distances, remarks = {}, []
    for plate in plates_of(examined.trial):
        points = plate.pressure_centre
        if len(points) < FEWEST_PRESSED:
            continue
        distances[plate.number] = plate.outside(points)
        remarks += plate_remarks(plate, points, distances[plate.number])
    if not distances:
        return not_applicable(NO_LOAD)
    return CheckResult(max(distances.values()), "; ".join(remarks))


def plate_remarks(plate: PlateRecord, points: Array, distance: float) -> list[str]:
    """What is likely wrong with a plate whose centre of pressure (k, 2) lies outside."""
    remarks, name = [], f"plate{plate.number}"
    if distance > 0 and plate.outside(points / 1000) == 0 and travel(points / 1000) > ROLLS:
        remarks.append(
            f"{name}: the centre of pressure is {distance:.3g} m outside: its moments look a thousand times too large; "
            "state `plate_units` in the source file, as {force: N, moment: N*mm}"
        )
    elif distance > 0:
        remarks.append(
            f"{name}: the centre of pressure is {distance:.3g} m outside: a moment channel is dead, clipped or of the "
            "other sign, or the corners are wrong"
        )
    return remarks


def measure_pressure_travel(examined: Examined) -> CheckResult:
    """Shortest way [m] that the centre of pressure covers under a loaded plate, from its 5th to its 95th percentile."""
    ways = {}
    for plate in plates_of(examined.trial):
        if len(plate.pressure_centre) >= FEWEST_PRESSED:
            ways[plate.number] = travel(plate.pressure_centre)
    if not ways:
        return not_applicable(NO_LOAD)
    number = min(ways, key=lambda plate: ways[plate])
    return CheckResult(
        ways[number], f"plate{number}: if it stands still, the moments are dead or a thousand times too small"
    )


def travel(points: Array) -> float:
    """Way [m] of points (k, 2) from their 5th to their 95th percentile."""
    low, high = np.percentile(points, [100 - OFTEN, OFTEN], axis=0)
    return float(np.hypot(*(high - low)))


PLATE_CHECKS = (
    Check("pressure_centre", "m", "above",
        "distance by which the centre of pressure of a loaded plate lies outside the plate", measure_pressure_centre,
        applies_to=lambda experiment: experiment.walker, otherwise=NO_WALKER),
    Check("pressure_travel", "m", "below",
        "way of the centre of pressure over a loaded plate; a foot rolls over 0.1 m and more", measure_pressure_travel,
        applies_to=lambda experiment: experiment.walker and bool(experiment.tables),
        otherwise="nobody walks over a plate"),
)  # fmt: skip
