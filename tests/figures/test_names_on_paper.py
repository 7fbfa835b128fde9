# SPDX-License-Identifier: Apache-2.0
"""Any controller, joint and side: told apart in figures, means, headlines and macros, and written
as they are."""

from io import BytesIO
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from test_figures import assert_whole, responses, scattered, stored, texts

from osl_analysis.base.table import with_places, write_table
from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.campaign.origin import about, sentence
from osl_analysis.campaign.result_files import response_example, time_series_example
from osl_analysis.commands.figure import fig7
from osl_analysis.config.impedance_trajectory import read_impedance_trajectory
from osl_analysis.figures.drawing import drawn, plotted_numbers
from osl_analysis.figures.style import by_controller, paper_style
from osl_analysis.model.compensator import PAPER_WEIGHT

HOSTILE = (
    "$x_1$ 50 %",
    "_hidden",
    "a" * 90 + "1",
    "a" * 90 + "2",
    "Ünï 脚 \\alpha {",
    "compensated",
    None,
)


def trials_by_controller(*names, **place):
    """The table of the figures' tests with these controllers in place of its two, and a joint and
    side."""
    parts = [stored("impedance").filter(controller="compensated")] * len(names)
    named = [
        part.with_columns(controller=pl.lit(name, pl.String))
        for part, name in zip(parts, names, strict=True)
    ]
    return pl.concat(named).with_columns(
        pl.lit(value, pl.String).alias(key) for key, value in place.items()
    )


def test_hostile_names_are_drawn_letter_by_letter_without_a_warning():
    """Mathematics, hidden labels, letters that no font has, and long names."""
    table = trials_by_controller(*HOSTILE, joint="exo $K_d$ & more", side="left").filter(
        pl.col("K_d") == 100
    )
    points = plotted_numbers("fig5", table)
    figure = drawn("fig5", points)
    figure.savefig(BytesIO(), format="png")
    written = texts(figure).replace("\\$", "$").replace("\n", " ")
    for shown in ("$x_1$ 50 %", "_hidden", "\\alpha {", "Controller not stated"):
        assert shown in written, shown
    with paper_style():
        figure.draw_without_rendering()
    assert_whole(figure)
    assert len({look.label for look, _ in by_controller(points)}) == len(HOSTILE)


