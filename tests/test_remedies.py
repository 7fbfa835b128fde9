"""Remedies are tried on the recording before they are printed."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
import yaml
from osl_analysis.commands.remedies import (
    OF_ROWS,
    changed,
    clock_drift_ppm,
    is_as_stated,
    other_readings,
    remedies_tried,
    tried,
)

from osl_analysis.bench.fit_tables import FitTables
from osl_analysis.bench.identifiability import check_told
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.bench import fit_actuator_trial, fit_torque_angle_trial
from osl_analysis.commands.fit import fit_settings, fit_trial
from osl_analysis.commands.trials import raw_trial
from osl_analysis.errors import Change, IdentifiabilityError, InputError
from osl_analysis.files import default_config
from osl_analysis.trial import Trial, unit_of

RATE = 100.0
CONFIG = read_config(default_config())


def slow_cycles(rest_s=0.0):
    """A spring of 40 N*m/rad that is moved in a sine of 0.1 Hz, and rests before it."""
    time = np.arange(0, 40, 1 / RATE)
    theta = 0.3 * np.sin(0.2 * np.pi * np.maximum(time - rest_s, 0.0))
    torque = 40 * theta + 0.01 * np.random.default_rng(2).standard_normal(time.size)
    return Trial("slow", pl.DataFrame({"time": time, "theta": theta, "torque": torque}))


def clamped(sign):
    """A clamped actuator of 0.8 N*m/A whose current is stepped, with the torque's sign."""
    rng = np.random.default_rng(4)
    current = np.repeat([0.0, 1, -1, 2, -2, 3, -3, 4, -4, 2], 200)
    time = np.arange(current.size) / RATE
    measured = current + 0.01 * rng.standard_normal(time.size)
    torque = sign * (0.8 * current + 0.01 * rng.standard_normal(time.size))
    columns = {"time": time, "current": measured, "torque_m": torque}
    return Trial("clamped", pl.DataFrame(columns))


def test_a_change_is_advised_where_it_helps_with_what_it_gives():
    @remedies_tried
    def fit(trial, settings):
        mean = trial.samples["theta"].mean()
        if mean < 0 or settings.zero == "end":
            changes = [
                Change("turn theta", {"theta": -1.0}),
                Change("start at the start", settings={"zero": "start"}),
                Change("turn it and start", {"theta": -1.0}, {"zero": "start"}),
            ]
            raise InputError("the mean is negative; do something", changes)
        row = {"K": 2 * mean, "K_se": 0.1, "K_low": 2 * mean - 0.2, "K_high": 2 * mean + 0.2}
        return {"belt": pl.DataFrame([row])}

    settings = CONFIG.torque_angle.model_copy(update={"zero": "end"})
    trial = Trial("a", pl.DataFrame({"time": [0.0, 1.0], "theta": [-3.0, -5.0]}))

    with pytest.raises(InputError) as refused:
        fit(trial, settings=settings)

    assert str(refused.value) == ("the mean is negative; turn it and start: K 8 ± 0.2 N·m/rad")


def test_a_clamped_actuator_does_not_tell_whose_sign_is_wrong():
    with pytest.raises(InputError) as refused:
        fit_actuator_trial(clamped(-1), None, CONFIG.actuator)

    assert "turn the `sign` of current in" in refused.value.remedy
    assert (
        "or turn the `sign` of torque_m in the source file: k_tau_n_m 0.8 " in refused.value.remedy
    )


def test_a_zero_that_does_not_help_is_not_advised():
    settings = CONFIG.torque_angle.model_copy(update={"zero": "end"})

    with pytest.raises(InputError) as refused:
        fit_torque_angle_trial(slow_cycles(), settings)

    assert refused.value.remedy.startswith("write torque_angle.zero: none: K 40 ± ")


