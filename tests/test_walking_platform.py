"""The platform's motion, its onset and a heavy plate; static trials of crossings, exchanged labels,
shifts."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import walking_synthetic as synthetic
import yaml
from conftest import ROOT
from walking_synthetic import (
    RATE,
    Ramp,
    Rig,
    changed,
    filled,
    headed,
    hidden,
    plate_trials,
    settings,
    static_trial,
    walked_over,
)

from osl_analysis.campaign.campaign_checks import check_walking
from osl_analysis.campaign.campaign_trials import Campaign, open_campaign
from osl_analysis.campaign.configuration import campaign_config
from osl_analysis.commands.walking import average_unperturbed, identify_plate
from osl_analysis.commands.walking_files import read_model, write_model, write_refusal
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.crossing import Crossing, RefusedCrossing, analyse_crossing
from osl_analysis.walking.groups import static_of
from osl_analysis.walking.plate_model import (
    NO_CORRECTION,
    PlateModel,
    identify_plate_inertia,
    identify_plate_model,
    unloaded_recording,
)
from osl_analysis.walking.platform import PlatformTrack, shared_directions
from osl_analysis.walking.poses import StaticCalibration, static_calibration
from osl_analysis.walking.setup_checks import check_onset
from osl_analysis.walking.shared_motion import (
    NO_SHARED_MOTION,
    PlatformModel,
    identify_platform,
    jackknife_rows,
    platform_table,
    platform_template,
    start_of_rise,
    trigger_edge,
)
from osl_analysis.walking.stance import Stance
from osl_analysis.walking.torque_errors import LABORATORY_ERRORS

CALIBRATION = static_calibration(static_trial(), settings())
RIG = Rig()
QUIET = Rig(marker=1e-5)
HEAVE = 0.003
GRID = np.arange(-0.06, 0.2, 0.002)
WALK = walked_over("walk_1", None, RIG, 1)


def calibrated(
    trials: list[Trial], static: StaticCalibration = CALIBRATION
) -> list[tuple[Trial, StaticCalibration]]:
    return [(trial, static) for trial in trials]


def ramps(count: int, seed: int, **changes: float) -> list[Ramp]:
    """Ramps of one kind, at scattered onsets."""
    starts = np.random.default_rng(seed).uniform(1.18, 1.2, count)
    return [replace(Ramp(**changes), onset=float(start)) for start in starts]


def shared(turned: list[Ramp], seed: int) -> tuple[list[Trial], PlatformModel]:
    """Crossings with these ramps, and what they share."""
    trials = [
        walked_over(f"walk_{k:02d}", ramp, RIG, 1000 * seed + k) for k, ramp in enumerate(turned)
    ]
    return trials, identify_platform(calibrated(trials), settings())


@cache
def three() -> tuple[list[Trial], PlatformModel]:
    return shared(ramps(3, 1), 1)


@cache
def plate(heave: float = 0.0) -> PlateModel:
    return identify_plate_model(calibrated(plate_trials(RIG, Ramp(heave=heave), 3, 2)), settings())


STAMPS = np.arange(3 * synthetic.PLATE_RATE) / synthetic.PLATE_RATE


def exact_torque(time: Array, ramp: Ramp) -> Array:
    """The ankle's torque at these times, through the low-pass of the analysis."""
    low_passed = LowPass(20.0)(synthetic.ankle_answer(STAMPS, ramp), synthetic.PLATE_RATE)
    return np.asarray(np.interp(time, STAMPS, low_passed))


def torque_error(turned: "TurnedCrossings", heave: float = 0.0) -> float:
    """RMS error [N*m] of the torque in the windows of the first crossings."""
    errors = []
    for trial, ramp in zip(turned.trials[:2], turned.ramps, strict=False):
        crossing = perturbed(trial, plate(heave), turned.model)
        inside = (crossing.time >= ramp.onset) & (crossing.time < ramp.onset + 0.1)
        errors.append((crossing.torque - exact_torque(crossing.time, ramp))[inside])
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))


def perturbed(
    trial: Trial,
    model: PlateModel = NO_CORRECTION,
    shared_motion: PlatformModel = NO_SHARED_MOTION,
    static: StaticCalibration = CALIBRATION,
    **choices: Any,
) -> Crossing:
    return analyse_crossing(trial, static, model, True, settings(**choices), shared_motion)


def unperturbed(trial: Trial, model: PlateModel = NO_CORRECTION, **choices: Any) -> Crossing:
    return analyse_crossing(trial, CALIBRATION, model, False, settings(**choices))


def moved(trial: Trial, *markers: str, by: float = 0.01) -> Trial:
    """The trial with markers [m] further to the left."""
    return changed(trial, *[pl.col(f"marker_{marker}_y") + by for marker in markers])


def with_corners(trial: Trial, ahead: float) -> Trial:
    corners = np.add(synthetic.CORNERS, (ahead, 0.0, 0.0)).tolist()
    plates = [{**plate, "corners": corners} for plate in trial.provenance["plates"]]
    return replace(trial, provenance={**trial.provenance, "plates": plates})


