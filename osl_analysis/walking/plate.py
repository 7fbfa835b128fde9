"""The force plate on the moving platform: stances, wrench, zero and range; and its own inertia and
lag.

A wrench (n, 6) is force [N] and moment [N*m] about the centre of the plate's surface, in axes that
are the laboratory's at rest and turn with the plate. The plate's own inertia causes a wrench in its
sensors, which is linear in its inertial parameters. These are identified from trials of the
unloaded, moving platform. After the zero has removed the weight,

    F = m a' + z x mc + w x (w x mc),    M = mc x a' + I z + w x I w,    a' = R^T (a - g) + g,

where m is the mass, mc mass times centre of mass, I the inertia about the plate's centre, a the
acceleration of that centre, w the angular velocity and z the angular acceleration.

A lag d of the torque behind the angle changes the damping by -K d. Walking data do not show it,
because the VAF does not change. The unloaded plate shows it: its inertial force and its
acceleration must peak at the same time."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.errors import IdentifiabilityError, InputError, naming
from osl_analysis.signals import LowPass, longest_run, runs, sampling_rate
from osl_analysis.trial import AXES, Array, Trial, plate_axes, plate_columns
from osl_analysis.walking import bodies, platform
from osl_analysis.walking.bodies import BodyMotion, Kept, StaticCalibration, cross_matrix
from osl_analysis.walking.settings import CrossingSettings, PlateModelSettings


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


def find_stances(time: Array, force: Array, on: float, off: float, shortest: float) -> list[Stance]:
    """Complete stances of at least `shortest` [s] in a vertical force (n,) [N], from where it rises
    through `on` [N] to where it falls through `off` <= `on`, between samples. A NaN keeps the last
    known state."""

    def passed(row: int, level: float) -> float:
        """Time between a row and the next at which the force passes a level; the later row's if one
        is NaN."""
        before, after = force[row], force[row + 1]
        if not np.isfinite(before + after) or before == after:
            return float(time[row + 1])
        share = np.clip((level - before) / (after - before), 0.0, 1.0)
        return float(time[row] + share * (time[row + 1] - time[row]))

    level = np.where(force > on, 1, np.where(force < off, -1, 0))
    known = np.maximum.accumulate(np.where(level != 0, np.arange(len(level)), -1))
    change = np.diff(((known >= 0) & (level[known] == 1)).astype(int))
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    ends = ends[ends > starts[0]] if len(starts) else ends[:0]
    stances = [
        Stance(passed(s, on), passed(e, off))
        for s, e in zip(starts.tolist(), ends.tolist(), strict=False)
    ]
    return [s for s in stances if s.duration >= shortest]


def recorded_wrench(trial: Trial, plate: int) -> tuple[Array, Array]:
    """Stamps (k,) [s] and wrench (k, 6) of a plate, counted from 1, as it was recorded."""
    signals = trial.signals(*plate_columns(plate, "force"), *plate_columns(plate, "moment"))
    return signals[0], np.column_stack(signals[1:])


def wrench_reader(time: Array, wrench: Array, frames: Array) -> Callable[[float], Array]:
    """The wrench (n, 6) at marker frames (n,) [s], as a function of the plate's lag [s]: it is read
    later by the lag. A low-pass at a third of the marker rate prevents aliasing. It attenuates 20
    Hz by less than 1e-5 at 300 Hz."""
    anti_alias = LowPass(sampling_rate(frames) / 3)
    spline = scipy.interpolate.make_interp_spline(
        time, anti_alias(wrench, sampling_rate(time)), k=3
    )
    return lambda lag: np.asarray(spline(np.clip(frames + lag, time[0], time[-1])))


def zeroed_wrench(
    trial: Trial, frames: Array, settings: CrossingSettings
) -> tuple[Callable[[float], Array], float | None]:
    """The `wrench_reader` of the plate minus its zero, and the zero's vertical force [N]; None if
    no zero is removed. The zero is read where the force varies least before its maximum: after
    that, the plate may be tilted."""
    (time, wrench), removed = recorded_wrench(trial, settings.plate), None
    if settings.unloaded_s is not None:
        length, vertical = round(settings.unloaded_s * sampling_rate(time)), wrench[:, 2]
        before = vertical[: int(np.argmax(vertical)) + 1]
        if len(before) < length:
            raise InputError(
                f"the plate is loaded within {settings.unloaded_s:g} s of the recording's start, so"
                " that its zero cannot be read; start to record earlier, or set unloaded_s to null"
            )
        windows = np.lib.stride_tricks.sliding_window_view(before - before[0], length)
        start = int(np.argmin(np.var(windows, axis=1)))
        zero: Array = wrench[start : start + length].mean(axis=0)
        if abs(zero[2]) > settings.largest_zero_n:
            raise InputError(
                f"the unloaded plate reads {zero[2]:.0f} N, expected less than"
                f" {settings.largest_zero_n:g} N: it was not zeroed or has reached its limit; zero"
                " it and record again, exclude the trial, or raise largest_zero_n"
            )
        wrench, removed = wrench - zero, float(zero[2])
    check_range(
        time, wrench[:, :3], plate_axes(recorded_corners(trial, settings.plate)), settings.load_on_n
    )
    return wrench_reader(time, wrench, frames), removed


# time [s] at its largest value from which a force is at the plate's limit; gait is never so
# constant
CLIPPED_S = 0.02


def check_range(time: Array, force: Array, axes: Array, load: float) -> None:
    """Refuse a force (n, 3) [N] that stays at its extreme, above `load`, in one of the plate's
    `axes` (3, 3), columns. For recordings without raw channels, as CSV files of Nexus:
    `check_plate` sees those of a C3D file."""
    rate = sampling_rate(time)
    longest = max(round(CLIPPED_S * rate), 3)
    for name, component in zip("xyz", (force @ axes).T, strict=True):
        for extreme in (float(component.max()), float(component.min())):
            run = longest_run(np.abs(component - extreme) <= 1e-6 * abs(extreme))
            if abs(extreme) > load and run.stop - run.start >= longest:
                raise InputError(
                    f"the plate's F{name} stays at {abs(extreme):.0f} N for"
                    f" {1e3 * (run.stop - run.start) / rate:.0f} ms until {time[run.stop - 1]:.3f}"
                    " s: it has reached its limit; choose a larger range, or exclude the trial"
                )


def recorded_plate(trial: Trial, plate: int) -> Mapping[str, Any]:
    """The recording's facts on a plate; empty if it describes no such plate."""
    return next(
        (facts for facts in trial.provenance.get("plates", []) if facts["plate"] == plate), {}
    )


