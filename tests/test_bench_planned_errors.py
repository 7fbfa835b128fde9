"""Predicted errors of K, B, I against closed forms, another formula and simulated trials;
`osl-analysis design`."""

import json
import re
from dataclasses import astuple, replace

import numpy as np
import polars as pl
import pytest
from click.testing import CliRunner

from osl_analysis.bench.planned_errors import Distortion, Sensors
from osl_analysis.bench.planned_motion import (
    Continuous,
    PeriodicMultisine,
    SteppedSine,
    long_enough,
)
from osl_analysis.bench.precision import precision
from osl_analysis.cli import main
from osl_analysis.commands import design, walking_plan
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.spectral.periods import periodic_motion

pytestmark = pytest.mark.usefixtures("in_root")
OPEN = LowPass(1e4)  # a filter that weighs nothing
JOINT = np.array([300.0, 5.0, 0.02])
DRAFT = SteppedSine(tuple(np.deg2rad([2, 4, 6])), (1.0, 2.0, 3.0, 4.0, 5.0), (20.0,) * 5, 2)
MULTISINE = PeriodicMultisine(8.0, (0.5, 6.0), float(np.deg2rad(2)), 4, 4)


def se(sensors, joint=JOINT, plan=DRAFT, stated=None):
    return precision(plan, joint, sensors, OPEN, stated).se


def test_two_sines_have_the_errors_that_one_computes_by_hand():
    """(X'X)^-1 of the columns a sin, a w cos, -a w^2 sin: with e = N a^2/2, var K = sigma^2 (e w1^4
    + e w2^4)/ (e^2 (w1^2 - w2^2)^2), var I = sigma^2 2 e/(...), var B = sigma^2/(e w1^2 + e
    w2^2)."""
    a, sigma, rate, seconds = 0.05, 0.3, 500.0, 10.0
    plan = SteppedSine((a,), (1.0, 2.0), (10.0 + 1, 20.0 + 1), 0)
    e, (w1, w2) = rate * seconds * a**2 / 2, (2 * np.pi, 4 * np.pi)
    apart = e**2 * (w1**2 - w2**2) ** 2
    by_hand = [e * (w1**4 + w2**4) / apart, 1 / (e * (w1**2 + w2**2)), 2 * e / apart]
    found = precision(plan, JOINT, Sensors(rate, sigma), OPEN)
    np.testing.assert_allclose(found.se, sigma * np.sqrt(by_hand), rtol=1e-9)
    assert found.fit.correlation == pytest.approx((w1**2 + w2**2) / np.sqrt(2 * (w1**4 + w2**4)))
    assert found.method == "repeats"  # of two frequencies
    alone = precision(plan, JOINT, Sensors(rate, 1e-6), OPEN, Distortion(coulomb=1.0))
    assert alone.degrees_of_freedom[1] == pytest.approx(29), "of 30 cycles, which are the units"
    # Welch and Satterthwaite: of B both frequencies weigh a^2 w^2 T; each has 9 of 10 cycles'
    # freedom
    found = precision(
        replace(plan, amplitudes=(a, a), cycles=(11.0, 11.0)), JOINT, Sensors(rate, sigma), OPEN
    )
    share = np.array([10 * 1.0, 5 * 4.0]) / 2
    assert found.degrees_of_freedom[1] == pytest.approx(
        9 * (2 * share.sum()) ** 2 / (2 * np.sum(share**2))
    )


def test_a_narrow_filter_costs_what_weighted_least_squares_cost():
    """Two sines, of which the filter halves the faster: (X'WX)^-1 X'W^2X (X'WX)^-1 with W = 1 and
    1/4."""
    plan, low_pass = SteppedSine((0.05,), (1.0, 4.0), (11.0, 41.0), 0), LowPass(4.0, 4)
    w, W = 2 * np.pi * np.array([1.0, 4.0]), (1 / (1 + (np.array([1.0, 4.0]) / 4) ** 8)) ** 2
    assert W[1] == pytest.approx(0.25)
    X = np.zeros((4, 3))
    X[0::2, 0], X[0::2, 2], X[1::2, 1] = 0.05, -0.05 * w**2, 0.05 * w
    W = np.repeat(W, 2)
    inverse = np.linalg.inv(X.T @ (W[:, None] * X))
    by_hand = inverse @ (X.T @ ((W**2)[:, None] * X)) @ inverse * 2 * 0.3**2 / (1000 * 10)
    found = precision(plan, JOINT, Sensors(1000.0, 0.3), low_pass)
    np.testing.assert_allclose(found.se, np.sqrt(np.diag(by_hand)), rtol=1e-9)


