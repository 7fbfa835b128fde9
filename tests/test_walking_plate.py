"""The moving force plate: its axes, its own mass, its lateness, its faults, and how the foot loads
it."""

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
import walking_synthetic as synthetic
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

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.trial import Array, Trial, furthest_outside, plate_axes
from osl_analysis.walking import plate_model
from osl_analysis.walking.ankle import Ankle, LoadOnFoot, load_on_foot
from osl_analysis.walking.plate import (
    check_plate,
    check_range,
    check_type_on_platform,
    recorded_corners,
    wrench_reader,
    zeroed_wrench,
)
from osl_analysis.walking.plate_model import (
    PlateModel,
    identify_plate_inertia,
    identify_plate_model,
    inertial_columns,
    ringing,
    stacked_columns,
    with_height,
    without_mean,
)
from osl_analysis.walking.poses import BodyMotion, static_calibration
from osl_analysis.walking.setup_checks import check_roll, check_side, check_vertical
from osl_analysis.walking.stance import Stance

PIVOT = np.array([-0.06, 0.0, 0.08])
TIME = np.arange(3 * PLATE_RATE) / PLATE_RATE
PHASE = np.linspace(0, 1, 11)
SURFACE = np.array([[0.3, 0.2, 0], [-0.3, 0.2, 0], [-0.3, -0.2, 0], [0.3, -0.2, 0]]) + np.array(
    [1.0, 2.0, 0.1]
)
CALIBRATION = static_calibration(static_trial(), settings())
MASS = 12.0
COM = np.array([0.01, -0.02, -0.03])
I_COM = np.diag([0.25, 0.36, 0.60])
ABOUT_CENTRE = I_COM + MASS * ((COM @ COM) * np.eye(3) - np.outer(COM, COM))
RIG = Rig(mass=MASS, marker=1.5e-4, moment=0.05)
RAMP = Ramp(angle=5, onset=1.0, returns=2.0)
TRUE = np.array([MASS, *(MASS * COM), *np.diag(ABOUT_CENTRE), *ABOUT_CENTRE[[0, 0, 1], [1, 2, 2]]])


def matrix(about: int, angle: Array) -> Array:
    """Rotations (n, 3, 3) about a laboratory axis."""
    order = np.roll([0, 1, 2], about - 1)
    return synthetic.about_y(angle)[:, order][:, :, order]


def plate_motion(about: int, height: float, scale: float) -> tuple[BodyMotion, Array]:
    """The plate turns about a laboratory axis through the pivot by two bumps; its wrench by Newton
    and Euler. All derivatives by hand: a = z x r + w x (w x r), and the force on the body is m
    (a_com - g)."""
    t = np.arange(RATE) / RATE
    phi, omega, alpha = (
        height * (a - 0.7 * b)
        for a, b in zip(bump(t, 0.3, scale), bump(t, 0.6, scale), strict=True)
    )
    R = matrix(about, phi)
    n = np.eye(3)[about]

    def swung(point: Array) -> tuple[Array, Array]:
        r = R @ (point - PIVOT)
        w = omega[:, None] * n
        z = alpha[:, None] * n
        return r + PIVOT, np.cross(z, r) + np.cross(w, np.cross(w, r))

    centre, acceleration = swung(np.zeros(3))
    com, com_acceleration = swung(COM)
    w = omega[:, None] * n
    z = alpha[:, None] * n
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


def test_recovers_all_ten_parameters_where_all_axes_turn() -> None:
    pairs = [plate_motion(about, 0.15, 0.04) for about in range(3)]
    inertia = identify_plate_inertia(
        [(m, w + k * np.repeat([1.0, -0.3], 3)) for k, (m, w) in enumerate(pairs)]
    )
    np.testing.assert_allclose(inertia.parameters, TRUE, rtol=1e-7, atol=1e-9)
    assert inertia.rms_before[1] > 1
    assert inertia.rms_after.max() < 1e-8


