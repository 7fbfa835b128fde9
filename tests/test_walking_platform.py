"""The platform's motion: its directions, its shared shape, the onset, and what marker noise leaves of a heavy plate."""

from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import pytest
from scipy.interpolate import make_interp_spline
from walking_platform import Ramp, Rig, ankle_answer, plate_trials, standing, walked
from walking_synthetic import PLATE_RATE, PLATFORM, changed, hidden, settings

from osl_analysis.commands.walking_files import read_platform, write_platform
from osl_analysis.signals import LowPass
from osl_analysis.trial import Trial
from osl_analysis.walking.bodies import cluster_poses, static_calibration
from osl_analysis.walking.crossing import analyse_crossing
from osl_analysis.walking.plate_model import (
    PlateModel,
    identify_plate_inertia,
    identify_plate_model,
    unloaded_recording,
)
from osl_analysis.walking.platform import (
    PlatformModel,
    identify_platform,
    jackknife_rows,
    platform_table,
    start_of_rise,
)
from osl_analysis.walking.platform_motion import (
    Screws,
    gated_noise,
    shared_directions,
)

CALIBRATION = static_calibration(standing(), settings())
RIG, HEAVE = Rig(), 0.003


def ramps(count: int, seed: int, **changes: float) -> list[Ramp]:
    """Ramps of one kind, at scattered onsets."""
    starts = np.random.default_rng(seed).uniform(1.18, 1.2, count)
    return [replace(Ramp(**changes), onset=float(start)) for start in starts]


def shared(turned: list[Ramp], seed: int) -> tuple[list[Trial], PlatformModel]:
    """Crossings with these ramps, and what they share."""
    trials = [walked(f"walk_{k:02d}", ramp, RIG, 1000 * seed + k) for k, ramp in enumerate(turned)]
    return trials, identify_platform(trials, CALIBRATION, settings())


@cache
def plate(heave: float = 0.0) -> PlateModel:
    return identify_plate_model(plate_trials(RIG, Ramp(heave=heave), 3), CALIBRATION, settings())


def torque_error(trials: list[Trial], turned: list[Ramp], model: PlatformModel, heave: float = 0.0) -> float:
    """RMS error [N*m] of the torque in the windows, against the exact torque through the same low-pass."""
    stamps, errors = np.arange(3 * PLATE_RATE) / PLATE_RATE, []
    for trial, ramp in zip(trials, turned, strict=True):
        crossing = analyse_crossing(trial, CALIBRATION, plate(heave), True, settings(), model)
        exact = LowPass(20.0)(ankle_answer(stamps, ramp, RIG), PLATE_RATE)
        inside = (crossing.time >= ramp.onset) & (crossing.time < ramp.onset + 0.1)
        errors.append((crossing.torque - np.interp(crossing.time, stamps, exact))[inside])
    return float(np.sqrt(np.mean(np.square(errors[0] if len(errors) == 1 else np.concatenate(errors)))))


def test_coordinates_of_poses_are_a_screw_and_come_back() -> None:
    """A rotation about a fixed axis is a straight line, to the precision of numbers."""
    t = np.linspace(0, 1, 50)
    moved = walked("w", Ramp(angle=20, onset=0.0, rise=3.0), replace(RIG, marker=0.0), 1, loaded=False)
    labels = [f"marker_PLAT{k}_{axis}" for k in range(1, 5) for axis in "xyz"]
    tracks = moved.samples.drop_nulls(labels).select(labels).to_numpy().reshape(-1, 4, 3)[: len(t) * 10 : 10]
    poses = cluster_poses(PLATFORM, tracks)
    screws = Screws.of(PLATFORM)
    found = screws.coordinates(poses)
    size = np.linalg.svd(found, compute_uv=False)
    assert size[1] < 1e-9 * size[0]
    np.testing.assert_allclose(screws.poses(found).points(PLATFORM), tracks, atol=1e-12)