def test_realisations_scatter_by_friction_as_predicted_and_shift_b():
    """100 realisations: 8 % in a ratio of standard deviations; B within 4 of its standard
    errors."""
    friction = Distortion(coulomb=1.0)
    time = 8.0 * np.arange(1000) / 1000
    fits = []
    for seed in range(100):
        motion = [MULTISINE.motion(1000 + seed).angle(time, k) for k in range(3)]
        X = np.column_stack([*motion, np.ones(1000)])
        fits.append(np.linalg.lstsq(X, np.sign(motion[1]))[0][:3])

    predicted = precision(MULTISINE, JOINT, Sensors(1000.0, 0.0), OPEN, friction)

    scatter = np.std(fits, axis=0, ddof=1)
    np.testing.assert_allclose(scatter / 2 / predicted.se, 1, atol=0.25)
    added = friction.added_damping(MULTISINE)["in all"]
    assert np.mean(fits, axis=0)[1] == pytest.approx(added, abs=4 * scatter[1] / 10 + 0.005)
    assert predicted.method == "realisations"
    # Student's t
    np.testing.assert_allclose(predicted.half_width, 3.1824463 * predicted.se)


def test_longer_records_do_not_average_friction_out_but_realisations_do():
    stated, sensors = Distortion(coulomb=0.5), Sensors(1000.0, 0.05)
    changes = ({}, {"periods": 16}, {"realisations": 16}, {"realisations": 1})
    plans = (replace(MULTISINE, **change) for change in changes)
    one, *others = (precision(plan, JOINT, sensors, OPEN, stated).variance for plan in plans)
    shares = [
        [one[cause] / other[cause] for cause in ("distortion", "torque noise")] for other in others
    ]
    np.testing.assert_allclose(shares[:2], [[[1] * 3, [4] * 3], [[4] * 3, [4] * 3]])
    # fewer than four have the level at detection lines, of which the scatter of K, B and I is 0.65,
    # 0.4 and 0.4
    np.testing.assert_allclose(np.sqrt(4 * shares[2][0]), [0.65, 0.4, 0.4], rtol=0.15)


def test_one_realisation_has_the_interval_of_its_detection_lines():
    plan, stated = replace(MULTISINE, realisations=1), Distortion(coulomb=0.5)
    by_level = precision(plan, JOINT, Sensors(1000.0, 0.0), OPEN, stated)
    assert by_level.method == "detection lines"
    lines, freedom = len(plan.motion(0).detection), by_level.degrees_of_freedom
    # of the two at each line; the stiffness is told by most of them
    assert lines < freedom[0] <= 2 * lines
    two = precision(replace(plan, realisations=2), JOINT, Sensors(1000.0, 0.0), OPEN, stated)
    np.testing.assert_allclose(two.degrees_of_freedom, 2 * freedom)
    np.testing.assert_allclose(two.se, by_level.se / np.sqrt(2))


@pytest.mark.parametrize("rate", [50.0, 2000.0])
def test_rounding_of_a_multisine_has_the_predicted_power_at_any_rate(rate):
    """Mean over lines, both quadratures, 20 realisations and their zeros: 6 % by chance, 20 % for a
    normal velocity."""
    q, rng, found = np.deg2rad(0.5), np.random.default_rng(4), []
    plan, time = (
        PeriodicMultisine(4.0, (0.5, 6.0), float(np.deg2rad(2)), 5, 1),
        np.arange(round(4 * rate)) / rate,
    )
    for number in range(20):
        motion, zero = plan.motion(number), rng.uniform(0, q)
        theta = motion.angle(time + rng.random() / rate)
        error = q * np.rint((theta + zero) / q) - zero - theta
        found.append(np.mean(np.abs(2 / len(time) * np.fft.rfft(error)[motion.lines]) ** 2) / 2)
    each = Sensors(rate, 0.0, encoder_step=q).rounding(plan.sines).variance
    assert np.mean(found) == pytest.approx(np.mean(each), rel=0.25)