def squares_of(*recordings: list[tuple[BodyMotion, Array]]) -> Array:
    """Squares (10, 10) of the columns of recordings, less those of others."""
    columns, *less = (
        np.concatenate([without_mean(inertial_columns(m)) for m, _ in p]) for p in recordings
    )
    stacked = stacked_columns(columns - sum(less))
    return np.asarray(stacked.T @ stacked)


def turned(pair: tuple[BodyMotion, Array], heading: float) -> tuple[BodyMotion, Array]:
    """The same recording with a laboratory, and a plate's own axes, that stand turned about the
    vertical."""
    Q = Rotation.from_euler("z", heading).as_matrix()
    motion = pair[0]
    vectors = [v @ Q.T for v in (motion.omega, motion.alpha, motion.point, motion.acceleration)]
    return BodyMotion(Q @ motion.rotation @ Q.T, *vectors), (
        pair[1].reshape(-1, 2, 3) @ Q.T
    ).reshape(-1, 6)


@pytest.mark.parametrize("heading", [0.0, 0.08, np.pi / 6, 2.0])
def test_the_wrench_of_a_motion_like_those_of_the_trials_is_known_about_any_axis(
    heading: float,
) -> None:
    """Trials that turn about one axis show no single parameter about the others, whichever way the
    laboratory lies."""
    trials = [turned(plate_motion(1, size, 0.03), heading) for size in (0.09, 0.05)]
    model = identify_plate_inertia(trials)
    motion, wrench = turned(plate_motion(1, -0.07, 0.035), heading)
    left = without_mean(wrench - inertial_columns(motion) @ model.parameters)
    assert np.abs(left).max() < 1e-3 * np.abs(wrench).max()
    assert (
        model.directions.shape[1]
        == identify_plate_inertia([plate_motion(1, 0.09, 0.03)]).directions.shape[1]
        < 10
    )


def test_what_recordings_do_not_show_stays_as_it_is_known() -> None:
    """A jackknife without the only trial about x must not call I_xx zero. Noise of an axis that
    hardly turns."""
    pairs = [plate_motion(1, 0.09, 0.03), plate_motion(0, 0.004, 0.04)]
    both = identify_plate_inertia(pairs)
    alone = identify_plate_inertia(pairs[:1], within=both.directions, known=TRUE)
    np.testing.assert_allclose(alone.parameters, TRUE, rtol=1e-6, atol=1e-8)
    assert 0 < alone.directions.shape[1] < both.directions.shape[1]
    noise = np.zeros((10, 10))
    noise[4, 4] = 0.9 * squares_of(pairs)[4, 4]
    assert identify_plate_inertia(pairs, noise=noise).directions.shape[1] < both.directions.shape[1]
    with pytest.raises(
        IdentifiabilityError,
        match="marker noise is 90% of what moves the unloaded plate in the dir",
    ):
        identify_plate_inertia(pairs, noise=0.9 * squares_of(pairs))


def test_noise_that_is_known_makes_no_plate_lighter() -> None:
    """A fifth of the acceleration: without a correction the mass is a seventh too small."""
    random = np.random.default_rng(3)
    quiet = [plate_motion(about, 0.15, 0.04) for about in range(3)]
    drawn = [random.normal(0, 0.2 * m.acceleration.std(), (RATE, 3)) for m, _ in quiet]
    noisy = [
        (replace(m, acceleration=m.acceleration + n), w)
        for (m, w), n in zip(quiet, drawn, strict=True)
    ]
    of_noise = squares_of(noisy, quiet)
    biased, found = (
        identify_plate_inertia(noisy, noise=squares).parameters for squares in (None, of_noise)
    )
    assert biased[0] < 0.9 * MASS
    np.testing.assert_allclose(found[:4], TRUE[:4], rtol=0.02, atol=0.01)


