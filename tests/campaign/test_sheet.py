# SPDX-License-Identifier: Apache-2.0
"""The sample sheet: what is valid is typed, what is not is named by line and column; the planned
sheet."""

import itertools
from collections import Counter
from pathlib import Path

import pytest
import yaml
from conftest import ROOT, refused_with

from osl_analysis.base.errors import UnreachableImpedanceError
from osl_analysis.base.yaml_settings import read_yaml
from osl_analysis.campaign.campaign_trials import check_campaign, open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.campaign.result_files import ResultFiles
from osl_analysis.commands.simulate import (
    planned_sheet,
    settings_files,
    simulate_planned_trial,
    write_sheet,
)
from osl_analysis.config.sheet import read_sheet
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.simulator.simulation_settings import SimulationSettings
from osl_analysis.simulator.trial_plan import plan_trials

HEADER = "trial,experiment,controller,K_d,B_d,perturbed,log,log_source,mocap,mocap_source,exclude\n"
BELT = "b,belt,,,,,b.mcap,dynamometer,,,"


def sheet(tmp_path, text):
    path = tmp_path / "trials.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_valid_sheet_is_typed_and_blanks_and_comments_say_nothing(tmp_path, mark):
    """A trial of experiment `belt ` was once dropped, and `uncompensated ` taken for
    compensated."""
    rows = (
        " # a comment, with a comma\n\n b , belt\t,,,,, b.mcap ,dynamometer\u00a0,,,#3 glitt weg:"
        " Fuß,,\nk,impedance,uncompensated ,300 , 5,,k.mcap,dynamometer,,,\u200b\nw,walking,,,,"
        " True ,,,w.c3d,vicon,\n"
    )
    rows += (
        "".join(f"{name},belt,,,,,b#2.mcap,dynamometer,,,\n" for name in ("NA", "null", "nan"))
        + ",,,,\n"
    )
    table = read_sheet(
        sheet(tmp_path, mark + "# mine\n" + HEADER.replace("log_source", " log_source ") + rows)
    )
    assert list(table) == ["b", "k", "w", "NA", "null", "nan"]
    given = [table["b"][name] for name in ("experiment", "log", "log_source", "exclude", "side")]
    assert given == ["belt", "b.mcap", "dynamometer", "#3 glitt weg: Fuß", None]
    assert [table["k"][name] for name in ("controller", "K_d", "B_d", "exclude")] == [
        "uncompensated",
        300,
        5,
        None,
    ]
    assert [(row["perturbed"], row["log"]) for row in table.values()][2:4] == [
        (True, None),
        (None, "b#2.mcap"),
    ]


IMPEDANCE_LOG = "k,impedance,{},,k.mcap,dynamometer,,,"


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("b1,blet,,,,,b.mcap,dynamometer,,,", "experiment:.*;.*'belt'"),
        ("../b1,belt,,,,,b.mcap,dynamometer,,,", "trial: '../b1'"),
        (IMPEDANCE_LOG.format("compensated,3,-5"), "B_d: '-5'"),
        (IMPEDANCE_LOG.format("Compensated,300,5"), "controller:.*;.*'compensated'"),
        ("b,belt,,,,,,,,,", "log: .*mocap"),
        ("b,belt,,,,maybe,b.mcap,leg,,,", "perturbed: 'maybe'"),
        ("w,walking,,,,,,,w.c3d,vicon,", "perturbed: .* walking"),
        ("w,static,,,,,,,w.c3d,,", "mocap: .*mocap_source"),
        (f"{BELT}No", "exclude: 'No' "),
        ("b,belt,,,,,b\u00a01.mcap,leg,,,", r"log: .*b\\xa01.mcap"),
        (f"{BELT}slipped, again", ""),
        ('b,belt,,,,,"b.mcap,dynamometer,,,\n', ""),
    ],
)
def test_a_wrong_cell_is_named_with_line_and_remedy(tmp_path, line, told):
    with refused_with(rf"trials.csv: line 2: {told}"):
        read_sheet(sheet(tmp_path, HEADER + line + "\n"))


