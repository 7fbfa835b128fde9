"""The sample sheet: what is valid is typed, what is not is named by line and column."""

import re
from types import SimpleNamespace

import pandas as pd
import pytest

from osl_analysis.campaign import Campaign
from osl_analysis.errors import InputError
from osl_analysis.sheet import read_sheet

HEADER = "trial,experiment,controller,K_d,B_d,perturbed,log,log_source,mocap,mocap_source,exclude\n"
GOOD = (
    HEADER
    + "belt_1,belt,,,,,belt.mcap,dynamometer,,,\n"
    + "k300,impedance,compensated,300,5,,k300.mcap,dynamometer,,,\n"
    + "w1,walking,,,,true,w1.mcap,leg,w1.c3d,vicon,stumbled\n"
)


def sheet(tmp_path, text):
    path = tmp_path / "trials.csv"
    path.write_text(text)
    return path


def test_a_valid_sheet_has_numbers_truth_values_and_gaps(tmp_path):
    table = read_sheet(sheet(tmp_path, GOOD))
    assert table.loc["k300", "K_d"] == 300.0
    assert table.loc["w1", "perturbed"]
    assert pd.isna(table.loc["belt_1", "perturbed"])
    assert table.loc["w1", "exclude"] == "stumbled"


def test_columns_that_a_campaign_does_not_need_may_be_left_out(tmp_path):
    table = read_sheet(sheet(tmp_path, "trial,experiment,log,log_source\nb,belt,b.mcap,dynamometer\n"))
    assert pd.isna(table.loc["b", "mocap"])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("b1,belts,,,,,b.mcap,dynamometer,,,", "line 2: experiment 'belts' is none of belt"),
        ("g,gait,,,,,,,g.c3d,vicon,", "experiment 'gait' is now called 'overground'; write 'overground'"),
        ("../b1,belt,,,,,b.mcap,dynamometer,,,", r"line 2: trial '\.\./b1' must be up to 100 letters"),
        ("k,impedance,compensated,-3,5,,k.mcap,dynamometer,,,", "K_d = -3, B_d = 5 is not the impedance of a joint"),
        ("k,impedance,compensated,1e999,5,,k.mcap,dynamometer,,,", "K_d '1e999' is not a number"),
        ("b1,belt,,,,,,,,,", "names no file; fill in log or mocap"),
        ("b1,belt,,,,,b.mcap,,,,", "log_source is empty"),
        ("k,impedance,compensated,stiff,5,,k.mcap,dynamometer,,,", "K_d 'stiff' is not a number"),
        ("k,impedance,compensated,nan,5,,k.mcap,dynamometer,,,", "K_d"),
        (
            "k,impedance,Compensated,300,5,,k.mcap,dynamometer,,,",
            "'Compensated' differs from 'compensated' by",
        ),
        (f"k,impedance,{'PD' * 51},300,5,,k.mcap,dynamometer,,,", "controller 'PDPD.*has 102 characters; up to 100"),
        ("k,impedance,,0,,,k.mcap,dynamometer,,,", "K_d = 0 is not the impedance of a joint"),
        ("w,walking,,,,maybe,,,w.c3d,vicon,", "perturbed 'maybe' must be true or false"),
        ("w,walking,,,,,,,w.c3d,vicon,", "perturbed is empty"),
        ("b1,belt,,,,,b.mcap,dynamometer,,,\nb1,belt,,,,,b.mcap,dynamometer,,,", "trial 'b1' stands twice"),
    ],
)
def test_a_wrong_cell_is_named_with_line_and_remedy(tmp_path, line, message):
    with pytest.raises(InputError, match=f"trials.csv: .*{message}"):
        read_sheet(sheet(tmp_path, HEADER + line + "\n"))