def test_a_wrench_is_brought_to_the_markers_frames() -> None:
    """Without delay; a late plate is read later; no aliasing: 290 Hz seen at 300 Hz would be 10 Hz,
    full size."""
    fast = np.arange(4500) / PLATE_RATE
    slow = np.arange(900) / RATE
    for frequency, late, seen in ((15, 0.0, 1.0), (8, 0.0021, 1.0), (290, 0.0, 0.0)):
        tone = np.sin(2 * np.pi * frequency * (fast - late))[:, None] * [1.0, 2.0, 3.0]
        sampled = wrench_reader(fast, np.hstack([tone, tone]), slow)(late)
        expected = seen * np.sin(2 * np.pi * frequency * slow)[:, None] * [1.0, 2.0, 3.0]
        np.testing.assert_allclose(
            sampled[60:-60, :3], expected[60:-60], atol=1e-4 if seen else 3e-3
        )
        np.testing.assert_allclose(sampled[:, 3:], sampled[:, :3])


def unloaded(name: str, load: float = 0.0, angle: float = 5.0, **changes: float) -> Trial:
    """A recording of a plate that turns and returns, with noise on all; `changes` of its rig."""
    trial = walked_over(name, replace(RAMP, angle=angle), replace(RIG, **changes), 7, loaded=False)
    return changed(trial, pl.col("plate1_force_z") + load)


def model_of(*trials: Trial, **choices: Any) -> PlateModel:
    return identify_plate_model([(trial, CALIBRATION) for trial in trials], settings(**choices))


def test_the_models_without_a_trial_know_nothing_of_it() -> None:
    trials = [unloaded(f"plate_{k}", lag=0.001 * (1 + k), mass=MASS + k) for k in range(3)]
    model = model_of(*trials)
    (motion, wrench) = plate_motion(1, 0.09, 0.03)
    for k, other in enumerate(model.leave_one_out):
        assert other.lag == pytest.approx(np.delete(model.lags, k).mean())
        alone = model_of(*(t for i, t in enumerate(trials) if i != k))
        shown = inertial_columns(motion) @ (other.parameters - alone.parameters)
        assert np.abs(shown).max() < 0.02 * np.abs(wrench).max()
    assert model.lag_se == pytest.approx(np.std(model.lags, ddof=1) / np.sqrt(3))
    assert (len(model.leave_one_out), model_of(trials[0]).leave_one_out) == (3, ())


def test_a_lag_that_is_not_found_or_not_asked_for_is_not_corrected() -> None:
    light = "the unloaded plate is too light to show it"
    unasked = "not estimated: correct_plate_lag is false"
    for mass, asked, reason in ((0.0, True, light), (1.0, False, unasked)):
        model = model_of(unloaded("plate_1", lag=0.002, mass=mass), correct_plate_lag=asked)
        assert (model.lag, model.lag_se, model.lag_reason) == (None, None, reason)


@pytest.mark.parametrize(("changes", "reason"), [
    pytest.param({"lag": 0.014}, "the unloaded plate's wrench does not follow",
    id="clocks that are far apart"),
    pytest.param({"lag": -0.05}, "the unloaded plate's wrench does not follow",
    id="clocks further apart"),
    pytest.param({"angle": 0.3}, r"the platform turns by 0\.\d+ deg only", id="a platform at rest"),
    pytest.param({"load": 300.0}, "the plate carries 300 N", id="a foot on the plate"),
    pytest.param({"plate": 2}, "no column 'plate2_force_x'", id="an unknown plate"),
    pytest.param({"blind": 1}, "markers PLAT1, PLAT2, PLAT3, PLAT4 are seen together in 0",
    id="a hidden platform"),
])  # fmt: skip
def test_a_recording_that_cannot_show_the_unloaded_plate_is_refused(
    changes: dict[str, Any], reason: str
) -> None:
    of_trial = {name: size for name, size in changes.items() if name not in ("plate", "blind")}
    trial = hidden(
        unloaded("plate_1", **of_trial), ["PLAT1", "PLAT2"], 0, 3.0 if "blind" in changes else -1
    )
    with pytest.raises(InputError, match=f"trial plate_1: {reason}"):
        model_of(trial, plate=changes.get("plate", 1))
    with pytest.raises(InputError, match="experiment 'plate'"):
        model_of()


