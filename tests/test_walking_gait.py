"""Stance and onset, and the phase of gait: found to a fraction of a frame, and at the pace that was to be expected."""

from dataclasses import replace

import numpy as np
import pytest
from test_walking_response import TIMING, B, K
from walking_crossings import crossing

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.gait import (
    BEFORE_ONSET_S,
    PHASES,
    UnperturbedGait,
    aligned_gait,
    matched_scales,
    unperturbed_gait,
)
from osl_analysis.walking.plate import Stance, find_stances
from osl_analysis.walking.platform import find_onset
from osl_analysis.walking.response import fit_response, isolate_response

TIME = np.arange(900) / 300
DEG = np.pi / 180


def trapezoid(start: float, end: float, slope: float = 8000.0, top: float = 800.0) -> np.ndarray:
    """A vertical force [N] that rises and falls by `slope` [N/s] from and to zero at `start` and `end` [s]."""
    return np.clip(np.minimum(TIME - start, end - TIME) * slope, 0, top)


def test_heel_strike_and_toe_off_between_frames() -> None:
    """A rise of 8 N/ms passes 40 N 5 ms after contact, the fall passes 20 N 2.5 ms before it ends."""
    (stance,) = find_stances(TIME, trapezoid(0.9012, 1.6187), 40, 20, 0.3)
    assert stance.heel_strike == pytest.approx(0.9012 + 0.005, abs=1e-9)
    assert stance.toe_off == pytest.approx(1.6187 - 0.0025, abs=1e-9)
    assert stance.duration == pytest.approx(0.71, abs=1e-9)


def test_dips_bumps_short_contacts_and_stances_that_the_record_cuts_do_not_count() -> None:
    force = trapezoid(0.9, 1.6)
    force[330] = 30.0  # below on, above off: the foot stays
    force[600:610] = 35.0  # above off, below on: nobody steps there
    assert len(find_stances(TIME, force, 40, 20, 0.3)) == 1
    force = trapezoid(0.9, 1.6) + trapezoid(2.2, 2.3)
    assert [len(find_stances(TIME, force, 40, 20, shortest)) for shortest in (0.3, 0.05)] == [1, 2]
    early, late = trapezoid(-1.0, 0.6), trapezoid(2.5, 4.0)
    nan = trapezoid(0.9, 1.6)
    nan[300:330], nan[600:620] = np.nan, np.nan  # leaves the foot where it was
    assert find_stances(TIME, nan, 40, 20, 0.3)[0].duration == pytest.approx(0.6925, abs=1e-6)
    for cut in (early, late, 0 * TIME):
        assert find_stances(TIME, cut, 40, 20, 0.3) == []
    assert len(find_stances(TIME, early + trapezoid(1.0, 1.7) + late, 40, 20, 0.3)) == 1


def ramp(onset: float = 1.2) -> np.ndarray:
    """A straight ramp of 5 deg in 75 ms [rad]."""
    return 5 * DEG * np.clip((TIME - onset) / 0.075, 0, 1)


X = np.clip((TIME - 1.2) / 0.075, 0, 1)
SOFT = 5 * DEG * X**4 * (35 - 84 * X + 70 * X**2 - 20 * X**3)
"""A line through its steep part would start 0.27 of the ramp late."""


@pytest.mark.parametrize("onset", [1.2, 1.2011, 1.2033])
@pytest.mark.parametrize("noise", [0.0, 0.015])
def test_the_onset_of_a_straight_ramp_is_found_within_a_millisecond(onset: float, noise: float) -> None:
    turned = ramp(onset) + DEG * (0.3 + noise * np.random.default_rng(3).standard_normal(len(TIME)))
    assert find_onset(TIME, turned, 1 * DEG) == pytest.approx(onset, abs=1e-3 if noise else 3e-4)
    turned[350:356] = np.nan
    assert find_onset(TIME, turned, 1 * DEG) == pytest.approx(onset, abs=1e-3 if noise else 5e-4)


def test_noise_of_the_markers_moves_the_onset_of_a_soft_start_by_an_eighth_of_the_ramp_at_most() -> None:
    """0.04 deg is 0.2 mm at 0.28 m from the axis. RMS over 40 draws: a fit up to 5 times the noise instead of 25 sees
    so little of the start that its power is not determined, and errs by a sixth."""
    assert find_onset(TIME, SOFT, DEG) == pytest.approx(1.2, abs=0.075 / 30)
    draws = [0.04 * DEG * np.random.default_rng(seed).standard_normal(len(TIME)) for seed in range(40)]
    onsets = np.array([find_onset(TIME, SOFT + noise, DEG) for noise in draws], dtype=float)
    assert np.sqrt(np.mean((onsets - 1.2) ** 2)) < 0.075 / 8


def test_a_platform_that_rests_has_no_onset_and_one_that_turns_at_the_start_of_the_record_is_refused() -> None:
    assert find_onset(TIME, 0.02 * DEG * np.sin(9 * TIME), DEG) is None
    with pytest.raises(InputError, match="start to record earlier"):
        find_onset(TIME, ramp(0.02), DEG)