@pytest.mark.parametrize(
    ("experiment", "column", "cell"),
    [
        ("static", "joint", "knee"),
        ("belt", "joint", "Ankle"),
        ("belt", "side", "both"),
        ("static", "windows", "2-30"),
        ("belt", "fixture_inertia", "-1"),
        ("actuator", "fixture_weight", "1"),
        ("belt", "fixture_rest_deg", "9"),
        ("belt", "direction", "up"),
        ("belt", "group", "a$"),
        ("belt", "static", "x"),
        ("belt", "tiral", "x"),
    ],
)
def test_a_cell_that_its_trial_cannot_have_is_named(tmp_path, experiment, column, cell):
    text = f"trial,experiment,log,log_source,{column}\na,{experiment},a,s,{cell}\n"
    with refused_with(rf"trials.csv: line 2: {column}:"):
        read_sheet(sheet(tmp_path, text))


def test_a_weight_of_zero_is_filled_in_beside_the_angle_at_which_it_hangs(tmp_path):
    text = "trial,experiment,log,log_source,fixture_weight,fixture_rest_deg\na,belt,a,s,0,9\n"

    assert read_sheet(sheet(tmp_path, text))["a"]["fixture_weight"] == 0.0


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("a,belt,h\u00fcfte,,a,s\nb,belt,Hu\u0308fte,,b,s\n", "'Hu.fte'.*'h.fte'"),
        ("b,belt,,,a,s\nb,belt,,,b,s\n", "trial 'b'"),
        ("b,belt,,,a,s\nB,belt,,,b,s\n", "trial 'B'.*'b'"),
        ('b,"belt",,,a,s\nc,calibration,,,a,s\n', "calibration.*known_K.*known_percent"),
    ],
)
def test_a_row_that_does_not_fit_the_others_is_named(tmp_path, rows, told):
    with refused_with(rf"trials.csv: line 3:.*{told}"):
        read_sheet(sheet(tmp_path, "trial,experiment,joint,side,log,log_source\n" + rows))


def test_a_cell_of_several_lines_counts_as_such(tmp_path):
    text = f'{HEADER}{BELT}"slipped\nand again"\nb2,belts,,,,,b.mcap,dynamometer,,,\n'
    with refused_with("line 4: experiment: 'belts'"):
        read_sheet(sheet(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "trials.csv: .*CSV UTF-8"),
        (HEADER, "trials.csv: .*CSV UTF-8"),
        ("trial,experiment,log,log\nb,belt,a,b\n", "trials.csv: "),
        ("trial\texperiment\na\tbelt\n", "'CSV UTF-8'"),
        (b"PK\x03\x04xl/\0\0", "trials.csv: .*CSV UTF-8"),
    ],
)
def test_a_wrong_sheet_is_refused_with_what_to_do(tmp_path, text, message):
    with refused_with(message):
        read_sheet(sheet(tmp_path, text))
    with refused_with(r"other.csv: "):
        read_sheet(tmp_path / "other.csv")


def test_a_sheet_that_Excel_saved_in_german_is_that_of_another_language(tmp_path):
    english = (
        "# a comment, of two parts\n"
        "trial,experiment,K_d,B_d,windows,log,log_source,controller\n"
        'a,impedance,300,2.5,"2-30.5 40-62","a,1.csv",s,"PD, new"\n'
    )
    of_english = read_sheet(sheet(tmp_path, english))

    german = (
        "# a comment, of two parts\n"
        "trial;experiment;K_d;B_d;windows;log;log_source;controller\n"
        "a;impedance;300;2,5;2-30,5 40-62;a,1.csv;s;PD, new\n;;;;;;;\n"
    )
    assert read_sheet(sheet(tmp_path, german.encode("utf-8-sig"))) == of_english