@pytest.mark.parametrize(
    ("trial", "what", "distance_mm"),
    [
        (moved(WALK, "SHANK2", by=0.008), "marker SHANK2 of the shank", 8.0),
        (moved(WALK, *[f"SHANK{k}" for k in (1, 2, 3, 4)]), "the ankle between foot and shank", 10),
        (moved(WALK, *[f"PLAT{k}" for k in (1, 2, 3, 4)]), "the platform at rest", 10.0),
        (with_corners(WALK, 0.03), "the corners of force plate 1", 30.0),
    ],
)
def test_what_is_not_where_it_was_in_the_static_trial_is_named_by_itself(
    trial: Trial, what: str, distance_mm: float
) -> None:
    quality = unperturbed(trial).quality

    assert quality.different == what
    assert quality.different_mm == pytest.approx(distance_mm, abs=0.5)
    assert unperturbed(WALK).quality.different_mm < 0.5


def test_corners_of_the_trials_of_the_plate_are_compared_with_the_static_trial_too() -> None:
    trials = [with_corners(trial, 0.02) for trial in plate_trials(RIG, Ramp(), 3, 2)]
    model = identify_plate_model(calibrated(trials), settings())

    quality = unperturbed(WALK, model).quality

    assert quality.different == "the corners of force plate 1 in trials of the plate"
    assert quality.different_mm == pytest.approx(20.0, abs=0.1)
    assert unperturbed(WALK, plate()).quality.different_mm < 0.5


def test_a_cluster_beyond_its_limit_is_refused_with_its_marker() -> None:
    with pytest.raises(InputError, match="throughout stance, SHANK2 most, by 25 mm"):
        unperturbed(moved(WALK, "SHANK2", by=0.025))


@pytest.mark.parametrize("heave", [0.0, HEAVE])
def test_the_mass_of_a_heavy_plate_is_inside_its_interval(heave: float) -> None:
    """25 kg, 0.3 mm, 2.5 deg: all six coordinates at 8 Hz read 22.9 +- 0.2 kg. Over 12 seeds -0.02
    +- 0.06 (0.06)."""
    model = plate(heave)

    assert abs(model.parameters[0] - RIG.mass) < 0.3
    assert abs(model.parameters[3] - RIG.mass * RIG.com[2]) < 0.04


def test_noise_that_the_low_pass_spread_into_rest_is_not_subtracted() -> None:
    """5 deg in 80 ms, 0.1 mm: noise that is read from columns in which the low-pass of 8 Hz spread
    the motion made the mass 25.06. Over 8 seeds it is 25.000 with a scatter of 0.014 (moment
    0.0022, I_yy 0.0006): three of them here."""
    rig = replace(RIG, marker=1e-4)
    ramp = Ramp(angle=5, rise=0.08)
    I_yy = rig.mass * (rig.gyration[1] ** 2 + rig.com[0] ** 2 + rig.com[2] ** 2)

    model = identify_plate_model(calibrated(plate_trials(rig, ramp, 1)), settings())

    mass, moment, inertia = model.parameters[[0, 3, 5]]
    assert mass == pytest.approx(rig.mass, abs=0.042)
    assert moment == pytest.approx(rig.mass * rig.com[2], abs=0.0066)
    assert inertia == pytest.approx(I_yy, abs=0.0018)


def test_hidden_markers_of_a_resting_platform_are_no_motion() -> None:
    """A cubic over 80 ms moved by 25 SDs of noise, where the platform never moves; the plate was 1
    % too light."""
    trials = plate_trials(replace(RIG, marker=1e-4), Ramp(angle=5, rise=0.08), 1, 2)
    trials[0] = hidden(trials[0], ("PLAT1", "PLAT4"), 1.5, 1.58)

    tracks = [unloaded_recording(trial, CALIBRATION, settings()).track for trial in trials]
    model = identify_plate_model(calibrated(trials), settings())

    assert [len(axes) for axes in shared_directions(tracks)] == [1, 1]
    assert [track.noise for track in tracks] == pytest.approx([1e-4, 1e-4], rel=0.1)
    assert [replace(t, low_pass=LowPass(10.0)).spread for t in tracks] == [0.05, 0.05]
    assert model.parameters[0] == pytest.approx(RIG.mass, abs=0.06)


def test_a_slow_return_that_noise_hides_is_not_taken_for_rest() -> None:
    """The gate of 0.3 mm on a motion without noise. One that falls after one spread reads 24.93 kg
    for 25."""
    quiet = replace(RIG, marker=1e-7, force=1e-3, moment=1e-3)
    pairs = []
    for trial in plate_trials(quiet, Ramp(), 5, 2):
        unloaded = unloaded_recording(trial, CALIBRATION, settings())
        noisy = replace(unloaded, track=replace(unloaded.track, noise=3e-4))
        motion = noisy.along(shared_directions([noisy.track])[0]).motion
        pairs.append((motion, unloaded.wrench_at(0.0)))

    model = identify_plate_inertia(pairs, unloaded.smooth)

    assert model.parameters[0] == pytest.approx(RIG.mass, abs=0.01)
    assert model.parameters[3] == pytest.approx(RIG.mass * RIG.com[2], abs=0.002)


@dataclass(frozen=True)
class TurnedCrossings:
    """Crossings whose platform turned by ramps, and what they share."""

    ramps: list[Ramp]
    trials: list[Trial]
    model: PlatformModel

    @property
    def late_s(self) -> Array:
        """Errors of the onsets."""
        onsets = platform_table(self.model)["onset_s"].to_numpy()
        return np.asarray(onsets - [ramp.onset for ramp in self.ramps])