def recorded_corners(trial: Trial, plate: int) -> Array:
    """Corners (4, 3) [m] of a plate at rest; refused if the plate stands on edge, so that z does
    not point up."""
    corners = recorded_plate(trial, plate).get("corners")
    if not corners:
        numbers = ", ".join(str(p["plate"]) for p in trial.provenance.get("plates", [])) or "none"
        raise InputError(
            f"trial {trial.name}: no corners of force plate {plate}; the recording has those of"
            f" {numbers}. Correct `plate` in the configuration"
        )
    found = np.asarray(corners, dtype=float)
    size = float(np.linalg.norm(found[0] - found[2]))
    if not 0.1 < size < 5:
        raise InputError(
            f"trial {trial.name}: force plate {plate} is {size:.3g} m from corner to corner,"
            " expected 0.1 to 5 m; correct the unit of its corners"
        )
    across = np.abs(plate_axes(found)[:, 2])
    if across[2] < 0.8:  # ramps and stairs are less steep
        axis = AXES[int(np.argmax(across))]
        remedy = "`axes: [x, -z, y]`" if axis == "y" else "`axes`"
        raise InputError(
            f"trial {trial.name}: the corners of force plate {plate} stand on edge, across the"
            f" {axis} axis: z does not point up; state {remedy} in the source file"
        )
    return found


def check_plate(trial: Trial, plate: int, stance: Stance, vertical: Array) -> None:
    """Refuse a plate whose raw channels are clipped or dead (one value for 0.1 s while the force
    changes) in a stance, by the facts that ingest found, or whose vertical force (n,) [N] is not
    one of a person."""
    for facts in recorded_plate(trial, plate).get("channels", []):
        name = f"channel {facts['label']} of force plate {plate}"
        clipped, stands = (  # time [s] that a run of the channel shares with the stance
            (
                min(facts[f"{run}_to_s"], stance.toe_off)
                - max(facts[f"{run}_from_s"], stance.heel_strike)
                if facts[f"{run}_samples"]
                else 0.0
            )
            for run in ("clipped", "stands")
        )
        if clipped >= CLIPPED_S:
            raise InputError(
                f"{name} stays at {facts['clipped_at']:.4g} from {facts['clipped_from_s']:.3f} s to"
                f" {facts['clipped_to_s']:.3f} s: it has reached its limit; choose a larger range"
                " and record again, or exclude the trial"
            )
        if stands >= 0.1:
            raise InputError(
                f"{name} repeats one value from {facts['stands_from_s']:.3f} s to"
                f" {facts['stands_to_s']:.3f} s while the force on the plate changes: it is dead;"
                " mend the channel and record again, or exclude the trial"
            )
    peak, largest = float(vertical.max()), 8000.0  # [N]: ten times the weight of 80 kg
    if peak > largest:
        raise InputError(
            f"force plate {plate} reads up to {peak:.3g} N, expected less than {largest:g} N under"
            " a person; correct the unit of its forces (`plate_units` in the source file)"
        )


