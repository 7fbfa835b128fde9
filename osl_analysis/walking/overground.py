"""Overground gait from another laboratory: the ankle moment from the plate, beside the laboratory's own.

Plug-in Gait gives the ankle's centre (TIO) and a second point (TIL) to its left on the tibia's mediolateral axis; both
are stored like markers. Its moment is quasi-static about that axis but for the foot's weight and inertia.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import Side, ankle_torque
from osl_analysis.walking.events import Stance, find_stances
from osl_analysis.walking.moving_plate import Wrench, at_marker_times
from osl_analysis.walking.segments import marker_tracks, plate_corners, plate_wrench

SIDES: dict[Side, str] = {"left": "L", "right": "R"}
SHORTEST_STANCE_S = 0.3
ON_PLATE = 0.5
"""A stance belongs to the foot whose ankle is over the plate in more than this share of its frames."""


@dataclass(frozen=True)
class MomentComparison:
    """One stance on one plate: our ankle moment beside the laboratory's, both [N*m/kg], plantarflexion positive.

    `time` [s], `moment` and `reference` (n,) in the frames in which the plate is loaded and both are known.
    """

    side: Side
    plate: int
    stance: Stance
    time: Array
    moment: Array
    reference: Array

    @property
    def correlation(self) -> float:
        """Correlation of the two."""
        return float(np.corrcoef(self.moment, self.reference)[0, 1])

    @property
    def slope(self) -> float:
        """The laboratory's moment over ours, by least squares through zero."""
        return float(self.moment @ self.reference / (self.moment @ self.moment))

    @property
    def peak(self) -> int:
        """Frame at which the laboratory's moment is largest."""
        return int(np.argmax(self.reference))


def compare_moments(trial: Trial, body_mass: float, load: float) -> list[MomentComparison]:
    """Every stance of the trial in which one foot alone is over a plate, in order of side and plate.

    `body_mass` [kg] divides our moment; frames count while the plate carries more than `load` [N].

    Raises
    ------
    InputError
        The trial has no reference moment or no ankle points, or no foot is ever over a plate.
    """
    plates = [int(plate["plate"]) for plate in trial.provenance.get("plates", [])]
    sides = [side for side in SIDES if reference_column(side) in trial.samples.columns]
    if not sides or not plates:
        lacks = f"column '{reference_column('left')}'" if not sides else "force plate"
        raise InputError(
            f"trial {trial.name}: no {lacks}; map the laboratory's moment and the plates in the source file"
        )
    found = [c for side in sides for plate in plates for c in stances_of(trial, side, plate, body_mass, load)]
    if not found:
        raise InputError(
            f"trial {trial.name}: no foot stands on a plate with its ankle over it; check the plates' corners and "
            f"channels, or lower load_on_n from {load:g} N"
        )
    return found


def check_plates(trial: Trial, largest_zero: float) -> None:
    """Refuse a plate whose vertical force is below minus `largest_zero` [N] in most of the record: a foot never pulls.

    An offset upwards is not found here: it looks like somebody who stands.

    Raises
    ------
    InputError
        Names the plate and what it reads.
    """
    for plate in trial.provenance.get("plates", []):
        number = int(plate["plate"])
        reading = float(np.median(plate_wrench(trial, number)[1].force[:, 2]))
        if reading < -largest_zero:
            raise InputError(
                f"trial {trial.name}: force plate {number} reads {reading:.0f} N in most of the record, as if a foot "
                "pulled it up: it was not zeroed, has reached its limit or is wired with the other sign; record again, "
                "or leave the plate out under `plates` in the source file"
            )


def reference_column(side: Side) -> str:
    """Column of the laboratory's own ankle moment."""
    return f"reference_ankle_moment_{side}"


def stances_of(trial: Trial, side: Side, plate: int, body_mass: float, load: float) -> Iterator[MomentComparison]:
    """The stances of one foot on one plate."""
    time, points = marker_tracks(trial, [f"{SIDES[side]}TIO", f"{SIDES[side]}TIL"])
    ankle, axis = points[:, 0], points[:, 1] - points[:, 0]
    plate_time, measured = plate_wrench(trial, plate)
    wrench = at_marker_times(plate_time, measured, time)
    corners = plate_corners(trial, plate)
    moment = moment_per_mass(wrench, corners.mean(axis=0), ankle, axis, body_mass)
    reference = trial.sampled(reference_column(side))[reference_column(side)].to_numpy()
    known = np.isfinite(moment) & np.isfinite(reference) & (wrench.force[:, 2] > load)
    over = over_plate(ankle, corners)
    for stance in find_stances(time, wrench.force[:, 2], load, load, SHORTEST_STANCE_S):
        inside = (time > stance.heel_strike) & (time < stance.toe_off)
        rows = known & inside
        if over[inside].mean() > ON_PLATE and rows.sum() > 2:
            yield MomentComparison(side, plate, stance, time[rows], moment[rows], reference[rows])


def moment_per_mass(wrench: Wrench, centre: Array, ankle: Array, axis: Array, body_mass: float) -> Array:
    """Ankle moment (n,) [N*m/kg] about `axis` (n, 3), of any length, that points to the left."""
    unit = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    return ankle_torque(wrench.force, wrench.moment, centre, ankle, unit) / body_mass


def over_plate(points: Array, corners: Array) -> np.ndarray:
    """Whether points (n, 3) [m] lie over the quadrilateral of the corners (4, 3) [m], seen from above; NaN does not."""
    edges = np.roll(corners, -1, axis=0) - corners
    away = points[:, None] - corners
    turn = edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0]
    return np.asarray((turn > 0).all(axis=1) | (turn < 0).all(axis=1))