def test_rounding_has_a_third_of_its_variance_in_phase():
    """Of many samples per step."""
    sensors, w = Sensors(1e5, 0.0, encoder_step=1e-2), DRAFT.sines.w
    of_angle = sensors.rounding(DRAFT.sines).variance
    np.testing.assert_allclose(of_angle[1], 2 * of_angle[0])
    of_torque = sensors.variances(DRAFT.sines, 5j * w, 100.0)["encoder rounding"]
    np.testing.assert_allclose(of_torque, (5 * w) ** 2 * of_angle[::-1])


def test_cycles_repeat_their_rounding():
    step = Sensors(1000.0, 0.0, encoder_step=np.deg2rad(0.5))
    longer = replace(DRAFT, cycles=(200.0,) * 5)
    np.testing.assert_allclose(se(step, plan=longer), se(step), rtol=1e-9)


def test_noise_of_half_a_step_cures_rounding():
    q = 2 * np.pi / 2**12
    steps = ({"encoder_step": q}, {"encoder_step": q, "angle_noise": q / 2})
    repeated, cured = (se(Sensors(1000.0, 0.0, **one)) for one in steps)
    np.testing.assert_allclose(
        cured, se(Sensors(1000.0, 0.0, angle_noise=np.hypot(q / 2, q / 12**0.5))), rtol=0.02
    )
    assert np.all(cured < 0.7 * repeated)


@pytest.mark.parametrize(("errors", "torque_noise"), [
    # all of it where the joint moves
    ({"torque_noise": 0.1, "noise_band_hz": 12.5}, 0.1 * np.sqrt(500 / 12.5)),
    ({"torque_noise": 0.0, "noise_band_hz": 12.5, "angle_noise": 1e-4}, 0.03),  # through Z = 300
    ({"torque_noise": 0.03, "torque_step": 0.1}, np.hypot(0.03, 0.1 / np.sqrt(12))),
])  # fmt: skip
def test_each_error_of_a_sensor_counts_as_so_much_torque_noise(errors, torque_noise):
    joint = np.array([300.0, 0.0, 0.0])
    np.testing.assert_allclose(
        se(Sensors(1000.0, **errors), joint), se(Sensors(1000.0, torque_noise), joint)
    )


def test_noise_of_the_torque_counts_in_its_own_band_alone():
    """Noise of 0.5 N*m up to 2.5 Hz, drawn by its spectrum, in fits of a stepped sine of 1 to 5 Hz
    by numpy."""
    rng, rate, seconds = np.random.default_rng(4), 100.0, 20.0
    plan, noise = (
        SteppedSine((0.1,), (1.0, 2.0, 3.0, 4.0, 5.0), (20.0, 40.0, 60.0, 80.0, 100.0), 0),
        [],
    )
    time, f = np.arange(0, seconds, 1 / rate), np.fft.rfftfreq(int(rate * seconds), 1 / rate)
    theta = np.array([0.1 * np.sin(2 * np.pi * one * time) for one in plan.frequencies_hz])
    w = 2 * np.pi * np.array(plan.frequencies_hz)[:, None]
    omega = 0.1 * w * np.cos(w * time)
    for _ in range(150):
        drawn = np.fft.rfft(rng.standard_normal((5, time.size)))
        torque = np.fft.irfft(drawn * (f <= 2.5), time.size)
        X = np.array([x.ravel() for x in (theta, omega, -(w**2) * theta)])
        noise.append(np.linalg.lstsq(X.T, 0.5 / torque.std() * torque.ravel(), rcond=None)[0])
    found = precision(plan, JOINT, Sensors(rate, 0.5, noise_band_hz=2.5), OPEN)
    np.testing.assert_allclose(found.se, np.std(noise, axis=0), rtol=0.17)