def check_type_on_platform(trial: Trial, plate: int) -> None:
    """Refuse a plate of type 1 on a platform that moves: it records the centre of pressure instead
    of the moment."""
    if recorded_plate(trial, plate).get("type") == 1:
        raise InputError(
            f"trial {trial.name}: force plate {plate} is of type 1 (centre of pressure) on a moving"
            " platform: without its moments the plate's own inertia cannot be taken away; export"
            " it as type 2, 3 or 4"
        )


def ankle_torque(reaction: Array, plate_centre: Array, ankle: Array, axis: Array) -> Array:
    """Internal plantarflexion moment tau (n,) [N*m] = -(M + (c - a) x F) . axis, about the plate's
    centre c [m], with the reaction (n, 6) on the foot in laboratory axes, the ankle a (n, 3) [m],
    the axis (n, 3) to the left."""
    about_ankle = reaction[:, 3:] + np.cross(plate_centre - ankle, reaction[:, :3])
    return np.asarray(-np.sum(about_ankle * axis, axis=1))


SINGLE_SUPPORT = (0.2, 0.8)  # Phases of stance in which one foot carries the body


def load_on_foot(reaction: Array, centre: Array, ankle: Array, axis: Array) -> Array:
    """Vertical force (n,) [N] on the foot, and the centre of pressure (n,) [m] to the left of the
    ankle along its axis and before it, 0 below 100 N: (3, n); from the reaction (n, 6) about the
    plate's centre, the ankle [m] and its axis, (n, 3) each."""
    vertical, up = reaction[:, 2], np.array([0.0, 0.0, 1.0])
    pressed = vertical > 100.0  # [N]
    pressure = centre + np.cross(up, reaction[:, 3:]) / np.where(pressed, vertical, 1.0)[:, None]
    places = [np.sum((pressure - ankle) * way, axis=1) for way in (axis, np.cross(axis, up))]
    return np.array([vertical, *np.where(pressed, places, 0.0)])


LIGHT = 0.1  # [N*m], weighted wrench of a plate that is too light to show its lag
# Of forces [m] and moments: a force's lever about the ankle is about 0.1 m
WEIGHT = np.array([0.1] * 3 + [1.0] * 3)


@dataclass(frozen=True)
class PlateModel:
    """The plate's inertial parameters, and its lag behind the markers."""

    # (10,): m, mc (x, y, z), I (xx, yy, zz, xy, xz, yz) [kg, kg*m, kg*m^2]; the least that fit
    parameters: Kept
    directions: Kept  # (10, r) of the parameters that the motion shows
    rms_before: Kept  # RMS wrench (6,) [N, N*m] of the unloaded plate as read, minus its mean
    rms_after: Kept  # the same without the plate's own wrench
    # of the wrench's noise, while the platform rests
    rms_at_rest: Kept = field(default_factory=lambda: np.zeros(6))
    lags: tuple[float, ...] = ()  # [s] of the trials that show one
    lag_reason: str | None = None  # why no trial does
    # the model without each trial, for the jackknife; empty with one
    leave_one_out: "tuple[PlateModel, ...]" = ()
    # [m] of the corners' centre above the point of the moments; None where it is not seen
    height: float | None = None
    height_se: float | None = None  # its standard error [m]
    # at which the unloaded plate rings after it was turned; None if it does not
    ringing_hz: float | None = None

    @property
    def certain_height(self) -> float | None:
        """`height` as far as it is certain, beyond four standard errors; else 0. None where it is
        not known."""
        return self.height and self.height * (abs(self.height) > 4 * (self.height_se or 0.0))

    @property
    def lag(self) -> float | None:
        """The mean of the lags [s]; None where it is unknown, and then not corrected."""
        return float(np.mean(self.lags)) if self.lags else None

    @property
    def lag_se(self) -> float | None:
        """Standard error [s] of the lag; None with fewer than two."""
        return (
            float(np.std(self.lags, ddof=1) / np.sqrt(len(self.lags)))
            if len(self.lags) > 1
            else None
        )

    @property
    def unexplained(self) -> float | None:
        """Share of the unloaded plate's wrench that the model leaves, beyond noise; None: too light
        to show a lag."""
        every = self.rms_before, self.rms_after, self.rms_at_rest
        before, after, noise = (float(np.linalg.norm(rms * WEIGHT)) for rms in every)
        return float(np.sqrt(max(after**2 - noise**2, 0.0))) / before if before > LIGHT else None


