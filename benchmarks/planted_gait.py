# SPDX-License-Identifier: Apache-2.0
"""Crossings of a walkway with a known ankle, from rigid-body mechanics alone, and what the analysis
makes of them.

Run from the repository: `python benchmarks/planted_gait.py [pairs]`, 5 by default, two minutes on
one core. Prints bias and coverage of K, B and I for `docs/study.md`. Each campaign is walked twice,
with scatter of either sign: the mean of both has no error that is linear in the scatter, so that
bias is left.

A platform with a force plate turns about a fixed axis while a foot stands on it. The ankle answers
the turn with K, B and I of Eq. 15. Nothing of `osl_analysis.simulator` is used. Axes: x along the
walkway, y to the left, z up. A person walks along x, or back.
"""

import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import polars as pl
import scipy
from causes import ROOT, markdown
from numpy.typing import NDArray

from osl_analysis.base.errors import OslAnalysisError
from osl_analysis.base.trial import Trial, marker_columns, plate_columns
from osl_analysis.campaign.configuration import config_for_trials
from osl_analysis.stats.budget import QUANTITIES
from osl_analysis.walking.crossing import analyse_crossing
from osl_analysis.walking.isolated_response import unperturbed_gait
from osl_analysis.walking.plate_inertia import identify_plate_model
from osl_analysis.walking.plate_lag import timing_of
from osl_analysis.walking.poses import static_calibration
from osl_analysis.walking.tables import GroupHeadline, group_headline
from osl_analysis.walking.walking_settings import WalkingAnalysis

Array = NDArray[np.float64]
Points = tuple[tuple[float, ...], ...]

RATE_HZ = 2000  # of the mechanics
PLATE_HZ = 1000
MARKER_HZ = 200
DURATION_S = 2.6
GRAVITY = np.array([0.0, 0.0, -9.81])
WEIGHT_N = 75 * 9.81  # of the person
STANCE_S = 0.7
MOMENT_NOISE_M = 0.2  # noise of a moment over that of a force

PLATE_CENTRE = np.array([0.9, -0.2, 0.0])  # of its surface, at rest
# A point of the platform's axis, which is along y
PIVOT = PLATE_CENTRE + np.array([0.05, 0.0, -0.15])
PLATE_COM = np.array([0.01, 0.02, -0.05])  # from the surface's centre
PLATE_GYRATION_M = 0.21  # about y
CORNERS = np.array([(0.3, 0.25, 0), (-0.3, 0.25, 0), (-0.3, -0.25, 0), (0.3, -0.25, 0)])
ANKLE_HEIGHT = 0.085
FOOT_PLACE = np.array([-0.05, 0.02, 0.0])  # of the ankle, from the surface's centre
# From the ankle, of the points about which the foot rolls
HEEL = np.array([-0.05, 0.0, -ANKLE_HEIGHT])
BALL = np.array([0.13, 0.0, -ANKLE_HEIGHT])

# Markers of a right leg from the ankle, and of the platform from the surface's centre
CLUSTERS: dict[str, Points] = {
    "FOOT": ((0.15, 0.04, -0.05), (0.14, -0.05, -0.06), (0.02, -0.06, -0.03), (-0.07, 0.01, -0.03)),
    "SHANK": ((0.05, 0.03, 0.13), (0.06, -0.05, 0.2), (-0.04, -0.04, 0.29), (0.02, -0.06, 0.33)),
    "PLAT": ((0.34, 0.3, 0.01), (-0.35, 0.31, 0.0), (-0.33, -0.3, 0.02), (0.35, -0.29, 0.01)),
}
MALLEOLI = {"ANKLE_MED": (0.0, 0.04, 0.0), "ANKLE_LAT": (0.0, -0.04, 0.0)}

