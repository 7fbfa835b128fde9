"""Which static trial calibrates which trial, on which side; labels that were exchanged; platforms that shift."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml
from conftest import ROOT
from test_walking_platform import CALIBRATION, RIG
from walking_platform import Ramp, Rig, ankle_answer, plate_trials, standing, walked
from walking_synthetic import PLATE_RATE, changed, settings

from osl_analysis.campaign import Campaign, check_walking, open_campaign
from osl_analysis.columns import marker_columns
from osl_analysis.commands.crossing import identify_plate
from osl_analysis.commands.walking import average_unperturbed
from osl_analysis.commands.walking_files import read_plate, write_refusal
from osl_analysis.config import campaign_config
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Trial
from osl_analysis.walking.bodies import static_calibration
from osl_analysis.walking.checks import exchanged_labels
from osl_analysis.walking.conditions import static_of
from osl_analysis.walking.crossing import RefusedCrossing, analyse_crossing
from osl_analysis.walking.plate_model import NO_CORRECTION, identify_plate_model
from osl_analysis.walking.platform import identify_platform

QUIET = Rig(marker=1e-5)


def campaign(folder: Path, rows: str, **walking: Any) -> Campaign:
    """A campaign with these rows: trial, experiment, perturbed, subject, session, side, static."""
    lines = [line.split(",") for line in rows.split()]
    cells = [",".join([*line, "a.c3d", "vicon"]) for line in lines]
    header = "trial,experiment,perturbed,subject,session,side,static,mocap,mocap_source"
    (folder / "trials.csv").write_text("\n".join([header, *cells]) + "\n")
    content = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    content |= {"sheet": folder / "trials.csv", "simulation": None, "walking": content["walking"] | walking}
    return open_campaign(campaign_config(content, [ROOT / "config/config.yaml"]), None)


CROSSINGS = "u1,walking,false,{0} u2,walking,false,{0} u3,walking,false,{0} p1,walking,true,{0} p2,walking,true,{0}"


def test_each_crossing_has_the_static_trial_of_its_subject_and_session(tmp_path: Path) -> None:
    rows = "sA,static,,A,1,, sB,static,,B,1,, sA2,static,,A,2,, wA,walking,false,A,1,, wB,walking,false,B,1,,"
    sheet = campaign(tmp_path, rows + " wA2,walking,true,A,2,, m,plate,,,,,sB")
    assert [sheet.static(trial) for trial in ("wA", "wB", "wA2", "m")] == ["sA", "sB", "sA2", "sB"]
    assert sheet.statics == {"sA": ["wA"], "sB": ["wB"], "sA2": ["wA2"]}


@pytest.mark.parametrize(
    ("cells", "statics", "found"),
    [
        ({"subject": "A", "session": "2", "static": "s1"}, {"s1": {"subject": "A"}, "s2": {"session": "2"}}, "s1"),
        ({"subject": "A", "session": "2"}, {"s1": {"subject": "A"}, "s2": {"subject": "A", "session": "2"}}, "s2"),
        ({"subject": "A"}, {"s1": {}}, "s1"),
        ({}, {"s1": {"subject": "A"}}, "s1"),
    ],
)
def test_the_static_trial_is_the_named_one_else_that_of_the_subject_else_the_only_one(cells, statics, found) -> None:
    assert static_of("w", cells, statics) == found


@pytest.mark.parametrize(
    ("cells", "statics", "message"),
    [
        ({}, {"s1": {}, "s2": {}}, r"states no subject, session or side: 2 static trials .*\(s1, s2\); name one"),
        ({"subject": "A"}, {"s1": {}, "s2": {}}, r"\(subject A\): 2 static trials could be its own"),
        ({"subject": "A"}, {"s1": {"subject": "B"}}, r"\(subject A\): no static trial of the same conditions"),
        ({"side": "left"}, {"s1": {"side": "right"}}, r"\(side left\): no static trial of the same conditions"),
        ({"static": "w1"}, {"s1": {}}, "static: 'w1' is no trial of experiment 'static' that is used; .* s1"),
    ],
)
def test_static_trials_that_are_not_told_apart_are_refused_with_the_remedy(
    cells: dict[str, str], statics: dict[str, dict[str, str]], message: str
) -> None:
    with pytest.raises(InputError, match=f"trial 'w'.*{message}"):
        static_of("w", cells, statics)


def test_two_static_trials_without_a_statement_are_refused_before_any_job(tmp_path: Path) -> None:
    rows = "s1,static,,,,, s2,static,,,,, m,plate,,,,, " + CROSSINGS.format(",,,")
    with pytest.raises(InputError, match=r"trials.csv: trial 'u1'.*: 2 static trials could be its own \(s1, s2\)"):
        check_walking(campaign(tmp_path, rows))


def test_the_side_of_the_sheet_goes_before_that_of_the_configuration(tmp_path: Path) -> None:
    rows = "s1,static,,,,{0}, m,plate,,,,, " + CROSSINGS.format(",,{1},")
    for own, crossings, side in (("left", "", "left"), ("", "left", "left"), ("", "", "right")):
        sheet = campaign(tmp_path, rows.format(own, crossings), side="right")
        check_walking(sheet)
        assert sheet.calibration_settings("s1")["side"] == side


@pytest.mark.parametrize(
    ("rows", "trial"),
    [
        ("s1,static,,,,, m,plate,,,,, " + CROSSINGS.format(",,right,") + " p3,walking,true,,,left,", "p3"),
        ("s1,static,,,,right, m,plate,,,,, " + CROSSINGS.format(",,left,s1"), "p2"),
    ],
)
def test_a_static_trial_of_both_sides_or_of_the_other_one_is_refused(tmp_path: Path, rows: str, trial: str) -> None:
    with pytest.raises(InputError, match=rf"'s1' serves trials of the sides left, right \(trial '{trial}': left\)"):
        check_walking(campaign(tmp_path, rows))


def test_a_static_trial_of_plate_trials_alone_needs_no_hinge(tmp_path: Path) -> None:
    rows = "s1,static,,A,,, s2,static,,B,,, m,plate,,B,,, " + CROSSINGS.format("A,,,")
    sheet = campaign(tmp_path, rows, hinge="functional")
    assert [sheet.calibration_settings(s)["hinge"] for s in ("s1", "s2")] == ["functional", "anatomical"]


def test_without_plate_trials_the_error_names_the_option_and_the_option_needs_none(tmp_path: Path) -> None:
    rows = "s1,static,,,,, " + CROSSINGS.format(",,,")
    with pytest.raises(InputError, match=r"0 trial of experiment 'plate'.*state `plate_inertia: none` under `walking`"):
        check_walking(campaign(tmp_path, rows))
    light = campaign(tmp_path, rows, plate_inertia="none")
    check_walking(light)
    assert light.plate_trials() == []
    assert campaign(tmp_path, rows + " m,plate,,,,,", plate_inertia="none").plate_trials() == []


def with_platform_markers_moved(trial: Trial, shift: float) -> Trial:
    """The platform's first marker glued elsewhere: `shift` [m] to the left, along the axis about which it turns."""
    return changed(trial, pl.col("marker_PLAT1_y") + shift)