@pytest.mark.parametrize(("start", "duration"), [(1.01, 0.04), (0.8, 1.7)])
def test_an_unloaded_trial_whose_turn_was_hidden_is_excluded_by_name(
    start: float, duration: float
) -> None:
    """40 ms of the start of the ramp, which a bridge would make the lag of. Or from before the ramp
    until the platform is back, longer than gaps are bridged: the longest run of frames that was
    seen does not turn."""
    seen, blind = (unloaded(f"plate_{k}", lag=0.0015) for k in (1, 2))
    blind = hidden(blind, ("PLAT1", "PLAT2"), start, start + duration)
    why = "the platform turned while its markers"
    with pytest.warns(UserWarning, match=f"trial plate_2: excluded from the plate.s model: {why}"):
        assert len(model_of(seen, blind).lags) == 1
    with pytest.raises(
        InputError, match=f"no unloaded trial .* trial plate_2, as others: {why} were hidden"
    ):
        model_of(blind)
    for begin, end in ((1.5, 1.545), (1.0, 1.005)):  # hidden at rest, or for two frames
        assert model_of(hidden(seen, ("PLAT1", "PLAT2"), begin, end)).lag == pytest.approx(
            0.0015, abs=3e-4
        )


def test_a_motion_that_the_recording_cuts_has_no_part_in_the_plates_model() -> None:
    """Half a motion made the lag 0.3 to 5 ms wrong and the mass 3 kg too small, with nothing
    said."""
    whole = unloaded("plate_1", lag=0.0015)
    early, late = (
        replace(
            whole, name=name, samples=whole.samples.filter(pl.col("time").is_between(first, last))
        )
        for name, first, last in (("plate_1", 0.0, 2.0), ("plate_2", 2.0, 3.0))
    )
    model = model_of(early)
    assert (model.lag, model.parameters[0]) == (
        pytest.approx(0.0015, abs=1e-4),
        pytest.approx(MASS, rel=0.02),
    )
    with pytest.warns(
        UserWarning,
        match="trial plate_2: excluded .*: the recording begins or ends while the platform",
    ):
        assert len(model_of(whole, late).lags) == 1
    slow = walked_over("plate_2", replace(RAMP, rise=1.2, returns=2.5), RIG, 7, loaded=False)
    never_still = replace(slow, samples=slow.samples.filter(pl.col("time").is_between(1.2, 2.0)))
    for cut in (late, never_still):
        with pytest.raises(
            InputError, match="plate_2, as others: the recording begins or ends while the platform"
        ):
            model_of(cut)


def stepped(offset: float, limit: float = np.inf, noise: float = 0.4) -> Array:
    """A step of 0.7 s and 800 N from 1 s; then the tilted plate reads 5 N more with half the noise.
    Fz has a limit."""
    load = 800 * np.sin(np.pi * np.clip((TIME - 1) / 0.7, 0, 1)) + 5.0 * (TIME > 1.75)
    calmer = np.where(TIME > 1.75, 0.5, 1.0)[:, None] * noise
    force = (
        np.outer(load, [0.1, 0.0, 1.0])
        + offset
        + calmer * np.random.default_rng(2).standard_normal((len(TIME), 3))
    )
    force[:, 2] = np.minimum(force[:, 2], limit)
    return np.hstack([force, 0.02 * offset + np.outer(load, [0.0, -0.1, 0.0])])


