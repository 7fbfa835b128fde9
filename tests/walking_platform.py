"""A walk over a heavy force plate by formula: rigid bodies in numpy, which share no code with analysis or simulator.

The platform turns about a mediolateral axis below its surface by a minimum-jerk ramp, and may heave, shiver or be
slower. The foot rides on it flat, so that the ankle turns by the platform's angle and the lean of the shank. The ankle
answers with K, B and I to it, on top of a load that does not vary from crossing to crossing.
"""

from dataclasses import dataclass, replace

import numpy as np
from walking_synthetic import FOOT, PLATE_RATE, PLATFORM, SHANK, about_y, labelled, recording, static_trial

from osl_analysis.trial import Array, Trial

ANKLE = np.array([-0.06, 0.0, 0.09])
STANCE = 0.9, 1.62
LOAD, LOAD_TORQUE = 800.0, 40.0
G = 9.80665
DEG = np.pi / 180


@dataclass(frozen=True)
class Ramp:
    """One ramp of the platform: angle [deg, toes up], duration and onset [s], heave [m], shiver [deg]."""

    angle: float = 2.5
    rise: float = 0.1
    onset: float = 1.19
    heave: float = 0.0
    heave_rise: float = 0.06
    shiver: float = 0.0
    shiver_hz: float = 9.0
    phase: float = 0.0
    returns: float = 2.1


@dataclass(frozen=True)
class Rig:
    """Plate of 25 kg, its centre of mass from the surface's centre, gyration and axis [m]; noise [m, N, N*m]."""

    mass: float = 25.0
    com: tuple[float, float, float] = (0.01, -0.015, -0.045)
    gyration: tuple[float, float, float] = (0.15, 0.17, 0.22)
    pivot: tuple[float, float, float] = (0.0, 0.0, -0.12)
    marker: float = 3e-4
    force: float = 0.4
    moment: float = 0.08
    lag: float = 0.0
    K: float = 340.0
    B: float = 3.0
    I: float = 0.02


def step(t: Array, start: float, duration: float) -> Array:
    """A minimum-jerk step from 0 to 1, with its two derivatives (3, n) in time."""
    x = (t - start) / duration
    y, inside = np.clip(x, 0, 1), (x > 0) & (x < 1)
    first, second = 30 * y**2 * (1 - y) ** 2 * inside, 60 * y * (1 - y) * (1 - 2 * y) * inside
    return np.array([y**3 * (10 - 15 * y + 6 * y**2), first / duration, second / duration**2])


def angle_and_heave(t: Array, ramp: Ramp | None) -> tuple[Array, Array]:
    """Angle [rad, toes up] and heave [m] with two derivatives, (3, n) each."""
    if ramp is None:
        return np.zeros((3, len(t))), np.zeros((3, len(t)))
    angle = ramp.angle * DEG * (step(t, ramp.onset, ramp.rise) - step(t, ramp.returns, 0.3))
    heave = ramp.heave * (step(t, ramp.onset, ramp.heave_rise) - step(t, ramp.onset + 0.08, ramp.heave_rise))
    if ramp.shiver:
        fine = np.arange(t[0], t[-1], 1e-5)
        since = fine - ramp.onset
        wave = step(fine, ramp.onset, 0.03)[0] * np.exp(-np.clip(since, 0, None) / 0.08)
        wave *= ramp.shiver * DEG * np.sin(2 * np.pi * ramp.shiver_hz * since + ramp.phase)
        speed = np.gradient(wave, 1e-5)
        angle = angle + np.array([np.interp(t, fine, x) for x in (wave, speed, np.gradient(speed, 1e-5))])
    return angle, heave


def plate_wrench(t: Array, ramp: Ramp | None, rig: Rig) -> Array:
    """What the plate's own mass shows (n, 6) [N, N*m], in its axes and about its centre, zeroed at rest."""
    (phi, w, z), (_, _, lift) = angle_and_heave(t, ramp)
    R, n = about_y(-phi), np.array([0.0, -1.0, 0.0])
    pivot, com = np.array(rig.pivot), np.array(rig.com)
    arm = np.einsum("nij,j->ni", R, com - pivot)
    W, Z = w[:, None] * n, z[:, None] * n
    a = np.cross(Z, arm) + np.cross(W, np.cross(W, arm)) + lift[:, None] * [0, 0, 1]
    force = rig.mass * (a + np.array([0, 0, G]))
    inertia = rig.mass * np.array(rig.gyration) ** 2
    spin = np.array([0.0, -1.0, 0.0]) * (inertia[1] * z)[:, None]
    in_plate = R.transpose(0, 2, 1)
    force = np.einsum("nij,nj->ni", in_plate, force)
    moment = np.einsum("nij,nj->ni", in_plate, spin) + np.cross(com, force)
    tare = np.array([0, 0, rig.mass * G])
    return np.hstack([force - tare, moment - np.cross(com, tare)])


