"""Quality control: every check sees the fault it is for, and nothing in a sound recording."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml
from c3d_builder import REAL_DATA
from conftest import ROOT

from osl_analysis.bench.components import actuator_trial, belt_trial
from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis
from osl_analysis.config.campaign import check_campaign, open_campaign
from osl_analysis.config.configuration import campaign_config, read_section
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.judge.recording import CHECKS, examine, quality_table, validate_rules
from osl_analysis.judge.table import CheckResult, Commanded, QualityRules
from osl_analysis.signals import longest_at_extreme, longest_run
from osl_analysis.trial import Array, Trial

COMMANDED = Commanded((2.0, 4.0), (2.0, 5.0), 6)
RULES = read_section(ROOT / "config/config.yaml", "quality", QualityRules)
RATE = 1000.0


def stepped_sine(commanded: Commanded = COMMANDED) -> Array:
    """The joint's angle [rad]: half a second of rest, then each amplitude at every frequency, rests between."""
    rest = np.zeros(500)
    pieces = [rest]
    for a in commanded.amplitudes_deg:
        for f, cycles in zip(commanded.frequencies_hz, commanded.protocol.cycles_at, strict=True):
            pieces.append(np.radians(a) * np.sin(2 * np.pi * f * np.arange(round(cycles / f * RATE)) / RATE))
        pieces.append(rest)
    return np.concatenate(pieces)


def bench(theta: Array | None = None, **changed: Array) -> pl.DataFrame:
    """A sound recording of the dynamometer, with columns changed or added."""
    theta, rng = stepped_sine() if theta is None else theta, np.random.default_rng(5)
    torque = 300 * theta + 0.5 + 0.05 * rng.standard_normal(theta.size)
    current = theta * 20 + 0.01 * rng.standard_normal(theta.size)
    columns = {"theta": theta, "theta_command": theta, "torque": torque, "current": current}
    return pl.DataFrame({"time": np.arange(theta.size) / RATE, **columns, **changed})


def laboratory(**changed: Array | pl.Series) -> pl.DataFrame:
    """A sound crossing: a plate at 1000 Hz that is stepped on, a marker at 200 Hz."""
    time, rng = np.arange(2000) / RATE, np.random.default_rng(6)
    load = 800 * np.clip(np.minimum(time - 0.7, 1.4 - time) / 0.02, 0, 1)
    frame = every_fifth(0.1 * time[::5])
    plate = {"plate1_force_z": load + 2 + rng.standard_normal(2000)}
    return pl.DataFrame({"time": time, **plate, "marker_A_x": frame, **changed})


def every_fifth(values: Array) -> pl.Series:
    """A marker's column beside one that is sampled five times as often."""
    column = pl.Series("marker_A_x", [None] * (5 * values.size), pl.Float64)
    return column.scatter(np.arange(values.size) * 5, values)


def results(samples: pl.DataFrame, experiment: str = "impedance", **provenance: Any) -> dict[str, CheckResult]:
    return examine(Trial("t", samples, provenance), experiment, COMMANDED)


def failed(found: Mapping[str, CheckResult]) -> set[str]:
    """Names of the checks that the shipped thresholds do not pass."""
    return {name for name, result in found.items() if CHECKS[name].failed(result.value, RULES.by_check[name].limit)}


def test_a_sound_recording_passes_every_check() -> None:
    assert failed(results(bench())) == set()
    assert failed(results(laboratory(), "walking")) == set()
    assert set(results(bench())) == set(CHECKS)


def test_every_recorders_rate_is_measured_on_its_own_and_a_slow_one_is_told() -> None:
    slow = results(bench()[::20])
    assert slow["rate"].value == pytest.approx(50.0)
    assert failed(slow) == {"rate"}
    found = results(laboratory(), "walking")["rate"]
    assert found.value == pytest.approx(200.0)
    assert found.remark == "plate1_force_z 1000 Hz, marker_A_x 200 Hz"