NOT_REMOVED = "walking.plate_inertia is none"
NO_CORRECTION = PlateModel(
    *(np.zeros(10), np.zeros((10, 0)), np.full(6, np.nan), np.full(6, np.nan)),
    lag_reason=f"not estimated: {NOT_REMOVED}",
)
"""The model of a plate that is light or compensates its own inertia: nothing is removed from its
wrench."""


def inertial_columns(motion: BodyMotion) -> Array:
    """Columns (n, 6, 10) whose product with the parameters is the wrench that the plate itself
    causes about its centre, the point of `motion`, in its axes."""
    vectors = (motion.acceleration - bodies.FREE_FALL, motion.omega, motion.alpha)
    a, w, z = (np.einsum("nij,nj->ni", motion.rotation.transpose(0, 2, 1), v) for v in vectors)
    a, W = a + bodies.FREE_FALL, cross_matrix(w)
    columns, of_inertia = np.zeros((len(a), 6, 10)), []
    for v in (z, w):  # matrices (n, 3, 6) that map (I_xx, I_yy, I_zz, I_xy, I_xz, I_yz) to I v
        (x, y, u), zero = v.T, np.zeros(len(v))
        rows = [
            [x, zero, zero, y, u, zero],
            [zero, y, zero, x, zero, u],
            [zero, zero, u, zero, x, y],
        ]
        of_inertia.append(np.moveaxis(np.array(rows), 2, 0))
    columns[:, :3, 0] = a
    columns[:, :3, 1:4] = cross_matrix(z) + W @ W
    columns[:, 3:, 1:4] = -cross_matrix(a)
    columns[:, 3:, 4:] = of_inertia[0] + W @ of_inertia[1]
    return columns


def excited_directions(squares: Array, noise: Array, within: Array) -> Array:
    """Directions (10, r) of the parameters, in the span of `within` (10, q), whose wrench the
    motion shows. `squares` and `noise` (10, 10) are the Gram matrices of the columns and of the
    marker noise in them. The directions are eigenvectors, scaled for a typical plate, above a share
    of the largest, with at most half of noise."""
    # of a plate of 1 kg whose half is 0.3 m long
    typical = np.array([[1.0]] + [[0.3]] * 3 + [[0.3**2]] * 6)
    basis = np.linalg.qr(within / typical)[0] * typical  # orthonormal in units of a typical plate
    power, vectors = np.linalg.eigh(basis.T @ squares @ basis)
    # its wrench is more than 0.01 of the largest
    basis = basis @ vectors[:, power > 0.01**2 * power[-1]]
    share, vectors = scipy.linalg.eigh(basis.T @ noise @ basis, basis.T @ squares @ basis)
    if share[0] > 0.5:
        raise IdentifiabilityError(
            f"marker noise is {share[0]:.0%} of what moves the unloaded plate in the direction that"
            " shows it best, expected 50% or less; record larger or faster motions of the unloaded"
            " plate"
        )
    return np.asarray(basis @ vectors[:, share <= 0.5])