def test_the_mass_of_a_heavy_plate_is_inside_its_interval_although_markers_are_noisy() -> None:
    """25 kg, 0.3 mm, 2.5 deg: all six coordinates at 8 Hz read 22.9 +- 0.2 kg. Over 12 seeds -0.02 +- 0.06 (0.06)."""
    for heave in (0.0, HEAVE):
        inertia = plate(heave).inertia
        assert abs(inertia.parameters[0] - RIG.mass) < 2.5 * inertia.standard_errors[0]
        assert inertia.standard_errors[0] < 0.3
        assert abs(inertia.parameters[3] - RIG.mass * RIG.com[2]) < 0.04


def test_a_large_turn_with_little_noise_does_not_make_the_plate_heavier() -> None:
    """5 deg in 80 ms, 0.1 mm. Noise that is read from columns in which the low-pass of 8 Hz spread the motion made it
    25.06. Over 8 seeds 25.000 with a scatter of 0.014 (moment 0.0022, I_yy 0.0006); three of the mean of two here."""
    rig, ramp = replace(RIG, marker=1e-4), Ramp(angle=5, rise=0.08)
    found = [identify_plate_model(plate_trials(rig, ramp, seed), CALIBRATION, settings()).inertia for seed in (1, 2)]
    own = rig.gyration[1] ** 2 + rig.com[0] ** 2 + rig.com[2] ** 2
    error = np.mean([one.parameters[[0, 3, 5]] for one in found], axis=0) - rig.mass * np.array([1, rig.com[2], own])
    assert (np.abs(error) < [0.03, 0.005, 0.0014]).all()


def test_hidden_markers_of_a_resting_platform_are_no_motion() -> None:
    """A cubic over a gap of 80 ms moved by 25 standard deviations of noise, where the platform never moves; the plate
    was then 1 % too light."""
    trials = plate_trials(replace(RIG, marker=1e-4), Ramp(angle=5, rise=0.08), 1, 2)
    trials[0] = hidden(trials[0], ("PLAT1", "PLAT4"), 1.5, 1.58)
    tracks = [unloaded_recording(trial, CALIBRATION, settings()).track for trial in trials]
    inside = (tracks[0].time > 1.49) & (tracks[0].time < 1.59)
    held = tracks[0].filtered[(tracks[0].time > 1.4) & (tracks[0].time < 1.8)].mean(axis=0)
    assert np.abs(tracks[0].filtered[inside] - held).max() < 3e-4
    assert [len(axes) for axes in shared_directions(tracks)] == [1, 1]
    found = identify_plate_model(trials, CALIBRATION, settings()).inertia
    assert found.parameters[0] == pytest.approx(RIG.mass, abs=0.06)


def test_a_slow_return_that_noise_hides_is_not_taken_for_rest() -> None:
    """The gate of 0.3 mm on a motion without noise. One that falls after one spread reads 24.93 kg for 25."""
    quiet, pairs = replace(RIG, marker=1e-7, force=1e-3, moment=1e-3), []
    for trial in plate_trials(quiet, Ramp(), 5, 2):
        recording = unloaded_recording(trial, CALIBRATION, settings())
        hidden = replace(recording, track=replace(recording.track, noise=3e-4))
        seen = hidden.along(shared_directions([hidden.track])[0])
        pairs.append((seen.motion, seen.wrench_at(0.0)))
    inertia = identify_plate_inertia(pairs, seen.smooth)
    assert inertia.parameters[0] == pytest.approx(RIG.mass, abs=0.01)
    assert inertia.parameters[3] == pytest.approx(RIG.mass * RIG.com[2], abs=0.002)


def test_the_noise_of_a_gated_acceleration_is_that_of_the_filters() -> None:
    random, rate, first, further = np.random.default_rng(0), 300.0, LowPass(20.0), LowPass(8.0)
    weights = np.zeros(600)
    weights[100:160], weights[300:420] = 1.0, np.hanning(120)
    filtered = first(random.standard_normal((600, 1500)), rate)
    acceleration = make_interp_spline(np.arange(600) / rate, filtered, k=5)(np.arange(600) / rate, 2)
    expected = np.sum(further(acceleration * weights[:, None], rate) ** 2) / 1500
    level = np.mean(acceleration[100:500] ** 2)
    assert gated_noise(weights, rate, first, further) == pytest.approx(expected / level, rel=0.08)