def turned_crossings(
    seed: int, count: int, heave: float = 0.0, **every_second: float
) -> TurnedCrossings:
    ramps_of_trials = ramps(count, seed, heave=heave)
    for k in range(1, count, 2):
        ramps_of_trials[k] = replace(ramps_of_trials[k], **every_second)
    trials, model = shared(ramps_of_trials, seed)
    return TurnedCrossings(ramps_of_trials, trials, model)


def test_torque_and_onset_are_free_of_each_crossings_own_noise() -> None:
    """Own motions in six coordinates leave 1.6 N*m and 7 ms."""
    turned = turned_crossings(seed=1, count=5)

    assert torque_error(turned) < 0.3
    assert np.std(turned.late_s) < 4e-4
    assert abs(np.mean(turned.late_s)) < 1e-3
    assert len(turned.model.template.axes) == 1
    assert not turned.model.template.scaled
    assert platform_table(turned.model)["follows"].to_list() == [1] * 5


def test_a_platform_that_heaves_moves_along_two_directions() -> None:
    """A single axis forced on a hexapod that heaves reads 9.4 N*m."""
    turned = turned_crossings(seed=2, count=4, heave=HEAVE)

    assert torque_error(turned, HEAVE) < 0.8
    assert len(turned.model.template.axes) == 2


def test_slower_ramps_are_the_same_shape_in_another_time() -> None:
    turned = turned_crossings(seed=3, count=4, rise=0.12)

    durations = platform_table(turned.model)["duration"]
    assert torque_error(turned) < 0.5
    assert turned.model.template.scaled
    assert durations[1::2].mean() / durations[::2].mean() == pytest.approx(1.2, abs=0.02)
    assert np.std(turned.late_s) < 1e-3


def test_the_other_direction_has_a_negative_amplitude() -> None:
    turned = turned_crossings(seed=5, count=4, angle=-2.5)

    signs = np.sign(platform_table(turned.model)["amplitude"].to_numpy())
    assert torque_error(turned) < 0.4
    assert (signs[::2] == -signs[1::2]).all()


def test_a_laboratory_turned_against_the_walkway_reads_the_same_angle_and_torque() -> None:
    """Read by planar parameters a plate at 30 degrees added 42 N*m/rad to K and 0.3 kg*m^2 to I."""
    trials, model = three()
    turn = partial(headed, heading=np.pi / 6)
    static = static_calibration(turn(static_trial()), settings())
    unloaded = [turn(trial) for trial in plate_trials(RIG, Ramp(), 3, 2)]
    turned = [turn(trial) for trial in trials]
    plate_there = identify_plate_model(calibrated(unloaded, static), settings())
    model_there = identify_platform(calibrated(turned, static), settings())

    here = perturbed(trials[0], plate(), model)
    there = perturbed(turned[0], plate_there, model_there, static)

    assert np.abs(there.theta - here.theta).max() < 1e-5
    assert np.abs(there.torque - here.torque).max() < 0.05
    assert plate_there.height == pytest.approx(plate().height, abs=1e-3)
    assert there.turn == pytest.approx(here.turn, abs=1e-5)


FILL_FROM = ramps(3, 1)[0].onset - 0.02


def with_filled(*markers: str) -> Crossing:
    """A crossing of which 100 ms at the onset were filled by a spline before the export."""
    trials, model = three()
    trial = filled(trials[0], markers, FILL_FROM, FILL_FROM + 0.1) if markers else trials[0]
    return perturbed(trial, plate(), model, longest_gap_s=0.2)


def test_what_was_filled_before_the_export_is_a_gap_and_counted() -> None:
    """One platform marker made I thirteen times too large, two of the shank K 441."""
    whole = with_filled()
    of_plate = with_filled("PLAT2")
    of_shank = with_filled("SHANK1", "SHANK3")

    window = (whole.time > FILL_FROM + 0.02) & (whole.time < FILL_FROM + 0.12)
    assert whole.quality.filled_share == 0
    assert whole.quality.filled_fitted == 0
    assert np.abs(of_plate.torque - whole.torque)[window].max() < 0.5
    assert of_plate.quality.filled_share > 0.1
    assert of_plate.quality.filled_fitted == 0
    assert of_shank.quality.filled_fitted > 0.3


def test_a_filled_cluster_is_refused_as_hidden() -> None:
    with pytest.raises(
        InputError,
        match=r"foot markers are hidden for .*, where they were filled before the export",
    ):
        with_filled("FOOT1", "FOOT2", "FOOT3", "FOOT4")


def test_a_cluster_that_was_put_on_again_asks_for_a_static_trial() -> None:
    moved = changed(WALK, *(pl.col(f"marker_SHANK1_{axis}") + 0.04 for axis in "xyz"))

    with pytest.raises(
        InputError,
        match=r"the shank markers stand \d+ mm .* record a static trial after the change",
    ):
        unperturbed(moved, plate())


def test_a_torque_s_errors_hold_what_each_group_does_to_the_shape() -> None:
    trials, model = three()
    alone = replace(plate(), leave_one_out=())
    of_groups = [replace(model, template=shape) for shape in model.leave_out]

    whole = perturbed(trials[0], alone, model)
    first, second = (perturbed(trials[0], alone, of_group) for of_group in of_groups[:2])

    change = whole.plate_errors[1] - whole.plate_errors[0]
    assert len(of_groups) == 3
    np.testing.assert_allclose(change, second.torque - first.torque, atol=1e-9)
    assert np.abs(change).max() > 1e-3
    assert whole.onset == model.alignments[trials[0].name].start