def identify_plate_inertia(
    recordings: Sequence[tuple[BodyMotion, Array]],
    smooth: Callable[[Array], Array] = np.asarray,
    within: Array | None = None,
    noise: Array | None = None,
    known: Array | None = None,
) -> PlateModel:
    """Parameters from unloaded recordings: motion of the plate's centre, and wrench (n, 6), each
    with its own zero.

    `smooth` is the low-pass that the wrench passed. It is applied to the columns, which are
    products of motions; with filtered motions instead, 8 Hz would make the lag 0.05 ms too small.
    Only directions that the motion shows are identified (`excited_directions`), of those `within`
    (10, q) (None: all). The others stay as in `known` (10,) (None:
    0). So a plate may turn about any axis: its wrench is known for motions in crossings like those
    here, even if single parameters are not. `noise` (10, 10) is the Gram matrix N of marker noise
    alone, G that of the columns: estimates are corrected by (G - N)^-1 G (Fuller, Measurement Error
    Models, 1987, 1.4)."""
    columns = np.concatenate(
        [without_mean(smooth(inertial_columns(motion))) for motion, _ in recordings]
    )
    wrench = np.concatenate([without_mean(w) for _, w in recordings])
    stacked, held = stacked_columns(columns), np.zeros(10) if known is None else known
    squares, of_noise = stacked.T @ stacked, np.zeros((10, 10)) if noise is None else noise
    basis = excited_directions(squares, of_noise, np.eye(10) if within is None else within)
    left = stacked.T @ ((wrench * WEIGHT).T.ravel() - stacked @ held) + of_noise @ held
    parameters = held + basis @ np.linalg.solve(
        basis.T @ (squares - of_noise) @ basis, basis.T @ left
    )
    at_rest = [np.zeros((1, 6))]
    for motion, read in recordings:  # 30 frames from any motion, which the low-pass spreads
        rows = scipy.ndimage.binary_erosion(
            np.linalg.norm(motion.alpha, axis=1) == 0, iterations=30
        )
        at_rest += [without_mean(read[rows])] if rows.any() else []
    each = (
        column_rms(wrench),
        column_rms(wrench - columns @ parameters),
        column_rms(np.concatenate(at_rest)),
    )
    return PlateModel(parameters, basis, *each)


def stacked_columns(columns: Array) -> Array:
    """Weighted columns (6 n, 10) out of (n, 6, 10), component by component."""
    return np.asarray((columns * WEIGHT[:, None]).transpose(1, 0, 2).reshape(-1, columns.shape[2]))


def without_mean(values: Array) -> Array:
    return np.asarray(values - values.mean(axis=0))