def test_unseen_drift_changes_a_sine_by_two_slopes_over_its_frequency():
    """The integral of t sin wt over whole cycles; in a record the slope is known to 6 S/T^3."""
    sines, density = DRAFT.sines, 2 * 0.05**2 / 1000
    for seconds, slope in ((1e-3, 1e-4), (100.0, np.sqrt(6 * density / 100**3))):
        drift = Sensors(1000.0, 0.05, drift=1e-4 if seconds < 1 else 1.0).variances(
            sines, 0j * sines.w, seconds
        )
        by_hand = (2 * slope / (2 * np.pi * sines.frequency_hz)) ** 2 / 2
        np.testing.assert_allclose(drift["load cell drift"][0], by_hand, rtol=1e-3)


def test_friction_shifts_damping_and_leaves_a_misfit_that_no_cycles_cure():
    """The describing function 4 T/pi in quadrature, fitted by numpy over amplitudes and
    frequencies."""
    friction, sines = Distortion(coulomb=0.3), DRAFT.sines
    columns, root = sines.size * sines.w, np.sqrt(sines.duration_s)
    torque = np.full(len(columns), 4 * 0.3 / np.pi)
    damping = np.linalg.lstsq((root * columns)[:, None], root * torque, rcond=None)[0][0]
    left = (torque - damping * columns) * sines.duration_s * columns
    by_hand = np.sqrt(np.sum(left**2)) / np.sum(sines.duration_s * columns**2)
    for cycles in (20.0, 200.0):
        found = precision(
            replace(DRAFT, cycles=(cycles,) * 5), JOINT, Sensors(1000.0, 0.05), OPEN, friction
        )
        assert np.sqrt(found.variance["distortion"][1]) == pytest.approx(by_hand, rel=1e-9)
        np.testing.assert_allclose(found.variance["distortion"][[0, 2]], 0, atol=1e-15)
        # of 15 units, whose scatter it is
        assert found.degrees_of_freedom[1] == pytest.approx(14, rel=0.01)
    added = friction.added_damping(DRAFT)
    assert list(added) == ["2 deg", "4 deg", "6 deg"]
    w, a = 2 * np.pi * np.array(DRAFT.frequencies_hz), DRAFT.amplitudes[1]
    assert added["4 deg"] == pytest.approx(
        4 * 0.3 / np.pi * np.sum(1 / w * w) / np.sum(a * w), rel=1e-9
    )


def test_a_record_that_is_long_enough_is_the_shortest_one():
    def enough(plan):
        sensors, within = Sensors(1000.0, 0.5), {"K": 5e-4, "B": 1e-3}
        return precision(plan, JOINT, sensors, LowPass(15.0, 4)).reaches(within)

    stepped, multisine = (
        long_enough(plan, enough)[0] for plan in (DRAFT, replace(MULTISINE, rms=0.01))
    )
    assert [enough(stepped), enough(multisine)] == [True, True]
    # of which five are fitted
    assert long_enough(DRAFT, lambda _: True)[0].cycles == (8.0,) * 5
    for fewest, any_length in ((2, lambda _: True), (3, lambda plan: plan.periods > 2)):
        assert long_enough(MULTISINE, any_length)[0] == replace(MULTISINE, periods=fewest)
    assert not enough(replace(stepped, cycles=tuple(n - 1 for n in stepped.cycles)))
    assert (
        not enough(replace(multisine, realisations=multisine.realisations - 1))
        or multisine.realisations == 4
    )