def test_joint_controller_desired_impedance_and_conditions_are_free(tmp_path):
    """Any name or none; each of K_d and B_d alone, or neither. A trial without a joint is one of
    the ankle."""
    rows = (
        "a,impedance,PD $x_1$ 50 %,300,,a.csv,bench_csv,knee,left,\n"
        "b,impedance,,,2,b.csv,bench_csv,éxo \\alpha,,slow walk\n"
        "d,impedance,,,,d.csv,bench_csv,kneeL,,\n"
        f"{'c' * 100},belt,,,,c.csv,bench_csv,,right,{'g' * 40}\n"
    )
    table = read_sheet(
        sheet(
            tmp_path, "trial,experiment,controller,K_d,B_d,log,log_source,joint,side,group\n" + rows
        )
    )
    columns = ("joint", "controller", "K_d", "B_d", "side", "group")
    assert [tuple(row[name] for name in columns) for row in table.values()] == [
        ("knee", "PD $x_1$ 50 %", 300, None, "left", None),
        ("éxo \\alpha", None, None, 2, None, "slow walk"),
        ("kneeL", None, None, None, None, None),
        ("ankle", None, None, None, "right", "g" * 40),
    ]


PLACED_TRIALS = """trial,experiment,mocap,mocap_source,perturbed,side,subject,static
l,static,l.c3d,vicon,,left,a,
r,static,r.c3d,vicon,,right,b,
p,plate,p.c3d,vicon,,,,r
w,walking,w.c3d,vicon,true,,a,
v,walking,v.c3d,vicon,false,,b,
"""


UNPERTURBED = "".join(f"u{k},walking,u{k}.c3d,vicon,false,,b,\n" for k in range(2))
ENOUGH = PLACED_TRIALS + UNPERTURBED + "x,walking,x.c3d,vicon,true,,b,\n"
CONFIG = read_config(ROOT / "config/config.yaml")


def opened(tmp_path, text=ENOUGH, rows=None, **settings):
    """The campaign of a sheet, with other rows by trial, and other settings."""
    sheet_rows = read_sheet(sheet(tmp_path, text)) | (rows or {})
    return open_campaign(CONFIG.model_copy(update=settings), sheet_rows)


def cells(tmp_path, trial, **changes):
    """The row of a trial of the sheet with enough crossings, with other cells."""
    return {trial: read_sheet(sheet(tmp_path, ENOUGH))[trial] | changes}


def test_an_excluded_crossing_need_not_be_complete(tmp_path):
    rows = read_sheet(sheet(tmp_path, HEADER + "w,walking,,,,,w.mcap,leg,,,he fell\n"))

    assert rows["w"]["mocap"] is None


def test_a_crossing_and_a_plate_trial_have_the_side_of_their_static_trial(tmp_path):
    of_crossing = PLACED_TRIALS.replace("right,b", ",b").replace("false,,b", "false,right,b")
    campaign = opened(tmp_path, of_crossing)

    sides = {"l": "left", "r": "right", "p": "right", "w": "left", "v": "right"}
    places = {trial: {"joint": "ankle", "side": side} for trial, side in sides.items()}
    assert campaign.places == places
    assert campaign.sides() == {"l": "left", "r": "right"}


def test_a_trial_has_the_files_that_its_row_names(tmp_path):
    campaign = opened(tmp_path, PLACED_TRIALS)

    assert campaign.sources("w") == [CONFIG.sources / "vicon.yaml"]
    assert campaign.logs("w") == [CONFIG.raw_data / "w.c3d"]
    assert ResultFiles(campaign).rows("walking") == ["results/fits/walking/w.csv"]
    assert campaign.recording("w").items() <= campaign.rows["w"].items()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PLACED_TRIALS, "walking.*3.*unperturbed.*,.*1;"),
        (PLACED_TRIALS + UNPERTURBED, "walking.*2.*perturbed"),
    ],
)
def test_walking_needs_several_crossings_of_either_kind(tmp_path, text, message):
    check_campaign(opened(tmp_path))
    with refused_with(message):
        check_campaign(opened(tmp_path, text))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"speed": "fast"}, r"trials\.csv: trial \w: .*speed"),
        ({"accept": "gap gaps"}, "trial 'x': accept: 'gaps'.*rate, gap"),
    ],
)
def test_a_condition_of_one_crossing_and_an_unknown_check_are_refused(tmp_path, changes, told):
    with refused_with(told):
        check_campaign(opened(tmp_path, rows=cells(tmp_path, "x", **changes)))