def column_rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def plate_lag(
    motion: BodyMotion, wrench_at: Callable[[float], Array], smooth: Callable[[Array], Array]
) -> float:
    """Lag [s] of the plate behind the markers in one unloaded recording with the least misfit; NaN
    if it is too light, below `LIGHT`. `wrench_at` returns the wrench a lag [s] later, filtered with
    `smooth`, the motion not."""
    largest, step = 0.012, 0.002  # [s]; a parabola between the steps is exact to 1 % below 20 Hz
    lags = np.arange(-largest, largest + step / 2, step)
    readings = [wrench_at(float(lag)) for lag in lags]
    shown = identify_plate_inertia([(motion, readings[len(lags) // 2])], smooth).directions
    basis = np.linalg.qr(stacked_columns(without_mean(smooth(inertial_columns(motion)))) @ shown)[0]
    stacked = [(without_mean(w) * WEIGHT).T.ravel() for w in readings]
    misfit = [float(6 * np.mean((w - basis @ (basis.T @ w)) ** 2)) for w in stacked]
    best = int(np.argmin(misfit))
    size = float(np.sum((column_rms(without_mean(readings[best])) * WEIGHT) ** 2))
    if size < LIGHT**2:
        return float("nan")
    if misfit[best] > 0.5 * size or best in (0, len(lags) - 1):
        raise InputError(
            f"the unloaded plate's wrench does not follow its motion within {largest * 1e3:g} ms;"
            " synchronise the recorders, check the platform's markers and the plate's channels, or"
            " set correct_plate_lag to false"
        )
    before, least, after = misfit[best - 1 : best + 2]
    return float(lags[best] + 0.5 * step * (before - after) / (before - 2 * least + after))


def with_height(model: PlateModel, parts: Sequence[tuple[Array, Array]]) -> PlateModel:
    """The model with the height of the corners' centre above the point of the moments, from each
    recording's columns (n, 6, 10) and wrench (n, 6), where its standard error, by leaving out each,
    is less than 5 mm."""

    def moments_below(pairs: Sequence[tuple[Array, Array]]) -> float:
        """Height [m] from the two centres of mass: forces show that from the corners' centre,
        moments that from their own point. NaN if only moments show one, as if the plate does not
        turn, or without a mass."""
        columns, wrench = (
            np.concatenate([without_mean(pair[k]) for pair in pairs]) for k in (0, 1)
        )
        apart = stacked_columns(columns[:, :, 1:4] * (np.arange(6) > 2)[:, None])
        stacked = np.column_stack([stacked_columns(columns) @ model.directions, apart])
        size = np.maximum(np.linalg.norm(stacked, axis=0), 1e-12)
        scaled = stacked / size
        estimates = np.linalg.lstsq(scaled, (wrench * WEIGHT).T.ravel(), rcond=1e-4)[0] / size
        others, below = scaled[:, :-1], scaled[:, -1]
        alone = below - others @ np.linalg.lstsq(others, below, rcond=1e-4)[0]
        mass = float(model.directions[0] @ estimates[: model.directions.shape[1]])
        return (
            float(estimates[-1] / mass)
            if mass > 0.1 and np.linalg.norm(alone) > 0.02
            else float("nan")
        )

    height, *fewer = (
        moments_below([*parts[:i], *parts[i + 1 :]]) for i in (len(parts), *range(len(parts)))
    )
    se = float(np.sqrt((len(parts) - 1) * np.var(fewer)))
    return replace(
        model, height=height if se < 0.005 else None, height_se=se if np.isfinite(se) else None
    )


def ringing(time: Array, wrench: Array, track: platform.PlatformTrack) -> tuple[float, float]:
    """Frequency [Hz] above 25 Hz at which the wrench (n, 6) grows most from before the first motion
    of the track to after it, and the ratio of its power; 0 where it rests for less than 0.15 s, or
    without any noise."""
    first = next(iter(runs(track.moving)), slice(0, 0))
    least, later = (
        round(0.15 * track.rate),
        [run for run in runs(~track.moving) if run.start >= first.stop],
    )
    rest = next((run for run in later if run.stop - run.start >= least), slice(0, 0))
    n = min(first.start, rest.stop - rest.start, round(0.4 * track.rate))
    if n < least:
        return 0.0, 0.0
    starts = np.searchsorted(time, track.time[[first.start - n, rest.start]])
    pieces = (
        scipy.signal.detrend([wrench[start : start + n] for start in starts], axis=1)
        * np.hanning(n)[:, None]
    )
    power = np.abs(np.fft.rfft(pieces, axis=1)) ** 2
    noise = power[0].mean(axis=0)
    if not noise.all():
        return 0.0, 0.0
    before, after = np.sum(power / noise, axis=2)
    hz = np.fft.rfftfreq(n, 1 / track.rate)
    ratio = np.where((hz > 25) & (hz < track.rate / 3), after / (before + before.mean()), 0.0)
    return float(hz[np.argmax(ratio)]), float(ratio.max())


@dataclass(frozen=True)
class UnloadedRecording:
    """A trial of an unloaded, moving plate."""

    # the longest run of frames in which it was seen, without a motion that the run cuts
    track: platform.PlatformTrack
    centre: Array  # the plate's centre (3,) [m] at rest
    # in the track's frames, read a lag [s] later, through both low-passes
    wrench_at: Callable[[float], Array]
    # the further low-pass of the identification, after that of the crossings
    plate_low_pass: LowPass
    unusable: str  # why the trial shows nothing of the plate, for a message; empty if it does
    rings: tuple[float, float]  # as of `ringing`

    def smooth(self, values: Array) -> Array:
        """Values in the track's frames, shape (n, ...), through the low-pass of the
        identification."""
        return self.plate_low_pass(values, self.track.rate)

    def along(self, axes: Array) -> tuple[BodyMotion, Array]:
        """Motion of the plate's centre along the directions (r, 6), low-passed, and weighted
        squares (10, 10) of marker noise in its columns: of frames at rest before `smooth`, which
        spreads the motions into them."""
        motion, weights = self.track.own_motion(axes, self.centre)
        resting = [
            run for run in runs(weights == 0) if run.stop - run.start >= platform.FEWEST_FRAMES
        ]
        columns = inertial_columns(motion)
        still = [stacked_columns(without_mean(columns[run])) for run in resting]
        squares = sum((one.T @ one for one in still), np.zeros((10, 10)))
        count = sum(run.stop - run.start for run in resting)
        # The noise's sum of squares after weights and `smooth`, over its mean square before them:
        # the sum over all lags of A r q, with the autocorrelations r of low-passed noise that is
        # differentiated twice (1 at lag 0), q of the further filter's response and A of the
        # weights.
        n = 2 * len(weights)
        f: Array = np.fft.rfftfreq(n, 1 / self.track.rate).astype(np.float64)
        passed, further = (one.gain(f) ** 2 for one in (self.track.low_pass, self.plate_low_pass))
        acceleration = np.fft.irfft(passed * f**4, n)
        lags = np.fft.irfft(np.abs(np.fft.rfft(weights, n)) ** 2, n)
        noise = float(np.sum(lags * acceleration / acceleration[0] * np.fft.irfft(further, n)))
        return motion.weighted(weights), squares / max(count, 1) * noise


def unloaded_recording(
    trial: Trial, calibration: StaticCalibration, settings: PlateModelSettings
) -> UnloadedRecording:
    """The platform over the longest run of frames in which it was seen, and the plate's wrench."""
    check_type_on_platform(trial, settings.plate)
    names = settings.markers.platform
    frames, poses = bodies.segment_poses(trial, names, calibration, settings)
    time, wrench = recorded_wrench(trial, settings.plate)
    load, largest = float(np.median(np.abs(wrench[:, 2]))), settings.largest_zero_n
    if load > largest:
        raise InputError(
            f"trial {trial.name}: the plate carries {load:.0f} N, expected an unloaded plate and at"
            f" most {largest:g} N; zero the plate and record again, or correct the experiment of"
            " this trial in the sheet, which is 'plate'"
        )
    rows, few = longest_run(poses.seen()), platform.FEWEST_FRAMES
    if rows.stop - rows.start < few:
        raise InputError(
            f"trial {trial.name}: markers {', '.join(names)} are seen together in"
            f" {rows.stop - rows.start} frames in a row, expected {few} or more; correct exchanged"
            " labels in Nexus, or record again with all of them in sight"
        )
    moved, threshold = platform.moved_from_rest(poses, settings)
    largest, shifts = float(np.max(moved[rows])), settings.perturbed_by == "belt"
    track = platform.platform_track(trial.name, frames[rows], poses[rows], calibration, settings)
    whole = whole_motions(track)
    cut, rests = whole.stop - whole.start < rows.stop - rows.start, whole.stop - whole.start >= few
    if cut and rests:
        rows = slice(rows.start + whole.start, rows.start + whole.stop)
        track = platform.platform_track(
            trial.name, frames[rows], poses[rows], calibration, settings
        )
    gaps = [
        gap
        for gap in runs(poses.bridged)
        if bodies.gap_duration(frames, gap) > settings.longest_fitted_gap_s
    ]
    unusable, turned = "", np.ptp(platform.moved_from_rest(poses[rows], settings)[0])
    if cut and (not rests or turned < threshold):
        unusable = "the recording begins or ends while the platform moves; record from rest to rest"
    elif largest < threshold and poses.seen().all():
        found, least = (
            f"turns by {np.rad2deg(largest):.2f} deg",
            f"{settings.perturbation_deg:g} deg",
        )
        if shifts:
            found, least = f"shifts by {1e3 * largest:.1f} mm", f"{settings.largest_shift_mm:g} mm"
        raise InputError(
            f"trial {trial.name}: the platform {found} only, expected {least} or more; record a"
            f" perturbation of the unloaded plate, or correct perturbed_by: {settings.perturbed_by}"
        )
    elif largest < threshold or any(
        # At rest noise gives 0.03 deg; 11 interpolated frames at 300 Hz change the lag by 2 ms
        abs(float(moved[gap.stop] - moved[gap.start - 1]))
        > (threshold / 5 if shifts else np.deg2rad(0.2))
        for gap in gaps
    ):
        unusable = (
            "the platform turned while its markers were hidden; record it again with all of them in"
            " sight"
        )
    read = wrench_reader(time, wrench, frames)

    def wrench_at(lag: float) -> Array:
        return settings.plate_low_pass(
            settings.low_pass(read(lag), sampling_rate(frames))[rows], track.rate
        )

    centre = recorded_corners(trial, settings.plate).mean(axis=0)
    rings = ringing(frames, read(0.0), track)
    return UnloadedRecording(track, centre, wrench_at, settings.plate_low_pass, unusable, rings)


def whole_motions(track: platform.PlatformTrack) -> slice:
    """The frames (n,) without a motion that begins before or ends after the track; empty if it
    never rests. Half a motion is wrong after a low-pass: the lag is then off by milliseconds, the
    plate's mass by a tenth."""
    count, n = max(round(0.05 * track.rate), 5), len(track.time)
    moves = track.moving.copy()
    for end in (slice(0, count), slice(n - count, n)):
        since = track.time[end] - track.time[end].mean()
        slopes = since @ track.measured[end] / (since @ since)
        moves[end] |= (
            float(np.abs(slopes).max() * np.sqrt(since @ since)) > platform.STILL * track.noise
        )
    rests = [
        run
        for run in runs(track.gate(moves) == 0)
        if run.stop - run.start >= platform.FEWEST_FRAMES
    ]
    rests = rests or [slice(0, 0)]
    return slice(rests[0].start if moves[0] else 0, rests[-1].stop if moves[-1] else n)


def identify_plate_model(
    pairs: Sequence[tuple[Trial, StaticCalibration]], settings: PlateModelSettings
) -> PlateModel:
    """The lag of each unloaded trial, each with its calibration, then one inertia from all at the
    mean lag."""
    if not pairs:
        raise InputError(
            "no trials of the unloaded plate; add trials of experiment 'plate' to the sheet"
        )
    every = [unloaded_recording(trial, calibration, settings) for trial, calibration in pairs]
    seen = [r for r in every if not r.unusable]
    if not seen:
        first = every[0]
        raise InputError(
            f"no unloaded trial shows the plate's inertia; trial {first.track.name}, as others:"
            f" {first.unusable}"
        )
    for r in every:
        if r.unusable:
            warnings.warn(
                f"trial {r.track.name}: excluded from the plate's model: {r.unusable}", stacklevel=2
            )
    motions, lags = shared_motions(seen), [float("nan")] * len(seen)
    for i, r in enumerate(seen if settings.correct_plate_lag else ()):
        with naming(f"trial {r.track.name}"):
            lags[i] = plate_lag(motions[i][0], r.wrench_at, r.smooth)
    reason = None if np.isfinite(lags).any() else "the unloaded plate is too light to show it"
    reason = reason if settings.correct_plate_lag else "not estimated: correct_plate_lag is false"
    hz, growth = np.median([r.rings for r in seen], axis=0).tolist()
    model = replace(
        plate_model(seen, lags), lag_reason=reason, ringing_hz=hz if growth > 500 else None
    )
    if len(seen) == 1:
        return model
    each = range(len(seen))
    if model.parameters[0] > 0.1:  # [kg]
        columns = [
            r.smooth(inertial_columns(motion)) for r, (motion, _) in zip(seen, motions, strict=True)
        ]
        parts = [(c, r.wrench_at(model.lag or 0.0)) for c, r in zip(columns, seen, strict=True)]
        model = with_height(model, parts)
    others = [plate_model(seen[:i] + seen[i + 1 :], lags[:i] + lags[i + 1 :], model) for i in each]
    return replace(model, leave_one_out=tuple(others))


def shared_motions(recordings: Sequence[UnloadedRecording]) -> list[tuple[BodyMotion, Array]]:
    """The motion of each recording along the directions that they share, and its noise, as of
    `along`."""
    axes = platform.shared_directions([r.track for r in recordings])
    return [r.along(own) for r, own in zip(recordings, axes, strict=True)]


def plate_model(
    recordings: Sequence[UnloadedRecording], lags: Sequence[float], whole: PlateModel | None = None
) -> PlateModel:
    """The recordings' lags [s], NaN where one shows none, and one inertia from all recordings at
    their mean. Only what `whole`, from more recordings, shows is identified, and the rest stays as
    it is there."""
    known, motions = (
        tuple(float(lag) for lag in lags if np.isfinite(lag)),
        shared_motions(recordings),
    )
    lag = float(np.mean(known)) if known else 0.0
    pairs = [(motion, r.wrench_at(lag)) for r, (motion, _) in zip(recordings, motions, strict=True)]
    noise = np.sum([squares for _, squares in motions], axis=0)
    within, held = (None, None) if whole is None else (whole.directions, whole.parameters)
    return replace(
        identify_plate_inertia(pairs, recordings[0].smooth, within, noise, held), lags=known
    )


def plate_table(model: PlateModel) -> pl.DataFrame:
    """`plate.csv`: RMS [N, N*m] of each component before and after the plate's own wrench is
    removed, and lag [s]."""
    before, after = model.rms_before, model.rms_after
    remaining = [
        100 * a / b if b > 0 else None for b, a in zip(before.tolist(), after.tolist(), strict=True)
    ]
    components = ("F_x", "F_y", "F_z", "M_x", "M_y", "M_z")
    rows = {
        "component": components,
        "rms_before": before,
        "rms_after": after,
        "left_percent": remaining,
    }
    lag = {
        "lag_s": model.lag,
        "lag_se_s": model.lag_se,
        "lag_unknown": model.lag_reason,
        "trials": len(model.lags),
    }
    lag |= {
        "height_m": model.height,
        "height_se_m": model.height_se,
        "ringing_hz": model.ringing_hz,
    }
    return pl.DataFrame(rows).with_columns(**{name: pl.lit(value) for name, value in lag.items()})