def test_joint_controller_and_desired_impedance_are_free(tmp_path):
    """Any name or none; each of K_d and B_d alone, or neither. A trial without a joint is one of the ankle."""
    rows = (
        "a,impedance,PD $x_1$ 50 %,300,,a.csv,bench_csv,knee,left\n"
        "b,impedance,,,2,b.csv,bench_csv,éxo \\alpha,\n"
        "c,belt,,,,c.csv,bench_csv,,right\n"
    )
    table = read_sheet(sheet(tmp_path, "trial,experiment,controller,K_d,B_d,log,log_source,joint,side\n" + rows))
    assert list(table["joint"]) == ["knee", "éxo \\alpha", "ankle"]
    assert table.loc["a", "controller"] == "PD $x_1$ 50 %"
    assert table.loc["a", "side"] == "left"
    assert table.loc["c", "side"] == "right"
    assert pd.isna(table.loc["b", "controller"])
    assert (table.loc["a", "K_d"], table.loc["b", "B_d"]) == (300, 2)
    assert pd.isna(table.loc["b", "K_d"])


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("a,belt,knee,\nb,belt,Knee,\n", "line 3: joint 'Knee' differs from 'knee' by capitals or accents alone"),
        ("a,impedance,e\u0301xo,\nb,impedance,\u00e9xo,\n", "line 3: joint .* by capitals or accents alone"),
        ("a,static,knee,\n", "joint 'knee' of experiment 'static': the walkway measures the ankle; leave the cell"),
        ("a,belt,knee,both\n", "side 'both' must be left or right"),
    ],
)
def test_a_joint_has_one_spelling_and_the_walkway_one_joint(tmp_path, rows, message):
    rows = "".join(f"{row},{row[0]}.csv,bench_csv\n" for row in rows.splitlines())
    with pytest.raises(InputError, match=message):
        read_sheet(sheet(tmp_path, "trial,experiment,joint,side,log,log_source\n" + rows))


def test_blanks_around_a_cell_say_nothing(tmp_path):
    """A trial of experiment `belt ` was once dropped, and `uncompensated ` taken for compensated."""
    rows = (
        " b , belt\t,,,,, b.mcap ,dynamometer\u00a0,,,\n"
        "k,impedance,uncompensated ,300 , 5,,k.mcap,dynamometer,,,\u200b\n"
        "w,walking,,,, True ,,,w.c3d,vicon,\n"
    )
    table = read_sheet(sheet(tmp_path, HEADER.replace("log_source", " log_source ") + rows))
    assert list(table.loc["b", ["experiment", "log", "log_source"]]) == ["belt", "b.mcap", "dynamometer"]
    assert list(table.loc["k", ["controller", "K_d", "B_d"]]) == ["uncompensated", 300, 5]
    assert table.loc["w", "perturbed"]
    assert table["exclude"].isna().all()


def test_a_reason_may_begin_with_a_number_sign_and_contain_one(tmp_path):
    rows = "# a comment, with a comma\n\nb1,belt,,,,,b.mcap,dynamometer,,,#3 slipped\n"
    rows += "b2,belt,,,,,b#2.mcap,dynamometer,,,\n"
    table = read_sheet(sheet(tmp_path, HEADER + rows))
    assert table.loc["b1", "exclude"] == "#3 slipped"
    assert table.loc["b2", "log"] == "b#2.mcap"