# Over the phase of stance: angles of the shank, leaning forward, and of the foot, toes down [deg]
LEAN = ((-1, 30), (-0.4, 5), (0, -15), (0.15, -9), (0.4, 3), (0.65, 12), (0.85, 23), (1, 36))
PITCH = ((-1, 20), (-0.3, -15), (0, -14), (0.09, -2), (0.14, 0), (0.6, 0), (0.8, 12), (1, 38))
FLAT = (0.15, 0.57)  # phases between which the foot is flat on the plate
# Internal plantarflexion moment [N*m], and forces as shares of the weight
TORQUE = ((0, 0), (0.06, -9), (0.13, -7), (0.3, 20), (0.5, 58), (0.7, 98), (0.79, 104), (1, 0))
VERTICAL = ((0, 0), (0.05, 0.4), (0.2, 1.08), (0.47, 0.8), (0.78, 1.08), (0.9, 0.55), (1, 0))
FORWARD = ((0, 0), (0.07, -0.07), (0.18, -0.16), (0.5, 0), (0.82, 0.18), (0.95, 0.05), (1, 0))


@dataclass(frozen=True)
class Walkway:
    """A campaign: the ankle, the turn, and what is not quiet. Every scatter is a standard
    deviation, and 0 in the quiet campaign."""

    K: float = 300.0  # [N*m/rad]
    B: float = 4.0  # [N*m*s/rad]
    I: float = 0.03  # [kg*m^2]
    perturbed: int = 12  # crossings
    unperturbed: int = 12
    turn_deg: float = 4.0
    ramp_s: float = 0.08
    onset: float = 0.42  # as a share of stance
    plate_kg: float = 20.0
    both_directions: bool = False  # every second turn is toes down
    to_and_fro: bool = False  # every second person walks back
    reaction: float = 0.0  # share of the turn that the shank gives way by, within 0.2 s
    stance: float = 0.0  # of the duration of stance, as a share
    angle_deg: float = 0.0  # of the shank's angle, over stance
    coupled: bool = False  # the ankle also answers a deviation of the angle
    torque_nm: float = 0.0  # of the gait's torque, over stance
    torque_share: float = 0.0  # of its size
    onset_scatter: float = 0.0  # as a share of stance
    place_m: float = 0.0  # of the foot on the plate
    yaw_deg: float = 0.0  # of the foot's direction
    marker_m: float = 0.0  # noise of a marker's coordinate
    force_n: float = 0.0  # noise of a sample of a force


@dataclass(frozen=True)
class Campaign:
    """Trials of a campaign."""

    static: Trial
    plates: list[Trial]
    crossings: list[tuple[Trial, bool]]  # and whether the platform turned


@dataclass(frozen=True)
class Body:
    """Poses of a rigid body: rotations (n, 3, 3), and places (n, 3) [m] of its origin."""

    rotation: Array
    origin: Array


def curve(points: Points, phase: Array, width_s: float) -> Array:
    """A curve (n,) through points, constant beyond its ends, smoothed by a Gaussian."""
    x, y = np.array(points, float).T
    sharp = scipy.interpolate.PchipInterpolator(x, y)(np.clip(phase, x[0], x[-1]))
    return smoothed(sharp, width_s)


def smoothed(signal: Array, width_s: float) -> Array:
    return np.asarray(scipy.ndimage.gaussian_filter1d(signal, width_s * RATE_HZ))