def standing_on(wrench: Array, first: int = 0) -> Trial:
    """A recording of this wrench from a row on."""
    markers = synthetic.labelled(
        "PLAT", np.tile(synthetic.PLATFORM, (len(wrench[first:]) // 5, 1, 1))
    )
    return synthetic.recording("c", markers, wrench[first:, :3], wrench[first:, 3:])


def test_the_zero_is_read_before_the_foot_comes_not_after_the_platform_tilted() -> None:
    """0.2 s of noise of 0.4 N: the mean's standard deviation is 0.02 N."""
    for seconds in (0.9, 0.2):  # of 1 s before the foot comes
        wrench = zeroed_wrench(standing_on(stepped(-60.0)), TIME[::5], settings(unloaded_s=seconds))
        assert wrench.zero == pytest.approx(-60.0, abs=0.1)
    np.testing.assert_allclose(wrench.read(0.0)[20:180].mean(axis=0), 0, atol=0.15)
    for zero in (-713.0, 713.0):
        with pytest.raises(
            InputError, match=f"unloaded plate reads {zero:.0f} N, expected less than 100 N"
        ):
            zeroed_wrench(standing_on(stepped(zero)), TIME[::5], settings())
    with pytest.raises(InputError, match=r"loaded within 0\.2 s of the recording's start"):
        zeroed_wrench(standing_on(stepped(0.0), 2000), TIME[:-2000:5], settings())


def test_a_plate_at_its_limit_is_refused_also_where_it_stands_askew_and_one_that_peaks_is_not() -> (
    None
):
    """Turned by 20 degrees: Fx of the plate is a mixture in the laboratory, and neither of its
    parts is flat."""
    axes = plate_axes(np.array(synthetic.CORNERS))
    turn = Rotation.from_euler("z", 20, degrees=True).as_matrix()
    own = stepped(0.0)[:, :3] @ np.diag([4.0, 1.0, 1.0])
    own[:, 0] = np.minimum(own[:, 0], 250.0)
    unloaded = stepped(0.0, noise=0.0)[:1400, :3]  # may well read one value
    for force in (stepped(0.0)[:, :3], own @ turn.T, unloaded):
        check_range(TIME, force, axes, 30)
    with pytest.raises(InputError, match=r"Fz stays at 600 N for \d+ ms .* reached its limit"):
        check_range(TIME, stepped(0.0, limit=600)[:, :3], axes, 30)
    with pytest.raises(InputError, match="stays at 250 N"):
        check_range(TIME, own @ turn.T, plate_axes(np.array(synthetic.CORNERS) @ turn.T), 30)


def examined(kind: int = 2, **channel: float) -> Trial:
    """A recording of a plate of which ingest found this in a channel."""
    facts = {"label": "A3", "clipped_samples": 0, "stands_samples": 0, **channel}
    return Trial(
        "w",
        pl.DataFrame({"time": [0.0]}),
        {"plates": [{"plate": 1, "type": kind, "channels": [facts]}]},
    )


def test_a_plate_that_fails_in_a_stance_is_refused_and_elsewhere_does_not_matter() -> None:
    stance = Stance(0.2, 0.8)
    person = np.array([0.0, 700.0])
    low = examined(clipped_samples=50, clipped_from_s=0.3, clipped_to_s=0.325, clipped_at=-200.0)
    dead = examined(stands_samples=50, stands_from_s=0.1, stands_to_s=0.31)
    with pytest.raises(
        InputError, match=r"channel A3 of force plate 1 stays at -200 from 0\.300 s to 0\.325 s"
    ):
        check_plate(low, 1, stance, person)
    with pytest.raises(
        InputError, match=r"channel A3 of force plate 1 repeats one value from 0\.100 .* it is dead"
    ):
        check_plate(dead, 1, stance, person)
    # before, on the other plate, after, for 90 ms; as when somebody else steps there
    for trial, number, contact in (
        (low, 1, Stance(0.35, 1.5)), (low, 2, stance), (low, 1, Stance(0.1, 0.28)),
        (dead, 1, Stance(0.22, 0.8)),
    ):  # fmt: skip
        check_plate(trial, number, contact, person)
    with pytest.raises(
        InputError,
        match=r"plate 1 reads up to 8\.4e\+03 N, expected less than 8000 N under a person",
    ):
        check_plate(examined(), 1, stance, 12 * person)
    with pytest.raises(InputError, match=r"of type 1 .* export it as type 2, 3 or 4"):
        check_type_on_platform(examined(1), 1)
    (bare := unloaded("plate_1")).provenance["plates"][0]["type"] = 1
    with pytest.raises(InputError, match=r"of type 1 .* export it as type 2, 3 or 4"):
        model_of(bare)
    check_type_on_platform(low, 1)


def test_the_pressure_beside_the_ankle_is_where_the_force_acts() -> None:
    """A force through a known point of the surface, the ankle 0.1 m above it; the axis points along
    -x, heading +y."""
    centre = np.array([[1.0, 2.0, 0.1]])
    ankle = np.array([[1.05, 1.9, 0.2]])
    force = np.array([[30.0, -20.0, 700.0]])
    point = np.array([0.93, 2.1, 0.1])
    moment = np.cross(point - centre, force) + np.array([0, 0, 4.0])  # and a free moment
    wrench = np.hstack([force, moment])
    left = np.array([[-1.0, 0, 0]])
    of_foot = Ankle(np.zeros(1), ankle, left)
    pressed = load_on_foot(wrench, centre, of_foot)
    light = load_on_foot(0.14 * wrench, centre, of_foot)
    assert pressed.vertical == pytest.approx([700])
    assert pressed.left == pytest.approx([1.05 - 0.93])
    assert pressed.forward == pytest.approx([0.2])
    assert light.left == [0.0], "98 N have no centre"
    for marker, distance in (
        ([1.29, 2.19, 0.1], 0.0),
        ([1.35, 2.1, 0.3], 0.05),
        ([0.66, 1.77, 0.1], 0.05),
    ):
        assert furthest_outside(np.array([centre[0], marker]), SURFACE) == pytest.approx(distance)


def test_a_load_that_does_not_act_upwards_and_a_plate_on_edge_are_refused_with_the_remedy() -> None:
    upwards = np.sin(np.pi * PHASE)[:, None]
    for force, along in (
        ([20.0, 700, 30], "+y (570"),
        ([20.0, 30, -700], "-z (-570"),
        ([-700.0, 30, 10], "-x (-570"),
    ):
        with pytest.raises(
            InputError, match=re.escape(f"along {along} N), expected +z: correct `sign`")
        ):
            check_vertical(upwards * force)
    check_vertical(upwards * [200.0, 100, 700])
    check_vertical(np.zeros((5, 3)))

    def with_corners(corners: Array) -> Trial:
        facts = {"plates": [{"plate": 1, "type": 2, "corners": corners.tolist()}]}
        return Trial("plate_1", pl.DataFrame({"time": [0.0]}), facts)

    x, y = (with_corners(SURFACE[:, axes]) for axes in ([2, 1, 0], [0, 2, 1]))
    ramp, steep = (SURFACE @ matrix(0, np.deg2rad([angle]))[0].T for angle in (33.0, 40.0))
    for trial, number, said in (
        (x, 1, "across the x"), (y, 1, r"across the y axis.*`axes: \[x, -z, y\]`"),
        (with_corners(steep), 1, "on edge"),
        (x, 2, "plate 2; the recording has those of 1"),
        (replace(x, provenance={}), 1, "has those of none"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=said):
            recorded_corners(trial, number)
    assert recorded_corners(with_corners(ramp), 1).tolist() == ramp.tolist()
    for corners in (SURFACE, SURFACE[::-1]):  # in either order, the normal points up
        normal = plate_axes(recorded_corners(with_corners(corners), 1))[:, 2]
        np.testing.assert_allclose(normal, [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("turn", [0.0, 2.0, np.pi])
def test_a_shank_against_its_own_heading_and_a_moment_that_lifts_the_toes_are_refused(
    turn: float,
) -> None:
    heading = np.array([np.cos(turn), np.sin(turn), 0])
    left = np.array([-np.sin(turn), np.cos(turn), 0])
    shank = np.outer(-0.1 + 0.25 * PHASE, heading) + np.array([0, 0, 0.3])
    axis = np.tile(left, (PHASE.size, 1))
    check_side(PHASE, shank, axis)
    with pytest.raises(
        InputError,
        match=r"the shank moves 20 cm backwards over the foot .* correct `side`, exchange",
    ):
        check_side(PHASE, shank, -axis)


def test_a_load_that_does_not_roll_over_the_foot_is_refused_by_its_cause() -> None:
    """A turned plate turns braking and push-off with the centre of pressure; a second foot, a load
    more, that alone."""
    zero = np.zeros(PHASE.size)
    torque = -10 + 90 * PHASE
    roll = 0.2 * PHASE
    push = np.array([zero, 300 * (PHASE - 0.5)])
    weight = np.full(PHASE.size, 700.0)
    sound = LoadOnFoot(weight, left=zero, forward=roll)
    check_roll(PHASE, sound, push, torque)
    check_roll(PHASE, LoadOnFoot(weight, left=0.1 * roll, forward=zero), push, None)  # hardly moves
    quarter = LoadOnFoot(weight, left=roll, forward=zero)
    with pytest.raises(
        InputError, match=r" 9 cm in stance, 90 deg .* turned by 90 deg or exchanged"
    ):
        check_roll(PHASE, quarter, push[::-1], torque)
    with pytest.raises(
        InputError, match=r"180 deg from forward: the plate's corners are turned by 180 deg"
    ):
        check_roll(PHASE, LoadOnFoot(weight, left=zero, forward=-roll), -push, -torque)
    said = r"moment in late stance is -53 N\*m.* another foot stands .* is 1\.50 of that"
    heavier = weight * (1 + 0.5 * (PHASE > 0.5))
    with pytest.raises(InputError, match=said):
        check_roll(PHASE, LoadOnFoot(heavier, left=zero, forward=roll), push, -torque)
    with pytest.raises(
        InputError, match=r"90 deg from forward, though the foot pushes off forward: another foot"
    ):
        check_roll(PHASE, quarter, push, None)


@pytest.mark.parametrize(("pauses", "noise"), [((), 0.02), ((101,), 0.02), ((), 0.0)])
def test_a_plate_that_rings_after_its_turn_is_named_with_its_frequency(
    pauses: tuple[int, ...], noise: float
) -> None:
    """A turn within frames 80 to 110, in which the platform may seem to rest for a frame, and a
    decaying 40 Hz."""
    time = np.arange(300) / RATE
    moving = (np.arange(300) >= 80) & (np.arange(300) < 110)
    moving[list(pauses)] = False
    white = noise * np.random.default_rng(1).standard_normal((300, 6))
    since = np.maximum(time - time[100], 0)
    ring = np.where(since > 0, np.exp(-8 * since) * np.sin(2 * np.pi * 40 * since), 0)[:, None]
    track = SimpleNamespace(moving=moving, rate=RATE, time=time)
    hz, growth = ringing(time, white + ring, track)
    assert (hz == pytest.approx(40, abs=1.5) and growth > 100) if noise else (hz, growth) == (0, 0)
    hum = noise * 30 * np.sin(2 * np.pi * 50 * time)[:, None]  # which is there before the turn
    assert max(ringing(time, white + other, track)[1] for other in (0, hum)) < 20


@pytest.mark.parametrize(
    ("growths", "hz"), [((5.0, 600.0, 600.0), 41.0), ((5.0, 400.0, 600.0), None)]
)
def test_a_plate_rings_if_most_of_its_trials_do(
    monkeypatch: pytest.MonkeyPatch, growths: Any, hz: float | None
) -> None:
    seen = iter(zip((40.0, 41.0, 42.0), growths, strict=True))
    monkeypatch.setattr(plate_model, "ringing", lambda *_: next(seen))
    assert model_of(*(unloaded(f"plate_{k}") for k in range(3))).ringing_hz == hz


def test_the_error_of_the_height_is_that_of_a_mean_over_recordings() -> None:
    """Recordings of one motion, whose moments are reported about points of other heights: the
    estimate is their mean, and the jackknife's error that of a mean."""
    motion, wrench = plate_motion(0, 0.15, 0.04)
    columns = inertial_columns(motion)
    model = identify_plate_inertia([(motion, wrench)])
    heights = np.array([-1.0e-3, 0.5e-3, 2.0e-3, 0.1e-3])
    recordings = []
    for height in heights:
        moment = MASS * height * columns[:, 3:, 3]  # of the centre of mass, higher by so much
        recordings.append((columns, wrench + np.hstack([0 * moment, moment])))

    model = with_height(model, recordings)

    assert model.height == pytest.approx(heights.mean(), rel=1e-6)
    assert model.height_se == pytest.approx(heights.std(ddof=1) / np.sqrt(4), rel=1e-6)