def test_without_a_stated_zero_the_torque_is_taken_from_where_the_joint_rests():
    settings = CONFIG.torque_angle.model_copy(update={"zero": None})

    moving = fit_torque_angle_trial(slow_cycles(), settings).estimates["torque_angle"]
    resting = fit_torque_angle_trial(slow_cycles(5.0), settings).estimates["torque_angle"]

    assert moving["torque_zero"][0] is None
    assert resting["torque_zero"][0] == pytest.approx(0.0, abs=0.01)
    assert moving["K"][0] == pytest.approx(40.0, abs=0.05)


def test_a_part_without_the_samples_of_a_failed_sensor_is_advised():
    trial = slow_cycles(5.0)
    torque = trial.samples["torque"].to_numpy().copy()
    torque[700:720] += 500.0
    failed = Trial("slow", trial.samples.with_columns(torque=pl.Series(torque)))
    settings = CONFIG.torque_angle.model_copy(update={"zero": None})

    with pytest.raises(InputError) as refused:
        fit_torque_angle_trial(failed, settings)

    assert "torque leaps in row 701 (7.000 s) and is back in row 721" in refused.value.reason
    assert refused.value.remedy.startswith("write windows `7.4-40.0` in the sheet: K 40")


@pytest.mark.parametrize(("column", "factor", "advice"), [
    ("theta", 180 / np.pi, "state `unit: deg` of theta in the source file: K 40 ± "),
    ("torque", 1000.0, "state `unit: N*mm` of torque in the source file: K 40 ± "),
    ("torque", -1.0, "turn the `sign` of the torque, or of all angles, in the source file: K 40 ±"),
])  # fmt: skip
def test_other_units_and_signs_are_tried(column, factor, advice):
    trial = slow_cycles(5.0)
    changed = Trial("slow", trial.samples.with_columns(pl.col(column) * factor))
    settings = CONFIG.torque_angle.model_copy(update={"zero": None})

    with pytest.raises(InputError) as refused:
        fit_torque_angle_trial(changed, settings)

    assert refused.value.remedy.startswith(advice)
    assert "; or " not in refused.value.remedy


@pytest.mark.parametrize(("K", "tried"), [(200.0, []), (11_000.0, ["theta", "torque"])])
def test_of_a_narrow_band_units_are_tried_where_no_joint_is_so_stiff(K, tried):
    w = 2 * np.pi * 2.0
    time = np.arange(0, 20, 1 / RATE)
    theta, omega, alpha = (0.02 * w**n * np.sin(w * time + n * np.pi / 2) for n in range(3))
    motion = np.array([theta, omega, alpha])

    with pytest.raises(IdentifiabilityError) as refused:
        check_told("made", (2.0, 2.1), motion, K * 0.014, (K, 0.1), 0.01)

    units = [change.other_unit_of for change in refused.value.changes if change.other_unit_of]
    assert units == tried


def driven_actuator():
    """An actuator of 0.8 N*m/A, f_C 0.3 N*m and J_m 0.008 kg*m^2, driven for 20 s."""
    rng = np.random.default_rng(6)
    time = np.arange(0, 20, 1 / 200)
    omega = 6 * np.sin(2.0 * time) + 3 * np.sin(5.2 * time + 1)
    alpha = 12 * np.cos(2.0 * time) + 15.6 * np.cos(5.2 * time + 1)
    current = 4 * np.sin(1.4 * time + 0.4) + 3 * np.sin(3.8 * time + 1.7)
    torque = 0.8 * current - 0.3 * np.tanh(omega / 0.05) - 0.02 * omega - 0.008 * alpha
    noise = 0.01 * rng.standard_normal((3, time.size))
    signals = {"current": current, "torque_m": torque, "omega_m": omega}
    return {"time": time} | {
        name: values + own for (name, values), own in zip(signals.items(), noise, strict=True)
    }


