"""Overground gait from another laboratory: the ankle moment from the plate, compared with the laboratory's own.

Plug-in Gait stores the ankle's centre (TIO) and a point to its left on the tibia's mediolateral axis (TIL) as markers.
Its moment is the quasi-static moment about that axis, plus the effects of the foot's weight and inertia."""

from itertools import product

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Trial
from osl_analysis.walking import plate as plates
from osl_analysis.walking.bodies import marker_tracks
from osl_analysis.walking.crossing import body_mass
from osl_analysis.walking.settings import OvergroundAnalysis


def overground_rows(
    trial: Trial, settings: OvergroundAnalysis, sheet_mass: float | None = None
) -> list[dict[str, object]]:
    """Rows of `ankle_moment.csv`: every stance in which exactly one foot is over a plate, in order of side and plate;
    moments in N*m/kg, plantarflexion positive. `sheet_mass` is the body mass [kg] in the trial's row of the sheet."""
    numbers = [int(plate["plate"]) for plate in trial.provenance.get("plates", [])]
    for number in numbers:  # An offset of the other sign looks like a standing person
        reading = float(np.median(plates.recorded_wrench(trial, number)[1][:, 2]))
        if reading < -settings.largest_zero_n:
            raise InputError(
                f"trial {trial.name}: force plate {number} reads {reading:.0f} N in most of the recording, expected "
                f"more than {-settings.largest_zero_n:g} N, because a foot cannot pull: the plate was not zeroed, has "
                "reached its limit, or has the other sign; record again, or remove the plate from `plates` in the "
                "source file"
            )
    mass, load = body_mass(trial, sheet_mass, settings.body_mass_kg), settings.load_on_n
    if mass is None:
        raise InputError(
            f"trial {trial.name}: the recording states no body mass; state body_mass_kg in the sheet, or "
            "overground.body_mass_kg in the configuration"
        )
    sides = [side for side in ("left", "right") if f"reference_ankle_moment_{side}" in trial.samples.columns]
    if not sides or not numbers:
        absent = "force plate" if sides else "column 'reference_ankle_moment_left'"
        raise InputError(
            f"trial {trial.name}: no {absent}; map the laboratory's moment and the plates in the source file"
        )
    rows = list[dict[str, object]]()
    for side, plate in product(sides, numbers):
        time, points = marker_tracks(trial, [f"{side[0].upper()}TIO", f"{side[0].upper()}TIL"])
        ankle, axis = points[:, 0], points[:, 1] - points[:, 0]
        wrench = plates.wrench_reader(*plates.recorded_wrench(trial, plate), time)(0.0)
        corners = plates.recorded_corners(trial, plate)
        unit = axis / np.linalg.norm(axis, axis=1, keepdims=True)
        own = plates.ankle_torque(wrench, corners.mean(axis=0), ankle, unit) / mass
        laboratory = trial.arrays(f"reference_ankle_moment_{side}")[1]
        known = np.isfinite(own) & np.isfinite(laboratory) & (wrench[:, 2] > load)
        # Over the plate, seen from above: on the same side of each edge; a NaN point is not
        edges, away = np.roll(corners, -1, axis=0) - corners, ankle[:, None] - corners
        turn = edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0]
        over = np.asarray((turn > 0).all(axis=1) | (turn < 0).all(axis=1))
        for stance in plates.find_stances(time, wrench[:, 2], load, load, 0.3):
            inside = (time > stance.heel_strike) & (time < stance.toe_off)
            used = known & inside
            if over[inside].mean() > 0.5 and used.sum() > 2:
                moment, reference = own[used], laboratory[used]
                peak = int(np.argmax(reference))
                row: dict[str, object] = {
                    "trial": trial.name,
                    "body_mass_kg": mass,
                    "side": side,
                    "plate": plate,
                    "heel_strike_s": stance.heel_strike,
                    "toe_off_s": stance.toe_off,
                    "frames": len(moment),
                    "correlation": float(np.corrcoef(moment, reference)[0, 1]),
                    "slope": float(moment @ reference / (moment @ moment)),
                    "reference_peak": float(reference[peak]),
                    "moment_at_peak": float(moment[peak]),
                }
                rows.append(row)
    if not rows:
        raise InputError(
            f"trial {trial.name}: no foot stands on a plate with its ankle over it; check the plates' corners and "
            f"channels, or lower load_on_n from {load:g} N"
        )
    return rows