def test_plate_trials_of_two_sessions_are_each_read_with_their_own_cluster() -> None:
    """The second session's PLAT1 was glued 30 mm beside: with the first static trial its residual exceeds the limit."""
    first, second = (static_calibration(with_platform_markers_moved(standing(), s), settings()) for s in (0.0, 0.03))
    trials = plate_trials(QUIET, Ramp(), 2)
    sessions = [trials[0], with_platform_markers_moved(trials[1], 0.03)]
    alike = identify_plate_model(trials, first, settings())
    model = identify_plate_model(sessions, {sessions[0].name: first, sessions[1].name: second}, settings())
    np.testing.assert_allclose(model.inertia.parameters, alike.inertia.parameters, atol=0.05)  # 0.01 mm of noise
    with pytest.raises(InputError, match="are seen together in 0 frames"):
        identify_plate_model(sessions, first, settings())


def test_platform_markers_that_were_moved_between_sessions_have_no_shared_motion() -> None:
    """The coordinates of one cluster are not those of another: crossings keep their own motion, and a line says so."""
    first, second = (static_calibration(with_platform_markers_moved(standing(), s), settings()) for s in (0.0, 0.03))
    trials = [walked(f"w{k}", Ramp(), Rig(), k) for k in range(4)]
    own = {"w0": first, "w1": first, "w2": second, "w3": second}
    moved = [*trials[:2], *(with_platform_markers_moved(trial, 0.03) for trial in trials[2:])]
    with pytest.warns(UserWarning, match=r"keeps its own motion of the platform: .* stand 13 mm \(RMS\) otherwise"):
        assert identify_platform(moved, own, settings()).template is None
    assert identify_platform(trials, dict.fromkeys(own, first), settings()).template is not None