def test_torque_and_onset_are_free_of_each_crossings_own_noise() -> None:
    """RMS over 8 crossings; each crossing's own motion in six coordinates leaves 1.6 N*m and 7 ms."""
    turned = ramps(8, 1)
    trials, model = shared(turned, 1)
    assert (len(model.template.axes), model.template.scaled) == (1, False)
    assert torque_error(trials, turned, model) < 0.3
    late = [model.alignments[t.name].start - r.onset for t, r in zip(trials, turned, strict=True)]
    assert np.std(late) < 4e-4
    assert abs(np.mean(late)) < 2.5 * model.template.start_se
    table = platform_table(model)
    assert table["follows"].to_list() == [1] * 8
    assert table["template_onset_se_s"].max() < 4e-4


def test_a_hexapod_that_heaves_has_two_directions_and_no_single_axis_is_forced_on_it() -> None:
    """A single axis reads 9.4 N*m."""
    turned = ramps(5, 2, heave=HEAVE)
    trials, model = shared(turned, 2)
    assert len(model.template.axes) == 2
    assert torque_error(trials, turned, model, HEAVE) < 0.8


def test_slower_ramps_are_the_same_shape_in_another_time() -> None:
    turned = [replace(r, rise=r.rise * (1.2 if k % 2 else 1.0)) for k, r in enumerate(ramps(8, 3))]
    trials, model = shared(turned, 3)
    assert model.template.scaled
    found = np.array([model.alignments[t.name].duration for t in trials])
    assert found[1::2].mean() / found[::2].mean() == pytest.approx(1.2, abs=0.02)
    late = [model.alignments[t.name].start - r.onset for t, r in zip(trials, turned, strict=True)]
    assert np.std(late) < 1e-3
    assert torque_error(trials, turned, model) < 0.5


def test_a_crossing_that_shivers_keeps_its_own_motion_by_name() -> None:
    turned = ramps(6, 4)
    turned[2] = replace(turned[2], shiver=0.5)
    with pytest.warns(UserWarning, match="trial walk_02: the platform does not move as in the other crossings"):
        trials, model = shared(turned, 4)
    assert [a.follows for a in model.alignments.values()] == [True, True, False, True, True, True]
    assert model.followed("walk_02") is None
    assert torque_error(trials[2:3], turned[2:3], model) < 1.5
    assert model.onset("walk_02", 1.234) == 1.234


def test_the_other_direction_is_the_same_shape_with_a_negative_amplitude() -> None:
    turned = [replace(r, angle=r.angle * (-1 if k % 2 else 1)) for k, r in enumerate(ramps(6, 5))]
    trials, model = shared(turned, 5)
    signs = np.sign([model.alignments[t.name].amplitude for t in trials])
    assert (signs[::2] == -signs[1::2]).all()
    assert torque_error(trials, turned, model) < 0.4


def test_a_resting_platform_adds_nothing() -> None:
    trial = walked("flat", None, RIG, 7)
    crossing = analyse_crossing(trial, CALIBRATION, plate(), False, settings())
    massless = replace(plate(), inertia=replace(plate().inertia, parameters=np.zeros(10)))
    bare = analyse_crossing(trial, CALIBRATION, massless, False, settings())
    assert np.sqrt(np.mean((crossing.torque - bare.torque) ** 2)) < 0.05


