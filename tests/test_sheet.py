"""The sample sheet: what is valid is typed, what is not is named by line and column; the planned
sheet."""

import itertools
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from conftest import ROOT

from osl_analysis.campaign.campaign_checks import check_campaign
from osl_analysis.campaign.campaign_trials import Campaign, open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.simulate import (
    planned_sheet,
    settings_files,
    simulate_trial,
    write_sheet,
)
from osl_analysis.config.sheet import read_sheet
from osl_analysis.errors import InputError, UnreachableImpedanceError
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.simulator.simulation_settings import SimulationSettings
from osl_analysis.simulator.trial_plan import plan_trials
from osl_analysis.yaml_settings import read_yaml

HEADER = "trial,experiment,controller,K_d,B_d,perturbed,log,log_source,mocap,mocap_source,exclude\n"
PLACED, BELT = "trial,experiment,joint,side,log,log_source\n", "b,belt,,,,,b.mcap,dynamometer,,,"


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


@pytest.mark.parametrize(("line", "message"), [
    ("b1,blet,,,,,b.mcap,dynamometer,,,", "experiment 'blet' is none of .*; did you mean 'belt'"),
    ("../b1,belt,,,,,b.mcap,dynamometer,,,", r"line 2: trial '\.\./b1' must be up to 100 letters"),
    ("k,impedance,compensated,3,-5,,k.mcap,dynamometer,,,",
     "K_d = 3, B_d = -5 is not the impedance of a joint"),
    ("b,belt,,,,,,,,,", "names no file; fill in"),
    ("b,belt,,,,yes,b.mcap,leg,,,", "'yes' must be true or false"),
    ("b1,belt,,,,,b.mcap,s.yaml,,,",
     "log_source 's.yaml' names a file; write its name without the ending"),
    ("k,impedance,compensated,1_0,5,,k.mcap,dynamometer,,,", "K_d '1_0' is not a number"),
    ("w,walking,,,,,,,w.c3d,vicon,", "perturbed is empty"),
    ("w,static,,,,,,,w.c3d,,", "mocap_source is empty"),
    ("k,impedance,Compensated,300,5,,k.mcap,dynamometer,,,",
     "'Compensated' differs from 'compensated' by"),
    (f"{BELT}\nb ,belt,,,,,b.mcap,dynamometer,,,",
     "line 3: trial 'b' stands twice, first in line 2"),
    (f"{BELT}\nB,belt,,,,,b2.mcap,leg,,,",
     "line 3: trial 'B' stands twice, .* differs by more than capitals"),
    (f"{BELT}No", "exclude 'No' is no reason; clear the cell"),
    ("k,impedance,,9,10000.0,,k.mcap,leg,,,", "K_d = 9, B_d = 10000.0 is not the"),
    ("b,belt,,,,,b\u00a01.mcap,leg,,,",
     r"line 2: column 'log': .* U\+00A0 \(NO-BREAK SPACE\); type"),
    (f"{BELT}slipped, again", "line 2: 12 cells, the header has 11; quote a cell"),
    ('b,belt,,,,,"b.mcap,dynamometer,,,\n', "line 2: not CSV"),
    (f'{BELT}"slipped\nand again"\nb2,belts,,,,,b.mcap,dynamometer,,,',
     "line 4: experiment 'belts'"),
])  # fmt: skip
def test_a_wrong_cell_is_named_with_line_and_remedy(tmp_path, line, message):
    with pytest.raises(InputError, match=f"trials.csv: .*{message}"):
        read_sheet(sheet(tmp_path, HEADER + line + "\n"))