def test_what_crossings_share_is_the_same_from_its_file(tmp_path: Path) -> None:
    _, model = three()
    write_model(model, tmp_path / "platform.json")

    stored = read_model(tmp_path / "platform.json", PlatformModel)

    assert platform_table(stored).equals(platform_table(model))
    assert len(stored.leave_out) == 3


def test_a_crossing_that_moves_in_another_way_keeps_its_own_motion_by_name() -> None:
    turned = ramps(6, 4)
    turned[2] = replace(turned[2], returns=1.22)

    with pytest.warns(
        UserWarning, match="trial walk_02: the platform does not move as in the other crossings"
    ):
        trials, model = shared(turned, 4)

    follows = [alignment.follows for alignment in model.alignments.values()]
    assert follows == [True, True, False, True, True, True]
    assert torque_error(TurnedCrossings(turned[2:3], trials[2:3], model)) < 1.5
    assert model.onset("walk_02", 1.234) == 1.234


def test_a_platform_that_rests_has_no_part_in_the_shared_motion() -> None:
    trials, _ = three()

    with pytest.warns(
        UserWarning, match="trial walk_1: has no part in .*: the platform does not turn by 1 deg"
    ):
        model = identify_platform(calibrated([WALK, trials[0]]), settings())

    assert model.template is None
    assert model.reason.startswith("1 motions of the platform,")


@cache
def triggered(scatter: float) -> tuple[list[Trial], PlatformModel]:
    """Six crossings with a trigger 12 ms before the platform; a later one tells nothing."""
    random = np.random.default_rng(8)
    trials = []
    for k, ramp in enumerate(ramps(6, 6)):
        trial = walked_over(f"walk_{k:02d}", ramp, replace(RIG, marker=6e-4), 6000 + k)
        edge = ramp.onset - 0.012 - float(random.normal(0, scatter))
        since = trial.samples["time"] - edge
        high = since.is_between(0, 0.02) | (since > 1)
        trials.append(changed(trial, trigger=high.cast(pl.Float64) * 0.6))
    return trials, identify_platform(calibrated(trials), settings())


def test_a_trigger_of_constant_latency_tells_the_onset() -> None:
    _, model = triggered(scatter=0.0)

    assert model.latency.used
    assert model.latency.mean == pytest.approx(0.012, abs=1.2e-3)
    # it is finer than the shape
    assert model.onset("walk_00", 1.3) == model.triggers["walk_00"] + model.latency.mean
    assert model.onset("walk_99", 1.3) == 1.3


def test_a_trigger_whose_latency_scatters_does_not() -> None:
    _, model = triggered(scatter=0.004)

    assert not model.latency.used
    assert model.onset("walk_00", 1.3) == model.alignments["walk_00"].start


def test_a_coarse_trigger_tells_the_onset_of_what_has_no_shape() -> None:
    _, model = triggered(scatter=0.0)
    coarse = replace(model, latency=replace(model.latency, used=True, finer=False))
    shapeless = replace(coarse, alignments={})

    assert coarse.onset("walk_00", 0.0) == model.alignments["walk_00"].start
    assert shapeless.onset("walk_00", 0.0) == model.triggers["walk_00"] + model.latency.mean


def test_the_table_of_the_platform_has_trigger_and_latency() -> None:
    _, model = triggered(scatter=0.0)

    table = platform_table(model)

    latencies = [a.start - model.triggers[a.name] for a in model.alignments.values()]
    assert table["latency_s"][0] == pytest.approx(np.mean(latencies))
    assert set(table["trigger_used"]) == {1}
    assert table["onset_s"].to_list() == [model.onset(name, 0.0) for name in model.alignments]
    assert table["onset_shape_s"][0] == model.template.start_shape


@pytest.mark.parametrize(
    "trigger",
    [
        pytest.param(pl.col("trigger") * 0.8, id="weak"),
        pytest.param((pl.col("time") < 1).cast(float), id="falling"),
    ],
)
def test_a_weak_or_falling_trigger_has_no_edge(trigger: pl.Expr) -> None:
    trials, _ = triggered(scatter=0.0)

    assert trigger_edge(changed(trials[0], trigger=trigger)) is None


def test_two_triggers_tell_no_latency() -> None:
    trials, _ = triggered(scatter=0.0)

    assert identify_platform(calibrated(trials[:2]), settings()).latency is None


def test_the_jackknife_of_both_sources_is_the_sum_of_their_variances() -> None:
    random = np.random.default_rng(0)
    by_trials = random.normal(size=(4, 5))
    by_crossings = random.normal(size=(10, 5))

    joined = jackknife_rows(list(by_trials), list(by_crossings))

    def variance(rows: Array) -> Array:
        return np.asarray((len(rows) - 1) * np.var(rows, axis=0))

    np.testing.assert_allclose(variance(joined), variance(by_trials) + variance(by_crossings))
    np.testing.assert_array_equal(jackknife_rows(list(by_trials), []), by_trials)