def test_na_null_and_nan_are_names(tmp_path):
    rows = "".join(f"{name},belt,,,,,{name}.mcap,dynamometer,,,\n" for name in ("NA", "null", "nan"))
    table = read_sheet(sheet(tmp_path, HEADER + rows))
    assert list(table.index) == ["NA", "null", "nan"]
    assert table["controller"].isna().all()


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_sheet_is_utf_8_with_or_without_a_byte_order_mark(tmp_path, mark):
    (tmp_path / "trials.csv").write_text(mark + HEADER + "b,belt,,,,,b.mcap,dynamometer,,,glitt weg: Fuß\n", "utf-8")
    assert read_sheet(tmp_path / "trials.csv").loc["b", "exclude"] == "glitt weg: Fuß"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (
            "b,belt,,,,,b\u00a01.mcap,dynamometer,,,",
            r"line 2: column 'log': .* U\+00A0 \(NO-BREAK SPACE\); type",
        ),
        ("b,belt,,,,,b.mcap,dynamo\u200bmeter,,,", r"line 2: column 'log_source': .* U\+200B"),
        ("b,belt,,,,,b.mcap,dynamometer,,,slipped, again", "line 2: 12 cells, the header has 11; quote a cell"),
        ('b,belt,,,,,"b.mcap,dynamometer,,,\n', "line 2: not CSV"),
        (
            "b,belt,,,,,b.mcap,dynamometer,,,\nb ,belt,,,,,b.mcap,dynamometer,,,",
            "line 3: trial 'b' stands twice, first in",
        ),
    ],
)
def test_a_cell_that_is_not_what_it_looks_like_is_refused(tmp_path, rows, message):
    with pytest.raises(InputError, match=message):
        read_sheet(sheet(tmp_path, HEADER + rows))


def test_another_encoding_is_refused_with_its_line(tmp_path):
    (tmp_path / "trials.csv").write_bytes((HEADER + "b,belt,,,,,b.mcap,dynamometer,,,Fuß\n").encode("latin-1"))
    with pytest.raises(InputError, match="line 2: byte 0xdf is not UTF-8; save the sheet as 'CSV UTF-8'"):
        read_sheet(tmp_path / "trials.csv")


def test_a_column_may_stand_once(tmp_path):
    with pytest.raises(InputError, match="line 1: column 'log' stands twice"):
        read_sheet(sheet(tmp_path, "trial,experiment,log,log\nb,belt,a,b\n"))


def test_a_cell_over_two_lines_does_not_shift_the_line_of_an_error(tmp_path):
    rows = 'b1,belt,,,,,b.mcap,dynamometer,,,"slipped\nand again"\nb2,belts,,,,,b.mcap,dynamometer,,,\n'
    with pytest.raises(InputError, match="line 4: experiment 'belts'"):
        read_sheet(sheet(tmp_path, HEADER + rows))


def test_checks_to_accept_are_named_with_blanks_between(tmp_path):
    header = "trial,experiment,log,log_source,accept\n"
    table = read_sheet(sheet(tmp_path, header + "b,belt,b.mcap,dynamometer,gap  saturation\n"))
    assert table.loc["b", "accept"].split() == ["gap", "saturation"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not a CSV table"),
        (HEADER, "no trials"),
        ("trial,log\nb,b.mcap\n", "no column 'experiment'"),
        ("trial,experiment,Kd\nb,belt,3\n", "unknown column 'Kd'"),
    ],
)
def test_a_wrong_table_is_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_sheet(sheet(tmp_path, text))


def test_a_missing_sheet_is_named(tmp_path):
    with pytest.raises(InputError, match="no such sample sheet"):
        read_sheet(tmp_path / "trials.csv")


def test_the_conditions_of_a_crossing_are_words_and_may_be_empty(tmp_path):
    header = "trial,experiment,perturbed,mocap,mocap_source,group,subject,speed,side,direction\n"
    rows = "w1,walking,true,w1.c3d,vicon,slow walk,S01,0.8 m/s,left,down\nw2,walking,false,w2.c3d,vicon,,S01,,,\n"
    table = read_sheet(sheet(tmp_path, header + rows))
    assert list(table.loc["w1", ["group", "subject", "speed", "side", "direction"]]) == [
        "slow walk", "S01", "0.8 m/s", "left", "down"
    ]  # fmt: skip
    assert table.loc["w2", ["group", "session", "direction"]].isna().all()


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ("true,both,,", "side 'both' must be left or right"),
        ("true,,dorsi,", "direction 'dorsi' must be up or down"),
        ("false,,up,", "direction 'up' of a trial that is not perturbed; leave the cell empty"),
        ("true,,,slow; fast", "group 'slow; fast' must be up to 40 letters"),
    ],
)
def test_a_wrong_condition_is_named(tmp_path, cells, message):
    header = "trial,experiment,mocap,mocap_source,perturbed,side,direction,group\n"
    with pytest.raises(InputError, match=f"trials.csv: line 2: {message}"):
        read_sheet(sheet(tmp_path, header + f"w1,walking,w1.c3d,vicon,{cells}\n"))


