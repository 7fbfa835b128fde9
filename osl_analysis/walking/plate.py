# SPDX-License-Identifier: Apache-2.0
"""Step 3, plate: the recorded wrench of a force plate, its zero, its range, and the stance on it.

A wrench (n, 6) is force [N] and moment [N*m] about the centre of the plate's surface, in axes that
are the laboratory's at rest and turn with the plate.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import AXES, Array, Trial, plate_columns
from osl_analysis.ingest.force_plates import distance_from_plate, plate_axes
from osl_analysis.signals.filters import LowPass, runs, sampling_rate
from osl_analysis.walking.poses import FREE_FALL, SIZES_M, Mask
from osl_analysis.walking.walking_settings import CrossingSettings

FLAT = (0.15, 0.35)  # phases of stance in which the foot is flat, before a perturbation
SINGLE_SUPPORT = (0.2, 0.8)  # phases of stance between which one foot carries the body


@dataclass(frozen=True)
class Stance:
    """One contact of the foot with the plate, from heel strike to toe-off [s]."""

    heel_strike: float
    toe_off: float

    @property
    def duration(self) -> float:
        return self.toe_off - self.heel_strike

    def phase(self, time: Array) -> Array:
        """Times [s] as shares of the stance."""
        return (time - self.heel_strike) / self.duration

    def contains(self, time: Array) -> Mask:
        return between(time, (self.heel_strike, self.toe_off))


def between(values: Array, bounds: Sequence[float] | Array) -> Mask:
    """Which values, such as times or phases, lie between two bounds, or on one."""
    return (values >= bounds[0]) & (values <= bounds[1])


def find_stances(time: Array, force: Array, on: float, off: float, shortest: float) -> list[Stance]:
    """Find the complete stances in a vertical force.

    Parameters
    ----------
    time, force : Array
        Times (n,) [s] and vertical force (n,) [N].
    on, off : float
        A stance begins where the force rises through `on`, and ends where it falls through `off`
        <= `on` [N]. Both instants are interpolated between samples.
    shortest : float
        Shortest stance [s]; shorter contacts are ignored.
    """
    stances = []
    for contact in runs(force >= off):
        loaded = np.flatnonzero(force[contact] > on)
        is_whole = contact.start > 0 and contact.stop < len(force)
        if len(loaded) and is_whole:
            first = contact.start + loaded[0] - 1
            rise = slice(first, first + 2)
            fall = slice(contact.stop - 1, contact.stop + 1)
            heel_strike = np.interp(on, force[rise], time[rise])
            toe_off = np.interp(-off, -force[fall], time[fall])
            stances.append(Stance(heel_strike, toe_off))
    return [stance for stance in stances if stance.duration >= shortest]


def only_stance(time: Array, force: Array, settings: CrossingSettings) -> Stance:
    """Find the only stance in a vertical force (n,) [N].

    Raises
    ------
    InputError
        There is none, or more than one.
    """
    # half of the load that begins a stance ends it, so that noise ends none as it begins
    stances = find_stances(
        time, force, settings.load_on_n, settings.load_on_n / 2, settings.shortest_stance_s
    )
    if len(stances) != 1:
        times = ", ".join(f"{s.heel_strike:.3f}-{s.toe_off:.3f} s" for s in stances) or "none"
        raise InputError(
            f"one stance on the plate is expected, found {times}",
            "check the plate's number, zero and load thresholds, cut the recording to one"
            " crossing, or exclude it in the sheet",
        )
    return stances[0]


# At its largest value for this time a force is at the plate's limit; gait is never so constant
CLIPPED_S = 0.02
DEAD_S = 0.1  # of one value in a channel while the force on the plate changes
LARGEST_LOAD_N = 8000.0  # ten times the weight of 80 kg
LARGEST_GAIN_ERROR = 0.03  # of a standing person's weight: clothes and a scale leave 1 % each


WrenchReader = Callable[[float], Array]
"""The wrench (n, 6) at the marker frames, read later by a lag [s]."""


def recorded_wrench(trial: Trial, plate: int) -> tuple[Array, Array]:
    """Stamps (k,) [s] and wrench (k, 6) of a plate, counted from 1, as it was recorded."""
    stamps, *components = trial.signals(*plate_columns(plate))
    return stamps, np.column_stack(components)


def wrench_reader(time: Array, wrench: Array, frames: Array) -> WrenchReader:
    """Interpolate a wrench (k, 6) at marker frames (n,) [s].

    A low-pass at a third of the marker rate, or of the plate's if that is lower, prevents aliasing.
    It attenuates 20 Hz by less than 1e-5 at 300 Hz.
    """
    rate = sampling_rate(time)
    anti_alias = LowPass(min(sampling_rate(frames), rate) / 3)
    spline = scipy.interpolate.make_interp_spline(time, anti_alias(wrench, rate))
    return lambda lag: spline(np.clip(frames + lag, time[0], time[-1]))


def zeroed_wrench(trial: Trial, frames: Array, settings: CrossingSettings) -> WrenchReader:
    """Read the plate at marker frames (n,) [s], minus its zero.

    The zero is read where the force varies least before its maximum: after that, the plate may be
    tilted.

    Raises
    ------
    InputError
        Another plate is loaded, or this one from the start.
    """
    time, wrench = recorded_wrench(trial, settings.plate)
    check_no_other_is_loaded(trial, settings.plate, settings.load_on_n)
    if settings.unloaded_s is not None:
        length = round(settings.unloaded_s * sampling_rate(time))
        vertical = wrench[:, 2]
        before = vertical[: np.argmax(vertical) + 1]
        if len(before) < length:
            raise InputError(
                f"the plate is loaded within {settings.unloaded_s:g} s of the recording's start,"
                " so that its zero cannot be read",
                "start to record earlier, or set unloaded_s to null",
            )
        windows = np.lib.stride_tricks.sliding_window_view(before - before[0], length)
        start = np.argmin(np.var(windows, axis=1))
        wrench = wrench - wrench[start : start + length].mean(axis=0)
    return wrench_reader(time, wrench, frames)


def recorded_plate(trial: Trial, plate: int) -> Mapping[str, Any]:
    """What ingest found out about a plate; empty if the recording describes no such plate."""
    plates = trial.provenance.get("plates", [])
    return next((facts for facts in plates if facts["plate"] == plate), {})


def recorded_corners(trial: Trial, plate: int) -> Array:
    """Corners (4, 3) [m] of a plate at rest.

    Raises
    ------
    InputError
        There are none, their unit is wrong, or they stand on edge, so that z does not point up.
    """
    recorded = recorded_plate(trial, plate).get("corners")
    if not recorded:
        plates = trial.provenance.get("plates", [])
        numbers = ", ".join(str(facts["plate"]) for facts in plates) or "none"
        raise InputError(
            f"no corners of force plate {plate}",
            f"the recording has those of {numbers}. Correct `plate` in the configuration",
        )
    corners = np.asarray(recorded, dtype=float)
    size = np.linalg.norm(corners[0] - corners[2])
    if not SIZES_M[0] < size < SIZES_M[1]:
        raise InputError(
            f"force plate {plate} is {size:.3g} m from corner to corner, expected 0.03 to 5 m",
            "correct the unit of its corners",
        )
    return corners


def check_plate(trial: Trial, plate: int, stance: Stance, vertical: Array) -> None:
    """Refuse a plate with a clipped or dead raw channel in stance, or a force beyond a person's.

    Ingest has found when a channel was clipped, and when it repeated one value while the force on
    the plate changed. `vertical` is the force (n,) [N].
    """
    for facts in recorded_plate(trial, plate).get("channels", []):
        at_limit = f"stays at {facts['clipped_at']:.4g}"
        for run, least_s, fault, remedy in (
            ("clipped", CLIPPED_S, at_limit, "it has reached its limit; choose a larger range"),
            ("stands", DEAD_S, "repeats one value", "it is dead; mend the channel"),
        ):
            start, stop = facts[f"{run}_from_s"], facts[f"{run}_to_s"]
            if min(stop, stance.toe_off) - max(start, stance.heel_strike) >= least_s:
                raise InputError(
                    f"channel {facts['label']} of force plate {plate} {fault} from {start:.3f} s to"
                    f" {stop:.3f} s, while the force changes: {remedy} and record again, or exclude"
                    " the trial"
                )
    peak = vertical.max()
    if peak > LARGEST_LOAD_N:
        raise InputError(
            f"force plate {plate} reads up to {peak:.3g} N, expected less than"
            f" {LARGEST_LOAD_N:g} N under a person",
            "correct the unit of its forces (`plate_units` in the source file)",
        )


def check_weight(static: Trial, mass_kg: float | None) -> None:
    """Refuse a static trial whose plates do not carry the person that its row of the sheet states,
    `mass_kg`: a gain that is wrong is in all torques."""
    if mass_kg is None:
        return
    plates = [facts["plate"] for facts in static.provenance.get("plates", [])]
    load = sum(np.median(recorded_wrench(static, plate)[1][:, 2]) for plate in plates)
    share = load / (mass_kg * np.linalg.norm(FREE_FALL))
    if abs(share - 1) > LARGEST_GAIN_ERROR:
        raise InputError(
            f"the plates carry {share:.2f} of the weight of {mass_kg:g} kg that this row of the"
            f" sheet states, expected 1 within {LARGEST_GAIN_ERROR:g}: a plate's gain is wrong, or"
            " a part of the person stands beside the plates",
            "correct the gain in the recorder, and export all trials again; where the plates carry"
            " a part of the person, leave body_mass_kg of this row empty",
        )


OTHER_PLACE_M = 0.1  # between the centres of two plates


def check_place(corners: Array, plate: int, in_static: Mapping[int, Array]) -> None:
    """Refuse a plate that stands where another one stood in the static trial.

    `corners` (4, 3) [m] are those of the plate with the number `plate`.
    """
    centre = corners.mean(axis=0)
    moved_m = {
        number: np.linalg.norm(static.mean(axis=0) - centre) for number, static in in_static.items()
    }
    nearest = min(moved_m, key=moved_m.__getitem__, default=plate)
    if moved_m.get(plate, 0.0) > OTHER_PLACE_M > moved_m.get(nearest, 0.0):
        raise InputError(
            f"force plate {plate} stands where plate {nearest} stood in the static trial,"
            f" {100 * moved_m[plate]:.0f} cm from its own place: the recorder has numbered the"
            f" plates anew. Number them as before and export again, or analyse these trials with"
            f" their static and plate trials alone, with `walking.plate: {nearest}`"
        )


def check_type_on_platform(trial: Trial, plate: int) -> None:
    """Refuse a moving plate of type 1, which records the centre of pressure and no moment."""
    if recorded_plate(trial, plate).get("type") == 1:
        raise InputError(
            f"force plate {plate} is of type 1 (centre of pressure) on a"
            " moving platform: without its moments the plate's own inertia cannot be taken away",
            "export it as type 2, 3 or 4",
        )


def check_no_other_is_loaded(trial: Trial, plate: int, load: float) -> None:
    """Refuse a plate that bears less than `load` [N] where another one bears more."""
    bears = {}
    for facts in trial.provenance["plates"]:
        _, wrench = recorded_wrench(trial, facts["plate"])
        bears[facts["plate"]] = np.ptp(wrench[:, :3], axis=0).max()
    most = max(bears, key=bears.__getitem__)
    if bears[plate] < load < bears[most]:
        raise InputError(
            f"plate {plate} bears {bears[plate]:.0f} N at most, plate {most} {bears[most]:.0f} N:"
            f" state `walking.plate: {most}`, or exclude the trial if it alone misses the plate"
        )


def check_vertical(force: Array, least: float) -> None:
    """Refuse a load (n, 3) [N] of `least` [N] or more that does not act along +z."""
    load = force.T @ np.linalg.norm(force, axis=1)
    axis = np.argmax(np.abs(load))
    if load[2] >= abs(load[axis]) or np.abs(force).max() < least:
        return
    sign = "-" if load[axis] < 0 else "+"
    raise InputError(
        f"the load on the plate acts along {sign}{AXES[axis]} (up to"
        f" {np.abs(force[:, axis]).max():.0f} N), expected +z",
        "state `axes` in the source file, as [x, -z, y] where y points up; else correct the"
        " plate's channels or corners, of a C3D file in the recorder, and export again, of an"
        " exported plate by `sign` or `corners` in the source file",
    )


def outside(points: Array, corners: Array) -> Array:
    """Distances (k,) [m] of points (k, 3) [m] from the plate's edges, seen along its normal; 0 of
    those over it.

    Points are in laboratory axes.
    """
    on_surface = (points - corners.mean(axis=0)) @ plate_axes(corners)[:, :2]
    return distance_from_plate(on_surface, corners)
