# SPDX-License-Identifier: Apache-2.0
"""The moving force plate: its axes, its own mass, its lateness, its faults, and how the foot loads
it."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
import walking_synthetic as synthetic
from c3d_builder import FACE
from conftest import refused_with, white_noise
from scipy.spatial.transform import Rotation
from walking_synthetic import (
    PLATE_RATE,
    RATE,
    G,
    Ramp,
    Rig,
    bump,
    changed,
    hidden,
    settings,
    static_trial,
    walked_over,
)

from osl_analysis.base.errors import IdentifiabilityError
from osl_analysis.base.trial import Trial, plate_columns
from osl_analysis.ingest.force_plates import plate_axes
from osl_analysis.walking.crossing import analyse_crossing
from osl_analysis.walking.geometry import Ankle, load_on_foot
from osl_analysis.walking.plate import (
    Stance,
    check_plate,
    check_vertical,
    check_weight,
    only_stance,
    outside,
    recorded_corners,
    wrench_reader,
    zeroed_wrench,
)
from osl_analysis.walking.plate_inertia import (
    NO_CORRECTION,
    PlateModel,
    Shown,
    height_of,
    identify_plate_inertia,
    identify_plate_model,
    inertial_columns,
    with_height,
    without_mean,
)
from osl_analysis.walking.poses import BodyMotion, static_calibration
from osl_analysis.walking.set_up import check_roll, check_side

PIVOT = np.array([-0.06, 0.0, 0.08])
TIME = np.arange(3 * PLATE_RATE) / PLATE_RATE
PHASE = np.linspace(0, 1, 11)
SURFACE = np.add(FACE, [1.0, 2.0, 0.1])
CALIBRATION = static_calibration(static_trial(), settings())
MASS = 12.0
COM = np.array([0.01, -0.02, -0.03])
I_COM = np.diag([0.25, 0.36, 0.60])
ABOUT_CENTRE = I_COM + MASS * ((COM @ COM) * np.eye(3) - np.outer(COM, COM))
RIG = Rig(mass=MASS, marker=1.5e-4, moment=0.05)
RAMP = Ramp(angle=5, onset=1.0, returns=2.0)
TRUE = np.array([MASS, *(MASS * COM), *np.diag(ABOUT_CENTRE), *ABOUT_CENTRE[[0, 0, 1], [1, 2, 2]]])


def matrix(about, angle):
    """Rotations (n, 3, 3) about a laboratory axis."""
    return Rotation.from_rotvec(np.outer(angle, np.eye(3)[about])).as_matrix()


def plate_motion(about, height, scale):
    """The plate turns about a laboratory axis through the pivot by two bumps; its wrench by Newton
    and Euler. All derivatives by hand: a = z x r + w x (w x r), and the force on the body is m
    (a_com - g)."""
    t = np.arange(RATE) / RATE
    phi, omega, alpha = height * (bump(t, 0.3, scale) - 0.7 * bump(t, 0.6, scale))
    R = matrix(about, phi)
    n = np.eye(3)[about]

    w = omega[:, None] * n
    z = alpha[:, None] * n

    def swung(point):
        r = R @ (point - PIVOT)
        return r + PIVOT, np.cross(z, r) + np.cross(w, np.cross(w, r))

    centre, acceleration = swung(np.zeros(3))
    com, com_acceleration = swung(COM)
    inertia = R @ I_COM @ R.transpose(0, 2, 1)
    turning = np.einsum("nij,nj->ni", inertia, z) + np.cross(w, np.einsum("nij,nj->ni", inertia, w))
    force = MASS * (com_acceleration + np.array([0, 0, G]))
    moment = turning + np.cross(com - centre, force)
    in_plate = R.transpose(0, 2, 1)
    tare = np.array([0, 0, MASS * G])
    tare_moment = np.cross(COM, [0, 0, MASS * G])
    parts = (
        np.einsum("nij,nj->ni", in_plate, force) - tare,
        np.einsum("nij,nj->ni", in_plate, moment) - tare_moment,
    )
    return BodyMotion(R, w, z, centre, acceleration), np.hstack(parts)


def shown(recordings, noise=0.0):
    """What (motion, wrench) show, with a share of the columns for noise."""
    columns = [(inertial_columns(motion), wrench) for motion, wrench in recordings]
    return [Shown(each, noise * without_mean(each), wrench) for each, wrench in columns]


def test_all_ten_parameters_come_out_where_all_axes_turn():
    recordings = []
    for about in range(3):
        motion, wrench = plate_motion(about, 0.15, 0.04)
        zero = about * np.repeat([1.0, -0.3], 3)  # each recording has its own
        recordings.append((motion, wrench + zero))

    model = identify_plate_inertia(shown(recordings))

    np.testing.assert_allclose(model.parameters, TRUE, rtol=1e-7, atol=1e-9)


def test_a_gain_shows_where_the_plates_carry_a_stated_weight():
    standing = changed(static_trial(), plate1_force_z=pl.lit(0.96 * 50 * G))

    check_weight(standing, None)
    check_weight(standing, 49.0)
    with refused_with("the plates carry 0.96 of the weight of 50 kg"):
        check_weight(standing, 50.0)


def headed(recording, heading):
    """The same recording with a laboratory, and a plate's own axes, that stand turned about the
    vertical."""
    motion, wrench = recording
    Q = Rotation.from_euler("z", heading).as_matrix()
    turned_motion = BodyMotion(
        rotation=Q @ motion.rotation @ Q.T,
        omega=motion.omega @ Q.T,
        alpha=motion.alpha @ Q.T,
        point=motion.point @ Q.T,
        acceleration=motion.acceleration @ Q.T,
    )
    return turned_motion, (wrench.reshape(-1, 2, 3) @ Q.T).reshape(-1, 6)


@pytest.mark.parametrize("heading", [0.0, 0.08, np.pi / 6, 2.0])
def test_the_wrench_of_a_motion_like_those_of_the_trials_is_known(heading):
    """Trials that turn about one axis show no single parameter about the others, whichever way the
    laboratory lies."""
    trials = [headed(plate_motion(1, size, 0.03), heading) for size in (0.09, 0.05)]
    motion, wrench = headed(plate_motion(1, -0.07, 0.035), heading)

    model = identify_plate_inertia(shown(trials))

    unexplained = without_mean(wrench - inertial_columns(motion) @ model.parameters)
    assert np.abs(unexplained).max() < 1e-3 * np.abs(wrench).max()
    in_x = identify_plate_inertia(shown([plate_motion(1, 0.09, 0.03)]))
    assert model.directions.shape[1] == in_x.directions.shape[1] < 10


def about_two_axes():
    """Of which the second hardly turns."""
    return [plate_motion(1, 0.09, 0.03), plate_motion(0, 0.004, 0.04)]


def test_the_error_of_the_height_is_that_of_a_mean_over_the_recordings():
    """Recordings of one motion weigh alike, so that the height is the mean of theirs. Its standard
    error is then s/sqrt(m)."""
    heights = np.array([0.020, 0.021, 0.017, 0.024, 0.018])
    parameters = np.array([MASS, 0, 0, 0, *np.diag(I_COM), 0, 0, 0])  # its mass is at the centre
    motions = [plate_motion(about, 0.15, 0.04)[0] for about in range(3)]
    columns = np.concatenate([inertial_columns(motion) for motion in motions])
    at_corners = columns @ parameters
    recordings = []
    for height in heights:
        wrench = at_corners.copy()
        wrench[:, 3:] += np.cross([0.0, 0.0, height], wrench[:, :3])
        recordings.append(Shown(columns, np.zeros((0, 6, 10)), wrench))
    model = PlateModel(parameters, np.eye(10), np.zeros(6), np.zeros(6))

    raised = with_height(model, recordings)

    assert raised.height == pytest.approx(heights.mean(), rel=1e-6)
    assert raised.height_se == pytest.approx(heights.std(ddof=1) / np.sqrt(len(heights)), rel=1e-6)


def test_motions_of_one_recording_have_its_noise_together():
    """Cut in two, it has the same height, of columns whose noise is taken off once."""
    columns = np.concatenate([inertial_columns(plate_motion(k, 0.15, 0.04)[0]) for k in range(3)])
    columns = without_mean(columns)
    wrench = columns @ np.array([MASS, 0, 0, 0, *np.diag(I_COM), 0, 0, 0])
    wrench[:, 3:] += np.cross([0.0, 0.0, 0.02], wrench[:, :3])
    whole = Shown(np.tile(columns, (2, 1, 1)), 0.3 * columns, np.tile(wrench, (2, 1)))
    moves = np.ones(2 * len(columns), dtype=bool)
    moves[len(columns) - 1] = False

    parts = whole.parts(moves)

    assert len(parts) == 2
    assert height_of(np.eye(10), parts) == pytest.approx(height_of(np.eye(10), [whole]), rel=1e-6)


def test_what_recordings_do_not_show_stays_as_it_is_known():
    """A jackknife without the only trial about x must not call I_xx zero."""
    recordings = about_two_axes()
    whole = identify_plate_inertia(shown(recordings))

    without_x = identify_plate_inertia(shown(recordings[:1]), replace(whole, parameters=TRUE))

    np.testing.assert_allclose(without_x.parameters, TRUE, rtol=1e-6, atol=1e-8)


def test_a_direction_that_is_mostly_noise_is_not_identified():
    recordings = about_two_axes()

    with pytest.raises(
        IdentifiabilityError,
        match=r"marker noise.*90%.*plate.*dir",
    ):
        identify_plate_inertia(shown(recordings, noise=np.sqrt(0.9)))


@pytest.mark.parametrize(
    ("frequency", "lag", "gain", "error"),
    [
        (15, 0.0, 1.0, 1e-4),  # without delay
        (8, 0.0021, 1.0, 1e-4),  # a late plate is read later
        (290, 0.0, 0.0, 3e-3),  # no aliasing: 290 Hz at 300 Hz would be 10 Hz
    ],
)
def test_a_wrench_is_brought_to_the_markers_frames(frequency, lag, gain, error):
    fast = np.arange(4500) / PLATE_RATE
    slow = np.arange(900) / RATE
    tone = np.sin(2 * np.pi * frequency * (fast - lag))[:, None] * [1.0, 2.0, 3.0]

    sampled = wrench_reader(fast, np.hstack([tone, tone]), slow)(lag)

    expected = gain * np.sin(2 * np.pi * frequency * slow)[:, None] * [1.0, 2.0, 3.0]
    inside = slice(60, -60)
    np.testing.assert_allclose(sampled[inside, :3], expected[inside], atol=error)
    np.testing.assert_allclose(sampled[:, 3:], sampled[:, :3])


def unloaded(name, load=0.0, angle=5.0, threshold=0.0, **changes):
    """A recording of a plate that turns and returns, with noise on all; `changes` of its rig. Below
    a threshold an export wrote 0."""
    trial = walked_over(name, replace(RAMP, angle=angle), replace(RIG, **changes), 7, loaded=False)
    force = pl.col("plate1_force_z")
    return changed(trial, (force + load) * (force.abs() > threshold))


def between(trial, start, end):
    """The part of a recording between two times [s]."""
    rows = pl.col("time").is_between(start, end)
    return replace(trial, samples=trial.samples.filter(rows))


def model_of(*trials, **choices):
    return identify_plate_model([(trial, CALIBRATION) for trial in trials], settings(**choices))


def test_the_models_without_a_trial_know_nothing_of_it():
    trials = [unloaded(f"plate_{k}", lag=0.001 * (1 + k), mass=MASS + k) for k in range(3)]
    motion, wrench = plate_motion(1, 0.09, 0.03)

    model = model_of(*trials)

    from_others = model_of(*trials[1:])
    difference = model.leave_one_out[0].parameters - from_others.parameters
    assert np.abs(inertial_columns(motion) @ difference).max() < 0.02 * np.abs(wrench).max()


def test_a_marker_that_moves_at_rest_costs_no_recording_of_the_plate():
    """2 mm of one marker look like a turn, which no wrench follows."""
    trial = unloaded("plate_1", lag=0.0015)
    bump = 0.002 * np.exp(-((trial.samples["time"].to_numpy() - 0.4) ** 2) / 8e-4)

    model = model_of(changed(trial, pl.col("marker_PLAT1_z") + bump))

    assert [turn.lag for turn in model.turns] == pytest.approx([0.0014] * 2, abs=1e-4)


def test_a_lag_that_is_not_found_is_not_corrected():
    model = model_of(unloaded("plate_1", lag=0.002, mass=0.0))

    assert model.lag is None


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"lag": 0.014}, "plate's wrench"),  # clocks
        ({"lag": -0.05}, "plate's wrench"),  # far apart
        ({"angle": 0.3}, r"platform.*0\.\d+ deg"),  # at rest
        ({"load": 300.0}, "plate.*300 N"),  # a foot on the plate
        ({"threshold": 0.11}, r"between 0 and 0\.11 N.*without a threshold"),
    ],
)
def test_a_recording_that_cannot_show_the_unloaded_plate_is_refused(changes, reason):
    with refused_with(f"trial plate_1: .*{reason}") as refusal:
        model_of(unloaded("plate_1", **changes))

    assert refusal.value.trial == "plate_1"


@pytest.mark.parametrize(("start", "end", "turns"), [(1.05, 1.057, 2), (0.99, 1.017, 1)])
def test_a_turn_with_occluded_markers_has_no_part_in_the_model(start, end, turns):
    """While they are hidden it turns by 0.6 deg in 7 ms, and by 0.3 deg in 27 ms."""
    trial = hidden(unloaded("plate_1", lag=0.0015), ("PLAT1", "PLAT2"), start, end)

    model = model_of(trial)

    assert len(model.turns) == turns
    assert model.lag == pytest.approx(0.0014, abs=2e-4)


def test_recordings_without_a_whole_motion_are_refused():
    late = between(unloaded("plate_2", lag=0.0015), 2.0, 3.0)
    slow = walked_over("plate_2", replace(RAMP, rise=1.2, returns=2.5), RIG, 7, loaded=False)
    never_still = between(slow, 1.2, 2.0)

    for cut in (late, never_still):
        with refused_with(r"plate_2: .*0\... deg"):
            model_of(cut)


def test_a_motion_that_the_recording_cuts_has_no_part_in_the_model():
    """Half a motion made the lag 0.3 to 5 ms wrong and the mass 3 kg too small, with nothing
    said."""
    early = between(unloaded("plate_1", lag=0.0015), 0.0, 2.0)

    model = model_of(early)

    assert model.lag == pytest.approx(0.0015, abs=1e-4)
    assert model.parameters[0] == pytest.approx(MASS, rel=0.02)


def stepped(offset):
    """A step of 0.7 s and 800 N from 1 s; then the tilted plate reads 5 N more with half the
    noise."""
    is_tilted = TIME > 1.75
    load = 800 * np.sin(np.pi * np.clip((TIME - 1) / 0.7, 0, 1)) + 5.0 * is_tilted
    noise_of_time = np.where(is_tilted, 0.2, 0.4)[:, None]
    random = white_noise((len(TIME), 3), 2)
    force = np.outer(load, [0.1, 0.0, 1.0]) + offset + noise_of_time * random
    moment = 0.02 * offset + np.outer(load, [0.0, -0.1, 0.0])
    return np.hstack([force, moment])


def standing_on(wrench, first=0):
    """A recording of this wrench from a row on."""
    frames = len(wrench[first:]) // 5
    markers = synthetic.labelled("PLAT", np.tile(synthetic.PLATFORM, (frames, 1, 1)))
    return synthetic.recording("c", markers, wrench[first:, :3], wrench[first:, 3:])


@pytest.mark.parametrize("unloaded_s", [0.9, 0.2])
def test_the_zero_is_read_before_the_foot_comes(unloaded_s):
    """Of 1 s before it, and not after the platform tilted. 0.2 s of noise of 0.4 N: the mean's
    standard deviation is 0.02 N."""
    trial = standing_on(stepped(-60.0))

    read = zeroed_wrench(trial, TIME[::5], settings(unloaded_s=unloaded_s))

    np.testing.assert_allclose(read(0.0)[20:180].mean(axis=0), 0, atol=0.15)


def test_a_plate_that_is_loaded_from_the_start_is_refused():
    with refused_with(r"0\.2 s.*recording's"):
        zeroed_wrench(standing_on(stepped(0.0), 2000), TIME[:-2000:5], settings())


def test_noise_as_the_foot_comes_ends_no_stance_that_it_begins():
    """A stance begins at 20 N, and ends at half of that."""
    time = np.arange(1200) / 1000
    load = 800 * np.minimum(time - 0.1, 1.0 - time)  # [N], 0.8 N in each sample
    noise = 4.0 * (-1.0) ** np.arange(1200) * (load < 60)

    stance = only_stance(time, load + noise, settings(load_on_n=20))

    assert stance.heel_strike == pytest.approx(0.1 + 20 / 800, abs=6e-3)
    assert stance.toe_off == pytest.approx(1.0 - 10 / 800, abs=6e-3)


RUNS = ("clipped_at", "clipped_from_s", "clipped_to_s", "stands_from_s", "stands_to_s")


def examined(**channel):
    """A recording of a plate of which ingest found this in a channel."""
    facts = {"label": "A3", **dict.fromkeys(RUNS, 0.0), **channel}
    plate = {"plate": 1, "channels": [facts]}
    return Trial("w", pl.DataFrame({"time": [0.0]}), {"plates": [plate]})


CLIPPED = examined(clipped_from_s=0.3, clipped_to_s=0.325, clipped_at=-200.0)
DEAD = examined(stands_from_s=0.1, stands_to_s=0.31)
STANCE = Stance(0.2, 0.8)
PERSON = np.array([0.0, 700.0])  # [N]


@pytest.mark.parametrize(
    ("trial", "message"),
    [
        (CLIPPED, r"A3.*force plate 1.*-200.*0\.300 s.*0\.325 s"),
        (DEAD, r"A3.*force plate 1.*0\.100"),
    ],
)
def test_a_channel_that_fails_in_stance_is_refused(trial, message):
    with refused_with(message):
        check_plate(trial, 1, STANCE, PERSON)


@pytest.mark.parametrize(
    ("trial", "plate", "stance"),
    [
        (CLIPPED, 1, Stance(0.35, 1.5)),  # before stance
        (CLIPPED, 2, STANCE),  # on another plate
        (CLIPPED, 1, Stance(0.1, 0.28)),  # after stance
        (DEAD, 1, Stance(0.22, 0.8)),  # for 90 ms
    ],
)
def test_a_channel_that_fails_elsewhere_does_not_matter(trial, plate, stance):
    check_plate(trial, plate, stance, PERSON)


@pytest.mark.parametrize(("size_m", "is_plate"), [
    (0.025, False), (0.04, True), (4.5, True), (6.0, False),
])  # fmt: skip
def test_a_plate_has_three_centimetres_to_five_metres_from_corner_to_corner(size_m, is_plate):
    corners = np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0]]) * size_m / np.sqrt(2)
    trial = Trial(
        "w", pl.DataFrame({"time": [0.0]}), {"plates": [{"plate": 1, "corners": corners.tolist()}]}
    )

    if is_plate:
        assert recorded_corners(trial, 1) == pytest.approx(corners)
    else:
        with refused_with("force plate 1 is .* from corner to corner"):
            recorded_corners(trial, 1)


def test_a_force_beyond_a_person_s_is_refused():
    with refused_with(r"plate 1.*8\.4e\+03 N,.*8000 N"):
        check_plate(examined(), 1, STANCE, 12 * PERSON)


def test_a_moving_plate_without_moments_is_refused():
    alone = unloaded("plate_1")
    walked = walked_over("p", Ramp(), Rig(), 1)
    for trial in (alone, walked):
        trial.provenance["plates"][0]["type"] = 1

    with refused_with(r"type 1.*type 2, 3.*4"):
        model_of(alone)
    with refused_with(r"type 1.*type 2, 3.*4"):
        analyse_crossing(walked, CALIBRATION, NO_CORRECTION, True, settings(), Ramp().onset, 0.0)


CENTRE = np.array([[1.0, 2.0, 0.1]])  # of the plate


def test_the_pressure_is_where_the_force_acts():
    """A force through a known point of the surface, the ankle 0.1 m above it; the axis points along
    -x, heading +y."""
    force = np.array([[30.0, -20.0, 700.0]])
    point = np.array([0.93, 2.1, 0.1])
    free_moment = np.array([0, 0, 4.0])
    wrench = np.hstack([force, np.cross(point - CENTRE, force) + free_moment])
    ankle = Ankle(np.zeros(1), np.array([[1.05, 1.9, 0.2]]), np.array([[-1.0, 0, 0]]))

    load = load_on_foot(wrench, CENTRE, ankle)

    assert load[:, 0] == pytest.approx([700, 1.05 - 0.93, 0.2])
    assert load_on_foot(0.14 * wrench, CENTRE, ankle)[1] == 0.0, "98 N have no centre"
    assert load_on_foot(0.2 * wrench, CENTRE, ankle)[1] == pytest.approx(0.12), "140 N have one"


@pytest.mark.parametrize(
    ("force", "along"),
    [
        ([20.0, 700, 30], r"\+y .up to 700"),
        ([20.0, 30, -700], "-z .up to 700"),
    ],
)
def test_a_load_that_does_not_act_upwards_is_refused(force, along):
    with refused_with(rf"{along}.*; .*`axes`.* C3D file in the recorder, .*`sign`"):
        check_vertical(np.outer(PHASE, force), 20.0)


def test_a_load_that_acts_upwards_and_noise_of_an_empty_plate_are_sound():
    check_vertical(np.outer(PHASE, [200.0, 100, 700]), 20.0)
    check_vertical(np.outer(PHASE, [-1.0, 0.3, 0.2]), 20.0)


def test_an_empty_plate_beside_a_loaded_one_is_refused():
    trial = standing_on(stepped(0.0))
    two = {column.replace("1", "2"): 0 * pl.col(column) for column in plate_columns(1)}
    trial = changed(trial, **two)
    trial.provenance["plates"].append({**trial.provenance["plates"][0], "plate": 2})

    with refused_with(r"plate 2 bears 0 N.*80. N.*`walking.plate: 1`"):
        zeroed_wrench(trial, TIME[::5], settings(plate=2))


@pytest.mark.parametrize(
    ("marker", "distance"),
    [
        ([1.29, 2.19, 0.1], 0.0),
        ([1.35, 2.1, 0.3], 0.05),  # however high
        ([0.66, 1.77, 0.1], 0.05),  # 4 cm behind one edge, 3 cm beyond the next
    ],
)
def test_a_marker_beside_the_plate_is_as_far_outside(marker, distance):
    assert outside(np.array([marker]), SURFACE) == pytest.approx([distance])


@pytest.mark.parametrize("corners", [SURFACE, SURFACE[::-1]])
def test_the_normal_points_up_in_either_order_of_corners(corners):
    np.testing.assert_allclose(plate_axes(corners)[:, 2], [0, 0, 1], atol=1e-12)


PLACED = Trial(
    "plate_1",
    pl.DataFrame({"time": [0.0]}),
    {"plates": [{"plate": 1, "type": 2, "corners": SURFACE.tolist()}]},
)


@pytest.mark.parametrize(
    ("trial", "plate", "message"),
    [
        (PLACED, 2, "plate 2;.*1"),
        (replace(PLACED, provenance={}), 1, "`plate`"),
    ],
)
def test_a_plate_without_corners_is_refused(trial, plate, message):
    with refused_with(message):
        recorded_corners(trial, plate)


def test_a_shank_that_moves_backwards_is_refused():
    ahead = -0.1 + 0.25 * PHASE

    check_side(PHASE, ahead)
    with refused_with(r"shank.*15 cm.*foot.*`side`,"):
        check_side(PHASE, -ahead)


def rolled(roll_m, roll_deg, push_deg, torque):
    """A load of 700 N that rolls and pushes at angles from forward in stance, checked."""
    turns = np.deg2rad([roll_deg, push_deg])
    roll, push = np.stack([np.sin(turns), np.cos(turns)], axis=1)[:, :, None] * PHASE
    weight = np.full(PHASE.size, 700.0)
    check_roll(PHASE, np.vstack([weight, roll_m * roll]), 300 * push, torque * PHASE)


@pytest.mark.parametrize("sound", [(0.2, 0, 0, 80), (0.2, 20, 40, 0), (0.02, 90, 0, 80)])
def test_a_load_that_rolls_forward_or_hardly_moves_is_sound(sound):
    rolled(*sound)


@pytest.mark.parametrize(
    ("turned", "message"),
    [
        ((90, 90, 80), "9 cm, 90 deg.*135 N, 90 deg.*corners' order"),
        ((180, 180, -80), "180 deg.*180 deg.*corners' order"),
        ((180, 0, -80), "180 deg.*N, 0 deg.*wrong sign.*export again"),  # My is reversed
        ((0, 180, 80), "0 deg.*180 deg.*wrong sign"),  # and the corners were turned for it
        ((0, 0, -80), r"toes up with 56\.0 N\*m.*another foot"),
    ],
)
def test_a_plate_that_is_turned_and_a_second_foot_are_refused(turned, message):
    with refused_with(message):
        rolled(0.2, *turned)
