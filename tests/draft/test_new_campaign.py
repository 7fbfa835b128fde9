# SPDX-License-Identifier: Apache-2.0
"""A new campaign: what is drafted from recordings, what is not overwritten, and how editors check
its files."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml
from bench_recordings import RECORDINGS
from c3d_builder import FACE, UNITS_OF_PLATE, level_plates, write_c3d
from command_line import call
from conftest import ROOT, refused_with
from jsonschema import Draft202012Validator
from log_builders import write_text

from osl_analysis.base.files import shipped
from osl_analysis.base.units import in_si, normalised
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.new_campaign import left_to_decide, new_campaign, schemas
from osl_analysis.commands.run import first_look, snakemake_arguments
from osl_analysis.commands.simulate import planned_sheet, settings_files
from osl_analysis.draft.draft_campaign import draft_campaign
from osl_analysis.draft.draft_sheet import draft_trials
from osl_analysis.draft.draft_walking import segment_of
from osl_analysis.draft.recorded_channel import name_and_ending
from osl_analysis.ingest.raw_files import read_source, recordings_in

pytestmark = pytest.mark.usefixtures("schemas_made_once")

KINDS = {
    "config": "config/config.yaml config/campaigns/*/config.yaml config/new_campaign/[ce]*.yaml",
    "simulation": "config/simulation/[!w]*.yaml config/new_campaign/simulation_*.yaml",
    "gait_laboratory": "config/simulation/walking.yaml",
    "parameters": "config/parameters/*.yaml",
    "source": "config/sources/*.yaml",
}
"""The shipped files of each schema."""


@pytest.fixture
def rec(tmp_path):
    """A folder for recordings."""
    folder = tmp_path / "rec"
    folder.mkdir()
    return folder


TIME = np.arange(2000) / 100
ANGLE = 4 * np.sin(6 * TIME)
HEAD = "time_s,angle_deg,torque_Nm"
ROWS = "\n".join([HEAD, *(f"{k / 100},{k % 7},{k % 5}" for k in range(30)), ""])


@pytest.mark.parametrize(
    ("names", "joint"),
    [
        ("HipAngle (deg),HipTorque (Nm)", "hip"),
        ("knee angle (deg),torque (N·m)", "knee"),
        ("knee angle (deg),hip torque (Nm)", ""),
    ],
)
def test_the_one_joint_that_a_recording_names_is_its_joint(tmp_path, names, joint):
    (tmp_path / "a.csv").write_text(ROWS.replace(HEAD, f"time (s),{names}"))

    new_campaign(tmp_path / "0314", recordings=tmp_path)

    config = yaml.safe_load((tmp_path / "0314/config.yaml").read_text())
    sheet = pl.read_csv(tmp_path / "0314/trials.csv")
    assert config["campaign"] == "0314", "YAML counts in eights"
    assert sheet.get_column("joint", default=pl.Series([""]))[0] == joint


@pytest.mark.parametrize(
    ("name", "experiment", "told"),
    [
        ("belt 01", "belt", {}),
        (
            "impedance_K300_B5.0_uncompensated",
            "impedance",
            {"K_d": "300", "B_d": "5.0", "controller": "uncompensated"},
        ),
        ("walk_pert_03", "walking", {"perturbed": "true"}),
        ("k9_comp_sines", "impedance", {"controller": "compensated"}),
        ("k90_b1_nocomp_1", "impedance", {"K_d": "90", "B_d": "1", "controller": "uncompensated"}),
        (
            "2026-11-21_K300_B7.5_uncomp",
            "impedance",
            {"K_d": "300", "B_d": "7.5", "controller": "uncompensated"},
        ),
        ("quasi-static 2", "torque_angle", {}),
        ("belt_motor", "ingest_only", {}),
        ("drivetrain", "transmission", {}),
        ("gait_baseline", "walking", {"perturbed": "false"}),
        ("calib", "static", {}),
        ("static 2", "ingest_only", {}),
        ("unloaded", "plate", {}),
        ("_-.motor", "actuator", {}),
        ("K100_B2_fixture", "ingest_only", {"K_d": "100", "B_d": "2"}),
    ],
)
def test_the_name_of_a_file_tells_its_trial_and_nothing_more(name, experiment, told):
    is_capture = experiment in ("static", "plate")
    ((cells, still_open),) = draft_trials([(Path(f"{name}.csv"), "csv", is_capture)], {}, {})
    assert (cells["experiment"], cells["trial"][0] in "_-.") == (experiment, False)
    assert {
        k: v for k, v in cells.items() if k in ("K_d", "B_d", "controller", "perturbed")
    } == told
    assert bool(still_open) == (experiment == "ingest_only")


def test_what_moves_tells_a_log_whose_name_tells_nothing():
    names = ("a.csv", "walk 3.csv", "belt_motor.csv")
    moved = {Path(name): "impedance" for name in names}

    told = draft_trials([(path, "s", False) for path in moved], moved, {})

    assert [cells["experiment"] for cells, _ in told] == ["impedance", "ingest_only", "ingest_only"]


def test_a_log_and_a_capture_of_one_name_are_one_trial_and_two_logs_are_two():
    files = [("a/walk_1.mcap", False), ("b/walk_1.c3d", True), ("c/walk_1.mcap", False)]
    trials = draft_trials([(Path(path), "s", is_capture) for path, is_capture in files], {}, {})
    found = [(cells["trial"], cells["log"], cells.get("mocap")) for cells, _ in trials]
    assert found == [
        ("walk_1", "a/walk_1.mcap", "b/walk_1.c3d"),
        ("walk_1_2", "c/walk_1.mcap", None),
    ]


def test_nothing_is_overwritten_and_nothing_stays_behind(tmp_path):
    for name in ("mine", "empty", "prose"):
        (tmp_path / name).mkdir()
    (tmp_path / "mine/notes.txt").write_text("mine")
    (tmp_path / "prose/a.csv").write_text("this is\nno table\nat all\n")
    before = sorted(tmp_path.rglob("*"))
    for arguments, said in (
        ((tmp_path / "mine",), "mine"),
        ((tmp_path / "new", "--from", tmp_path / "empty"), "empty"),
        ((tmp_path / "new", "--from", tmp_path / "prose"), "a.csv"),
        ((tmp_path / "new", "--from", tmp_path / "none"), "none"),
        ((tmp_path / "mine/notes.txt/new",), "notes.txt/new"),
    ):
        result = call("init", *arguments)
        assert (result.exit_code, said in result.stderr, len(result.stderr.splitlines())) == (
            1,
            True,
            1,
        )
    assert sorted(tmp_path.rglob("*")) == before


def test_an_empty_folder_becomes_a_campaign_where_one_stands(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path / "mine")

    result = call("init", ".")

    assert result.exit_code == 0, result.stderr
    made = {path.name for path in Path().iterdir()}
    assert made == {"config.yaml", "trials.csv", "sources", "schemas", "recordings"}
    assert yaml.safe_load(Path("config.yaml").read_text())["campaign"] == "mine"


def test_snakemake_is_given_the_campaign_of_the_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with refused_with("`osl-analysis init FOLDER`"):
        snakemake_arguments([])
    (tmp_path / "config.yaml").write_text("campaign: mine\n")

    given = snakemake_arguments(["-n", "--workflow-profile=none"])
    with refused_with("^profiles/slurm: there is no `sbatch`|snakemake-executor-plugin-slurm"):
        snakemake_arguments(["-n", "--workflow-profile=profiles/slurm"])
    (tmp_path / "config.yaml").write_text("campaign: x\n  more: [1\n")
    damaged = call("run")

    assert {"-n", "config.yaml", str(ROOT / "Snakefile"), "none"} <= {*given}
    assert damaged.exit_code == 1
    assert "config.yaml: line 2: " in damaged.output


@pytest.mark.parametrize("named", [["--configfile", "b.yaml"], ["--configfiles=b.yaml"]])
def test_a_named_configuration_overrides_that_of_the_campaign(tmp_path, monkeypatch, named):
    """Of several the last one holds."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config.yaml").write_text("campaign: mine\n")
    (tmp_path / "b.yaml").write_text("results: results_b\n")

    given = snakemake_arguments(["a.csv", *named, "-n"])

    assert given[:5] == ["a.csv", "-n", "--configfile", "config.yaml", "b.yaml"]


