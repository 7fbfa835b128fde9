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