@pytest.mark.parametrize(("text", "message"), [
    (f"{PLACED}a,belt,h\u00fcfte,,a,s\nb,belt,Hu\u0308fte,,b,s\n",
     "line 3: joint 'Hu.fte' differs from 'h.fte' by ca"),
    (f"{PLACED}a,belt,knee,,a,s\nb,belt,Knee,,b,s\n",
     "line 3: joint 'Knee' differs from 'knee' by capitals or ac"),
    (f"{PLACED}a,belt,Ankle,,a,s\n",
     "line 2: joint 'Ankle' differs from 'ankle' by capitals or accents alone"),
    (f"{PLACED}a,static,knee,,a,s\n",
     "joint 'knee' of experiment 'static': the walkway measures the ankle; leave"),
    (f"{PLACED}a,belt,knee,both,a,s\n", "side 'both' must be left or right"),
    *((f"trial,experiment,log,log_source,{name}\na,{kind},a,s,{cell}\n", said) for name, kind, cell,
    said in (
        ("windows", "static", "2-30", "it is for 'belt' or 'transmission' or "),
        ("windows", "impedance", "2-", "are not from-to"),
        ("known_K", "calibration", "9", "needs known_K .* and known_percent"),
        ("fixture_inertia", "belt", "-1", "fixture_inertia '-1' is below 0"),
        ("fixture_weight", "actuator", "1", "turns no joint under a load cell"),
        ("fixture_rest_deg", "belt", "9", "fixture_rest_deg without fixture_weight"),
        ("body_mass_kg", "belt", "0", "must be above 0"),
        ("direction", "belt", "left", "be up or down"),
        ("group", "belt", "a$", "it names a group"),
        ("session", "belt", "a" * 41, "must be up to 40 letters"))),
    ("trial,experiment,log_part,mocap,mocap_source\nb,static,x,a,s\n",
     "log_part 'x' without a log"),
    ("trial,experiment,log,direction\nb,belt,b.mcap,up\n",
     "direction 'up' of a trial that is not perturbed"),
    ("", "not a CSV table"), (HEADER, "no trials"),
    ("trial,log\nb,b.mcap\n", "no column 'experiment'"),
    ("trial,experiment,log,log\nb,belt,a,b\n", "line 1: column 'log' stands twice"),
    ("trial,experiment,log,log_source,joint\na,belt,a.csv,b,ankel\n",
     "joint 'ankel' is no.* did you mean 'ankle'"),
    ("trial,experiment,log,log_source,static\na,belt,a.csv,b,x\n",
     "static 'x' of experiment 'belt'; it is for 'sta"),
    ("trial,experimnt,log\n", "unknown column 'experimnt'; .*; did you mean 'experiment'"),
    ("trial;experiment\na;belt\n", "its cells are separated by ';'; save the sheet with commas"),
    (f"{HEADER}{BELT}Fuß\n".encode("latin-1"),
     "line 2: byte 0xdf is not UTF-8; save the sheet as 'CSV UTF-8'"),
    (HEADER.encode("utf-16-le"), "its header holds zero bytes, it is not UTF-8; save the sheet as"),
    (b"PK\x03\x04xl/\0\0",
     "a workbook, or another binary table, which no sheet is; save it as 'CSV UTF-8'"),
])  # fmt: skip
def test_a_wrong_sheet_is_refused_with_what_to_do(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_sheet(sheet(tmp_path, text))
    with pytest.raises(InputError, match="no such sample sheet"):
        read_sheet(tmp_path / "other.csv")


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


def test_a_crossing_and_a_plate_trial_have_the_side_of_their_static_trial(tmp_path):
    campaign = opened(tmp_path, PLACED_TRIALS)

    sides = {"l": "left", "r": "right", "p": "right", "w": "left", "v": "right"}
    places = {trial: {"joint": "ankle", "side": side} for trial, side in sides.items()}
    assert campaign.places == places
    assert campaign.statics == {"l": ["w"], "r": ["v"]}


def test_a_trial_has_the_files_that_its_row_names(tmp_path):
    campaign = opened(tmp_path, PLACED_TRIALS)

    assert campaign.sources("w") == [CONFIG.sources / "vicon.yaml"]
    assert campaign.logs("w") == [CONFIG.raw_data / "w.c3d"]
    used = ("trial", "experiment", "log", "log_source", "log_part", "mocap", "mocap_source")
    assert campaign.recording("w") == {name: campaign.row("w")[name] for name in used}


@pytest.mark.parametrize(("text", "message"), [
    (PLACED_TRIALS, "1 unperturbed crossings, walking needs 3 or more; add them, or exclude"),
    (PLACED_TRIALS + UNPERTURBED, "1 perturbed crossings, walking needs 2 or more"),
])  # fmt: skip
def test_walking_needs_several_crossings_of_either_kind(tmp_path, text, message):
    check_campaign(opened(tmp_path))
    with pytest.raises(InputError, match=message):
        check_campaign(opened(tmp_path, text))


def test_a_condition_that_one_crossing_alone_states_is_refused(tmp_path):
    said = r"trials.csv: trial \w: no speed in the sheet, but other crossings state"
    with pytest.raises(InputError, match=said):
        check_campaign(opened(tmp_path, rows=cells(tmp_path, "x", speed="fast")))


IMPEDANCE = {"experiment": "impedance", "log": "k.csv", "log_source": "s", "mocap": None}


def two_of_one_log(tmp_path, **second):
    """Impedance trials `k`, of windows of a log, and `j`, of the same log."""
    trials = {"k": {"windows": "1-4 6-9"}, "j": {"windows": "4-6"} | second}
    of_bench = {}
    for name, changes in trials.items():
        empty = dict.fromkeys(cells(tmp_path, "x")["x"])
        of_bench[name] = empty | IMPEDANCE | changes
    return of_bench


@pytest.mark.parametrize("second", [{}, {"windows": None, "log_part": "b"}])
def test_two_trials_of_one_log_have_parts_or_windows_of_their_own(tmp_path, second):
    check_campaign(opened(tmp_path, rows=two_of_one_log(tmp_path, **second)))


@pytest.mark.parametrize(("windows", "said"), [
    ("4-6.1", "its `windows` overlap those of trial 'k' by 0.1 s; part them"),
    ("0-99", "its `windows` overlap those of trial 'k' by 3 s; part them"),
    (None, "log 'k.csv' is that of trial 'k'; correct one, or give each it"),
])  # fmt: skip
def test_two_trials_of_the_same_samples_are_refused(tmp_path, windows, said):
    with pytest.raises(InputError, match=f"trial 'j': {said}"):
        check_campaign(opened(tmp_path, rows=two_of_one_log(tmp_path, windows=windows)))


def test_a_copy_of_a_log_is_no_second_trial_of_its_experiment(tmp_path):
    copy = {"log": "j.csv", "windows": "1-4 6-9"}
    recorded = {"simulation": None, "raw_data": tmp_path}
    (tmp_path / "j.csv").write_bytes(b"1 2 3")
    (tmp_path / "k.csv").write_bytes(b"1 2 4")
    check_campaign(opened(tmp_path, rows=two_of_one_log(tmp_path, **copy), **recorded))

    (tmp_path / "k.csv").write_bytes(b"1 2 3")

    said = r"trial 'j': .*j.csv is a copy of .*k.csv, the recording of trial 'k'"
    with pytest.raises(InputError, match=said):
        check_campaign(opened(tmp_path, rows=two_of_one_log(tmp_path, **copy), **recorded))
    belt = two_of_one_log(tmp_path, **copy, experiment="belt")
    check_campaign(opened(tmp_path, rows=belt, **recorded))


def test_a_copy_of_a_capture_is_no_second_crossing(tmp_path):
    for name in ("u0", "u1"):
        (tmp_path / f"{name}.c3d").write_bytes(b"1 2 3")

    said = r"trial 'u1': .*u1.c3d is a copy of .*u0.c3d, the recording of trial 'u0'"
    with pytest.raises(InputError, match=said):
        check_campaign(opened(tmp_path, simulation=None, raw_data=tmp_path))


def test_excluded_trials_have_their_reason_and_some_trial_must_be_left(tmp_path):
    fell = cells(tmp_path, "w", exclude="he fell")
    every = {trial: cells(tmp_path, trial, exclude="he fell")[trial] for trial in "lrpwvx"}
    every |= {trial: cells(tmp_path, trial, exclude="he fell")[trial] for trial in ("u0", "u1")}

    assert opened(tmp_path, rows=fell).excluded == {"w": "he fell"}
    said = r"trials.csv: every trial is excluded; clear `exclude` of those to analyse"
    with pytest.raises(InputError, match=said):
        opened(tmp_path, rows=every)


def test_an_unknown_trial_is_told_with_the_nearest_one():
    experiments = {
        "t_1": "belt",
        "t_10": "impedance",
        "t_100": "actuator",
        "a.b": "belt",
        "acb": "impedance",
    }
    rows = {trial: {"experiment": experiment} for trial, experiment in experiments.items()}
    found = Campaign(SimpleNamespace(sheet="trials.csv"), rows, {})

    assert found.trials("belt") == ["t_1", "a.b"]
    with pytest.raises(InputError, match=r"trials\.csv: no trial 't_11'; did you mean 't_1"):
        found.row("t_11")


DEFAULT, TINY = (
    ROOT / "config" / "simulation" / "default.yaml",
    ROOT / "tests" / "tiny_simulation.yaml",
)


def settings_with(tmp_path, place, value):
    """The tiny settings with a value set at a dotted place, as a file."""
    content = inner = yaml.safe_load(TINY.read_text())
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
        "belt": 10, "transmission": 5, "actuator": 3, "impedance": 32, "static": 1, "plate": 6,
        "walking": 60,
    }  # fmt: skip
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
    fewer = settings.model_copy(
        update={"experiments": settings.experiments.model_copy(update={"walking": 9})}
    )
    few, many = ([row["perturbed"] for name, row in one.items() if name.startswith("walking")]
                 for one in (plan_trials(fewer), plan))  # fmt: skip
    assert few == many[:9]