def test_a_chirp_and_noise_carry_what_their_bands_carry():
    """Moments of a flat spectrum from f1 to f2, integrated by hand: w^2, w^4 as (f2^3 - f1^3)/3,
    (f2^5 - f1^5)/5."""
    f1, f2, rms, seconds = 0.5, 6.0, 0.03, 60.0
    m2, m4 = (
        (2 * np.pi) ** k * (f2 ** (k + 1) - f1 ** (k + 1)) / (k + 1) / (f2 - f1) for k in (2, 4)
    )
    by_hand = np.sqrt(
        0.05**2
        / (1000 * seconds * rms**2)
        * np.array([m4 / (m4 - m2**2), 1 / m2, 1 / (m4 - m2**2)])
    )
    for chirp in (True, False):
        plan, largest = (
            Continuous((f1, f2), rms, seconds, chirp),
            np.sqrt(2) * (2 * np.pi * f2) ** np.arange(3),
        )
        assert astuple(plan.peak) == pytest.approx(
            rms * (largest if chirp else 4 * np.sqrt([1, m2, m4])), rel=0.01
        )
        found = precision(plan, JOINT, Sensors(1000.0, 0.05), OPEN)
        np.testing.assert_allclose(found.se, by_hand, rtol=1e-3)
        assert found.method == "units"
        freedom = found.degrees_of_freedom
        np.testing.assert_allclose(freedom, 60 / 1.5 - 2.5)  # stretches of a second, five columns
    plans, stated = (replace(plan, record_s=T) for T in (60.0, 120.0)), Distortion(coulomb=1.0)
    once, twice = (
        precision(plan, JOINT, Sensors(1000.0, 0.05), OPEN, stated).variance["distortion"]
        for plan in plans
    )
    np.testing.assert_allclose(once / twice, 2, rtol=0.01)
    assert astuple(DRAFT.peak) == pytest.approx(np.deg2rad(6) * (10 * np.pi) ** np.arange(3))


@pytest.mark.parametrize(
    ("band", "rms", "seconds"), [((0, 2), 1, 1), ((2, 2), 1, 1), ((1, 2), 0, 1), ((1, 2), 1, 0)]
)
def test_what_is_no_motion_of_a_band_is_refused(band, rms, seconds):
    with pytest.raises(InputError, match="no motion has a band"):
        Continuous(band, rms, seconds, True)


def call(*arguments):
    return CliRunner().invoke(main, ["design", *(str(a) for a in arguments)])