def test_jitter_passes_where_the_signals_decide_and_a_gap_is_not_jitter() -> None:
    samples = bench()
    noise = np.sort(samples["time"].to_numpy() + 0.3 / RATE * np.random.default_rng(2).standard_normal(samples.height))
    found = results(samples.with_columns(time=pl.Series(noise)))
    assert found["jitter"].value == 0
    assert " % of scatter, even: theta g = 0.00" in found["jitter"].remark
    assert failed(found) == set()
    late = results(samples.with_columns(time=pl.col("time") + pl.when(pl.col("time") > 3).then(0.2).otherwise(0)))
    assert late["gap"].value == pytest.approx(0.2)
    assert late["jitter"].value == pytest.approx(0, abs=1e-6)
    assert failed(late) >= {"gap"}


def test_jitter_is_the_wander_of_stamps_about_which_nothing_decides() -> None:
    resting = bench(1e-5 * np.random.default_rng(3).standard_normal(10_000))
    resting = resting.with_columns(torque=0.05 * np.random.default_rng(4).standard_normal(10_000))
    wander = 0.5 / RATE * np.sin(2 * np.pi * np.arange(10_000) / 3000)
    found = results(resting.with_columns(time=pl.col("time") + pl.Series(wander)))["jitter"]
    assert found.value == pytest.approx(50 / np.sqrt(2), rel=0.1)
    assert "undecided, true" in found.remark


@pytest.mark.parametrize("sign", [1, -1])
def test_a_load_cell_that_rails_is_seen_at_either_end_by_its_samples(sign: int) -> None:
    torque = bench()["torque"].to_numpy().copy()
    found = results(bench(torque=sign * np.minimum(torque, 15.0)))
    beyond = longest_run(torque > 15)
    assert found["saturation"] == CheckResult(beyond.stop - beyond.start, "torque")
    assert failed(found) == {"saturation"}
    torque[1000:1009] = torque[1100:1104] = 40.0
    assert results(bench(torque=sign * torque))["saturation"].value == 9


def test_an_unloaded_plate_that_reads_zero_is_neither_railed_nor_stuck() -> None:
    time = np.arange(2000) / RATE
    clipped = 800 * np.clip(np.minimum(time - 0.7, 1.4 - time) / 0.02, 0, 1) * (1 + 0.01 * np.sin(300 * time))
    assert failed(results(laboratory(plate1_force_z=clipped), "walking")) == set()


def test_an_extreme_at_zero_or_where_the_channel_mostly_is_is_no_rail() -> None:
    loaded = np.where(np.arange(1000) < 800, 700 + np.sin(np.arange(1000)), 0.0)
    assert longest_at_extreme(loaded) < 5  # on a plate that is mostly stood on, zero is an extreme
    coarse = np.where(np.arange(1000) < 800, -80.0, 700 + np.sin(np.arange(1000)))
    assert longest_at_extreme(coarse) < 5  # an unzeroed plate whose noise is below its resolution
    assert longest_at_extreme(-coarse + 300) < 5
    assert longest_at_extreme(np.minimum(loaded, 700.5)) < 5
    assert longest_at_extreme(np.where(np.arange(1000) % 100 < 20, 900.0, np.sin(np.arange(1000)))) == 20


def test_a_channel_that_repeats_a_value_is_stuck() -> None:
    torque = bench()["torque"].to_numpy().copy()
    torque[2000:2800] = torque[2000]
    found = results(bench(torque=torque))
    assert found["stuck"] == CheckResult(pytest.approx(0.799), "torque")
    assert failed(found) == {"stuck"}