@pytest.mark.parametrize("scatter", [0.0, 0.004])
def test_a_trigger_tells_the_onset_only_if_its_latency_is_constant(scatter: float) -> None:
    random, trials = np.random.default_rng(8), []
    for k, ramp in enumerate(ramps(6, 6)):
        trial = walked(f"walk_{k:02d}", ramp, RIG, 6000 + k)
        since = trial.samples["time"] - (ramp.onset - 0.012 - float(random.normal(0, scatter)))
        trials.append(changed(trial, trigger=((since >= 0) & (since < 0.02)).cast(pl.Float64) * 5))
    model = identify_platform(trials, CALIBRATION, settings())
    assert model.latency.used == (scatter == 0.0)
    if scatter == 0.0:
        assert model.latency.mean == pytest.approx(0.012, abs=1.2e-3)
        assert model.onset("walk_99", 1.3) == 1.3
    assert platform_table(model)["trigger_s"].null_count() == 0


def test_the_shared_motion_survives_its_file(tmp_path) -> None:
    trials, model = shared(ramps(3, 9), 9)
    write_platform(model, tmp_path / "platform.json")
    again = read_platform(tmp_path / "platform.json")
    assert platform_table(again).equals(platform_table(model))
    assert len(again.leave_out) == len(model.leave_out) == 3
    write_platform(identify_platform(trials[:1], CALIBRATION, settings()), tmp_path / "none.json")
    assert read_platform(tmp_path / "none.json").template is None


def test_the_jackknife_of_both_sources_is_the_sum_of_their_variances() -> None:
    random = np.random.default_rng(0)
    plates, groups = random.normal(size=(4, 5)), random.normal(size=(10, 5))

    def variance(rows: np.ndarray) -> np.ndarray:
        return (len(rows) - 1) * np.var(rows, axis=0)

    joined = jackknife_rows(list(plates), list(groups))
    np.testing.assert_allclose(variance(joined), variance(plates) + variance(groups))
    np.testing.assert_array_equal(jackknife_rows(list(plates), []), plates)


GRID = np.arange(-0.06, 0.2, 0.002)


def rise(degree: int, start: float, height: float = 0.04, duration: float = 0.1) -> np.ndarray:
    """A rise (n, 1) [m] on the grid, of the degree of its polynomial."""
    x = np.clip((GRID - start) / duration, 0, 1)
    steps = {1: x, 3: x**2 * (3 - 2 * x), 5: x**3 * (10 - 15 * x + 6 * x**2)}
    steps[7] = x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)
    return np.asarray(height * steps[degree][:, None])


@pytest.mark.parametrize("degree", [1, 3, 5, 7])
def test_the_start_of_a_mean_rise_has_no_bias_for_any_smooth_step(degree: int) -> None:
    """0.05 % of noise, as in the mean of 20 crossings of 5 deg."""
    noise = np.random.default_rng(degree).normal(0, 2e-5, (len(GRID), 1))
    found = start_of_rise(GRID, rise(degree, 0.0131) + noise, 2e-5)
    assert found.time == pytest.approx(0.0131, abs=1e-3)
    assert found.shape == 0.0


def test_the_start_of_a_rise_has_the_error_of_its_noise() -> None:
    """Two directions, 0.3 % of noise. A length in place of a displacement would start early, by noise alone."""
    random, axis = np.random.default_rng(3), np.array([[0.6, 0.8]])
    found = [
        start_of_rise(GRID, rise(5, 0.0) @ axis + random.normal(0, 1.2e-4, (len(GRID), 2)), 1.2e-4) for _ in range(60)
    ]
    z = np.array([one.time / one.se for one in found])
    assert {one.kind for one in found} == {3}
    assert abs(z.mean()) < 0.4  # 3 / sqrt(60)
    assert 0.75 < z.std() < 1.25  # 1 +- 2.7 / sqrt(120)


def test_a_start_that_noise_hides_says_what_another_kind_of_start_would_change() -> None:
    """A step of seventh degree, 1 % of noise: minimum jerk starts 7 ms later, and the statement covers it."""
    noise = np.random.default_rng(5).normal(0, 4e-4, (len(GRID), 1))
    found = start_of_rise(GRID, rise(7, 0.0) + noise, 4e-4)
    assert (found.kind, round(1e3 * found.time)) == (3, 7)
    assert abs(found.time) < found.shape + 3 * found.se