def tracks_of(count: int, seed: int, slower: float = 0.0) -> tuple[list[PlatformTrack], Array]:
    """Motions of 4 cm in 0.1 s, each second one slower by a share, with noise of 0.1 mm in each
    frame; and onsets."""
    random = np.random.default_rng(seed)
    time = np.arange(600) / RATE
    onsets = random.uniform(0.98, 1.0, count)
    tracks = []
    for k, onset in enumerate(onsets):
        duration = 0.1 * (1 + slower) if k % 2 else 0.1
        rise_of_track = synthetic.step(time, onset, duration)[0]
        moved = 0.04 * np.outer(rise_of_track, [0.6, 0, 0.8, 0, 0, 0])
        measured = moved + random.normal(0, 1e-4, moved.shape)
        track = PlatformTrack(f"w{k}", time, synthetic.PLATFORM, measured, LowPass(20.0), 1e-4)
        tracks.append(track)
    return tracks, onsets


@pytest.mark.parametrize("slower", [0.0, 0.2])
def test_the_errors_of_the_starts_are_their_scatter(slower: float) -> None:
    """22 free starts scatter by their errors to within 15 %, and where durations differ too."""
    scores = []
    for seed in range(2):
        tracks, onsets = tracks_of(12, seed, slower)
        template, alignments = platform_template(tracks, 0.1)
        errors = np.array([alignment.start for alignment in alignments]) - onsets
        start_se = [alignment.start_se for alignment in alignments]
        scores.append((errors - errors.mean()) / start_se)

    assert template.scaled == (slower > 0)
    assert np.sqrt(np.sum(np.square(scores)) / 22) == pytest.approx(1, abs=0.3)


def rise(degree: int, start: float) -> np.ndarray:
    """A rise (n, 1) of 0.04 m in 0.1 s on the grid, of the degree of its polynomial."""
    x = np.clip((GRID - start) / 0.1, 0, 1)
    steps = {1: x, 3: x**2 * (3 - 2 * x), 5: x**3 * (10 - 15 * x + 6 * x**2)}
    steps[7] = x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)
    return np.asarray(0.04 * steps[degree][:, None])


@pytest.mark.parametrize("degree", [1, 3, 5, 7])
def test_the_start_of_a_mean_rise_has_no_bias_for_any_smooth_step(degree: int) -> None:
    """0.05 % of noise, as in the mean of 20 crossings of 5 deg."""
    noise = np.random.default_rng(degree).normal(0, 2e-5, (len(GRID), 1))

    begun = start_of_rise(GRID, rise(degree, 0.0131) + noise, 2e-5)

    assert begun.start == pytest.approx(0.0131, abs=1e-3)
    assert begun.change_by_other_steps == 0.0


def test_the_start_of_a_rise_in_two_directions_has_no_bias() -> None:
    """0.3 % of noise: a length in place of a displacement would start early."""
    random = np.random.default_rng(3)
    straight = rise(5, 0.0) @ np.array([[0.6, 0.8]])
    noisy = [straight + random.normal(0, 1.2e-4, (len(GRID), 2)) for _ in range(30)]

    starts = np.array([start_of_rise(GRID, motion, 1.2e-4).start for motion in noisy])

    assert abs(starts.mean()) < 0.55 * starts.std()  # 3 / sqrt(30)


def test_a_start_that_noise_hides_has_the_change_by_other_steps() -> None:
    """Of a step of seventh degree, 1 % of noise: minimum jerk starts 7 ms later."""
    noise = np.random.default_rng(5).normal(0, 4e-4, (len(GRID), 1))

    begun = start_of_rise(GRID, rise(7, 0.0) + noise, 4e-4)

    assert begun.start == pytest.approx(7e-3, abs=1.5e-3)
    assert abs(begun.start) < 1.3 * begun.change_by_other_steps


def campaign(folder: Path, rows: str, **walking: Any) -> Campaign:
    """A campaign with these rows: trial, experiment, perturbed, subject, session, side, static."""
    header = "trial,experiment,perturbed,subject,session,side,static,mocap,mocap_source"
    (folder / "trials.csv").write_text(
        "\n".join([header, *(f"{line},a.c3d,vicon" for line in rows.split())]) + "\n"
    )
    content = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    content |= {
        "sheet": folder / "trials.csv",
        "simulation": None,
        "walking": content["walking"] | walking,
    }
    return open_campaign(campaign_config(content, [ROOT / "config/config.yaml"]), None)


SUBJECTS = (
    "sA,static,,A,1,, sB,static,,B,1,, sA2,static,,A,2,, wA,walking,false,A,1,,"
    # sC is that of a plate alone, sD of nothing
    " wB,walking,false,B,1,, sC,static,,C,1,right, sD,static,,D,1,, p,plate,,,,,sC"
)


def test_each_crossing_has_the_static_trial_of_its_subject_and_session(tmp_path: Path) -> None:
    sheet = campaign(tmp_path, SUBJECTS + " wA2,walking,true,A,2,, m,plate,,,,,sB")

    assert [sheet.static(trial) for trial in ("wA", "wB", "wA2", "m")] == ["sA", "sB", "sA2", "sB"]
    assert sheet.statics == {"sA": ["wA"], "sB": ["wB"], "sA2": ["wA2"], "sC": []}


def test_without_a_correction_no_static_trial_of_the_plate_is_needed(tmp_path: Path) -> None:
    sheet = campaign(tmp_path, SUBJECTS, plate_inertia="none")

    assert sheet.statics == {"sA": ["wA"], "sB": ["wB"]}


