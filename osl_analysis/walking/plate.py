"""The force plate on the moving platform: wrench, zero and range, and how the foot loads it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.spatial.transform import Rotation

from osl_analysis.columns import AXES, plate_columns
from osl_analysis.errors import InputError
from osl_analysis.plate_surface import plate_axes
from osl_analysis.signals import LowPass, longest_run, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.bodies import GRAVITY, Poses
from osl_analysis.walking.events import Stance
from osl_analysis.walking.settings import CrossingSettings

ANTI_ALIAS = 1 / 3  # Cut-off of the low-pass before resampling, as a fraction of the marker rate
LEVEL = 0.8  # Smallest vertical part of a plate's normal: ramps and stairs are less steep
CLIPPED_S = 0.02
"""A force that keeps its largest value for this time [s] has reached the plate's limit. Noise and gait never do so."""


@dataclass(frozen=True)
class PlateWrench:
    """Ground reaction on the foot: force (n, 3) [N], and moment (n, 3) [N*m] about the centre of the plate's
    surface."""

    force: Array
    moment: Array

    def __getitem__(self, rows: slice) -> "PlateWrench":
        return PlateWrench(self.force[rows], self.moment[rows])

    def __sub__(self, other: "PlateWrench") -> "PlateWrench":
        return PlateWrench(self.force - other.force, self.moment - other.moment)

    def filtered(self, low_pass: LowPass, rate: float) -> "PlateWrench":
        """The wrench through a low-pass, at the sampling `rate` [Hz]."""
        smooth = low_pass(self.components(), rate)
        return PlateWrench(smooth[:, :3], smooth[:, 3:])

    def components(self) -> Array:
        return np.hstack([self.force, self.moment])


@dataclass(frozen=True)
class RecordedWrench:
    """A plate's wrench at its own stamps (k,) [s], in axes that are the laboratory's at rest and turn with the
    plate."""

    time: Array
    wrench: PlateWrench

    def at_frames(self, marker_time: Array) -> "WrenchAtFrames":
        """The wrench for the marker frames (n,) [s]. A zero-phase low-pass at a third of the marker rate prevents
        aliasing, and attenuates a fifteenth of that rate (20 Hz at 300 Hz) by less than 1e-5."""
        anti_alias = LowPass(sampling_rate(marker_time) * ANTI_ALIAS)
        smooth = anti_alias(self.wrench.components(), sampling_rate(self.time))
        ends = float(self.time[0]), float(self.time[-1])
        return WrenchAtFrames(marker_time, make_interp_spline(self.time, smooth, k=3), ends)


@dataclass(frozen=True)
class WrenchAtFrames:
    """A plate's wrench without what would alias at the marker frames (n,) [s]: a spline of its components between two
    ends."""

    time: Array
    spline: BSpline
    ends: tuple[float, float]

    def late_by(self, lag: float) -> PlateWrench:
        """The wrench (n, 3) of a plate that is late by `lag` [s]: it is read that much later."""
        sampled = self.spline(np.clip(self.time + lag, *self.ends))
        return PlateWrench(sampled[:, :3], sampled[:, 3:])


def recorded_wrench(trial: Trial, plate: int) -> RecordedWrench:
    """The wrench that a plate, counted from 1, recorded."""
    signals = trial.signals(*plate_columns(plate, "force"), *plate_columns(plate, "moment"))
    values = np.column_stack(signals[1:])
    return RecordedWrench(signals[0], PlateWrench(values[:, :3], values[:, 3:]))


def zeroed_wrench(trial: Trial, settings: CrossingSettings) -> tuple[RecordedWrench, float | None]:
    """The plate's wrench minus its zero, and the vertical force [N] of the zero; None if no zero is removed."""
    recorded, zero_force = recorded_wrench(trial, settings.plate), None
    if settings.unloaded_s is not None:
        zero = unloaded_zero(recorded, settings.unloaded_s, settings.largest_zero_n)
        recorded, zero_force = RecordedWrench(recorded.time, recorded.wrench - zero), float(zero.force[0, 2])
    axes = plate_axes(recorded_corners(trial, settings.plate))
    check_range(recorded.time, recorded.wrench.force, axes, settings.load_on_n)
    return recorded, zero_force