def test_a_file_of_the_campaign_goes_before_the_shipped_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert shipped("Snakefile") == ROOT / "Snakefile"
    (tmp_path / "Snakefile").write_text("mine")
    assert [shipped(one) for one in ("Snakefile", "none.yaml")] == [
        Path("Snakefile"),
        Path("none.yaml"),
    ]


def test_shipped_files_are_valid_by_schemas_that_know_their_fields():
    made = schemas()
    validators = {name: Draft202012Validator(schema) for name, schema in made.items()}
    for kind, patterns in KINDS.items():
        files = [file for pattern in patterns.split() for file in ROOT.glob(pattern)]
        assert len(files) >= len(patterns.split())
        for file in files:
            text = file.read_text()
            if file.parent.name == "new_campaign" and kind == "config":
                text = text.format(name="mine", raw_data="rec")
            content = json.loads(json.dumps(yaml.safe_load(text), default=str))
            assert [error.message for error in validators[kind].iter_errors(content)] == [], file
    assert not validators["config"].is_valid({"dynamometer": {"cutof_hz": 15}})
    assert not validators["source"].is_valid({"format": "csv", "clock": "master", "chanels": {}})


@pytest.mark.parametrize(
    ("names", "segment"),
    [
        (
            "RHEE RTOE R.Heel R.Toe.Tip R.Toe.Med R.MT5 R_FCC R_FM1 Sub:RHEE RFT1 HEEL_R"
            " Right.Foot.1 RCAL",
            "R foot",
        ),
        ("LTIB R_SK1 L.Shank.Front R_TTC R.TT RSHA RS1 RSH3 R.HF left_leg_2", "RL shank"),
        ("FOOT1 S01:HEEL Shoe3", " foot"),
        ("RMED RMMA R_TAM RMMAL R.Ankle.Medial RAM R_med_mall", "R ankle_medial"),
        ("ANKLE_MED", " ankle_medial"),
        ("LANK R_FAL RLMA L.Ankle.Lat R.Ankle RLMAL r_mall RLAT", "RL ankle_lateral"),
        ("SHANK1 TIB_M Pylon2 LEG1", " shank"),
        (
            "RASI LTHI RKNE R.Knee.Med LFHD R_FTC R.Thigh.1 L_UPPER_LEG C7 RTIO LELB REARVIEW"
            " RLFC R.MT",
            " ",
        ),
        ("PLAT1 HEXAPOD_3 Lab:Plate2", " platform"),
    ],
)
def test_the_names_of_three_marker_sets_tell_side_and_segment(names, segment):
    sides, _, expected = segment.partition(" ")
    found = {name: segment_of(name) for name in names.split()}
    assert {name: own for name, (_, own) in found.items() if own != expected} == {}
    assert {side for side, _ in found.values()} == ({*sides} or {""})