@pytest.mark.parametrize(("cells", "statics", "own"), [
    ({"subject": "A", "session": "2", "static": "s1"},
     {"s1": {"subject": "A"}, "s2": {"session": "2"}}, "s1"),
    ({"subject": "A", "session": "2"},
     {"s1": {"subject": "A"}, "s2": {"subject": "A", "session": "2"}}, "s2"),
    ({"side": "left"}, {"s1": {"side": "right"}, "s2": {"side": "left"}}, "s2"),
    ({"subject": "A"}, {"s1": {}}, "s1"),
])  # fmt: skip
def test_the_static_trial_is_the_named_one_else_the_subject_s_else_the_only(
    cells: dict[str, str], statics: dict[str, dict[str, str]], own: str
) -> None:
    assert static_of("w", cells, statics) == own


@pytest.mark.parametrize(("cells", "statics", "message"), [
    ({}, {"s1": {}, "s2": {}},
     r"states no subject, session or side: 2 static trials .*\(s1, s2\); name one"),
    ({"subject": "A"}, {"s1": {}, "s2": {}}, r"\(subject A\): 2 static trials could be its own"),
    ({"subject": "A"},
     {"s1": {"subject": "B"}}, r"\(subject A\): no static trial of the same conditions"),
    ({"static": "w1"},
     {"s1": {}}, "static: 'w1' is no trial of experiment 'static' that is used; .* s1"),
])  # fmt: skip
def test_a_crossing_without_a_static_trial_of_its_own_is_refused(
    cells: dict[str, str], statics: dict[str, dict[str, str]], message: str
) -> None:
    with pytest.raises(InputError, match=f"trial 'w'.*{message}"):
        static_of("w", cells, statics)


def sided(static: str, crossings: str) -> str:
    """Rows of a campaign whose static trial, and whose crossings, state a side."""
    names = ("u1,walking,false", "u2,walking,false", "u3,walking,false", "p1,walking,true",
             "p2,walking,true")  # fmt: skip
    walks = " ".join(f"{name},,,{crossings}" for name in names)
    return f"s1,static,,,,{static}, m,plate,,,,, {walks}"


@pytest.mark.parametrize(
    ("static", "crossings", "side"),
    [("left", ",", "left"), ("", "left,", "left"), ("", ",", "right")],
)
def test_the_side_of_the_sheet_goes_before_that_of_the_configuration(
    tmp_path: Path, static: str, crossings: str, side: str
) -> None:
    sheet = campaign(tmp_path, sided(static, crossings), side="right")

    check_walking(sheet)
    assert sheet.calibration_settings("s1")["side"] == side


@pytest.mark.parametrize(
    ("rows", "trial"),
    [
        (sided("", "right,") + " p3,walking,true,,,left,", "p3"),
        (sided("right", "left,s1"), "p2"),
    ],
)
def test_a_static_trial_of_both_sides_is_refused(tmp_path: Path, rows: str, trial: str) -> None:
    message = rf"'s1' serves trials of the sides left, right \(trial '{trial}': left\)"

    with pytest.raises(InputError, match=message):
        check_walking(campaign(tmp_path, rows))


def glued_elsewhere(trial: Trial) -> Trial:
    """The trial with PLAT1 30 mm to the left, along the axis about which the platform turns."""
    return changed(trial, pl.col("marker_PLAT1_y") + 0.03)


LATER_CALIBRATION = static_calibration(glued_elsewhere(static_trial()), settings())


def test_each_unloaded_trial_is_read_with_the_cluster_of_its_session() -> None:
    """With the first static trial the residual of the second session exceeds the limit."""
    trials = plate_trials(QUIET, Ramp(), 2, 2)
    later = glued_elsewhere(trials[1])

    alike = identify_plate_model(calibrated(trials), settings())
    model = identify_plate_model([(trials[0], CALIBRATION), (later, LATER_CALIBRATION)], settings())

    np.testing.assert_allclose(model.parameters, alike.parameters, atol=0.05)  # 0.01 mm of noise
    with pytest.raises(InputError, match="are seen together in 0 frames"):
        identify_plate_model(calibrated([later]), settings())


def test_motions_of_different_clusters_are_not_compared() -> None:
    first, second = (walked_over(f"w{k}", Ramp(), RIG, k) for k in range(2))
    pairs = [(first, CALIBRATION), (glued_elsewhere(second), LATER_CALIBRATION)]

    with pytest.warns(
        UserWarning, match=r"keeps its own motion of the platform: .* stand 13 mm \(RMS\) otherwise"
    ):
        model = identify_platform(pairs, settings())

    assert model.template is None
    assert model.reason.startswith("the platform markers PLAT1")


def test_without_a_correction_the_torque_is_that_of_the_wrench_as_recorded() -> None:
    """0.4 N and 0.08 N*m of noise at 1500 Hz through 20 Hz leave 0.02 N*m; the filters' rates
    differ by 0.1."""
    light, heavy = (
        perturbed(walked_over("w", Ramp(), rig, 1), plate_inertia="none")
        for rig in (replace(QUIET, mass=1e-9), QUIET)
    )

    window = (light.time > 1.1) & (light.time < 1.3)
    error = (light.torque - exact_torque(light.time, Ramp()))[window]
    assert np.abs(error).max() < 0.3
    assert np.abs(heavy.torque - light.torque).max() > 5