@pytest.mark.parametrize("late", [("current",), ("torque_m",), ("torque_m", "omega_m")])
def test_the_channels_that_are_late_are_told_by_the_fit_without_their_delay(late):
    recorded = driven_actuator()
    rows = 20  # 100 ms
    columns = {
        name: values[:-rows] if name in late else values[rows:] for name, values in recorded.items()
    }

    with pytest.raises(InputError) as refused:
        fit_actuator_trial(Trial("late", pl.DataFrame(columns)), None, CONFIG.actuator)

    advice = f"state `delay: 100 ms` of {' and '.join(late)} in the source file: k_tau_n_m 0.8 "
    assert refused.value.remedy.startswith(advice)


def joint_recording(rows, stiffness=150.0):
    """Rows of a joint's recording at 200 Hz, moved by many sines, numbered anew."""
    time = np.arange(5200) / 200.0
    turn = 2 * np.pi * time
    amplitudes = {0.7: 0.03, 1.9: 0.02, 3.1: 0.01, 4.7: 0.01}
    angles = [size * np.sin(hz * turn + hz) for hz, size in amplitudes.items()]
    speeds = [2 * np.pi * hz * s * np.cos(hz * turn + hz) for hz, s in amplitudes.items()]
    alphas = [-((2 * np.pi * hz) ** 2) * x for hz, x in zip(amplitudes, angles, strict=True)]
    noise = 0.03 * np.random.default_rng(6).standard_normal(time.size)
    torque = stiffness * sum(angles) + 2.4 * sum(speeds) + 0.02 * sum(alphas) + noise
    columns = {"time": time[: len(rows)], "theta": sum(angles)[rows], "torque": torque[rows]}
    return Trial("joint", pl.DataFrame(columns))


def slope_fit(trial, windows=None):
    """A fit that is doubtful where both halves of a recording have another stiffness."""
    samples = trial.within(windows).samples if windows else trial.samples
    theta, torque = (samples[name].to_numpy() for name in ("theta", "torque"))
    half = theta.size // 2
    halves = [
        np.polyfit(theta[part], torque[part], 1)[0] for part in (slice(half), slice(half, None))
    ]
    K = float(np.mean(halves))
    row = {"VAF": 99.0, "K": K, "K_se": 1.0, "K_low": K - 1, "K_high": K + 1}
    row["fault_harm"] = abs(halves[1] - halves[0]) / 20
    return FitTables({"impedance": pl.DataFrame([row])})


def test_rows_of_two_trials_are_told_before_a_stiffness_that_steps():
    first = joint_recording(np.arange(2400)).samples
    second = joint_recording(np.arange(2600, 5000), stiffness=230.0).samples
    joined = pl.concat([first, second]).with_columns(time=np.arange(4800) / 200.0)

    tables = remedies_tried(slope_fit)(Trial("joint", joined))

    row = tables.estimates["impedance"].row(0, named=True)
    assert row["row_harm"] == row["fault_harm"]
    assert row["row_fault"].startswith("theta and torque leap in row 2401 (12.000 s) and go on")
    assert row["mended"].startswith("write windows `0.0-11.8` in the sheet: K 1")
    assert "; or write windows `12.2-24.0` in the sheet: K 2" in row["mended"]


def test_a_doubt_that_leaving_rows_out_does_not_clear_is_no_doubt_about_rows():
    bent = joint_recording(np.delete(np.arange(5200), slice(600, 640)))
    bent = Trial("joint", bent.samples.with_columns(pl.col("torque") * (1 + pl.col("time"))))

    tables = remedies_tried(slope_fit)(bent)

    assert tables.estimates["impedance"].select(*OF_ROWS).row(0) == (None,) * 4


def test_of_swapped_channels_the_remedy_is_tried():
    sound = joint_recording(np.arange(2400))
    swapped = sound.samples.rename({"theta": "torque", "torque": "theta"})
    settings, limits = fit_settings("impedance", default_config())

    with pytest.raises(InputError) as refused:
        fit_trial("impedance", Trial("joint", swapped), None, settings, limits)

    advice = "swap the channels of theta and torque in the source file: K 150 "
    assert refused.value.remedy.startswith(advice)