FRAMES = np.arange(240)  # at 100 Hz
WALK = np.stack([20.0 * FRAMES - 2400, 0 * FRAMES, 60 + 40 * np.sin(FRAMES / 9)], axis=1)  # [mm]
LEG = {
    "R_FCC": (-60, 0, 0),
    "R_FM1": (90, 20, 0),
    "R_FM5": (70, -30, 0),
    "R_SK1": (0, 0, 200),
    "R_SK2": (0, 40, 250),
    "R_SK3": (30, 0, 300),
}
MALLEOLI = {"R_TAM": (0, 40, 80), "R_FAL": (0, -40, 70)}
PULSES = ["Sync.1", "Voltage.Trigger"]


def capture(path, of_leg, force=0.0, platform=("PLAT1", "PLAT2", "PLAT3"), labels=PULSES):
    """A capture whose leg walks over the second of two plates, which it loads for a step."""
    tracks = {name: np.add(place, WALK) for name, place in of_leg.items()}
    for name, place in zip(platform, [(200, 200), (-200, 200), (200, -200)], strict=False):
        tracks[name] = np.add((*place, -20), 0 * WALK)
    points = np.zeros((240, len(tracks), 4))
    points[:, :, :3] = np.stack(list(tracks.values()), axis=1)
    analogs = np.zeros((480, 8))
    analogs[:, 2], analogs[::50, 6:] = -force * np.repeat(((FRAMES > 90) & (FRAMES < 160)), 2), 5.0
    corners = FACE * [1000, 1250, 1]
    named = {
        "POINT__LABELS": [*tracks],
        "ANALOG__LABELS": ["Fx", "Fy", "Fz", "Mx", "My", "Mz", *labels],
    }
    return write_c3d(
        path,
        points,
        analogs,
        **named,
        **level_plates(corners + 3000, corners),
        ANALOG__UNITS=UNITS_OF_PLATE + ["V"] * 2,
    )