EARLY = PHASES[PHASES <= 0.36]


def angle(phase: Array) -> Array:
    """Ankle angle [rad]: plantarflexion after heel strike, then slow dorsiflexion."""
    return 0.2 * np.sin(2.4 * phase) - 0.12 * np.exp(-(((phase - 0.09) / 0.06) ** 2))


def walked(name: str, scale: float = 1.0, slow: float = 0.0, onset: float | None = None) -> Crossing:
    """A crossing with that angle at a pace, and with slow deviations of angle and torque that its name determines.
    Deviations of the angle are of `slow` [rad] and below 4 Hz. Those of the torque are 300 N*m/rad of them."""
    random = np.random.default_rng(sum(map(ord, name)))
    plain = crossing(name, onset=onset, stance=0.72 * scale)
    waves = random.uniform(0.3, 4.0, 4)[:, None] * plain.time + random.random((4, 1))
    deviation = slow * random.standard_normal(4) @ np.sin(2 * np.pi * waves) / np.sqrt(2)
    phase = (plain.time - 0.3) / (0.72 * scale)
    turn = plain.theta - crossing(name, stance=0.72 * scale).theta
    return replace(plain, theta=angle(phase) + turn + deviation, torque=plain.torque + 300 * deviation)


def usual(slow: float = 0.0, n: int = 10) -> UnperturbedGait:
    return unperturbed_gait([walked(f"u{k}", 1 + 0.02 * np.sin(k), slow) for k in range(n)], 3)


@pytest.mark.parametrize("slower", [0.85, 0.92, 1.0, 1.08, 1.15])
@pytest.mark.parametrize("lingers", [0.92, 1.0, 1.08])
def test_the_matched_stance_is_right_for_any_pace_and_any_end_of_stance(slower: float, lingers: float) -> None:
    """The crossing is slower throughout, its toe-off comes late, or both."""
    late = walked("p", slower, onset=0.3 + 0.42 * 0.72 * slower)
    late = replace(late, stance=Stance(0.3, 0.3 + lingers * 0.72 * slower))
    response = isolate_response(late, usual(), TIMING, "matched")
    assert response.stance == pytest.approx(0.72 * slower, rel=1e-4)
    assert response.stance_change == pytest.approx(lingers - 1, abs=1e-3)
    fit = fit_response(response)
    assert (fit.K, fit.B) == pytest.approx((K, B), rel=2e-3)


def test_the_drift_has_the_order_at_which_the_paces_of_the_unperturbed_crossings_scatter_least() -> None:
    gait, one = usual(np.deg2rad(0.5)), walked("p", onset=0.6)
    count = int(np.sum((0.6 - BEFORE_ONSET_S - 0.3) / 0.72 >= PHASES))
    scales = matched_scales(PHASES[:count:4], gait.theta[:, :count:4], gait.theta.mean(axis=0))
    scatter = np.std(scales[np.isfinite(scales).all(axis=1)], axis=1)
    assert np.std(aligned_gait(one, gait, "matched").scales) == pytest.approx(scatter.min(), rel=1e-3)
    assert scatter.max() > 1.1 * scatter.min()


def test_an_unperturbed_crossing_whose_toe_off_came_late_is_matched_too() -> None:
    crossings = [walked(f"u{k}") for k in range(5)]
    late = replace(crossings[0], stance=Stance(0.3, 0.3 + 1.06 * 0.72))
    gait, one = unperturbed_gait([*crossings[1:], late], 3), walked("p", onset=0.6)
    errors = {s: abs(fit_response(isolate_response(one, gait, TIMING, s)).K / K - 1) for s in ("own", "matched")}
    assert errors["own"] > 0.01
    assert errors["matched"] < 0.3 * errors["own"]
    spread = {s: np.std(isolate_response(one, gait, TIMING, s).torques, axis=0).max() for s in ("own", "matched")}
    assert spread["matched"] < 0.3 * spread["own"]


def test_a_pace_far_from_the_mean_or_that_nothing_tells_has_no_scale_and_is_refused() -> None:
    assert np.isnan(matched_scales(EARLY, angle(1.6 * EARLY)[None], angle(PHASES))).all()
    for mean in (0 * PHASES, 0 * PHASES + 0.2, 0.3 - 0.1 * PHASES):  # it stands still, or drifts
        assert np.isnan(matched_scales(EARLY, np.array([mean[: len(EARLY)]] * 3), mean)).all()
    gait, far = usual(), replace(walked("p", onset=0.6), stance=Stance(0.3, 0.3 + 0.45))
    assert np.isnan(isolate_response(far, gait, TIMING, "own").stance_change)
    with pytest.raises(InputError, match=r"trial p: its ankle angle before the onset .* at no pace .* own"):
        isolate_response(far, gait, TIMING, "matched")
    with pytest.raises(InputError, match="at no pace"):  # an onset at heel strike
        isolate_response(replace(walked("p", onset=0.6), onset=0.33), gait, TIMING, "matched")