def test_without_a_correction_the_torque_of_a_light_plate_is_that_of_the_wrench_as_recorded(tmp_path: Path) -> None:
    outputs, chosen = (tmp_path / "plate.json", tmp_path / "plate.csv"), settings(plate_inertia="none")
    with pytest.warns(UserWarning, match="own inertia and lag stay in the torque: walking.plate_inertia is none"):
        identify_plate([], [], {}, chosen, *outputs)
    table = read_table(outputs[1])
    assert table["plate_inertia"].unique().to_list() == ["none"]
    assert table["rms_before"].null_count() == len(table)
    model = read_plate(outputs[0])
    assert (model.delay, model.lag, model.leave_one_out) == (0.0, None, ())
    calibration = static_calibration(standing(), settings())
    weightless, stamps = replace(QUIET, mass=1e-9), np.arange(3 * PLATE_RATE) / PLATE_RATE
    crossing = analyse_crossing(walked("w", Ramp(), weightless, 1), calibration, model, True, chosen)
    heavy = analyse_crossing(walked("w", Ramp(), QUIET, 1), calibration, NO_CORRECTION, True, chosen)
    exact = np.interp(crossing.time, stamps, LowPass(20.0)(ankle_answer(stamps, Ramp(), weightless), PLATE_RATE))
    window = (crossing.time > 1.1) & (crossing.time < 1.3)
    # 0.4 N and 0.08 N*m of noise at 1500 Hz through 20 Hz leave 0.02 N*m; the filters' rates differ by 0.1
    np.testing.assert_allclose(crossing.torque[window], exact[window], atol=0.3)
    assert np.abs(heavy.torque - crossing.torque).max() > 5


WALK = walked("walk_1", None, RIG, 1)


def relabelled(trial: Trial, *pairs: tuple[str, str]) -> Trial:
    """The trial with the labels of each pair exchanged."""
    other = dict(pairs) | {b: a for a, b in pairs}
    names = {c: n for a, b in other.items() for c, n in zip(marker_columns(a), marker_columns(b), strict=True)}
    return replace(trial, samples=trial.samples.rename(names))


FOOT_AND_SHANK = [(f"FOOT{k}", f"SHANK{k}") for k in range(1, 5)]


@pytest.mark.parametrize(
    ("pairs", "named"),
    [
        ([("FOOT1", "FOOT3")], "the labels FOOT1 and FOOT3"),
        ([("FOOT4", "SHANK1")], "the labels FOOT4 and SHANK1"),
        ([("PLAT1", "PLAT3")], "the labels PLAT1 and PLAT3"),
        (FOOT_AND_SHANK, "the labels of foot and shank"),
    ],
)
def test_exchanged_labels_are_named_in_the_refusal(pairs: list[tuple[str, str]], named: str) -> None:
    with pytest.raises(InputError, match=f"trial walk_1: .*; {named} look exchanged in 900 frames: markers lie"):
        analyse_crossing(relabelled(WALK, *pairs), CALIBRATION, NO_CORRECTION, False, settings())
    if named == "the labels FOOT1 and FOOT3":  # in the static trial
        static = static_calibration(relabelled(standing(), *pairs), settings())
        with pytest.raises(InputError, match=f"{named} look exchanged .* or of its static trial"):
            analyse_crossing(WALK, static, NO_CORRECTION, False, settings())
    if named.startswith("the labels PLAT"):
        unloaded = relabelled(walked("plate_1", Ramp(), RIG, 1, loaded=False), *pairs)
        with pytest.raises(InputError, match=f"seen together in 0 frames.*; {named} look exchanged"):
            identify_plate_model([unloaded], CALIBRATION, settings())