def test_a_plate_that_is_not_corrected_is_said_and_stored(tmp_path: Path) -> None:
    outputs = (tmp_path / "plate.json", tmp_path / "plate.csv")

    with pytest.warns(
        UserWarning, match="own inertia and lag stay in the torque: walking.plate_inertia is none"
    ):
        identify_plate([], [], {}, settings(plate_inertia="none"), *outputs)

    table = read_table(outputs[1])
    assert table["plate_inertia"].unique().to_list() == ["none"]
    assert table["rms_before"].is_null().all()
    assert not read_model(outputs[0], PlateModel).parameters.any()


def raised(trial: Trial, by: list[float]) -> Trial:
    """The trial whose recording states the corners elsewhere [m]."""
    plate = {"plate": 1, "type": 2, "corners": np.add(synthetic.CORNERS, by).tolist()}
    return replace(trial, provenance={"plates": [plate]})


def test_a_resting_plate_adds_nothing() -> None:
    weightless = replace(plate(), parameters=np.zeros(10))

    difference = unperturbed(WALK, plate()).torque - unperturbed(WALK, weightless).torque

    assert np.sqrt(np.mean(difference**2)) < 0.05


def shifted(size: float) -> Trial:
    """The platform, and what stands on it, moves forward [m] within 0.1 s in mid-stance."""
    share = pl.Series(np.clip((WALK.samples["time"].to_numpy() - 1.2) / 0.1, 0, 1))
    return changed(WALK, pl.col("^marker_.*_x$") + size * share)


@pytest.mark.parametrize("is_perturbed", [False, True])
def test_a_translation_is_no_crossing(is_perturbed: bool) -> None:
    with pytest.raises(
        InputError, match=r"the platform shifts by (50|51) mm in stance without a turn, expect"
    ):
        analyse_crossing(shifted(0.05), CALIBRATION, NO_CORRECTION, is_perturbed, settings())


def test_a_platform_that_yields_a_little_is_no_perturbation() -> None:
    crossing = unperturbed(shifted(0.005))

    quality = crossing.quality
    assert crossing.onset is None
    assert (quality.foot_forward_m, quality.foot_left_m) == pytest.approx((-0.06, 0), abs=2e-3)
    assert quality.foot_outside_m == 0


BESIDE = raised(WALK, [0.2, -0.02, 0])  # corners further forward and to the right


def test_a_foot_beside_the_plate_has_its_place_and_its_load() -> None:
    crossing = unperturbed(BESIDE)

    quality = crossing.quality
    assert (quality.foot_forward_m, quality.foot_left_m) == pytest.approx((-0.26, 0.02), abs=2e-3)
    assert quality.foot_outside_m == pytest.approx(0.03, abs=2e-3)
    # through the ankle
    middle = len(crossing.time) // 2
    assert crossing.load[:, middle] == pytest.approx([680, -0.02, 0.25], rel=0.02)


def test_a_late_plate_is_read_later() -> None:
    crossing = unperturbed(BESIDE)

    late = unperturbed(BESIDE, replace(NO_CORRECTION, lags=(0.01,)))

    assert crossing.stance.heel_strike - late.stance.heel_strike == pytest.approx(0.01, abs=1e-4)
    np.testing.assert_allclose(late.torque, crossing.torque, atol=1)  # 3 frames earlier


def test_a_turn_with_some_shift_is_a_perturbation() -> None:
    heaved = walked_over("w", Ramp(heave=0.015), replace(RIG, mass=1e-9), 1)

    assert perturbed(heaved, largest_shift_mm=5).onset is not None


def test_none_and_several_stances_are_refused() -> None:
    in_air = pl.col("time").is_between(1.25, 1.3)
    lifted = changed(WALK, plate1_force_z=pl.col("plate1_force_z") * ~in_air)

    with pytest.raises(InputError, match="one stance on the plate is expected, found none; check"):
        unperturbed(WALK, load_on_n=1000)
    with pytest.raises(InputError, match=r"found 0\.93\d-1\.25\d s, 1\.29\d-1\.59\d s; check"):
        unperturbed(lifted, shortest_stance_s=0.2)


def test_a_moment_that_lifts_the_toes_in_late_stance_is_refused() -> None:
    in_stance = pl.col("time").is_between(1.0, 1.6).cast(pl.Float64)
    pulled = changed(WALK, pl.col("plate1_moment_y") + in_stance * 120)

    with pytest.raises(InputError, match=r"the ankle's moment in late stance is -.*, though"):
        unperturbed(pulled)