def test_a_capture_without_a_trigger_has_a_source_file_of_its_own(tmp_path, rec):
    capture(rec / "walk_pert_3.c3d", LEG, force=800)
    capture(rec / "walk_unpert_6.c3d", LEG, force=800, labels=["TTL", "EMG1"])

    draft = new_campaign(tmp_path / "mine", recordings=rec)

    analogs = {
        name: yaml.safe_load(source.text)["analogs"] for name, source in draft.source_files.items()
    }
    source_of = {cells["trial"]: cells["mocap_source"] for cells, _ in draft.trials}
    assert analogs[source_of["walk_pert_3"]] == {
        name: {"channel": label, "unit": "V"}
        for name, label in zip(("sync", "trigger"), PULSES, strict=True)
    }
    assert [*analogs[source_of["walk_unpert_6"]]] == ["sync"]


def test_the_leg_that_steps_on_the_platform_is_asked_where_both_have_markers(rec):
    left = {f"L{name[1:]}": place for name, place in LEG.items()}
    capture(rec / "walk_pert_2.c3d", {**LEG, **left}, force=800)

    draft = draft_campaign(rec)

    assert "side: right" in draft.walking
    assert '"L_FCC"' not in draft.walking
    assert "`walking.side`: " in draft.open[0][0]


def test_what_captures_of_walking_do_not_tell_is_to_be_edited(tmp_path, rec):
    markers = {"RHEE": (0, 0, 0), "LTIB": (0, 0, 200)}
    capture(rec / "a.c3d", markers, force=800, platform=("PL", "PLAT1"))

    draft = new_campaign(tmp_path / "mine", recordings=rec)

    assert 'foot: ["RHEE", UNKNOWN]' in draft.walking
    assert yaml.safe_load(draft.walking) is None, "a part of a section would be refused"
    read_config(tmp_path / "mine/config.yaml")
    ((cells, question),) = draft.trials
    assert cells["experiment"] == "ingest_only"
    assert question


UNITS_IN_NAMES = {
    "Nm": "torque_Nm torqueNm torque_N_m TORQUE_NM torque_m_Nm",
    "N*cm": "torque_Ncm torque_N_cm torque_N-cm torqueNcm",
    "N*mm": "torque_Nmm torque_mNm",
    "kN*m": "torque_kNm",
    "lbf*in": "torque_inlb torque_in_lb torque_lbfin",
    "lbf*ft": "torque_lbf_ft torque_lbfft torque_lbft torque_ftlb torque_ft-lbs MomentLbfFt",
    "ozf*in": "torque_ozin torque_oz_in",
    "deg": "a_deg aDeg a_degrees a_m_deg",
    "rad": "a_rad",
    "rev": "a_rev",
    "deg/s": "w_deg_s w_dps w_deg_per_s",
    "s": "t_s t_sec",
    "ms": "t_ms tMs",
    "A": "i_A",
    "V": "u_V",
    "N*m/rad": "K_Nm_rad",
}


def test_the_end_of_a_name_states_its_unit_in_any_spelling():
    for unit, names in UNITS_IN_NAMES.items():
        for name in names.split():
            assert in_si(normalised(name_and_ending(name)[1])) == in_si(normalised(unit)), name
    for name in [
        "theta_m",
        "mSec",
        "phaseA",
        "currentmA",
        "torquemNm",
        "torque_raw",
        "position",
        "deg",
    ]:
        assert name_and_ending(name) == (name, "")


@pytest.mark.parametrize("name", ["torque", "torque_raw"])
def test_a_unit_that_nothing_but_the_size_of_readings_tells_is_to_be_stated(tmp_path, rec, name):
    write_text(rec / "a.csv", {"time_s": TIME, "ankle_angle_deg": ANGLE, name: 2 * ANGLE})
    draft = new_campaign(tmp_path / "mine", recordings=rec)
    assert yaml.safe_load(draft.source_files["csv"].text)["channels"]["torque"]["unit"] == "UNKNOWN"
    assert "`channels.torque.unit`" in left_to_decide(tmp_path / "mine", draft)[0][0]


def triangle(turns):
    return 1 - 2 * np.abs(2 * (turns % 1) - 1)