def test_trials_of_two_joints_share_neither_a_panel_nor_a_swarm():
    places = (("knee", "left"), ("ankle", "left"), ("ankle", "right"))
    each = [
        trials_by_controller("pd", joint=joint, side=side).filter(K_d=100) for joint, side in places
    ]
    both = pl.concat(table.with_columns(pl.col("K") + 1000 * k) for k, table in enumerate(each))

    axes = drawn("fig5", plotted_numbers("fig5", both)).axes[:3]
    swarms = drawn("fig6", plotted_numbers("fig6", both)).axes[0]

    shown = [{int(y // 1000) for y in scattered(ax, "pd")[0][:, 1]} for ax in axes]
    titles = [ax.get_title(loc="left") for ax in axes]
    assert shown == [{0}, {1}, {2}]
    assert titles == ["(a) Knee, left", "(b) Ankle, left", "(c) Ankle, right"]
    assert len(swarms.get_xticks()) == 3


def test_a_trial_without_k_d_stands_at_the_end_of_the_axis():
    table = trials_by_controller("pd").with_columns(
        K_d=pl.col("K_d").replace_strict({100: 1, 200: 2, 300: 500, 400: None})
    )
    stiffness, _ = drawn("fig5", plotted_numbers("fig5", table)).axes
    letters = [label.get_text() for label in stiffness.get_xticklabels()]
    assert letters == ["1", "2", "500", "not stated"]
    desired = {line.get_ydata()[0] for line in stiffness.lines if line.get_label() == "Desired"}
    assert desired == {1, 2, 500}


def campaign(tmp_path: Path, rows: str, **settings):
    """A campaign of these trials and settings."""
    (tmp_path / "trials.csv").write_text(
        "trial,experiment,controller,K_d,B_d,joint,log,log_source\n" + rows
    )
    lines = [
        f"{name}: {value}"
        for name, value in ({"sheet": tmp_path / "trials.csv"} | settings).items()
    ]
    (tmp_path / "c.yaml").write_text("\n".join(lines))
    return open_campaign(read_config(tmp_path / "c.yaml"), None)


TWO_JOINTS = (
    "a,impedance,compensated,300,5,,a.csv,bench_csv\n"
    "k,impedance,compensated,300,5,knee,k.csv,bench_csv\n"
    "p,impedance,pd,300,5,,p.csv,bench_csv\nb,impedance,compensated,300,,,b.csv,bench_csv\n"
)


def test_a_parameter_file_is_used_for_its_own_joint_only(tmp_path):
    """The default file is of the ankle: gains of a knee by it would be wrong without a word."""
    made = campaign(tmp_path, TWO_JOINTS)

    assert made.device("k") is None
    assert made.device("a").name == "default.yaml"


def test_examples_are_those_of_the_configuration_or_chosen_and_said(tmp_path):
    shown = time_series_example(campaign(tmp_path, TWO_JOINTS))
    assert (shown.trials, shown.chosen) == (["a"], ""), "of two"
    knee = "k,impedance,pd,,,knee,k.csv,bench_csv\n"
    belt = campaign(tmp_path, "b,belt,,,,,b.csv,bench_csv\n")
    assert (time_series_example(belt), response_example(belt)) == (None, None)
    found = time_series_example(campaign(tmp_path, knee))
    assert (found.trials, bool(found.chosen)) == (["k"], True)
    assert response_example(campaign(tmp_path, knee)) is None
    unstated = time_series_example(campaign(tmp_path, knee, figures="{time_series: null}"))
    assert unstated.chosen not in ("", found.chosen)


def test_the_hash_is_of_the_settings_and_of_the_files_that_they_name(tmp_path):
    parameters = tmp_path / "p.yaml"
    parameters.write_text(Path("config/parameters/default.yaml").read_text())
    real = {"simulation": "null", "raw_data": tmp_path, "parameters": parameters}

    def made(**settings):
        return about(campaign(tmp_path, TWO_JOINTS, **(real | settings)), [])

    first = made()
    assert first["data"] == "measured"
    assert made(results=tmp_path / "else", failed_trials="accept") == first
    parameters.write_text(parameters.read_text().replace("685.6", "700.1"))
    again = made(data="measured", recorded="2026-03-14")  # which stand beside the hash
    assert again["configuration"] == made()["configuration"] != first["configuration"]
    assert again["configuration"] in sentence(again)
    assert "2026-03-14" in sentence(again, below_figure=True)
    assert about(campaign(tmp_path, TWO_JOINTS), [])["data"] == "simulated"
    (tmp_path / "truth").mkdir()
    assert made()["data"] == "simulated"


@pytest.mark.parametrize(
    ("joint", "curves"),
    [("ankle", "desired linear model observed"), ("knee", "desired observed"), ("", "")],
)
def test_responses_are_predicted_by_a_parameter_file_of_their_joint_alone(tmp_path, joint, curves):
    """Fig. 7: Eq. 9 with the belt and motor of another joint would be wrong without a word. A
    campaign may have no responses."""
    device = Path("config/parameters/default.yaml")
    table = responses().with_columns(joint=pl.lit(joint)).filter(pl.col("joint") != "")
    write_table(table, tmp_path / "t.csv")

    numbers = fig7(tmp_path / "t.csv", device, None, PAPER_WEIGHT, [])

    assert " ".join(sorted(set(numbers["curve"]))) == curves


def test_fig_7_shows_the_desired_impedance_with_the_most_trials(tmp_path):
    table = responses().with_columns(joint=pl.lit("ankle"))
    lone = table.filter(trial=table["trial"][0]).with_columns(trial=pl.lit("lone"), K_d=77.0)
    write_table(pl.concat([*[lone] * 4, table]), tmp_path / "t.csv")  # more rows, fewer trials

    shown = fig7(tmp_path / "t.csv", None, None, PAPER_WEIGHT, []).filter(curve="observed")
    assert {*shown["K_d"]} == {*table["K_d"]}


def test_a_stated_side_goes_before_that_of_the_trials():
    groups = pl.DataFrame({"group": ["a"], "side": ["left"], "n": [1]})
    assert with_places(groups, {"a": {"joint": "knee", "side": "right"}}, "group").row(
        0, named=True
    ) == {"group": "a", "joint": "knee", "side": "left", "n": 1}


def test_a_trajectory_says_of_itself_that_it_is_synthetic():
    found = read_impedance_trajectory(Path("config/impedance/synthetic_walking.csv"))
    at = found.at(found.phase, np.array([0.25, 1.5, -0.25])).tolist()
    assert (found.kind, at) == ("synthetic", [0.25, 0.5, 0.75])
    without_gains = stored("gains").with_columns(K_1_joint=None, B_1_joint=None)
    lettering = texts(drawn("fig8", plotted_numbers("fig8", without_gains)))
    assert "(a) Trajectory: synthetic" in lettering
    assert "Gain" not in lettering
