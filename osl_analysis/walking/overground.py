"""Overground gait from another laboratory: the ankle moment from the plate, compared with the laboratory's own.

Plug-in Gait gives the ankle's centre (TIO) and a second point (TIL) to its left on the tibia's mediolateral axis. Both
are stored like markers. Plug-in Gait's moment is the quasi-static moment about that axis, plus the effects of the
foot's weight and inertia.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.bodies import Mask, Side, marker_tracks
from osl_analysis.walking.plate import (
    Stance,
    ankle_torque,
    find_stances,
    recorded_corners,
    recorded_wrench,
    wrench_reader,
)
from osl_analysis.walking.settings import OvergroundAnalysis
from osl_analysis.walking.setup import body_mass

LETTERS_OF_SIDES: dict[Side, str] = {"left": "L", "right": "R"}


@dataclass(frozen=True)
class MomentComparison:
    """One stance on one plate: this package's ankle moment and the laboratory's reference (n,) [N*m/kg], plantarflexion
    positive, in n frames (n,) [s] in which both are known."""

    side: Side
    plate: int
    stance: Stance
    time: Array
    moment: Array
    reference: Array

    @property
    def correlation(self) -> float:
        return float(np.corrcoef(self.moment, self.reference)[0, 1])

    @property
    def slope(self) -> float:
        """Slope of a regression of the laboratory's moment on this package's, through zero."""
        return float(self.moment @ self.reference / (self.moment @ self.moment))


def overground_rows(
    trial: Trial, settings: OvergroundAnalysis, sheet_mass: float | None = None
) -> list[dict[str, object]]:
    """Rows of `ankle_moment.csv`, one per stance and plate; moments in N*m/kg, plantarflexion positive. `sheet_mass` is
    the body mass [kg] in the trial's row of the sheet."""
    check_no_downward_force(trial, settings.largest_zero_n)
    mass = body_mass(trial, sheet_mass, settings.body_mass_kg)
    if mass is None:
        raise InputError(
            f"trial {trial.name}: the recording states no body mass; state body_mass_kg in the sheet, or "
            "overground.body_mass_kg in the configuration"
        )
    rows = []
    for comparison in compare_moments(trial, mass, settings.load_on_n):
        peak = int(np.argmax(comparison.reference))
        rows.append(
            {
                "trial": trial.name,
                "body_mass_kg": mass,
                "side": comparison.side,
                "plate": comparison.plate,
                "heel_strike_s": comparison.stance.heel_strike,
                "toe_off_s": comparison.stance.toe_off,
                "frames": len(comparison.time),
                "correlation": comparison.correlation,
                "slope": comparison.slope,
                "reference_peak": float(comparison.reference[peak]),
                "moment_at_peak": float(comparison.moment[peak]),
            }
        )
    return rows


def compare_moments(trial: Trial, body_mass: float, load: float) -> list[MomentComparison]:
    """Every stance of the trial in which exactly one foot is over a plate, in order of side and plate, in N*m/kg.
    Frames count while the plate carries more than `load` [N]."""
    plates = [int(plate["plate"]) for plate in trial.provenance.get("plates", [])]
    sides = [side for side in LETTERS_OF_SIDES if f"reference_ankle_moment_{side}" in trial.samples.columns]
    if not sides or not plates:
        absent = "force plate" if sides else "column 'reference_ankle_moment_left'"
        raise InputError(
            f"trial {trial.name}: no {absent}; map the laboratory's moment and the plates in the source file"
        )
    stances = [c for side in sides for plate in plates for c in stances_on_plate(trial, side, plate, body_mass, load)]
    if not stances:
        raise InputError(
            f"trial {trial.name}: no foot stands on a plate with its ankle over it; check the plates' corners and "
            f"channels, or lower load_on_n from {load:g} N"
        )
    return stances


def check_no_downward_force(trial: Trial, largest_zero: float) -> None:
    """Refuse a plate whose vertical force is below minus `largest_zero` [N] in most of the recording: a foot cannot
    pull. An offset of the other sign looks like a standing person."""
    for plate in trial.provenance.get("plates", []):
        number = int(plate["plate"])
        reading = float(np.median(recorded_wrench(trial, number)[1][:, 2]))
        if reading < -largest_zero:
            raise InputError(
                f"trial {trial.name}: force plate {number} reads {reading:.0f} N in most of the recording, expected "
                f"more than {-largest_zero:g} N, because a foot cannot pull: the plate was not zeroed, has reached its "
                "limit, or has the other sign; record again, or remove the plate from `plates` in the source file"
            )


def stances_on_plate(trial: Trial, side: Side, plate: int, body_mass: float, load: float) -> Iterator[MomentComparison]:
    """The stances of one foot on one plate."""
    time, points = marker_tracks(trial, [f"{LETTERS_OF_SIDES[side]}TIO", f"{LETTERS_OF_SIDES[side]}TIL"])
    ankle, axis = points[:, 0], points[:, 1] - points[:, 0]
    wrench = wrench_reader(*recorded_wrench(trial, plate), time)(0.0)
    corners = recorded_corners(trial, plate)
    unit = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    moment = ankle_torque(wrench, corners.mean(axis=0), ankle, unit) / body_mass
    reference = trial.arrays(f"reference_ankle_moment_{side}")[1]
    known = np.isfinite(moment) & np.isfinite(reference) & (wrench[:, 2] > load)
    over = over_plate(ankle, corners)
    for stance in find_stances(time, wrench[:, 2], load, load, 0.3):
        inside = (time > stance.heel_strike) & (time < stance.toe_off)
        rows = known & inside
        if over[inside].mean() > 0.5 and rows.sum() > 2:
            yield MomentComparison(side, plate, stance, time[rows], moment[rows], reference[rows])


def over_plate(points: Array, corners: Array) -> Mask:
    """Whether points (n, 3) [m], seen from above, lie within the corners (4, 3) [m]; a NaN point does not."""
    edges = np.roll(corners, -1, axis=0) - corners
    away = points[:, None] - corners
    turn = edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0]
    return np.asarray((turn > 0).all(axis=1) | (turn < 0).all(axis=1))