@pytest.mark.parametrize(
    ("wave", "frequency_hz", "experiment"),
    [
        (triangle, 0.1, "torque_angle"),
        (lambda turns: np.sin(2 * np.pi * turns), 0.1, "torque_angle"),
        (triangle, 0.3, "impedance"),
        # quick strokes with rests, as of a hand
        (lambda turns: np.clip(6 * triangle(turns), -1, 1), 0.2, "impedance"),
    ],
)
def test_a_slow_triangle_or_sine_of_counts_is_torque_over_angle(
    tmp_path, wave, frequency_hz, experiment
):
    time = np.arange(4000) / 100
    angle = wave(frequency_hz * time)
    counts = np.rint(100 * angle) % 4096
    columns = {"time_s": time, "encoder [counts]": counts, "torque_Nm": 2 * angle}
    write_text(tmp_path / "a.csv", columns)

    draft = draft_campaign(tmp_path)

    assert [trial.cells["experiment"] for trial in draft.trials] == [experiment]
    assert "wraps_at: 4096.0" in draft.source_files["csv"].text


def test_a_recording_without_an_ending_is_found_by_its_first_bytes(tmp_path):
    lines = "".join(f'{{"time": {k / 100}, "angle_deg": {k % 7}}}\n' for k in range(30))
    console = "boot\n".join([*"12345", ""]) + ROWS  # of a serial line
    read = {"recording": ROWS, "a.log": ROWS, "c.log": console, "a.json": lines}
    others = {
        "README": "12 rows\n" * 30,
        "b.log": "2024-05-01 12:00:00 started\n" * 30,
        "b.json": '{"rate": 500}',
    }
    for name, content in (read | others).items():
        (tmp_path / name).write_text(content)
    assert {path.name for path in recordings_in(tmp_path)} == {*read}


# The end of `init`.


def write_bench(path):
    """A joint, moved by sines one after the other."""
    names = {"time": "time_s", "theta": "ankle_angle_rad", "torque": "torque_Nm"}
    write_text(path, {names[name]: values for name, values in RECORDINGS["impedance"].items()})


def test_a_dry_run_names_the_one_source_file_of_two_that_is_to_be_edited(
    tmp_path, rec, monkeypatch
):
    write_bench(rec / "impedance_K150.csv")
    text = (rec / "impedance_K150.csv").read_text()
    (rec / "b.csv").write_text(text.replace("torque_Nm", "torque"))
    new_campaign(tmp_path / "mine", recordings=rec)
    monkeypatch.chdir(tmp_path / "mine")

    (problem,) = first_look()

    assert re.search(r"sources/csv\.yaml: .* \d+: `channels\.torque\.unit`", problem)


def test_all_that_a_draft_of_a_configuration_leaves_open_is_named_at_once(tmp_path):
    draft = "walking:\n  side: UNKNOWN\n  plate: UNKNOWN\n  markers: {foot: [A, UNKNOWN]}\n"
    (tmp_path / "config.yaml").write_text(draft)

    with refused_with(r"2: `walking\.side`, .*3: `walking\.plate`, .*4: `walking\.markers\.foot`"):
        read_config(tmp_path / "config.yaml")


def test_a_log_and_a_capture_whose_clocks_are_not_aligned_are_a_question(tmp_path, rec):
    capture(rec / "walk_pert_1.c3d", {**LEG, **MALLEOLI}, force=800)
    write_bench(rec / "walk_pert_1.csv")

    result = call("init", tmp_path / "mine", "--from", rec)

    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert any("`clock`" in line for line in lines)
    assert "osl-analysis run -n" in lines[-1]


def drafted_of(tmp_path):
    """The draft of the recordings in `rec`, its questions, and whether it ends with `run`."""
    folder = tmp_path / "mine"
    draft = new_campaign(folder, recordings=tmp_path / "rec")
    return left_to_decide(folder, draft)