@pytest.mark.parametrize(
    ("onset", "message"),
    [
        (1.75, r"starts at 1\.750 s, outside stance 0\.930-1\.590 s"),
        (0.8, r"starts at 0\.800 s, outside stance"),
        (1.02, r"baseline and window, .* s, leave stance 0\.930-1\.590 s"),
        (1.53, "baseline and window, .* s, leave stance"),
    ],
)
def test_an_onset_whose_response_leaves_stance_is_refused(onset: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_onset(onset, True, Stance(0.93, 1.59), settings())


def test_too_few_unperturbed_crossings_say_how_many_and_the_most_frequent_reason(
    tmp_path: Path,
) -> None:
    backwards = "trial u{0}: the shank moves 2{0} cm backwards over the foot"
    reasons = {
        "u0": backwards.format(0),
        "u1": backwards.format(1),
        "u2": "trial u2: hidden",
        "p1": "another",
    }
    files = [tmp_path / f"u{k}.parquet" for k in range(3)]
    for file in files:
        write_refusal(RefusedCrossing(file.stem, False, reasons[file.stem]), file)
    rows = [{"trial": name, "reason": reason} for name, reason in reasons.items()]
    table = pl.DataFrame(rows).with_columns(
        perturbed=pl.col("trial") == "p1", gait=pl.lit("all"), group=None, direction=None
    )
    write_table(table, tmp_path / "selection.csv")

    with pytest.raises(InputError) as caught:
        average_unperturbed(files, tmp_path / "selection.csv", 4, tmp_path / "gait.parquet")

    message = str(caught.value)
    assert message.startswith("0 of 3 unperturbed crossings can be used, expected 4 or more")
    assert "2 times (u0, u1) beside 1 for other reasons" in message
    assert message.endswith("as in u0: the shank moves 20 cm backwards over the foot")


SILENT = Rig(mass=1e-9, marker=0, force=0, moment=0)
FAST = Ramp(angle=5.0, rise=0.08)


def leaning_walk() -> Trial:
    """A crossing over a plate without mass, whose force also acts forward and to the left."""
    trial = walked_over("w", FAST, SILENT, 1)
    of_load = 0.1 * pl.col("plate1_force_z")
    return changed(
        trial,
        plate1_force_x=pl.col("plate1_force_x") + of_load,
        plate1_force_y=pl.col("plate1_force_y") + of_load,
    )


def scaled(trial: Trial, quantity: str) -> Trial:
    """The trial with `moment` or `force` channels that are 1 % too large."""
    columns = [f"plate1_{quantity}_{axis}" for axis in "xyz"]
    return changed(trial, **{column: 1.01 * pl.col(column) for column in columns})


def pitched(trial: Trial) -> Trial:
    """The trial of cameras that are pitched by 1 deg: all markers turn toes down about the
    laboratory's origin."""
    c, s = np.cos(np.deg2rad(1.0)), np.sin(np.deg2rad(1.0))
    turned = {}
    for column in trial.columns:
        if column.endswith("_x") and "plate1" not in column:
            marker = column.removesuffix("_x")
            x, z = pl.col(f"{marker}_x"), pl.col(f"{marker}_z")
            turned[f"{marker}_x"] = c * x + s * z
            turned[f"{marker}_z"] = c * z - s * x
    return changed(trial, **turned)


def expected_change(sound: Crossing, error: str, time: Array) -> Array:
    """Of the torque by an error of the laboratory."""
    return sound.lab_errors[list(LABORATORY_ERRORS).index(error)][time]


@pytest.mark.parametrize(
    ("error", "faulty", "static"),
    [
        ("corners_height", lambda trial: raised(trial, [0, 0, 0.01]), static_trial),
        ("corners_forward", lambda trial: raised(trial, [0.01, 0, 0]), static_trial),
        ("moments", lambda trial: scaled(trial, "moment"), static_trial),
        ("forces", lambda trial: scaled(trial, "force"), static_trial),
        ("pitch", pitched, lambda: pitched(static_trial())),
    ],
)
def test_the_change_by_an_error_of_the_laboratory_is_that_of_a_faulty_recording(
    error: str, faulty: Callable[[Trial], Trial], static: Callable[[], Trial]
) -> None:
    sound = perturbed(leaning_walk())

    wrong = perturbed(faulty(leaning_walk()), static=static_calibration(static(), settings()))

    rows = (sound.time > 1.0) & (sound.time < 1.5)
    expected = expected_change(sound, error, rows)
    assert np.ptp(expected) > 0.01
    change = (wrong.torque - sound.torque)[rows]
    np.testing.assert_allclose(change, expected, atol=0.03 * np.ptp(expected))


def test_the_change_by_a_late_plate_is_that_of_a_faulty_recording() -> None:
    """Of a plate with its mass, of which the model knows."""
    sound, late = (
        perturbed(walked_over("w", FAST, replace(SILENT, mass=25.0, lag=lag), 1), plate())
        for lag in (0.0, 0.001)
    )

    rows = (sound.time > 1.0) & (sound.time < 1.5)
    change = (np.interp(sound.time, late.time, late.torque) - sound.torque)[rows]
    expected = expected_change(sound, "plate_lag", rows)
    np.testing.assert_allclose(change, expected, atol=0.1 * np.ptp(change))


def test_the_unloaded_plate_shows_the_height_of_its_corners_to_2_mm() -> None:
    trials = [raised(trial, [0, 0, 0.02]) for trial in plate_trials(RIG, Ramp(), 3, 2)]

    high = identify_plate_model(calibrated(trials), settings())

    assert plate().height == pytest.approx(0, abs=2e-3)
    assert high.height == pytest.approx(0.02, abs=2e-3)
    assert high.height_se == pytest.approx(0, abs=2e-3)


def test_a_height_is_certain_beyond_four_standard_errors() -> None:
    high = replace(plate(), height=0.02, height_se=0.0049)

    assert high.certain_height == 0.02
    assert replace(high, height_se=0.0051).certain_height == 0
    assert replace(high, height=None).certain_height is None