def unloaded_zero(recorded: RecordedWrench, duration: float, largest: float) -> PlateWrench:
    """Mean wrench (one sample) of a plate over the `duration` [s], before the largest vertical force, in which that
    force varies least: gait is never as constant, and after the step the platform may be tilted."""
    length, vertical = round(duration * sampling_rate(recorded.time)), recorded.wrench.force[:, 2]
    before = vertical[: int(np.argmax(vertical)) + 1]
    if len(before) < length:
        raise InputError(
            f"the plate is loaded within {duration:g} s of the recording's start, so that its zero cannot be read; "
            "start to record earlier, or set unloaded_s to null"
        )
    windows = np.lib.stride_tricks.sliding_window_view(before - before[0], length)
    start = int(np.argmin(np.var(windows, axis=1)))
    unloaded = recorded.wrench[slice(start, start + length)]
    zero = PlateWrench(*(part.mean(axis=0, keepdims=True) for part in (unloaded.force, unloaded.moment)))
    if abs(zero.force[0, 2]) > largest:
        raise InputError(
            f"the unloaded plate reads {zero.force[0, 2]:.0f} N, expected less than {largest:g} N: it was not zeroed "
            "or has reached its limit; zero it and record again, exclude the trial, or raise largest_zero_n"
        )
    return zero


def check_range(time: Array, force: Array, axes: Array, load: float) -> None:
    """Refuse a force (n, 3) [N] that stays at its extreme, above `load`, in one of the plate's `axes` (3, 3), columns.
    For recordings without raw channels, as CSV files of Nexus: `check_plate` sees those of a C3D file."""
    rate = sampling_rate(time)
    longest = max(round(CLIPPED_S * rate), 3)
    for name, component in zip("xyz", (force @ axes).T, strict=True):
        for extreme in (float(component.max()), float(component.min())):
            run = longest_run(np.abs(component - extreme) <= 1e-6 * abs(extreme))
            if abs(extreme) > load and run.stop - run.start >= longest:
                raise InputError(
                    f"the plate's F{name} stays at {abs(extreme):.0f} N for {1e3 * (run.stop - run.start) / rate:.0f} "
                    f"ms until {time[run.stop - 1]:.3f} s: it has reached its limit; choose a larger range, or exclude "
                    "the trial"
                )


def recorded_corners(trial: Trial, plate: int) -> Array:
    """Corners (4, 3) [m] of a plate at rest; refused if the plate stands on edge, so that z does not point up."""
    corners = recorded_plate(trial, plate).get("corners")
    if not corners:
        numbers = ", ".join(str(p["plate"]) for p in trial.provenance.get("plates", [])) or "none"
        raise InputError(
            f"trial {trial.name}: no corners of force plate {plate}; the recording has those of {numbers}. Correct "
            "`plate` in the configuration"
        )
    found = np.asarray(corners, dtype=float)
    across = np.abs(plate_axes(found)[:, 2])
    if across[2] < LEVEL:
        axis = AXES[int(np.argmax(across))]
        remedy = "`axes: [x, -z, y]`" if axis == "y" else "`axes`"
        raise InputError(
            f"trial {trial.name}: the corners of force plate {plate} stand on edge, across the {axis} axis: z does not "
            f"point up; state {remedy} in the source file"
        )
    return found


def in_laboratory(wrench: PlateWrench, platform: Poses, centre: Array) -> tuple[PlateWrench, Array]:
    """The wrench in laboratory axes, from the plate's own, which are the laboratory's at rest, and the plate's centre
    (n, 3) [m], about which its moment acts; `centre` (3,) [m] is that of the surface at rest."""
    force = np.einsum("nij,nj->ni", platform.rotation, wrench.force)
    moment = np.einsum("nij,nj->ni", platform.rotation, wrench.moment)
    return PlateWrench(force, moment), platform.point(centre)


def rotation_from_rest(platform: Poses) -> Array:
    """Angle (n,) [rad] by which the platform is turned from its pose in the static trial, about the axis of the largest
    rotation, which counts as positive; NaN where not seen. It is signed, so that marker noise has zero mean."""
    seen = np.flatnonzero(platform.seen())
    angle = np.full(len(platform.position), np.nan)
    if not len(seen):
        return angle
    vectors = Rotation.from_matrix(platform.rotation[seen]).as_rotvec()
    size = np.linalg.norm(vectors, axis=1)
    largest = int(np.argmax(size))
    angle[seen] = vectors @ vectors[largest] / max(float(size[largest]), np.finfo(float).tiny)
    return angle