def test_an_actuator_is_tried_without_its_lost_rows():
    """Without an inference it is the torque that is left that tells."""
    sound = joint_recording(np.arange(5200)).samples["theta"].to_numpy()
    rows = np.delete(np.arange(5200), slice(2600, 2700))
    bends = np.gradient(np.gradient(sound[rows])) * 4e4
    torque = 0.02 * np.gradient(np.gradient(sound))[rows] * 4e4
    columns = {"time": np.arange(rows.size) / 200.0, "theta_m": sound[rows], "torque_m": torque}

    def inertia_fit(trial):
        time, _ = trial.arrays("theta_m")
        alpha, measured = bends[np.rint(time * 200).astype(int)], trial.arrays("torque_m")[1]
        J_m = float(alpha @ measured / (alpha @ alpha))
        vaf = 100 * (1 - np.var(measured - J_m * alpha) / np.var(measured))
        return FitTables({"actuator": pl.DataFrame([{"J_m": J_m, "J_m_se": 0.0, "VAF": vaf}])})

    tables = remedies_tried(inertia_fit)(Trial("drive", pl.DataFrame(columns)))

    row = tables.estimates["actuator"].row(0, named=True)
    assert row["mended"].startswith("write windows `0.0-12.8 13.2-25.5` in the sheet: J_m 0.02")
    assert row["row_harm"] > 2


def test_an_actuator_is_tried_where_a_recording_is_no_joint_s():
    actuator = clamped(1).samples.rename({"torque_m": "torque"})
    rest = 0.3 + 1e-3 * np.random.default_rng(5).standard_normal(len(actuator))
    settings, limits = fit_settings("impedance", default_config())
    trial = Trial("stair", actuator.with_columns(theta=pl.Series(rest)))

    with pytest.raises(InputError) as refused:
        fit_trial("impedance", trial, None, settings, limits)

    assert refused.value.remedy.startswith("take experiment 'actuator', with theta named theta_m")
    assert "k_tau_n_m 0.8 " in refused.value.remedy


def test_a_change_that_gives_an_impossible_estimate_is_not_advised():
    @remedies_tried
    def fit(trial):
        mean = trial.samples["theta"].mean()
        if mean < 0:
            raise InputError("the mean is negative; do something", [Change("a", {"theta": -1.0})])
        row = {"K": mean, "K_se": 1.0, "K_low": mean - 2, "K_high": mean + 2, "K_over_K_d": mean}
        return {"impedance": pl.DataFrame([row])}

    for mean in (-1.0, -6.0):  # not told from 0; six times K_d
        with pytest.raises(InputError) as refused:
            fit(Trial("a", pl.DataFrame({"time": [0.0, 1.0], "theta": [mean, mean]})))
        assert refused.value.remedy == "do something"


def test_a_torque_whose_clock_drifts_is_told_by_how_much():
    samples = joint_recording(np.arange(5200)).samples
    time = samples["time"].to_numpy()
    late = np.interp(time * (1 - 2e-3), time, samples["torque"].to_numpy())
    drifting = Trial("joint", samples.with_columns(torque=pl.Series(late)))

    found_ppm = clock_drift_ppm(drifting)
    assert found_ppm == pytest.approx(2e3, rel=0.01)
    mended = changed(drifting, Change("", drift_ppm=found_ppm)).samples["torque"].to_numpy()
    inside = slice(100, -100)
    np.testing.assert_allclose(mended[inside], samples["torque"].to_numpy()[inside], atol=0.3)
    assert clock_drift_ppm(joint_recording(np.arange(5200))) is None