def ankle_answer(t: Array, ramp: Ramp | None, rig: Rig) -> Array:
    """The ankle's torque (n,) [N*m]: load of stance, and the answer to the ramp."""
    phi, w, z = angle_and_heave(t, ramp)[0]
    return LOAD_TORQUE * stance_load(t) + rig.K * phi + rig.B * w + rig.I * z


def stance_load(t: Array) -> Array:
    """Share of the load (n,), about 1 in stance, with the two humps of gait."""
    phase = np.clip((t - STANCE[0]) / (STANCE[1] - STANCE[0]), 0, 1)
    held = step(t, STANCE[0], 0.15)[0] - step(t, STANCE[1] - 0.15, 0.15)[0]
    return np.asarray(held * (1 - 0.15 * np.cos(4 * np.pi * phase)))


def shank_lean(t: Array) -> Array:
    """Forward lean (n,) [rad] of the shank, which swings over the foot in stance."""
    return -0.1 + 0.35 * step(t, STANCE[0], STANCE[1] - STANCE[0])[0]


def carried(points: Array, t: Array, ramp: Ramp | None, rig: Rig) -> Array:
    """Points (m, 3) that ride on the platform: (n, m, 3)."""
    (phi, _, _), (lift, _, _) = angle_and_heave(t, ramp)
    pivot = np.array(rig.pivot)
    ridden = np.einsum("nij,mj->nmi", about_y(-phi), points - pivot) + pivot
    ridden[:, :, 2] += lift[:, None]
    return np.asarray(ridden)


def walked(name: str, ramp: Ramp | None, rig: Rig, seed: int, loaded: bool = True) -> Trial:
    """A crossing, or a trial of the unloaded platform, with noise from the seed."""
    random = np.random.default_rng(seed)
    fast = np.arange(3 * PLATE_RATE) / PLATE_RATE
    slow, late = fast[::5], fast - rig.lag
    wrench = plate_wrench(late, ramp, rig)
    tracks = labelled("PLAT", carried(PLATFORM, slow, ramp, rig))
    if loaded:
        wrench += reaction(late, ramp, rig)
        ankle = carried(ANKLE[None], slow, ramp, rig)
        phi = angle_and_heave(slow, ramp)[0][0]
        foot = np.einsum("nij,mj->nmi", about_y(-phi), FOOT - ANKLE) + ankle
        shank = np.einsum("nij,mj->nmi", about_y(shank_lean(slow)), SHANK - ANKLE) + ankle
        tracks |= labelled("FOOT", foot) | labelled("SHANK", shank)
    wrench += random.normal(0, [rig.force] * 3 + [rig.moment] * 3, wrench.shape)
    tracks = {label: track + random.normal(0, rig.marker, track.shape) for label, track in tracks.items()}
    return recording(name, tracks, wrench[:, :3], wrench[:, 3:])


def reaction(t: Array, ramp: Ramp | None, rig: Rig) -> Array:
    """The foot's wrench (n, 6) in the plate's axes about its centre: a force through the ankle, and its torque."""
    phi = angle_and_heave(t, ramp)[0][0]
    in_plate = about_y(-phi).transpose(0, 2, 1)
    force = np.einsum("nij,nj->ni", in_plate, stance_load(t)[:, None] * [0, 0, LOAD])
    moment = np.cross(ANKLE, force)
    moment[:, 1] -= ankle_answer(t, ramp, rig)
    return np.hstack([force, moment])


def plate_trials(rig: Rig, ramp: Ramp, seed: int, count: int = 4) -> list[Trial]:
    """Trials of the unloaded platform: the same ramp, at other times."""
    random = np.random.default_rng(seed + 77)
    starts = 1.0 + random.uniform(0, 0.05, count)
    return [
        walked(f"plate_{k}", replace(ramp, onset=float(start), returns=1.9), rig, 1000 * seed + 900 + k, loaded=False)
        for k, start in enumerate(starts)
    ]


def standing() -> Trial:
    """The static trial."""
    return static_trial(ANKLE)