TONE = {"frequency_hz": 200, "size": 1}
PRBS = {"name": "a", "kind": "prbs", "rms_deg": 2}


@pytest.mark.parametrize(("place", "value", "match"), [
    ("effects.load_cell_noise.unit", "mN*m", r"effects.load_cell_noise.*unit must be 'N\*m'"),
    ("effects.control_delay.size", 1.5, "effects.control_delay.*whole number"),
    ("drivetrain.control_updates", 3, "drivetrain.*control_updates must divide substeps"),
    ("experiments.walking", 3, "'walking' names no settings file"),
    ("dynamometer.rate_hz", 1,
     r"dynamometer\.rate_hz = 1 Hz takes 0\.2 samples of a cycle at 5 Hz; take 50 Hz"),
    ("actuator",
     {"duration_s": 9, "fade_s": 1, "velocity": [TONE], "current": [TONE]},
     "2000 Hz or .* actuator.veloc"),
    ("excitations", [PRBS | {"clock_s": 1e-5}], "at 50000 Hz; .*or correct excitations"),
    ("excitations",
     [PRBS | {"rms_deg": 120}], "excitations.0.rms_deg: 120 is not allowed: .* 60"),
    ("excitations", [PRBS, PRBS], "excitations: 'a' stands twice"),
    ("excitations",
     [PRBS | {"kind": "multisine", "band_hz": [0.1, 0.5]}],
     "0: 2 odd lines of a period of 8 s lie"),
    ("experiments.conditions.subjects", [{"name": "A"},
     {"name": "A"}], "subjects: 'A' stands twice"),
    ("effects.actuator_encoder",
     {"enabled": True, "size": 200, "unit": "bit"}, "its size is 200 bit; give at most 32"),
    *(("effects.dynamometer_bandwidth.size", hz,
    f"size: {hz} Hz do not .* choose 5 to 500 Hz") for hz in (1, 600)),
    ("recorder.torque_node.rate",
     {"enabled": True, "size": 10, "unit": "Hz"}, "torque_node.rate.size: 10 Hz do not"),
])  # fmt: skip
def test_a_wrong_setting_is_named_with_its_place(tmp_path, place, value, match):
    path = settings_with(tmp_path, place, value)
    with pytest.raises(InputError, match=match) as refused:
        read_yaml(path, SimulationSettings)
    assert (str(refused.value).startswith(f"{path}: "), "\n" in str(refused.value)) == (True, False)


def test_an_unstable_loop_or_a_missing_file_is_refused_and_nothing_is_written(tmp_path, in_root):
    """20 ms of delay: an actuator that turned by 1e18 rad was logged."""
    path = settings_with(tmp_path, "effects.control_delay.size", 100)
    with pytest.raises(
        InputError, match=r"runs away, beyond 100 rad.* lower effects\.control_delay"
    ):
        simulate_trial(path, tmp_path / "raw", "impedance_K300_B5.0_compensated")
    assert not (tmp_path / "raw").exists()
    with pytest.raises(
        UnreachableImpedanceError,
        match=r"yaml: experiments: K_d = 3000 N\*m/rad cannot be rendered",
    ):
        settings_files(settings_with(tmp_path, "experiments.K_d", [300, 3000]))
    with pytest.raises(InputError, match=r"simulation: no\.yaml: no such file"):
        planned_sheet(Path("no.yaml"), tmp_path / "raw/trials.csv")
    # of the gait laboratory, for a trial of the bench
    missing = settings_with(tmp_path, "walking", "none.yaml")
    with pytest.raises(
        InputError, match=r"walking: none\.yaml is no file; correct it, or write null"
    ):
        simulate_trial(missing, tmp_path / "raw", "belt_01")