@pytest.mark.parametrize(("own", "advice"), [
    ({"theta": "motor", "torque": "torque"}, "name 'theta' as theta in the source file"),
    ({"theta": "theta", "torque": "side"}, "name 'torque' as torque in the source file"),
    ({"theta": "torque", "torque": "theta"},
     "exchange the channels of theta and torque in the source file"),
])  # fmt: skip
def test_other_channels_of_the_file_are_tried_where_K_is_not_K_d(own, advice, tmp_path):
    joint = joint_recording(np.arange(1200)).samples
    turned = joint.with_columns(motor=9 * pl.col("theta"), side=0.1 * pl.col("torque"))
    turned.write_csv(tmp_path / "log.csv")
    channels = {name: {"column": column, "unit": unit_of(name)} for name, column in own.items()}
    source = {"format": "csv", "clock": "master", "time": {"column": "time", "unit": "s"}}
    text = yaml.safe_dump({**source, "channels": channels})
    (tmp_path / "source.yaml").write_text(text)

    trial = raw_trial(tmp_path / "log.csv", tmp_path / "source.yaml", "impedance")
    given = {"trial": trial, "condition": {"K_d": 150.0}}
    outcomes = tried(known_slope_fit, given, other_readings(given, {}), is_as_stated)

    assert [outcome.change.words for outcome in outcomes] == [advice]


def known_slope_fit(trial, condition):
    row = slope_fit(trial).estimates["impedance"].row(0, named=True)
    ratio = row["K"] / condition["K_d"]
    return FitTables({"impedance": pl.DataFrame([row | {"K_over_K_d": ratio}])})


@pytest.mark.parametrize(("VAF_of_part", "is_advised"), [(99.99, True), (95.0, False)])
def test_where_the_stiffness_changes_the_parts_that_are_sound_are_tried(VAF_of_part, is_advised):
    """A hand that holds the joint from 12 s on, first softly. In a part that it holds, too, more of
    the torque is left."""
    samples = joint_recording(np.arange(5200)).samples
    held = 1 + 0.5 * np.clip((samples["time"].to_numpy() - 12) / 3, 0, 1)
    trial = Trial("joint", samples.with_columns(torque=pl.col("torque") * held))

    def fit(trial, windows=None):
        row = slope_fit(trial, windows).estimates["impedance"].row(0, named=True)
        told = {"fault": "K steps", "VAF": VAF_of_part if windows else 90.0}
        return FitTables({"impedance": pl.DataFrame([row | told])})

    row = remedies_tried(fit)(trial).estimates["impedance"].row(0, named=True)

    assert row["mended_fault"] == ("held_joint" if is_advised else None)
    if not is_advised:
        return
    assert row["mended"].startswith("write windows `0.0-7.8` in the sheet: K 1")
    assert "write windows `18.2-26.0` in the sheet: K 2" in row["mended"]


@pytest.mark.parametrize(("K_d", "VAF", "is_tried"), [
    (150.0, 99.0, True), (None, 1.0, True), (None, 99.0, False),
])  # fmt: skip
def test_other_channels_need_something_that_tells_which_is_right(K_d, VAF, is_tried):
    sound = joint_recording(np.arange(1200))
    trial = replace(sound, other_channels=lambda: [Change("name another")])
    given = {"trial": trial, "condition": {"K_d": K_d}}

    words = [change.words for change in other_readings(given, {"VAF_in_band": VAF})]

    assert ("name another" in words) == is_tried


@pytest.mark.parametrize(("turn", "is_tried"), [(1e-3, True), (0.3, False), (4.0, True)])
def test_an_actuator_is_tried_only_where_the_angle_is_not_that_of_a_joint(turn, is_tried):
    recorded = clamped(1).samples.rename({"torque_m": "torque"})
    theta = np.linspace(-turn, turn, len(recorded))
    given = {
        "trial": Trial("a", recorded.with_columns(theta=pl.Series(theta))),
        "settings": CONFIG.dynamometer,
    }

    experiments = [change.experiment for change in other_readings(given, {})]

    assert ("actuator" in experiments) == is_tried