def test_a_laboratory_with_names_of_its_own_is_drafted_without_a_question(tmp_path, rec):
    """Subjects before the names of markers, `noload`, `nom`, and the leg's log beside captures."""
    leg = {f"P07:{name}": place for name, place in {**LEG, **MALLEOLI}.items()}
    platform = [f"hexapod:PLAT{k}" for k in range(3)]
    capture(rec / "static_01.c3d", leg, platform=platform)
    capture(rec / "hex_noload01_fwd.c3d", {}, platform=platform)
    crossings = ["hex_trip02_pert_fwd", "hex_trip06_pert_fwd"]
    crossings += [f"hex_trip{k}_nom_rev" for k in (3, 4, 5)]
    rows = np.arange(400)
    for number, name in enumerate(crossings):
        capture(rec / f"{name}.c3d", leg, force=800 + number, platform=platform)
        turn = 0.2 * np.sin(rows / 40) + 0.01 * number
        columns = {"loop_time": rows / 400, "ankle.output_position": turn}
        write_text(rec / f"{name}.csv", {**columns, "sync_in": rows // 30 % 2})

    questions, is_ready = drafted_of(tmp_path)

    assert questions == []
    assert is_ready
    sheet = pl.read_csv(tmp_path / "mine/trials.csv")
    assert dict(sheet.select("trial", "experiment").iter_rows()) == {
        "hex_noload01_fwd": "plate",
        "static_01": "static",
        **dict.fromkeys(crossings, "walking"),
    }
    assert yaml.safe_load((tmp_path / "mine/config.yaml").read_text())["walking"] == {
        "markers": {
            "foot": ["R_FCC", "R_FM1", "R_FM5"],
            "shank": ["R_SK1", "R_SK2", "R_SK3"],
            "platform": ["PLAT0", "PLAT1", "PLAT2"],
            "ankle_medial": "R_TAM",
            "ankle_lateral": "R_FAL",
        },
        "side": "right",
        "plate": 2,
    }
    log = yaml.safe_load((tmp_path / "mine/sources/csv.yaml").read_text())
    assert log["clock"] == "sync"
    assert log["channels"]["theta"] == {"column": "ankle.output_position", "unit": "rad"}
    for path in (tmp_path / "mine/sources").glob("*.yaml"):
        read_source(path)


def test_rotations_without_markers_are_a_question_before_a_run(tmp_path, rec):
    analogs = np.ones((80, 6))
    write_c3d(
        rec / "static_1.c3d",
        np.zeros((80, 0, 4)),
        analogs,
        ROTATION__USED=3,
    )

    questions, is_ready = drafted_of(tmp_path)

    assert re.search("marker.*static_1", questions[0])
    assert not is_ready


def test_a_file_without_a_signal_is_left_out_with_a_sentence(tmp_path, rec):
    write_bench(rec / "impedance_K150_B3.csv")
    write_text(rec / "clock.csv", {"time_s": np.arange(500) / 250})

    draft = draft_campaign(rec)

    assert [trial.cells["log"] for trial in draft.trials] == ["impedance_K150_B3.csv"]
    (refused,) = draft.refused
    assert re.search(rf"^{tmp_path}/rec/clock\.csv: .*`osl-analysis inspect`", refused)


def test_a_fixture_alone_is_a_calibration_and_tells_no_sign_of_torque(tmp_path):
    """Of its inertia alone, which comes first by its name, the torque falls as the angle rises."""
    torque = {"fixture": -0.005 * ANGLE, "impedance_K80": 1.4 * ANGLE}
    for name, values in torque.items():
        columns = {"time [s]": TIME, "joint angle [deg]": ANGLE, "torque [Nm]": values}
        write_text(tmp_path / f"{name}.csv", columns)

    draft = draft_campaign(tmp_path)

    cells = {trial.cells["trial"]: trial.cells for trial in draft.trials}
    assert cells["fixture"]["experiment"] == "calibration"
    assert cells["fixture"]["fixture"] == "alone"
    assert "sign: -1" not in draft.source_files["csv"].text


def test_an_example_without_the_simulator_s_libraries_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)

    with refused_with("-m pip install numba$"):
        new_campaign(tmp_path / "demo", example="bench")

    assert not (tmp_path / "demo").exists()


def test_the_example_of_a_walkway_simulates_all_that_its_analysis_needs(tmp_path, monkeypatch):
    new_campaign(tmp_path / "walkway", example="walking")
    monkeypatch.chdir(tmp_path / "walkway")

    settings_files(Path("simulation.yaml"))  # refuses what is inconsistent
    sheet = planned_sheet(Path("simulation.yaml"), Path("recordings/trials.csv"))

    planned = [row["experiment"] for row in sheet.values()]
    assert {name: planned.count(name) for name in set(planned)} == {
        "static": 1,
        "plate": 3,
        "walking": 24,
    }


def test_a_recorded_theta_m_asks_for_n_t_alone(tmp_path, rec):
    columns = {"time_s": TIME, "ankle_angle_deg": ANGLE, "torque_Nm": 2 * ANGLE}
    write_text(rec / "a.csv", {**columns, "motor_angle_deg": 4.6 * ANGLE})

    questions, is_ready = drafted_of(tmp_path)

    assert is_ready
    assert any("n_T" in question for question in questions)


def test_a_controller_that_no_name_tells_is_asked():
    files = [(Path(f"{name}.csv"), "csv", False) for name in ("k90_b1", "k60_comp")]
    trials = draft_trials(files, {}, {})

    assert ["controller" in question for _, question in trials] == [True, False]