def ramp(share: Array) -> Array:
    """Minimum jerk from 0 to 1 while `share` goes from 0 to 1."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def derivative(signal: Array) -> Array:
    return np.asarray(np.gradient(signal, 1 / RATE_HZ, axis=0))


def about(axis: int, angle: Array) -> Array:
    """Rotation matrices (n, 3, 3) about an axis by angles (n,) [rad]."""
    vectors = np.zeros((len(angle), 3))
    vectors[:, axis] = angle
    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(vectors).as_matrix())


def joint_angle(foot: Array, shank: Array) -> Array:
    """Angle (n,) [rad] by which the shank leans forward over the foot, of their rotations."""
    relative = np.swapaxes(foot, 1, 2) @ shank
    return np.arctan2(relative[:, 0, 2] - relative[:, 2, 0], relative[:, 0, 0] + relative[:, 2, 2])


class Laboratory:
    """Records the crossings of one campaign.

    A `mirrored` laboratory draws the same scatter with the other sign. The mean of the estimates of
    both has no error that is linear in the scatter: what is left of it is bias (antithetic pairs,
    Hammersley and Morton, 1956).
    """

    def __init__(self, walkway: Walkway, seed: int, mirrored: bool = False) -> None:
        self.walkway = walkway
        self.random = np.random.default_rng(seed)
        self.scatter_sign = -1 if mirrored else 1
        self.time = np.arange(round(DURATION_S * RATE_HZ)) / RATE_HZ

    def normal(self, *shape: int) -> Array:
        return self.scatter_sign * self.random.standard_normal(shape)

    def campaign(self) -> Campaign:
        walkway = self.walkway
        n = len(self.time)
        no_load = np.zeros((n, 6))
        standing = Body(
            np.broadcast_to(np.eye(3), (n, 3, 3)),
            np.tile(PLATE_CENTRE + FOOT_PLACE + (0, 0, ANKLE_HEIGHT), (n, 1)),
        )
        bodies = {"FOOT": standing, "SHANK": standing, "ANKLE": standing}
        static = self.recorded("static", np.zeros(n), bodies, no_load)

        plates = []
        for i in range(6):
            turn = self.sign(i) * self.turn_between(0.8, 1.5)
            plates.append(self.recorded(f"plate_{i}", turn, {}, no_load))

        count = walkway.perturbed + walkway.unperturbed
        is_perturbed = np.arange(count) < walkway.perturbed
        self.random.shuffle(is_perturbed)
        crossings = []
        for i in range(count):
            sign = self.sign(int(is_perturbed[:i].sum())) if is_perturbed[i] else 0
            walks_back = walkway.to_and_fro and i % 2 == 1
            trial = self.crossing(f"walk_{i:02d}", sign, walks_back)
            crossings.append((trial, bool(is_perturbed[i])))
        return Campaign(static, plates, crossings)

    def sign(self, number: int) -> int:
        """Direction of the turn of a number: 1 is toes up."""
        return -1 if self.walkway.both_directions and number % 2 else 1

    def turn_between(self, onset: float, back: float) -> Array:
        """Angle (n,) [rad] of a turn that starts at `onset` and returns at `back` [s]."""
        shape = ramp((self.time - onset) / self.walkway.ramp_s) - ramp((self.time - back) / 0.3)
        return np.deg2rad(self.walkway.turn_deg) * shape

    def deviation(self, size: float, phase: Array) -> Array:
        """A smooth random curve (n,) over stance, of a given standard deviation."""
        waves = np.zeros(len(phase))
        for cycles in (0.5, 1.0, 1.5, 2.0):
            a, b = self.normal(2)
            angle = 2 * np.pi * cycles * np.clip(phase, 0.0, 1.0)
            waves += (a * np.cos(angle) + b * np.sin(angle)) / 2
        return size * waves

    def crossing(self, name: str, sign: int, walks_back: bool) -> Trial:
        """Walk one crossing. With the `sign` 0 the platform rests."""
        walkway = self.walkway
        of_stance, of_strike, of_onset, of_yaw, forward, left, of_torque = self.normal(7)
        stance_s = STANCE_S * (1 + walkway.stance * of_stance)
        strike = 0.9 + 0.02 * of_strike
        phase = (self.time - strike) / stance_s
        onset = strike + (walkway.onset + walkway.onset_scatter * of_onset) * stance_s
        toes_up = sign * self.turn_between(onset, strike + stance_s + 0.1)
        turn = -toes_up if walks_back else toes_up
        angle_deviation = np.deg2rad(self.deviation(walkway.angle_deg, phase))
        torque_deviation = self.deviation(walkway.torque_nm, phase)

        # Motion: the foot rides on the platform, and the shank gives way a little later
        late = np.interp(self.time - 0.03, self.time, toes_up)
        gives_way = walkway.reaction * smoothed(late, 0.03)
        lean = np.deg2rad(curve(LEAN, phase, 0.03)) + angle_deviation + gives_way
        pitch = np.deg2rad(curve(PITCH, phase, 0.01))
        pitch = np.where((phase > FLAT[0]) & (phase < FLAT[1]), 0.0, pitch)
        yaw = np.deg2rad(180.0 * walks_back + walkway.yaw_deg * of_yaw)
        heading = about(2, np.array([yaw]))[0]
        platform = about(1, -turn)
        foot = platform @ heading @ about(1, pitch)
        shank = heading @ about(1, lean)
        ankle = self.carried(platform, self.foot_path(phase, pitch, forward, left) @ heading.T)

        # Torque: that of gait, and what the ankle answers to the turn
        answered = joint_angle(foot, shank) - (lean - gives_way - pitch)
        if walkway.coupled:
            answered = answered + angle_deviation
        omega = derivative(answered)
        impedance = walkway.K * answered + walkway.B * omega + walkway.I * derivative(omega)
        gait = curve(TORQUE, phase, 0.02) * (1 + walkway.torque_share * of_torque)
        loaded = ramp(phase / 0.06) * (1 - ramp((phase - 0.9) / 0.1))
        torque = (gait + torque_deviation + impedance) * loaded

        # Wrench of the foot about the centre of the plate's surface; below the ankle is no mass
        vertical = curve(VERTICAL, phase, 0.01)
        shares = np.column_stack([curve(FORWARD, phase, 0.01), 0.03 * vertical, vertical])
        stands = (phase > 0) & (phase < 1)
        force = WEIGHT_N * stands[:, None] * shares @ heading.T
        axis = shank[:, :, 1] + foot[:, :, 1]
        axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
        centre = self.carried(platform, np.zeros(3))
        moment = np.cross(ankle - centre, force) - torque[:, None] * axis
        bodies = {"FOOT": Body(foot, ankle), "SHANK": Body(shank, ankle)}
        return self.recorded(name, turn, bodies, np.hstack([force, moment]))

    def foot_path(self, phase: Array, pitch: Array, forward: float, left: float) -> Array:
        """Path (n, 3) [m] of the ankle over a resting plate, from its centre."""
        place = FOOT_PLACE + self.walkway.place_m * np.array([forward, left, 0.0])
        rolled_about = np.where((pitch < 0)[:, None], HEEL, BALL)
        rolled = rolled_about - np.einsum("nij,nj->ni", about(1, pitch), rolled_about)
        swing = np.clip(-phase, 0, 1) ** 2
        swung = np.column_stack([-0.8 * swing, np.zeros(len(phase)), 0.1 * swing])
        return np.asarray(place + rolled + swung + (0, 0, ANKLE_HEIGHT))

    def carried(self, platform: Array, point: Array) -> Array:
        """Where the platform carries points (n, 3) or (3,) [m] that are given from its centre."""
        arm = np.broadcast_to(PLATE_CENTRE + point - PIVOT, (len(platform), 3))
        return np.asarray(PIVOT + np.einsum("nij,nj->ni", platform, arm))

    def plate_reading(self, turn: Array, wrench: Array) -> Array:
        """The wrench (n, 6) of the foot and of the plate's own mass, in the plate's axes.

        It was zeroed at rest.
        """
        mass = self.walkway.plate_kg
        platform = about(1, -turn)
        centre = self.carried(platform, np.zeros(3))
        centre_of_mass = self.carried(platform, PLATE_COM)
        inertial = mass * (derivative(derivative(centre_of_mass)) - GRAVITY)
        spin = np.zeros((len(turn), 3))
        spin[:, 1] = -mass * PLATE_GYRATION_M**2 * derivative(derivative(turn))
        force = wrench[:, :3] + inertial
        moment = wrench[:, 3:] + spin + np.cross(centre_of_mass - centre, inertial)
        read = [np.einsum("nji,nj->ni", platform, vector) for vector in (force, moment)]
        weight = -mass * GRAVITY
        return np.asarray(np.hstack(read) - np.hstack([weight, np.cross(PLATE_COM, weight)]))

    def recorded(self, name: str, turn: Array, bodies: Mapping[str, Body], wrench: Array) -> Trial:
        """Record markers and plate, with their noise; with the body `ANKLE` the malleoli, too."""
        walkway = self.walkway
        platform = about(1, -turn)
        of_plate = slice(None, None, RATE_HZ // PLATE_HZ)
        of_markers = slice(None, None, RATE_HZ // MARKER_HZ)

        markers = {"time": self.time[of_markers]}
        seen = {**bodies, "PLAT": Body(platform, self.carried(platform, np.zeros(3)))}
        for body, pose in seen.items():
            labelled = MALLEOLI
            if body != "ANKLE":
                labelled = {f"{body}{i}": place for i, place in enumerate(CLUSTERS[body], 1)}
            for label, place in labelled.items():
                position = (pose.origin + pose.rotation @ np.array(place))[of_markers]
                position = position + walkway.marker_m * self.normal(*position.shape)
                markers |= dict(zip(marker_columns(label), position.T, strict=True))

        read = self.plate_reading(turn, wrench)[of_plate]
        noise = walkway.force_n * np.repeat((1.0, MOMENT_NOISE_M), 3)
        read = read + noise * self.normal(*read.shape)
        names = plate_columns(1)
        forces = {"time": self.time[of_plate], **dict(zip(names, read.T, strict=True))}

        samples = pl.DataFrame(forces).join(pl.DataFrame(markers), on="time", how="left")
        plate = {
            "plate": 1,
            "type": 2,
            "corners": (PLATE_CENTRE + CORNERS).tolist(),
            "channels": [],
        }
        return Trial(name, samples, {"plates": [plate], "warnings": []})


LABORATORIES = {
    "quiet": Walkway(),
    "all scatters": Walkway(
        marker_m=0.3e-3,
        force_n=1.0,
        stance=0.03,
        onset_scatter=0.01,
        place_m=0.02,
        yaw_deg=3.0,
        torque_nm=3.0,
        torque_share=0.05,
        angle_deg=0.4,
        reaction=0.15,
        to_and_fro=True,
    ),
}


def headline_of(campaign: Campaign, settings: WalkingAnalysis) -> GroupHeadline:
    """Analyse a campaign. Crossings that are refused have no part."""
    calibration = static_calibration(campaign.static, settings)
    plate = identify_plate_model([(trial, calibration) for trial in campaign.plates], settings)
    turned = [(trial, calibration) for trial, turned in campaign.crossings if turned]
    timing = timing_of(turned, plate, settings)
    crossings = []
    for trial, is_perturbed in campaign.crossings:
        onset = timing.onsets.get(trial.name)
        lag = timing.lags.get(trial.name, timing.lag) or 0.0
        with suppress(OslAnalysisError):
            crossings.append(
                analyse_crossing(trial, calibration, plate, is_perturbed, settings, onset, lag)
            )
    unperturbed = [crossing for crossing in crossings if crossing.onset is None]
    perturbed = [crossing for crossing in crossings if crossing.onset is not None]
    gait = unperturbed_gait(unperturbed, settings.fewest_unperturbed)
    return group_headline(perturbed, gait, settings, plate, timing)


def main() -> None:
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    settings = config_for_trials(ROOT / "config/config.yaml").walking
    rows = []
    for label, walkway in LABORATORIES.items():
        errors = []  # of each campaign: relative errors (3,) of K, B and I [%]
        held = []
        for seed in range(pairs if label != "quiet" else 1):
            for is_mirrored in (False, True):
                campaign = Laboratory(walkway, seed, is_mirrored).campaign()
                headline = headline_of(campaign, settings)
                true = np.array([getattr(walkway, name) for name in QUANTITIES])
                budgets = [headline.ensemble.budgets[name] for name in QUANTITIES]
                found = np.array([budget.value for budget in budgets])
                low = np.array([budget.low for budget in budgets])
                high = np.array([budget.high for budget in budgets])
                errors.append(100 * (found / true - 1))
                held.append((low <= true) & (true <= high))
        of_pairs = np.mean(np.reshape(errors, (-1, 2, 3)), axis=1)
        scatter = of_pairs.std(axis=0, ddof=1) / np.sqrt(pairs) if len(of_pairs) > 1 else 0 * true
        bias = [
            f"{mean:.2f} ± {se:.2f}" for mean, se in zip(of_pairs.mean(0), scatter, strict=True)
        ]
        coverage = [f"{100 * share:.0f}" for share in np.mean(held, axis=0)]
        rows.append((label, len(errors), ", ".join(bias), ", ".join(coverage)))
    print(markdown(("laboratory", "campaigns", "bias of K, B, I, %", "coverage, %"), rows))


if __name__ == "__main__":
    main()