def ankle_torque(reaction: PlateWrench, plate_centre: Array, ankle: Array, axis: Array) -> Array:
    """Internal plantarflexion moment tau (n,) [N*m] from the ground reaction on the foot. tau = -(M + (c - a) x F) .
    axis, with the force F and the moment M about the plate's centre c (n, 3) or (3,) [m], the ankle a (n, 3) [m], and
    the axis (n, 3) to the left. The centre of pressure is not used: an unloaded plate has none."""
    about_ankle = reaction.moment + np.cross(plate_centre - ankle, reaction.force)
    return np.asarray(-np.sum(about_ankle * axis, axis=1))


STANDS_S = 0.1  # A raw channel that repeats one value for this time [s] while the force changes is dead
LARGEST_FORCE = 8000.0  # Vertical force [N] that no walking person causes: ten times the weight of 80 kg


def check_plate(trial: Trial, plate: int, stance: Stance, vertical: Array) -> None:
    """Refuse a plate whose raw channels fail in a stance, or whose vertical force (n,) [N] is not one of a person."""
    for facts in recorded_plate(trial, plate).get("channels", []):
        check_channel(plate, facts, stance)
    peak = float(vertical.max())
    if peak > LARGEST_FORCE:
        raise InputError(
            f"force plate {plate} reads up to {peak:.3g} N, expected less than {LARGEST_FORCE:g} N under a person; "
            "correct the unit of its forces (`plate_units` in the source file)"
        )


def check_channel(plate: int, facts: Mapping[str, Any], stance: Stance) -> None:
    """Refuse a raw channel of a plate, with the facts that ingest found, that is clipped in the stance or dead."""
    name = f"channel {facts['label']} of force plate {plate}"
    if shared_time(facts, "clipped", stance) >= CLIPPED_S:
        raise InputError(
            f"{name} stays at {facts['clipped_at']:.4g} from {facts['clipped_from_s']:.3f} s to "
            f"{facts['clipped_to_s']:.3f} s: it has reached its limit; choose a larger range and record again, or "
            "exclude the trial"
        )
    if shared_time(facts, "stands", stance) >= STANDS_S:
        raise InputError(
            f"{name} repeats one value from {facts['stands_from_s']:.3f} s to {facts['stands_to_s']:.3f} s while the "
            "force on the plate changes: it is dead; mend the channel and record again, or exclude the trial"
        )


def shared_time(facts: Mapping[str, Any], run: str, stance: Stance) -> float:
    """Time [s] that a run of a channel's facts, `clipped` or `stands`, shares with the stance."""
    if not facts[f"{run}_samples"]:
        return 0.0
    first, last = facts[f"{run}_from_s"], facts[f"{run}_to_s"]
    return float(min(last, stance.toe_off) - max(first, stance.heel_strike))


def check_type_on_platform(trial: Trial, plate: int) -> None:
    """Refuse a plate of type 1 on a platform that moves: it records the centre of pressure instead of the moment."""
    if recorded_plate(trial, plate).get("type") == 1:
        raise InputError(
            f"trial {trial.name}: force plate {plate} is of type 1 (centre of pressure) on a moving platform: "
            "without its moments the plate's own inertia cannot be taken away; export it as type 2, 3 or 4"
        )


def recorded_plate(trial: Trial, plate: int) -> Mapping[str, Any]:
    """What the recording states of a plate; empty where it describes no such plate."""
    found = [facts for facts in trial.provenance.get("plates", []) if facts["plate"] == plate]
    return found[0] if found else {}


PRESSED = 100.0  # Vertical force [N] from which there is a centre of pressure
SINGLE_SUPPORT = (0.2, 0.8)  # Phases of stance in which one foot carries the body


@dataclass(frozen=True)
class Load:
    """Ground reaction on the foot in a crossing, n samples: vertical force (n,) [N], and the centre of pressure (n,)
    [m] to the left of the ankle along its axis, 0 while the force is below 100 N."""

    force: Array
    left: Array


def load_on_foot(reaction: PlateWrench, centre: Array, ankle: Array, axis: Array) -> Load:
    """Load from the reaction about the plate's centre (n, 3) [m], the ankle (n, 3) [m] and its axis (n, 3) to the
    left."""
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