def test_sound_labels_and_those_that_no_exchange_explains_say_nothing() -> None:
    assert exchanged_labels(WALK, CALIBRATION, settings()) == ""
    lost = changed(WALK, pl.col("marker_FOOT2_z") + 0.1)
    with pytest.raises(InputError, match=r"the foot markers cannot be followed [^;]*; [^;]*$"):
        analyse_crossing(lost, CALIBRATION, NO_CORRECTION, False, settings())


def test_clusters_exchanged_everywhere_are_seen_by_their_heights_in_the_static_trial() -> None:
    with pytest.raises(InputError, match=r"the foot markers FOOT1, .* stand 24 cm above the shank markers SHANK1"):
        static_calibration(relabelled(standing(), *FOOT_AND_SHANK), settings())


def shifted(trial: Trial, size: float) -> Trial:
    """The platform, and what stands on it, moved forward by `size` [m] within 0.1 s in mid-stance."""
    step = size * np.clip((trial.samples["time"].to_numpy() - 1.2) / 0.1, 0, 1)
    return changed(trial, pl.col("^marker_.*_x$") + pl.Series(step))


@pytest.mark.parametrize("claimed", [False, True])
def test_a_translation_is_no_unperturbed_crossing_and_is_not_analysed_as_a_perturbed_one(claimed: bool) -> None:
    with pytest.raises(InputError, match=r"the platform shifts by (50|51) mm in stance without a turn, expected 10 mm"):
        analyse_crossing(shifted(WALK, 0.05), CALIBRATION, NO_CORRECTION, claimed, settings())


def test_a_platform_that_yields_under_the_person_and_one_that_turns_and_heaves_are_analysed() -> None:
    assert analyse_crossing(shifted(WALK, 0.005), CALIBRATION, NO_CORRECTION, False, settings()).onset is None
    light = replace(RIG, mass=1e-9)
    crossing = analyse_crossing(
        walked("w", Ramp(heave=0.015), light, 1), CALIBRATION, NO_CORRECTION, True, settings(largest_shift_mm=5)
    )
    assert crossing.onset is not None


def test_too_few_unperturbed_crossings_say_how_many_and_why(tmp_path: Path) -> None:
    why = "the shank moves {} cm backwards over the foot in stance: correct `side`"
    reasons = {f"u{k}": f"trial u{k}: {why.format(20 + k)}" for k in range(5)} | {"u5": "trial u5: hidden"}
    for name, reason in reasons.items():
        write_refusal(RefusedCrossing(name, False, reason), tmp_path / f"{name}.parquet")
    rows = [{"trial": n, "perturbed": False, "reason": r, "gait": "all", "group": None} for n, r in reasons.items()]
    rows.append({"trial": "p1", "perturbed": True, "reason": "another", "gait": "all", "group": None})
    write_table(pl.DataFrame(rows).with_columns(direction=None), tmp_path / "selection.csv")
    files = [tmp_path / f"{name}.parquet" for name in reasons]
    with pytest.raises(InputError) as caught:
        average_unperturbed(files, tmp_path / "selection.csv", settings(), tmp_path / "gait.parquet")
    assert str(caught.value) == (
        "0 of 6 unperturbed crossings can be used, expected 3 or more; 5 times (u0, u1, u2, u3, u4) "
        "beside 1 for other reasons, which walking_crossings.csv lists, as in u0: " + why.format(20)
    )