def two_of_one_log(tmp_path, **second):
    """Impedance trials `k`, of windows of a log, and `j`, of the same log."""
    trials = {"k": {"windows": "1-4 6-9"}, "j": {"windows": "4-6"} | second}
    of_bench = {}
    for name, changes in trials.items():
        empty = dict.fromkeys(cells(tmp_path, "x")["x"])
        of_bench[name] = (
            empty
            | {"experiment": "impedance", "log": "k.csv", "log_source": "s", "mocap": None}
            | changes
        )
    return of_bench


@pytest.mark.parametrize("second", [{}, {"windows": None, "log_part": "b"}])
def test_two_trials_of_one_log_have_parts_or_windows_of_their_own(tmp_path, second):
    check_campaign(opened(tmp_path, rows=two_of_one_log(tmp_path, **second)))


@pytest.mark.parametrize("windows", ["4-6.1", "0-99", None])
def test_two_trials_of_the_same_samples_are_refused(tmp_path, windows):
    with refused_with("trial 'j': trial 'k'.*part.*log 'k.csv'"):
        check_campaign(opened(tmp_path, rows=two_of_one_log(tmp_path, windows=windows)))


def test_a_copy_of_a_log_is_no_second_trial_of_its_experiment(tmp_path):
    copy = {"log": "j.csv", "windows": "1-4 6-9"}
    recorded = {"simulation": None, "raw_data": tmp_path}
    (tmp_path / "j.csv").write_bytes(b"1 2 3")
    (tmp_path / "k.csv").write_bytes(b"1 2 4")
    campaign = opened(tmp_path, rows=two_of_one_log(tmp_path, **copy), **recorded)
    check_campaign(campaign)
    row = b"1 2 3\n"
    (tmp_path / "j.csv").write_bytes(row * 6000)
    (tmp_path / "k.csv").write_bytes(row * 3000 + b"1 2 4\n" + row * 2999)
    check_campaign(campaign)

    (tmp_path / "k.csv").write_bytes(row * 6000)

    with refused_with("trial 'j':.*j.csv.*k.csv,"):
        check_campaign(campaign)
    belt = two_of_one_log(tmp_path, **copy, experiment="belt")
    check_campaign(opened(tmp_path, rows=belt, **recorded))


def test_a_copy_of_a_capture_is_no_second_crossing(tmp_path):
    for name in ("u0", "u1"):
        (tmp_path / f"{name}.c3d").write_bytes(b"1 2 3")

    with refused_with("trial 'u1':.*u1.c3d.*u0.c3d,"):
        check_campaign(opened(tmp_path, simulation=None, raw_data=tmp_path))


def test_excluded_trials_have_their_reason_and_some_trial_must_be_left(tmp_path):
    fell = cells(tmp_path, "w", exclude="he fell")
    every = {trial: cells(tmp_path, trial, exclude="he fell")[trial] for trial in "lrpwvx"}
    every |= {trial: cells(tmp_path, trial, exclude="he fell")[trial] for trial in ("u0", "u1")}

    assert "w" not in opened(tmp_path, rows=fell).rows
    with refused_with("trials.csv:.*trial.*`exclude`"):
        opened(tmp_path, rows=every)


DEFAULT = ROOT / "config" / "simulation" / "default.yaml"


