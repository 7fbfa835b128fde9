"""The sample sheet: what is valid is typed, what is not is named by line and column."""

import pandas as pd
import pytest

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
        ("k,impedance,,300,5,,k.mcap,dynamometer,,,", "controller is empty"),
        ("k,impedance,open loop,300,5,,k.mcap,dynamometer,,,", "controller 'open loop' is none of"),
        ("w,walking,,,,maybe,,,w.c3d,vicon,", "perturbed 'maybe' must be true or false"),
        ("w,walking,,,,,,,w.c3d,vicon,", "perturbed is empty"),
        ("b1,belt,,,,,b.mcap,dynamometer,,,\nb1,belt,,,,,b.mcap,dynamometer,,,", "trial 'b1' stands twice"),
    ],
)
def test_a_wrong_cell_is_named_with_line_and_remedy(tmp_path, line, message):
    with pytest.raises(InputError, match=f"trials.csv: .*{message}"):
        read_sheet(sheet(tmp_path, HEADER + line + "\n"))


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