SHORT = "trial,experiment,log,log_source\n"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("trial,experimnt,log\n", "unknown column 'experimnt'; .*; did you mean 'experiment'"),
        (f"{SHORT}a,blet,a.csv,s\n", "experiment 'blet' is none of .*; did you mean 'belt'"),
        (f"{SHORT}a,belt,a.csv,s.yaml\n", "log_source 's.yaml' names a file; write its name without the ending"),
        (f"{SHORT}a,belt,a.csv,s\n".replace(",", ";"), "its cells are separated by ';'; save the sheet with commas"),
        (f"{SHORT}a,belt,a.csv,s\n".encode("utf-16-le"), "its header holds zero bytes, it is not UTF-8; save"),
        (b"PK\x03\x04xl/\0\0", "an Excel workbook, which is not read; save its sheet as 'CSV UTF-8'"),
    ],
)
def test_a_slip_in_a_sheet_is_answered_with_what_was_meant(tmp_path, text, problem):
    (tmp_path / "trials.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=problem):
        read_sheet(tmp_path / "trials.csv")


def campaign(experiments: dict[str, str]) -> Campaign:
    """A campaign of these trials, each with its experiment."""
    rows = pd.DataFrame({"trial": list(experiments), "experiment": list(experiments.values())})
    sheet = rows.set_index("trial", drop=False)
    return Campaign(SimpleNamespace(sheet="trials.csv"), sheet, sheet[:0])


@pytest.mark.parametrize(
    "experiments",
    [
        {"belt_01": "belt", "belt_02": "belt", "actuator_1": "actuator", "b": "impedance"},
        {"t_1": "belt", "t_10": "impedance", "t_2": "impedance", "t_11": "belt", "t_100": "belt"},
        {"a.b": "belt", "acb": "impedance", "a.b.c": "impedance"},
    ],
)
def test_the_pattern_of_an_experiment_matches_its_trials_and_no_other(experiments):
    found = campaign(experiments)
    for experiment in set(experiments.values()):
        pattern = re.compile(found.pattern(experiment))
        matched = {trial for trial in experiments if pattern.fullmatch(trial)}
        assert matched == {trial for trial, own in experiments.items() if own == experiment}


def test_an_experiment_without_trials_matches_nothing():
    assert re.fullmatch(campaign({"t": "belt"}).pattern("impedance"), "t") is None


def test_the_pattern_of_many_trials_is_no_longer_than_that_of_a_few():
    """Snakemake reads it for every file: with a name of each trial in it, planning takes time with their square."""
    few, many = (
        campaign({f"{experiment}_{n:04d}": experiment for experiment in ("belt", "impedance") for n in range(number)})
        for number in (2, 500)
    )
    assert few.pattern("impedance") == many.pattern("impedance")


def test_the_row_of_another_experiment_s_trial_is_refused_by_name():
    found = campaign({"belt_01": "belt", "k300": "impedance"})
    assert found.row("k300", "impedance")["experiment"] == "impedance"
    with pytest.raises(InputError, match=r"trials\.csv: trial 'belt_01' is of experiment 'belt', not 'impedance'; ask"):
        found.row("belt_01", "impedance")
    with pytest.raises(InputError, match=r"trials\.csv: no trial 'belt_02'; it has belt_01, k300"):
        found.row("belt_02", "impedance")