def settings_with(tmp_path, place, value):
    """The tiny settings with a value set at a dotted place, as a file."""
    content = inner = yaml.safe_load((ROOT / "tests" / "tiny_simulation.yaml").read_text())
    *parents, last = place.split(".")
    for parent in parents:
        inner = inner.setdefault(parent, {})
    inner[last] = value
    path = tmp_path / "settings.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_the_default_campaign_is_that_of_the_paper():
    rows = plan_trials(read_yaml(DEFAULT, SimulationSettings)).values()

    assert Counter(row["experiment"] for row in rows) == {
        "belt": 10,
        "transmission": 5,
        "actuator": 3,
        "impedance": 32,
        "static": 1,
        "plate": 6,
        "walking": 60,
    }
    conditions = itertools.product(CONTROLLERS, (100, 200, 300, 400), (0, 2.5, 5, 7.5))
    planned = {(row["controller"], row["K_d"], row["B_d"]) for row in rows if row["K_d"]}
    assert planned == {*conditions}
    # 30 +- 2.6 SD of a fair coin
    assert 20 <= sum(bool(row["perturbed"]) for row in rows) <= 40


def test_the_written_sheet_is_the_plan(
    tmp_path,
):
    settings = read_yaml(DEFAULT, SimulationSettings)
    write_sheet(DEFAULT, tmp_path / "trials.csv")
    plan = plan_trials(settings)
    assert read_sheet(tmp_path / "trials.csv") == plan


TONE = {"frequency_hz": 200, "size": 1}
NOISE = {"name": "a", "kind": "noise", "rms_deg": 2}


@pytest.mark.parametrize(
    ("place", "value", "match"),
    [
        ("effects.load_cell_noise.unit", "mN*m", r"effects.load_cell_noise.*unit.*'N\*m'"),
        ("effects.control_delay.size", 1.5, "effects.control_delay.*1.5"),
        ("drivetrain.control_updates", 3, "drivetrain.*control_updates.*substeps"),
        ("protocol.cycles", [2, 3, 4], "frequencies"),
        (
            "excitations",
            [{"name": "x", "kind": "noise", "rms_deg": 1, "band_hz": [6, 2]}],
            "2.0.*6.0",
        ),
        (
            "actuator",
            {"duration_s": 3, "fade_s": 1, "velocity": [TONE], "current": [TONE]},
            "fade_s",
        ),
        ("experiments.walking", 3, "'walking'.*settings"),
        ("dynamometer.rate_hz", 1, r"dynamometer\.rate_hz: 1 Hz"),
        ("excitations", [NOISE | {"rms_deg": 120}], "excitations.0.rms_deg: 120.*60"),
    ],
)
def test_a_wrong_setting_is_named_with_its_place(tmp_path, place, value, match):
    path = settings_with(tmp_path, place, value)
    with refused_with(f"^{path}: .*{match}"):
        read_yaml(path, SimulationSettings)


def test_an_unstable_loop_or_a_missing_file_writes_nothing(tmp_path, in_root):
    """20 ms of delay: an actuator that turned by 1e18 rad was logged."""
    path = settings_with(tmp_path, "effects.control_delay.size", 100)
    with refused_with(r"100 rad.*effects\.control_delay"):
        simulate_planned_trial(path, tmp_path / "raw", "impedance_K300_B5.0_compensated")
    assert not (tmp_path / "raw").exists()
    with pytest.raises(
        UnreachableImpedanceError,
        match=r"experiments: K_d = 3000 N\*m/rad",
    ):
        settings_files(settings_with(tmp_path, "experiments.K_d", [300, 3000]))
    with refused_with(r"simulation: no\.yaml: "):
        planned_sheet(Path("no.yaml"), tmp_path / "raw/trials.csv")
    # of the gait laboratory, for a trial of the bench
    missing = settings_with(tmp_path, "walking", "none.yaml")
    with refused_with(r"walking: none\.yaml .*null"):
        simulate_planned_trial(missing, tmp_path / "raw", "belt_01")