def as_json(*arguments):
    result = call(*arguments, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_the_configuration_s_protocol_is_the_default():
    said = as_json()
    assert (
        said["protocol"]
        == "stepped sine: 2, 4, 6 deg at 1, 2, 3, 4, 5 Hz, 20 cycles at each (17 fitted)"
    )
    assert said["record_s"] == pytest.approx(3 * 20 * (1 + 1 / 2 + 1 / 3 + 1 / 4 + 1 / 5))
    assert {name: one["expected"] for name, one in said["estimates"].items()} == {
        "K": 300,
        "B": 5,
        "I": 0.02,
    }
    assert said["interval_method"] == "units"  # as impedance.csv names it
    for name, cause in (("B", 300), ("I", 5)):  # to first order -K lag and -B lag
        assert said["lag_errors"][name] == pytest.approx(-cause * 1e-4, rel=0.1)


def test_a_named_configuration_has_cycles_for_its_own_frequencies(
    tmp_path,
):
    own = ("--config", tmp_path / "c.yaml")
    own[1].write_text(
        "dynamometer: {frequencies_hz: [2, 4], cycles: [10, 20], load_cell_range: 25}"
    )
    said = as_json(*own)
    assert said["record_s"] == pytest.approx(3 * (10 / 2 + 20 / 4))
    assert "above dynamometer.load_cell_range = 25" in said["warnings"][-1]
    assert (
        "cycles for its own frequencies; give --cycles"
        in call(*own, "--frequencies", "2,3,4").stderr
    )


def test_every_error_that_is_stated_is_handed_on_in_si_units(monkeypatch):
    seen, of = [], design.precision
    monkeypatch.setattr(design, "precision", lambda *given: seen.append(given) or of(*given))
    options = {
        "torque-noise": 0.2,
        "noise-band": 50,
        "torque-step": 0.1,
        "encoder-step": 0.01,
        "angle-noise": 0.02,
    }
    options |= {"rate": 500, "drift": 30, "friction": 0.3, "stiffness": 200, "lag": 2}
    said = as_json(*(word for name, value in options.items() for word in (f"--{name}", value)))
    _, joint, sensors, _, stated = seen[0]
    assert sensors == Sensors(500, 0.2, 50, 0.1, *np.deg2rad([0.01, 0.02]).tolist(), 0.5)
    assert (joint[0], stated, said["lag_s"]) == (200, Distortion(0.3), 2e-3)


def test_json_says_null_where_the_freedom_is_infinite():
    certain = as_json("--torque-noise", "0", "--encoder-step", "0")["estimates"]["K"]
    assert certain["degrees_of_freedom"] is None


def test_the_torque_to_expect_is_that_of_the_largest_sine():
    """|300 - 0.02 w^2 + 5j w| times 6 deg at 5 Hz; of noise of 2 deg on a spring, four times
    300 N*m/rad."""
    w = 10 * np.pi
    largest = abs(300 - 0.02 * w**2 + 5j * w) * np.deg2rad(6)
    assert f"torque about {largest:.3g} N·m" in call().stdout
    assert f"torque about {largest + 4:.3g} N·m" in call("--friction", "4").stdout
    said = call(
        "--excitation", "noise", "--band", "0.2,5", "--damping", "0", "--inertia", "0"
    ).stdout
    assert f"torque about {4 * 300 * np.deg2rad(2):.3g} N·m" in said


def test_the_recommended_multisine_reaches_what_is_asked_for(tmp_path):
    output = tmp_path / "multisine.csv"
    asked = (
        "--friction",
        "0.5",
        "--stiffness-within",
        "0.5%",
        "--damping-within",
        "1",
        "--rate",
        "200",
    )
    said = as_json("--excitation", "multisine", "--peak", "6", *asked, "--write", output)
    best, shares = said["recommended"], {"K": 0.005, "B": 0.01}
    for name, share in shares.items():
        assert best["estimates"][name]["half_width"] <= share * best["estimates"][name]["expected"]
    table = pl.read_csv(output)
    time, angle = table["time"].to_numpy(), table["theta_command"].to_numpy()
    np.testing.assert_allclose(np.diff(time), 1 / 200)
    assert angle[0] == angle[-1] == 0
    assert 5 < np.rad2deg(np.abs(angle).max()) <= 6.0001  # no realisation goes beyond the peak
    # rad/s: no jump at the ends of realisations
    assert np.max(np.abs(np.diff(angle))) * 200 < 1.3 * 3.3
    found = periodic_motion(angle, 300 * angle, 200.0, 10.0)
    assert found.period == pytest.approx(8, rel=1e-4)
    assert f"{len(found.realisations)} realisations" in best["protocol"]
    assert best["record_s"] == 8 * sum(one.periods + 1 for one in found.realisations)


def test_a_pilot_states_friction_and_what_no_longer_record_cures(tmp_path):
    """0.8 N*m of a drivetrain's friction: ± 2.6 N*m/rad and ± 0.25 N*m*s/rad on a leg, not 0.011
    and 0.0005."""
    rows = {"trial": ["a", "a", "b"], "amplitude_deg": [2.0, None, None], "f_C": [0.1, 0.8, 0.2]}
    rows |= {name: [300.0, 300.0, 300.0] for name in "KBI"}
    rows |= {f"{name}_se": [9.0, se, 9.0] for name, se in zip("KBI", (1.2, 0.1, 2e-3), strict=True)}
    (tmp_path / "tables").mkdir()
    pl.DataFrame(rows).write_csv(tmp_path / "tables/impedance.csv")
    pilot = ("--from", tmp_path, "--trial", "a", "--cycles", "200")
    plans = as_json(*pilot), as_json("--friction", "0.8", "--cycles", "200")
    found, friction = (plan["estimates"] for plan in plans)
    assert found["I"]["se"] == pytest.approx(2e-3, rel=1e-3)
    assert found["B"]["se"] == pytest.approx(max(friction["B"]["se"], 0.1), rel=1e-3)
    assert plans[0]["friction_damping"] == plans[1]["friction_damping"]
    of_both = as_json("--from", tmp_path, "--cycles", "200")["estimates"]["K"]["se"]
    assert (found["K"]["se"], of_both) == pytest.approx((1.2, (1.2 + 9.0) / 2), rel=1e-3)
    assert "no impedance trial 'c'" in call("--from", tmp_path, "--trial", "c").stderr
    assert "state the same friction" in call("--from", tmp_path, "--friction", "1").stderr


@pytest.mark.parametrize(("arguments", "message"), [
    (("--rms", "3"), "a stepped-sine has no --rms"), (("--rate", "25"), "twice the cut-off"),
    (("--stiffness-within", "0"), "no percentage"),
    (("--frequencies", "1,nan"), "give a finite number"),
    (("--inertia", "0", "--inertia-within", "5%"),
     "--inertia-within is a share of an expected I of 0; give --inertia"),
    (("--excitation", "noise", "--rms", "3", "--peak", "4"), "give --rms or --peak, not both"),
    (("--excitation", "chirp", "--band", "3,2"), "lower frequency first"),
    (("--excitation", "multisine", "--band", "1,1.2"), "longer period or a wider band"),
    (("--excitation", "multisine", "--band", "0.5,1.5"), "the analysis would refuse this protocol"),
    (("--excitation", "chirp", "--band", "0.2,1"), "the band from 1 to about 2.3 Hz is missing"),
    (("--write", "/tmp/x.csv"), "only a multisine is written"),
    (("--frequencies", "2"),
     "told apart by 2 Hz alone, where K - I w^2 is one number; excite down to 1 Hz"),
    (("--frequencies", "1,20"), "20 Hz is above the filter's cut-off of 15 Hz"),
])  # fmt: skip
def test_a_mistake_is_one_line(arguments, message):
    result = call(*arguments)
    assert result.exit_code != 0
    assert message in result.stderr.splitlines()[-1]


@pytest.mark.parametrize(("arguments", "said"), [
    (("--friction", "0.1"), ""), (("--excitation", "multisine"), "no distortion is stated"),
    (("--encoder-bits", "12"), "rounding of the encoder makes"),
    (("--encoder-bits", "12", "--amplitudes", "0.5"), "steps of the encoder"),
    (("--frequencies", "3,3.5"), "hardly tells K from I .*above 3.5 Hz, up to 7 Hz"),
    (("--amplitudes", "80"), r"largest_angle = 1\.2 rad: the recording would be refused"),
])  # fmt: skip
def test_warnings_name_what_no_length_cures(arguments, said):
    warnings = "; ".join(as_json(*arguments)["warnings"])
    assert re.search(said, warnings) if said else warnings == ""


def test_a_band_is_refused_as_the_analysis_refuses_it():
    """0.1 % of the torque over what of the acceleration angle and velocity do not explain; moments
    of a flat band."""
    w = 2 * np.pi * np.linspace(0.5, 1.5, 2001)
    own = np.sqrt(np.mean(w**4) - np.mean(w**2) ** 2)
    change = 1e-3 * np.sqrt(np.mean(np.abs(300 - 0.02 * w**2 + 5j * w) ** 2)) / own
    for kind in ("noise", "chirp"):
        assert (
            f"changes I by {change:.2g} kg*m^2"
            in call("--excitation", kind, "--band", "0.5,1.5").stderr
        )


def test_what_only_a_longer_record_reaches_is_not_called_out_of_reach():
    """White noise averages out: the interval shrinks by the root of the time, down to the longest
    that is searched."""
    asked = ("--excitation", "noise", "--encoder-step", "0", "--drift", "0")
    one = as_json(*asked, "--duration", "7200")["estimates"]["K"]
    share = 100 * one["half_width"] / one["expected"]
    said = call(*asked, "--stiffness-within", share / 2).stdout
    assert (
        f"the longest record that is searched, 2 h, which gives K ± {share:.2g} % (variance by"
        " torque noise" in said
    )
    best = as_json(*asked, "--stiffness-within", 1.01 * share)["recommended"]
    assert best["record_s"] == pytest.approx(7200, rel=0.03)


def test_the_duration_of_a_minimum_jerk_turn_is_told_from_its_rise_time():
    time = np.arange(0.0, 2.0, 1e-4)
    share = np.clip((time - 0.5) / 0.08, 0.0, 1.0)
    turn = np.deg2rad(5.0) * (10 * share**3 - 15 * share**4 + 6 * share**5)

    duration = walking_plan.ramp_duration(time, 0.01 - turn, onset=0.5)

    assert duration == pytest.approx(0.08, rel=5e-3)