def test_an_encoder_that_stands_while_the_joint_is_told_to_move_is_stuck_and_one_at_rest_is_not() -> None:
    theta = stepped_sine().copy()
    theta[1000:2000] = theta[1000]
    found = results(bench(theta, theta_command=stepped_sine()))
    assert found["stuck"] == CheckResult(pytest.approx(1.0, abs=2e-3), "theta")
    assert results(bench())["stuck"].value == 0.0  # though the joint rests for half a second
    samples = bench().drop("theta_command")
    torque = samples["torque"].to_numpy() + 40 * (np.arange(samples.height) // 20 == 24)  # before it breaks loose
    assert results(samples.with_columns(torque=torque))["stuck"].value < 0.1


@pytest.mark.parametrize(
    ("moved", "K", "noise", "step"),
    [
        (np.round(stepped_sine() / 2.4e-5) * 2.4e-5, 2, 0.03, 0),  # at rest the noise is a part of the torque's range
        (0.07 * np.cos(2 * np.pi * np.arange(4000) / RATE), 300, 0.01, 0),  # the first moment of motion is no reference
        (stepped_sine(), 300, 0, 0.5),
    ],
    ids=["small noisy torque", "start with a jump", "coarse load cell"],
)
def test_a_joint_at_rest_is_not_stuck_though_nothing_is_commanded(
    moved: Array, K: float, noise: float, step: float
) -> None:
    theta = np.concatenate([np.zeros(2000), moved])
    torque = K * theta + noise * np.random.default_rng(3).standard_normal(theta.size)
    torque = np.round(torque / step) * step if step else torque
    samples = pl.DataFrame({"time": np.arange(theta.size) / RATE, "theta": theta, "torque": torque})
    assert results(samples)["stuck"].value < 0.1
    if step:
        assert results(samples.drop("theta"))["stuck"].value > 1.9  # nothing says that the joint rests


def test_a_commanded_current_of_a_few_levels_is_not_stuck_and_a_measured_one_is() -> None:
    levels = np.repeat([1.0, 4.0, -2.0, 0.0], 1000)[: actuator_bench().height]
    assert results(actuator_bench(current=levels), "actuator")["stuck"].value == 0
    measured = actuator_bench()["current"].to_numpy().copy()
    measured[500:1500] = measured[500]
    assert results(actuator_bench(current=measured), "actuator")["stuck"].remark == "current"


@pytest.mark.parametrize("channel", ["torque", "current"])
@pytest.mark.parametrize("value", [0.0, 3.0])
def test_a_torque_or_current_that_never_changes_is_stuck_also_at_zero(channel: str, value: float) -> None:
    dead = bench(**{channel: np.full(stepped_sine().size, value)})
    found = results(dead)
    assert found["stuck"] == CheckResult(pytest.approx(dead["time"][-1], abs=2e-3), channel)
    assert failed(found) == {"stuck"}


def test_a_joint_angle_that_never_changes_is_stuck_where_the_joint_should_move_and_not_in_a_static_trial() -> None:
    still = pl.DataFrame({"time": np.arange(2000) / RATE, "theta": 0.1})
    for experiment in ("belt", "impedance", "walking"):
        assert results(still, experiment)["stuck"] == CheckResult(pytest.approx(1.999), "theta")
    assert results(still, "static")["stuck"].value is None
    locked = bench().with_columns(theta_m=pl.lit(0.2))
    assert results(locked, "belt")["stuck"].value == 0.0  # the belt's experiment locks the input shaft


def test_a_plate_channel_that_is_zero_throughout_is_stuck_while_the_others_of_its_plate_move() -> None:
    zero = np.zeros(2000)
    dead = results(laboratory(plate1_force_x=zero), "walking")
    assert dead["stuck"] == CheckResult(pytest.approx(1.999), "plate1_force_x")
    unused = results(laboratory(plate2_force_x=zero, plate2_force_z=zero), "walking")
    assert unused["stuck"].value == 0.0


def actuator_bench(**changed: Array) -> pl.DataFrame:
    """A sound recording of the actuator's own bench: two seconds of a slow sine."""
    time, rng = np.arange(2000) / RATE, np.random.default_rng(8)
    noise = rng.standard_normal((2, time.size))
    columns = {"theta_m": np.sin(3 * time), "current": 5 * np.sin(3 * time) + 0.01 * noise[0]}
    return pl.DataFrame({"time": time, **columns, "torque_m": 5 * np.sin(3 * time) + 0.01 * noise[1], **changed})


@pytest.mark.parametrize("experiment", [name for name, facts in EXPERIMENTS.items() if facts.torque])
def test_the_torque_of_every_experiment_is_checked_for_rails_and_for_standing_still(experiment: str) -> None:
    torque = str(EXPERIMENTS[experiment].torque)
    sound = actuator_bench() if experiment == "actuator" else bench()
    dead, railed = (
        results(sound.with_columns(values.alias(torque)), experiment)
        for values in (pl.lit(0.0), pl.col(torque).clip(None, 4.0))
    )
    assert (dead["stuck"].remark, railed["saturation"].remark) == (torque, torque)
    if experiment == "actuator":
        assert [failed(found) for found in (results(sound, "actuator"), railed, dead)] == [
            set(),
            {"saturation"},
            {"stuck"},
        ]


@pytest.mark.parametrize("level", [0.0, 3.0])
def test_the_fits_of_belt_and_actuator_refuse_a_dead_load_cell_by_trial_and_channel(
    level: float, parameters: DrivetrainParameters
) -> None:
    time = np.arange(3000) / RATE
    moved, dead = 0.0873 * np.sin(np.pi * time / 3), np.full(3000, level)
    belt = pl.DataFrame({"time": time, "theta": moved, "theta_m": 0.0, "torque": dead})
    dynamometer = read_section(ROOT / "config/config.yaml", "dynamometer", DynamometerAnalysis)
    with pytest.raises(InputError, match=f"trial made: torque stays at {level:g} throughout; check its sensor"):
        belt_trial(Trial("made", belt), parameters, dynamometer)
    actuator = pl.DataFrame({"time": time, "theta_m": 9 * moved, "current": moved, "torque_m": dead})
    settings = read_section(ROOT / "config/config.yaml", "actuator", ActuatorAnalysis)
    with pytest.raises(InputError, match=f"trial made: torque_m stays at {level:g} throughout; check its sensor"):
        actuator_trial(Trial("made", actuator), settings)


@pytest.mark.parametrize("turn", [2 * np.pi, -2 * np.pi, 360.0])
def test_jumps_by_a_turn_are_counted(turn: float) -> None:
    theta = stepped_sine() + turn * (np.arange(stepped_sine().size) > 2000) * (np.arange(stepped_sine().size) < 2500)
    assert results(bench(theta))["encoder_wrap"] == CheckResult(2.0, "theta")


def test_a_load_cell_that_was_not_zeroed_is_told_by_its_rest() -> None:
    found = results(bench(torque=bench()["torque"].to_numpy() - 8.0))
    assert found["unzeroed_load_cell"].value == pytest.approx(7.5, abs=0.05)
    assert failed(found) == {"unzeroed_load_cell"}


def test_the_rest_ends_where_the_joint_first_moves() -> None:
    theta = np.radians(5) * np.clip((np.arange(4000) - 1000) / 2000, 0, 1)
    found = results(bench(theta), "belt")["unzeroed_load_cell"]
    assert found.value == pytest.approx(0.5, abs=0.05)
    assert "over the first 1.04 s" in found.remark
    assert results(bench()[500:])["unzeroed_load_cell"].value is None, "it begins in motion: there is no rest to judge"


def test_a_load_cell_of_its_own_node_is_told_by_its_rest_too() -> None:
    both = bench()
    angle, torque = both.drop("torque"), both.select("time", pl.col("torque") + 7.5)
    later = torque.with_columns(pl.col("time") + 3e-4)
    found = results(angle.join(later, on="time", how="full", coalesce=True).sort("time"))["unzeroed_load_cell"]
    assert found.value == pytest.approx(results(bench(torque=torque["torque"].to_numpy()))["unzeroed_load_cell"].value)


@pytest.mark.parametrize("offset", [-100.0, 60.0])
def test_a_plate_that_was_not_zeroed_is_told_by_its_bare_level(offset: float) -> None:
    force = laboratory()["plate1_force_z"].to_numpy() + offset
    found = results(laboratory(plate1_force_z=force), "walking")
    assert found["unzeroed_plate"].value == pytest.approx(abs(offset + 2), abs=0.5)
    assert failed(found) == {"unzeroed_plate"}


def test_somebody_who_stands_on_a_plate_all_the_time_is_no_offset() -> None:
    force = 800 + np.random.default_rng(1).standard_normal(2000)
    assert results(laboratory(plate1_force_z=force), "static")["unzeroed_plate"].value is None
    assert failed(results(laboratory(plate1_force_z=force), "walking")) == {"unzeroed_plate"}
    assert failed(results(laboratory(plate1_force_z=-force), "static")) == {"unzeroed_plate"}


def test_a_persons_weight_with_the_wrong_sign_is_told_from_an_offset() -> None:
    def remark(level: float, experiment: str) -> str:
        force = level + np.random.default_rng(1).standard_normal(2000)
        return results(laboratory(plate1_force_z=force), experiment)["unzeroed_plate"].remark

    told = remark(-735.7, "static")
    assert re.match(r"plate1 -735\.\d N, a person's weight with the wrong sign: correct the plate's `sign` or", told)
    assert "sign" not in remark(-150.0, "static")
    assert "sign" not in remark(-735.7, "plate")  # nobody stands on it


def test_the_plate_at_minus_713_n_of_a_real_recording_is_caught() -> None:
    path = REAL_DATA / "c3d/qtm_JH_01_300_1200_plate_offset.c3d"
    if not path.is_file():
        pytest.skip("no real data")
    recording = FORMATS["c3d"].read(path, FORMATS["c3d"].source(format="c3d"))
    found = results(recording.samples, "ingest_only")
    assert found["unzeroed_plate"].value == pytest.approx(702, abs=1)  # its quietest; its median is 713 N
    assert "plate1 -702.0 N" in found["unzeroed_plate"].remark
    assert "unzeroed_plate" in failed(found)


def test_a_hidden_marker_is_told_by_its_longest_gap_between_sightings() -> None:
    seen = np.linspace(0, 0.1, 400)
    seen[:40] = np.nan  # before it was first seen: no gap
    seen[100:160] = np.nan
    seen[200:210] = np.nan
    found = results(laboratory(marker_A_x=every_fifth(seen)), "walking")
    assert found["marker_gap"] == CheckResult(pytest.approx(60 / 200), "A; 1 of 1 markers")
    never = results(laboratory(marker_A_x=every_fifth(np.full(400, np.nan))), "walking")
    assert never["marker_gap"].value == pytest.approx(1.995)


def test_clocks_that_fit_badly_and_a_damaged_log_are_told_from_the_provenance() -> None:
    clock = {"offset": 0.0, "drift": 5e-5, "drift_error": 1e-6, "residual": 2.5e-3, "edges": 20, "excluded_edges": 1}
    damage = {"complete": False, "crc": "checked", "chunks_lost": 2, "messages_lost": 130, "share_lost": 0.04}
    found = results(bench(), clock=clock, damage=damage | {"remarks": ["chunk 3: checksum"]})
    assert failed(found) == {"clock_residual", "damage", "truncated"}
    assert found["clock_residual"].remark.startswith("drift 50.0 +- 1.0 ppm; 20 matched and 1 excluded by edges")
    assert found["damage"].value == pytest.approx(4.0)
    assert "130 messages lost; the file is not complete; CRC checked; chunk 3" in found["damage"].remark
    assert results(bench())["damage"] == CheckResult(None, "not applicable: no damage report")


@pytest.mark.parametrize(
    ("really", "missing", "remark"),
    [
        (Commanded((2.0, 4.0), (2.0, 5.0), 6), 0, "4 commanded pairs of amplitude and frequency found"),
        (Commanded((2.0, 4.0), (2.0,), 6), 2, "missing 2 deg at 5 Hz; missing 4 deg at 5 Hz"),
        (Commanded((2.0, 6.0), (2.0, 5.0), 6), 4, "missing 4 deg at 5 Hz; besides 6 deg at 2 Hz (6.0 cycles); besides"),
        (Commanded((2.0, 4.0), (2.0, 5.0), 3), 4, "2 deg at 2 Hz (3.0 cycles), commanded are 6"),
        (Commanded((2.0, 4.0), (2.0, 5.0), (6, 15)), 2, "4 deg at 5 Hz (15.0 cycles), commanded are 6"),
        (Commanded((2.0, 4.0), (2.01, 5.025), 6), 0, "found; frequencies are 0.5 % above the commanded ones"),
    ],
)
def test_the_protocol_in_the_log_is_held_against_the_configured_one(
    really: Commanded, missing: int, remark: str
) -> None:
    found = results(bench(stepped_sine(really)))["protocol"]
    assert found.value == missing
    assert remark in found.remark


def test_a_time_per_frequency_may_be_commanded_in_place_of_cycles() -> None:
    theta = stepped_sine(Commanded((2.0, 4.0), (2.0, 5.0), (6, 15)))
    seconds = examine(Trial("a", bench(theta)), "impedance", Commanded((2.0, 4.0), (2.0, 5.0), 6, 3.0))["protocol"]
    assert seconds == CheckResult(0.0, "4 commanded pairs of amplitude and frequency found")
    assert results(bench(np.zeros(5000)))["protocol"].value == 4, "a joint that never moved lacks all of it"
    stated = examine(Trial("a", bench(np.zeros(5000))), "impedance", replace(COMMANDED, excitation="any"))["protocol"]
    assert stated == CheckResult(0.0, "not compared: the configuration says that any motion moves the joint")


def test_a_failure_flags_or_excludes_by_its_rule_and_the_sheet_accepts_it_by_name() -> None:
    found = {"gap": CheckResult(0.2, "theta"), "unzeroed_plate": CheckResult(700.0, "plate1 -700 N")}
    table = quality_table("w", found | {"rate": CheckResult(None)}, RULES, ())
    assert table["verdict"].to_list() == ["flag", "exclude", "pass"]
    assert table.row(1) == ("w", "unzeroed_plate", 700.0, "N", 20.0, "exclude", "plate1 -700 N")
    accepted = quality_table("w", found, RULES, ("unzeroed_plate",))
    assert accepted["verdict"].to_list() == ["flag", "pass"]
    assert accepted["remark"][1] == "accepted in the sheet; plate1 -700 N"


@pytest.mark.parametrize("rows", [1, 2, 3, 250])
@pytest.mark.parametrize("experiment", ["impedance", "walking"])
def test_a_trial_of_few_rows_or_empty_columns_is_judged_without_an_error(rows: int, experiment: str) -> None:
    nothing = pl.lit(None, pl.Float64)
    samples = bench()[:rows].with_columns(plate1_force_z=nothing, marker_A_x=pl.lit(np.nan))
    found = results(samples, experiment)
    assert all(f.value is None or np.isfinite(f.value) for f in found.values())
    for one in (found, results(samples.with_columns(theta=nothing, torque=nothing), experiment)):
        assert quality_table("t", one, RULES, ())["check"].to_list() == list(CHECKS)


@pytest.mark.parametrize(
    ("name", "value", "failing"),
    [("rate", 99.0, True), ("rate", 100.0, False), ("gap", 0.05, False), ("gap", 0.051, True), ("gap", np.nan, True)],
)
def test_a_value_at_its_threshold_passes_and_no_number_fails(name: str, value: float, failing: bool) -> None:
    assert CHECKS[name].failed(value, RULES.by_check[name].limit) is failing


def rules_with(**changed: Any) -> QualityRules:
    """The shipped rules, with some changed, added, or None: taken out."""
    content = yaml.safe_load((ROOT / "config/config.yaml").read_text())["quality"] | changed
    return QualityRules.model_validate({name: rule for name, rule in content.items() if rule})


@pytest.mark.parametrize("threshold", ["20", "20 kN", "much N", "-1 N", "nan N", "inf N"])
def test_a_threshold_without_its_unit_is_refused(threshold: str) -> None:
    message = f"quality.unzeroed_plate: threshold '{threshold}' must be a number from 0 and its unit, as in '1 N'"
    with pytest.raises(InputError, match=re.escape(message)):
        validate_rules(rules_with(unzeroed_plate={"threshold": threshold, "on_failure": "flag"}))


def test_rules_and_checks_are_the_same_list_and_an_old_name_is_refused_with_the_new_one() -> None:
    rule = {"threshold": "0 logs", "on_failure": "flag"}
    validate_rules(RULES)
    with pytest.raises(InputError, match="quality: no rule for the check 'gap'"):
        validate_rules(rules_with(gap=None))
    with pytest.raises(InputError, match="'gaps' is no quality check; the checks are rate, jitter, gap"):
        validate_rules(rules_with(gaps=rule))
    with pytest.raises(InputError, match="the check 'unfinished' is now called 'truncated'"):
        validate_rules(rules_with(unfinished=rule))


def test_the_sheet_may_accept_only_checks_that_there_are(tmp_path: Path) -> None:
    (tmp_path / "trials.csv").write_text("trial,experiment,log,log_source,accept\nb,belt,b.mcap,dynamometer,gap gaps\n")
    content = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    config = campaign_config(
        content | {"sheet": tmp_path / "trials.csv", "simulation": None}, [ROOT / "config/config.yaml"]
    )
    with pytest.raises(InputError, match="trial 'b', accept: 'gaps' is no quality check; the checks are rate, jitter"):
        check_campaign(open_campaign(config, None))
