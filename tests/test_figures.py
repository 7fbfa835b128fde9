"""Figures show the numbers of their tables: checked on the lines, markers and bars that they draw."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from matplotlib.figure import Figure

from osl_analysis.campaign.campaign import ABOUT_MEANING
from osl_analysis.commands.figure import caption_of, draw_figure, draw_table, plot_numbers, write_captions
from osl_analysis.commands.tables import write_table_metadata
from osl_analysis.errors import InputError
from osl_analysis.figures import FIGURES, drawing_of, others
from osl_analysis.figures.frequency import DESIRED, LINEAR_MODEL, OBSERVED, response_curve
from osl_analysis.figures.impedance import LARGEST_VAF
from osl_analysis.figures.names import (
    as_text,
    doubtful_said,
    listed_text,
    rounded_number,
    with_interval,
    with_sd,
    write_footer,
)
from osl_analysis.figures.quasi_static import MEAN_SLOPE
from osl_analysis.figures.style import LOOKS, MAGENTA, SINGLE_COLUMN, paper_style
from osl_analysis.refusal import Refusal, write_refusals
from osl_analysis.table import read_table, write_table

fig3, fig4, fig5, fig6, fig7, fig8, fig9 = (drawing_of(f"fig{number}") for number in range(3, 10))
impedance_over_stance, model_comparison, response, torque_angle, walking_page = map(
    drawing_of, ("impedance_over_stance", "model_comparison", "response", "torque_angle", "walking_page")
)
BELTS = [f"belt_{number:02d}" for number in range(1, 11)]


def stored(name):
    """A small made-up table: of results, or of a figure's plotted numbers."""
    return read_table(ROOT / f"tests/figure_tables/{name}.csv")


def time_series():
    time = np.arange(0, 10, 0.01)
    torque = 30 * np.sin(8 * time)
    table = pl.DataFrame({"time": time, "theta_deg": torque / 5, "torque": torque, "torque_model": 0.99 * torque})
    none = pl.lit(None, pl.String)
    return table.with_columns(doubtful=pl.lit(""), trial=pl.lit("k300"), chosen=none, joint=pl.lit("ankle"), side=none)


def response_table():
    curves, f, Y = [(DESIRED, None), *((LINEAR_MODEL, name) for name in LOOKS)], np.arange(1.0, 6.0), 3.5e-3 - 2e-3j
    return fig7.points(stored("frequency_response"), [response_curve(*one, f, np.full(5, Y), PLACE) for one in curves])


def torque_angle_table():
    table = stored("torque_angle")
    return torque_angle.points(table.drop("joint", "side", "doubtful"), table.unique("trial", maintain_order=True))


def response_tables():
    """Two trials: lines of a drivetrain with distortion, and one without levels that misses Eq. 9; no pools."""
    single = stored("response")
    return single, single.clear().rename({"trial": "trials"})


PLACE = (None, None)
CAMS = [f"both_cams_{5 * number:02d}mm" for number in range(11)]
PLOTTED = {
    "fig4": time_series,
    "fig5": lambda: fig5.points(stored("impedance")),
    "fig6": lambda: fig6.points(stored("impedance")),
    "fig7": response_table,
    "fig8": lambda: fig8.points(stored("gains")),
    "fig9": lambda: fig9_points(340.0),
    "response": lambda: response.points(*response_tables()),
    "torque_angle": torque_angle_table,
    "model_comparison": lambda: model_comparison.points(stored("model_comparison")),
}


def plotted(name):
    return PLOTTED[name]() if name in PLOTTED else stored(name)


CAPTIONS = {
    "fig3": ["Ankle (10 trials): the mean stiffness $K_s$ is 685.6 N·m/rad (95 % interval 682.9 to 688.3)"],
    "fig7": [
        "$K_d$ = 200 N·m/rad, $B_d$ = 7.5 N·m·s/rad.",
        "at most ± 5.7 % and ± 1 deg",  # 2e-4 of 3.5e-3
        "compensated 1 trial, uncompensated 1 trial",
    ],
    "impedance_over_stance": ["all at 25 % of stance: $K$ 75.0 N·m/rad (95 % interval 67.5 to 82.5)"],
    "model_comparison": [
        "Transmission (no panel: two models alone), mean of 1 trial: $B_j$, $J_j$ 0.1 %",
        "Rendered impedance, compensated, mean of 2 trials: Eq. 15 3.2 %; Eq. 9 6.3 %",
    ],
    "response": [
        "within 2.6 % of the second-order system",  # |1 - 0.98 exp(j deg)| = 0.0263
        "within 0.5 % of the drivetrain",
    ],
    "torque_angle": [r"both\_cams\_00mm: −4 to 6 N·m, steepest 62 N·m/rad.", r"1 of 11 trials (both\_cams\_15mm)"],
}


@pytest.mark.parametrize("name", CAPTIONS)
def test_a_caption_says_in_numbers_of_the_table_what_is_drawn(name):
    table = conditions_of(1) if name == "response" else plotted(name)
    if name == "torque_angle":
        table = table.with_columns(stiffness=57 + pl.col("angle_deg"))
    said = drawing_of(name).caption(table)
    assert [part for part in CAPTIONS[name] if part not in said] == []
    assert "Commanded" not in said


def conditions_of(number):
    """The numbers of the figure `response` of that many trials of which none is pooled."""
    single, pooled = response_tables()
    chirp, periodic = (single.filter(trial=name).head(4) for name in ("C1", "M1"))
    rows = [(chirp if k % 2 else periodic).with_columns(trial=pl.lit(f"t{k}")) for k in range(number)]
    return response.points(pl.concat(rows, how="diagonal_relaxed"), pooled)


def texts(figure):
    return " ".join(text.get_text() for text in figure.findobj(lambda a: hasattr(a, "get_text")))


def line(ax, label):
    """Data (2, n) of the line with that label."""
    (found,) = [artist for artist in ax.lines if artist.get_label() == label]
    return np.array(found.get_data(), dtype=float)


def scattered(ax, label):
    """Places (n, 2), faces (n, 4) and links (n,) of the points with that label."""
    (found,) = [artist for artist in ax.collections if artist.get_label() == label]
    return np.asarray(found.get_offsets()), found.get_facecolor(), found.get_urls()


def bars(ax, axis=0):
    """Ends (2,) of the bars of a panel along the other axis, in the order in which they were drawn; 0: upright ones."""
    found = [np.asarray(s) for c in ax.collections if hasattr(c, "get_segments") for s in c.get_segments()]
    return [one[:, 1 - axis] for one in found if one[0][axis] == one[1][axis]]


def links_to(trials):
    return [f"../report.html#trial={trial}" for trial in trials]


def same(drawn, table, *columns):
    """Data (2, n) are those of two columns."""
    data = drawn.get_data() if hasattr(drawn, "get_data") else drawn
    np.testing.assert_array_equal(np.array(data, dtype=float), table.select(columns).to_numpy().T)


def test_trials_of_a_pool_are_drawn_once():
    single, _ = response_tables()
    pooled = single.filter(trial="M1").rename({"trial": "trials"}).with_columns(trials=pl.lit("M1, M2"))
    assert response.points(single, pooled)["trials"].unique(maintain_order=True).to_list() == ["M1, M2", "C1"]


def test_conditions_stand_side_by_side_each_in_its_place(monkeypatch):
    monkeypatch.setattr("osl_analysis.figures.frequency.MOST_CONDITIONS", 4)
    table = conditions_of(5)
    figure = response.draw(table)
    assert response.draw(conditions_of(3)).axes[0].get_gridspec().get_geometry() == (3, 3)
    places = {(s.rowspan.start, s.colspan.start): ax for ax in figure.axes if (s := ax.get_subplotspec())}
    assert len(figure.axes) == 3 * 4
    for k, step in product(range(4), range(2)):
        rows, ax = table.filter(trials=f"t{k}"), places[3 * (k // 3) + step, k % 3]
        (drawn,) = [a for a in ax.lines if a.get_marker() == "o"]
        same(drawn, rows, "frequency_hz", ("magnitude", "phase_deg")[step])
        assert (drawn.get_markerfacecolor() == "#FFFFFF") == (rows["doubtful"][0] != "")
        assert (f"t{k}" in ax.get_title(loc="left")) == (step == 0)
    assert "Further 1 condition in response.csv" in texts(figure)
    monkeypatch.undo()
    page = response.draw(conditions_of(12))
    assert page.get_figheight() < 9.5, "the text block of an IEEE page is 9.6 in high"
    assert "Further" not in texts(page)


def test_a_condition_shows_intervals_levels_above_the_noise_and_how_far_its_structures_are():
    table = conditions_of(1)
    magnitude, phase, beside = response.draw(table).axes
    row = table.row(0, named=True)
    half, ends = 1.96 * row["total_sd"] / np.sqrt(2), np.array([-1, 1])
    np.testing.assert_allclose(bars(magnitude)[0], row["magnitude"] + half * ends)
    np.testing.assert_allclose(bars(phase)[0], row["phase_deg"] + ends * np.rad2deg(half / row["magnitude"]))
    turned = {m: np.deg2rad(row[f"phase_deg_{m}"] - row["phase_deg"]) for m in ("eq15", "eq9")}
    apart = [abs(row["magnitude"] - row[f"magnitude_{m}"] * np.exp(1j * angle)) for m, angle in turned.items()]
    assert [a.get_ydata()[0] for a in beside.lines] == pytest.approx([*apart, row["odd_level"], row["noise_level"]])


def test_a_condition_without_distortion_says_why():
    table = conditions_of(2)
    said = {name: ax.get_title(loc="left") for name, ax in zip("pl", response.draw(table).axes[4:], strict=True)}
    assert said == {"p": "", "l": "Distortion is in the noise"}
    quiet = table.with_columns(odd_level=pl.col("noise_level") / 2, method=pl.lit("fast"))
    assert "Distortion below noise" in texts(response.draw(quiet))
    unseen = table.with_columns(odd_level=None, even_level=None, method=pl.lit("fast"))
    assert "No line shows distortion" in texts(response.draw(unseen))


def test_fig3_draws_every_trial_grey_and_the_mean_slope_dashed_magenta_with_its_interval():
    figure = fig3.draw(stored("fig3"))
    *trials, mean = figure.axes[0].lines
    for name, trial in zip(BELTS, trials, strict=True):
        same(trial, stored("fig3").filter(trial=name), "theta_s_deg", "torque")
    same(mean, stored("fig3").filter(trial=MEAN_SLOPE), "theta_s_deg", "torque")
    assert (mean.get_color(), mean.is_dashed()) == (MAGENTA, True)
    assert "685.6" in texts(figure)
    assert "682.9 to 688.3 N·m/rad" in texts(figure)
    single = texts(fig3.draw(stored("fig3").with_columns(K_s_low=None, K_s_high=None)))
    assert ("685.6" in single, "interval" in single) == (True, False)


def test_fig3_tells_trials_apart_below_by_branch_with_their_names_and_the_area_of_their_loops():
    there = stored("fig3").filter(pl.col("trial") != MEAN_SLOPE)
    back = there.with_columns(branch=pl.lit("unloading"), deviation=pl.col("deviation") - 0.5)
    table = pl.concat([there, back, stored("fig3").filter(trial=MEAN_SLOPE)])
    loops = fig3.draw(table).axes[1]
    _, *branches = [a for a in loops.lines if len(a.get_xdata())]
    for name, solid, dashed in zip(BELTS, branches[::2], branches[1::2], strict=True):  # in the order of their ends
        same(solid, there.filter(trial=name), "theta_s_deg", "deviation")
        same(dashed, back.filter(trial=name), "theta_s_deg", "deviation")
        assert (solid.is_dashed(), dashed.is_dashed()) == (False, True)
    assert all(one.get_color() != other.get_color() for one, other in pairwise(branches[::2]))
    named = [a for a in loops.texts if "belt" in a.get_text()]
    assert [a.get_text() for a in named] == BELTS
    assert [a.get_url() for a in named] == links_to(BELTS)
    assert [a.xy[1] for a in named] == pytest.approx([line.get_ydata()[-1] for line in branches[::2]])
    assert "Mean loop area 0.0451 J" in texts(loops.figure)
    renamed = pl.when(pl.col("trial") == MEAN_SLOPE).then("trial").otherwise(pl.col("trial") + "b")
    many = fig3.draw(pl.concat([table.with_columns(trial=renamed), table])).axes[1]
    assert not [a for a in many.texts if "belt" in a.get_text()]


def test_fig4_draws_angle_torque_fit_and_residual_and_shades_what_the_fit_leaves_out():
    left_out = pl.col("time").is_between(2, 3) | (pl.col("time") > 9)
    table = time_series().with_columns(torque_model=pl.when(~left_out).then("torque_model"))
    angle, torque, residual = fig4.draw(table).axes
    same(angle.lines[0], table, "time", "theta_deg")
    same(line(torque, "Measured"), table, "time", "torque")
    same(line(torque, "Best-fit second-order system"), table, "time", "torque_model")
    same(residual.lines[1], table.select("time", pl.col("torque") - pl.col("torque_model")), "time", "torque")
    for ax in (angle, torque, residual):
        spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in ax.patches]
        np.testing.assert_allclose(spans, [(2, 3), (9.01, 9.99)], atol=1e-9)
    assert "trial k300" in angle.get_title(loc="left")
    assert ["Not fitted" in texts(f) for f in (torque.figure, fig4.draw(time_series()))] == [True, False]
    assert [part in fig4.caption(table) for part in ("VAF 99.99 %", "leaves out")] == [True, True]


@pytest.mark.parametrize(("panel", "symbol"), [(0, "K"), (1, "B")])
def test_fig5_gives_each_desired_impedance_a_place_and_draws_every_trial_there_beside_its_desired_value(panel, symbol):
    table, places = fig5.points(stored("impedance")), []
    ax = fig5.draw(table).axes[panel]
    lines = [s for c in ax.collections if hasattr(c, "get_segments") for s in c.get_segments() if s[0][1] == s[1][1]]
    assert len(lines) == 16
    for controller, look in LOOKS.items():
        rows = table.filter(controller=controller).sort("K_d", "B_d")
        points, _, links = scattered(ax, look.label)
        np.testing.assert_array_equal(points[:, 1], rows[symbol])
        assert links == links_to(rows["trial"])
        beside = [line[0][1] for x, _ in points for line in lines if line[0][0] < x < line[1][0]]
        assert beside == rows[f"{symbol}_d"].to_list()
        places += list(points[:, 0])
    assert np.diff(sorted(places)).min() == 1


def test_fig5_draws_the_range_over_amplitudes_and_its_caption_says_which_bar_is_what():
    ends = {f"{q}_amplitudes_{end}": pl.col(q) + step for q in "KB" for end, step in (("low", -7.0), ("high", 5.0))}
    table = fig5.points(stored("impedance").with_columns(**ends))
    drawn = {tuple(ends) for ends in bars(fig5.draw(table).axes[1])}
    for kind in ("B_amplitudes", "B"):
        assert set(table.select(f"{kind}_low", f"{kind}_high").rows()) < drawn
    assert "Thin bars are the range of the fits to single amplitudes" in fig5.caption(table)
    assert "at most ±0.98 N·m/rad and ±0.1 N·m·s/rad" in fig5.caption(table)
    without = fig5.points(
        stored("impedance").with_columns(K_low=pl.lit(None, pl.Float64), K_high=pl.lit(None, pl.Float64))
    )
    assert "bars" not in fig5.caption(without)
    unpredicted = fig5.points(stored("impedance").drop("K_predicted", "B_predicted"))
    assert ["Linear model" in texts(fig5.draw(one)) for one in (table, unpredicted)] == [True, False]


@pytest.mark.parametrize(
    ("name", "table", "message"),
    [
        ("fig5", stored("impedance").drop_nulls("amplitude_deg"), "no fit over all amplitudes"),
        ("fig6", stored("impedance").with_columns(VAF=float("nan")), "no VAF of a single amplitude"),
        (
            "model_comparison",
            stored("model_comparison").with_columns(VAF_held_out=float("nan")),
            "no model was held against",
        ),
    ],
)
def test_a_table_without_what_a_figure_shows_is_refused(name, table, message):
    with pytest.raises(InputError, match=message):
        drawing_of(name).points(table)


def test_fig5_caption_has_the_errors_of_each_controller_with_mean_sd_and_range():
    table = fig5.points(stored("impedance").with_columns(K=pl.col("K_d") + 2 * (pl.col("B_d") > 0)))
    assert r"Compensated ($n$ = 16): $\hat{K} - K_d$ is 1.50 ± 0.89 N·m/rad, 0.00 to 2.00" in fig5.caption(table)
    some = table.with_columns(K=pl.when(pl.col("B_d") > 0).then("K"))
    assert r"$\hat{K} - K_d$ of 12 fits is" in fig5.caption(some)


def test_fig6_has_a_point_for_each_trial_and_amplitude_that_touches_no_other_and_marks_the_median():
    table = fig6.points(stored("impedance").reverse())
    ax = fig6.draw(table).axes[0]
    for controller, look in LOOKS.items():
        rows = table.filter(controller=controller)
        assert len(rows) == 48
        points, _, links = scattered(ax, look.label)
        same(points.T, rows, "x", "VAF")
        assert links == links_to(rows["trial"])
        printed = ax.transData.transform(points) / ax.figure.dpi * 72
        distance = np.hypot(*(printed[:, None, :] - printed[None, :, :]).transpose(2, 0, 1))
        nearest = distance[np.triu_indices(48, 1)].min()
        assert nearest == pytest.approx(4.9, rel=1e-3), "the largest marker and a small gap"
    low, high = ax.get_ylim()
    assert table["VAF"].is_between(low, high).all()
    medians = sorted(c.get_segments()[0][0][1] for c in ax.collections if hasattr(c, "get_segments"))
    np.testing.assert_allclose(medians, sorted(float(np.median(g["VAF"])) for g in table.partition_by("controller")))
    assert "48 fits of 16 trials" in texts(ax.figure)
    assert "log scale of 100 − VAF" in texts(ax.figure)


def test_fig6_draws_a_perfect_fit_at_the_end_of_its_axis_says_so_and_leaves_out_one_without_a_vaf():
    vaf = pl.Series([float("nan"), 99.99999999, 99.0, 97.0])
    table = fig6.points(stored("impedance").filter(amplitude_deg=2).head(4).with_columns(VAF=vaf))
    ax = fig6.draw(table).axes[0]
    np.testing.assert_allclose(scattered(ax, "Compensated")[0][:, 1], [LARGEST_VAF, 99, 97], rtol=1e-12)
    low, high = ax.get_ylim()
    assert low < 97 < LARGEST_VAF < high
    said = fig6.caption(table)
    assert "(3 trials): median 99.00 %, 97.00 % to 100.000000 %" in said
    assert "Larger VAFs than 99.9999 % are drawn there" in said


def test_figures_say_which_fits_are_doubtful_and_how_many_only_where_some_are():
    reason = pl.when(pl.col("trial").is_in(["belt_02", "belt_07", "w2"])).then(pl.lit("VAF 80 is below 90"))
    belts = fig3.draw(stored("fig3").with_columns(doubtful=reason))
    for ax in belts.axes:
        dotted = [a for a in ax.lines if a.is_dashed() and a.get_color() != MAGENTA and len(a.get_xdata())]
        assert [a.get_ydata()[0] for a in dotted] == [2, 7]
    assert "Doubtful fit ($n$ = 2)" in texts(belts)
    page = walking_page.draw(stored("walking_page").with_columns(doubtful=reason))
    (dotted,) = [a for a in page.axes[2].lines if a.is_dashed()]
    assert dotted.get_ydata().max() == pytest.approx(1.1 * 60)
    assert "Doubtful fit ($n$ = 1)" in texts(page)
    first = fig5.points(stored("impedance")).with_columns(
        doubtful=pl.when(K_d=100, B_d=0).then(pl.lit("VAF 80 is below 90"))
    )
    axes = fig5.draw(first).axes
    faces = [scattered(ax, look.label)[1] for ax in axes for look in LOOKS.values()]
    assert [int((face == 1).all(axis=1).sum()) for face in faces] == [1, 1, 1, 1], "open ones"
    assert "2 of 32 fits (impedance\\_K100\\_B0.0\\_comp" in fig5.caption(first)
    for name in ("fig3", "fig4", "fig5", "fig6", "fig7", "fig9", "walking_page"):
        table, said = plotted(name), {"fig4": "system (doubtful)"}.get(name, "oubtful")
        assert said in texts(drawing_of(name).draw(table.with_columns(doubtful=pl.lit("x"))))
        assert "oubtful" not in texts(drawing_of(name).draw(table.with_columns(doubtful=pl.lit(""))))


def test_fig7_draws_observed_points_with_intervals_and_links_to_their_trials_and_the_curves():
    table = response_table()
    magnitude, phase = fig7.draw(table).axes
    for ax, column in ((magnitude, "magnitude"), (phase, "phase_deg")):
        same(line(ax, "Desired"), table.filter(curve=DESIRED), "frequency_hz", column)
        for name, look in LOOKS.items():
            rows = table.filter(controller=name)
            points, _, links = scattered(ax, look.label)
            same(points.T, rows.filter(curve=OBSERVED), "frequency_hz", column)
            assert links == links_to([f"{name}%20trial"] * 5)
            same(line(ax, f"{look.label}, linear model"), rows.filter(curve=LINEAR_MODEL), "frequency_hz", column)
    assert magnitude.get_yscale() == magnitude.get_xscale() == phase.get_xscale() == "log"
    assert [tick.get_text() for tick in phase.get_xticklabels()] == ["1", "2", "3", "4", "5"]
    assert [tick.get_text() for tick in magnitude.get_yticklabels()] == ["3.5", "4", "4.5", "5"], "in thousandths"
    np.testing.assert_allclose(magnitude.get_yticks(), [3.5e-3, 4e-3, 4.5e-3, 5e-3])
    assert phase.get_ylim()[1] > 0
    with pytest.raises(InputError, match="2 desired impedances"):
        fig7.points(pl.DataFrame({"K_d": [100.0, 200.0], "B_d": [0.0, 0.0]}), [])
    for ax, amplitudes, interval in ((phase, [-16, -11], [-14, -12]), (magnitude, [4.6e-3, 5.3e-3], [4.8e-3, 5.2e-3])):
        np.testing.assert_allclose([bars(ax)[0], bars(ax)[5]], [amplitudes, interval])


def test_fig8_draws_desired_impedance_and_gains_at_the_joint_over_the_gait():
    table = stored("gains")
    swing = table.tail(1).with_columns(phase=pl.lit(0.63), K_d=pl.lit(1e6))
    assert fig8.points(pl.concat([table, swing])).equals(fig8.points(table))
    assert fig8.points(table, 0.3)["phase"].max() == pytest.approx(0.3)
    assert "first 60 % of the gait cycle" in fig8.caption(table)
    assert "100 to 340 N·m/rad and 2 to 2.6 N·m·s/rad" in fig8.caption(table)
    panels = fig8.draw(fig8.points(table)).axes
    for ax, symbol in zip(panels, "KB", strict=True):
        same(ax.lines[0], table, "phase", f"{symbol}_d")
        same(ax.lines[1], table, "phase", f"{symbol}_1_joint")
    assert panels[1].xaxis.get_major_formatter()(0.4) == "40"


def walking_fits(n=31, group="all"):
    """Perturbations `walk_1` ... of a group: K from 300 on, each 2 more; the second is doubtful."""
    number = np.arange(n)
    rows = {"trial": [f"walk_{k + 1}" for k in number], "K": 300 + 2.0 * number, "B": 4 + 0.02 * number}
    doubtful = ["VAF 80" if k == 1 else "" for k in number]
    return pl.DataFrame(rows | {"I": 1e-3 * number, "group": group, "doubtful": doubtful})


def over_stance(commanded_B=None):
    """What a trajectory commands of the one group."""
    return pl.DataFrame({"group": "all", "quantity": ["K", "B"], "commanded": [345.0, commanded_B]})


def fig9_points(commanded_K=None, summary=None, commanded_B=None):
    table = stored("walking_summary") if summary is None else summary
    return fig9.points(table, walking_fits(), over_stance(commanded_B), commanded_K)


def commanded_in(ax):
    return [float(a.get_ydata()[0]) for a in ax.lines if a.get_label() == "Commanded"]


def test_fig9_has_every_estimate_the_mean_with_one_sd_the_ensemble_with_its_interval_and_the_commanded_values():
    table = fig9_points(340.0, commanded_B=4.5)
    figure = fig9.draw(table)
    for ax, quantity, mean, sd in zip(figure.axes, "KBI", (338.0, 4.3, 0.012), (20.0, 0.7, 0.02), strict=True):
        points, faces, links = scattered(ax, "One perturbation")
        np.testing.assert_allclose(points[:, 1], walking_fits()[quantity])
        assert [k for k, face in enumerate(faces) if (face == 1).all()] == [1]
        assert links == links_to(f"walk_{k}" for k in range(1, 32))
        np.testing.assert_allclose(bars(ax), [[mean - sd, mean + sd], [1.09 * mean, 1.12 * mean]])
        drawn = {a.get_marker(): a.get_ydata()[0] for a in ax.lines if a.get_marker() in "sD"}
        assert drawn == {"s": mean, "D": pytest.approx(1.1 * mean)}
        assert not ax.patches
    assert [commanded_in(ax) for ax in figure.axes] == [[340.0], [4.5], []]
    said = fig9.caption(table)
    assert "31 perturbations. Squares" in said
    assert r"$\hat{K}$ is 338 ± 20 N·m/rad, of the mean response 371.8 N·m/rad (95 % interval 368.4 to 378.6)" in said
    assert "(95 % interval 4.687 to 4.816), commanded 4.5;" in said
    assert r"1 of 31 fits (walk\_2)" in said
    lowest = [ax.get_ylim()[0] for ax in figure.axes]
    assert (lowest[0] > 250, lowest[1] > 2, lowest[2] <= 0) == (True, True, True), "inertia alone is drawn from zero"
    outside = table.with_columns(ensemble_low=1.01 * pl.col("ensemble"))  # of the percentiles of its bootstrap
    np.testing.assert_allclose(bars(fig9.draw(outside).axes[0])[1], [1.01 * 1.1 * 338, 1.12 * 338])


@pytest.mark.parametrize(
    ("sheet", "configured", "drawn"), [(300.0, 340.0, 300.0), (None, 340.0, 340.0), (None, None, 345.0)]
)
def test_fig9_takes_what_was_commanded_from_the_sheet_or_the_configuration_or_the_trajectory(sheet, configured, drawn):
    summary = stored("walking_summary").with_columns(commanded=pl.lit(sheet, pl.Float64))
    assert fig9_points(configured, summary).filter(quantity="K")["commanded"][0] == drawn


def test_fig9_leaves_out_crossings_without_a_fit_or_a_group_and_shows_one_perturbation_without_a_mean():
    K, group = pl.Series([300.0, None, float("nan"), 310.0]), pl.Series(["all", "all", "all", None])
    without = stored("walking_summary").with_columns(mean=pl.lit(None, pl.Float64))
    table = fig9.points(without, walking_fits(4).with_columns(K=K, group=group), over_stance().head(0))
    assert table["trial"].drop_nulls().unique().to_list() == ["walk_1"]
    figure = fig9.draw(table)
    assert [len(scattered(ax, "One perturbation")[0]) for ax in figure.axes] == [1, 1, 1]
    assert [bars(ax) for ax in figure.axes] == [[], [], []]
    assert "ommanded" not in texts(figure)
    assert "has no mean" in fig9.caption(table)
    with pytest.raises(InputError, match="no perturbation has a fit"):
        fig9.points(without, walking_fits(0), over_stance())


def test_fig9_shows_every_group_with_a_result_and_each_group_s_command():
    """K of the second group is twice that of the first, the third has no result; the configuration's command is of one
    group."""
    one = stored("walking_summary").with_columns(group=pl.lit("K_d 200"), commanded=pl.lit(200.0))
    two = one.with_columns(pl.col("mean", "low", "high") * 2, group=pl.lit("K_d 400"), commanded=pl.lit(400.0))
    none = one.with_columns(mean=None, low=None, high=None, group=pl.lit("K_d 600"))
    summary = pl.concat([one, two, none], how="diagonal_relaxed")
    fits = pl.concat([walking_fits(31, "K_d 200"), walking_fits(31, "K_d 400")])
    table = fig9.points(summary, fits, over_stance(), 340.0)
    panel, _, lowest = fig9.draw(table).axes
    assert [a.get_ydata()[0] for a in panel.lines if a.get_marker() == "s"] == [338.0, 676.0]
    assert [label.get_text() for label in lowest.get_xticklabels()] == ["$K_d$ 200 (31)", "$K_d$ 400 (31)"]
    assert commanded_in(panel) == [200.0, 400.0]
    said = fig9.caption(table)
    assert "62 perturbations in 2 groups" in said
    assert r"K\_d 400: $\hat{K}$ is 676 ± 20" in said
    trajectory = pl.DataFrame({"group": ["K_d 400"], "quantity": ["K"], "commanded": [390.0]})
    unstated = summary.with_columns(commanded=pl.lit(None, pl.Float64))
    stated = fig9.points(unstated, fits, trajectory, 340.0).filter(pl.col("trial").is_null(), quantity="K")
    assert stated["commanded"].to_list() == [None, 390.0]


def test_impedance_over_stance_shows_estimates_at_their_phases_with_intervals_windows_and_the_command():
    panel = impedance_over_stance.draw(stored("impedance_over_stance")).axes[0]
    (dots,) = [a for a in panel.lines if a.get_marker() == "o"]
    np.testing.assert_allclose(dots.get_xydata(), [[25, 75], [45, 135], [65, 195]])
    np.testing.assert_allclose(line(panel, "Commanded").T, [[0, 10], [50, 160], [100, 310]])
    np.testing.assert_allclose(bars(panel, 1), [[15, 29], [35, 49], [55, 69]])
    np.testing.assert_allclose(bars(panel), [[67.5, 82.5], [121.5, 148.5], [175.5, 214.5]])


def test_torque_against_angle_shows_both_branches_of_every_trial_its_desired_curve_and_its_slope():
    table = torque_angle_table()
    figure = torque_angle.draw(table)
    loops, slopes = figure.axes
    colours = {name: loops.lines[2 * number].get_color() for number, name in enumerate(CAMS)}
    assert len(set(colours.values())) == 11
    rows = table.filter(trial="both_cams_50mm", branch="unloading")
    loading, unloading, desired = loops.lines[20], loops.lines[21], loops.lines[22]
    same(unloading, rows, "angle_deg", "torque")
    assert loading.get_linewidth() > unloading.get_linewidth()
    same(desired, rows, "angle_deg", "desired_torque")
    assert (desired.get_color(), desired.is_dashed()) == (loading.get_color(), True)
    assert [line.is_dashed() for line in slopes.lines[:11]] == [number == 3 for number in range(11)]
    np.testing.assert_array_equal(slopes.lines[5].get_data()[1], 62.0)
    assert len(slopes.collections) == 11
    for ax in (loops, slopes):
        names = {text.get_text(): text for text in ax.texts}
        assert set(names) == {name.replace("_", " ") for name in CAMS}
        assert names["both cams 15mm"].get_color() == colours["both_cams_15mm"]
    assert names["both cams 15mm"].xy == (5.0, 60.0)
    sound = torque_angle.draw(table.with_columns(doubtful=pl.lit(""), desired_torque=pl.lit(None, pl.Float64)))
    legends = [[text.get_text() for text in one.legends[0].get_texts()] for one in (figure, sound)]
    assert legends == [["Loading", "Unloading", "Desired", "Doubtful trial"], ["Loading", "Unloading"]]


def test_the_study_marks_values_beyond_a_panel_by_arrows_and_covers_no_more_than_all():
    shared = {"experiment": "second order", "estimator": "filtered", "interval_method": "cycles", "bias_mc": 0.1}
    shared |= {"rmse_over_bound": 1.0, "rmse_over_bound_mc": 0.1, "coverage_mc": 0.01}
    values = {"quantity": ["K", "B"], "bias": [0.1, 12.0], "coverage": [0.99, 0.5]}
    bias, _, coverage = others.draw_study(pl.DataFrame(values | shared)).axes
    shown = {(line.get_marker(), float(line.get_xdata()[0])) for line in bias.lines if len(line.get_xdata()) == 1}
    assert shown == {("o", 0.1), (">", 1.2)}
    assert {line.get_marker() for line in coverage.lines} >= {"o", "<"}
    assert [ends.tolist() for ends in bars(coverage, 1)] == [[97.0, 100.0]]


def test_the_walking_page_shows_both_gaits_every_response_their_mean_and_its_fit():
    table = stored("walking_page")
    angle, torque, isolated_angle, isolated_torque = walking_page.draw(table).axes

    def intervals_in(ax):
        return {str(patch.get_label()): (patch.get_x(), patch.get_x() + patch.get_width()) for patch in ax.patches}

    for ax in (angle, torque):
        x, mean = line(ax, "Unperturbed ($n$ = 7)")
        np.testing.assert_allclose(mean, x * (100 - x) / 100)
        band = ax.collections[0].get_paths()[0].get_extents()
        assert band.y1 == pytest.approx(mean.max() + 2, abs=0.1)
        assert intervals_in(ax) == {"Baseline": (26, 34), "Fitted window": (40, 54)}
    for ax, fits in ((isolated_angle, 0), (isolated_torque, 1)):
        assert intervals_in(ax) == {"Baseline": (-100, -40), "Fitted window": (0, 100)}
        thin = [a for a in ax.lines if a.get_alpha()]
        assert [a.get_url() for a in thin] == links_to(["w1", "w2"])
        np.testing.assert_allclose(line(ax, "Mean")[1], np.mean([a.get_ydata() for a in thin], axis=0))
        dashed = [a for a in ax.lines if a.is_dashed()]
        assert len(dashed) == fits
    np.testing.assert_allclose(dashed[0].get_ydata(), np.clip(dashed[0].get_xdata(), 0, 60) - 1)
    both = [table.with_columns(group=pl.lit(name), mean=k * pl.col("mean")) for k, name in ((1, "fast"), (2, "slow"))]
    axes = walking_page.draw(pl.concat(both)).axes
    assert len(axes) == 8, "four panels per group"
    np.testing.assert_allclose(line(axes[6], "Mean")[1], 2 * line(axes[2], "Mean")[1])


def test_the_walking_page_s_caption_says_where_responses_are_zero_and_what_they_are_at_the_onset():
    response_rows = pl.col("panel").str.starts_with("response") & pl.col("curve").is_in(["each", "mean"])
    onset = response_rows & (pl.col("x").abs() < 6)
    shift = pl.col("trial").replace_strict({"w1": -1.0, "w2": -2.0}, default=-1.5)
    said = walking_page.caption(stored("walking_page").with_columns(mean=pl.when(onset).then(shift).otherwise("mean")))
    assert "hatched baseline, −100 to −40 ms from the onset, and not at the onset" in said
    assert "at the onset the mean response is −1.50 deg (SD 0.71) and −1.50 N·m (SD 0.71)" in said
    assert "7 unperturbed crossings and 5 perturbed" in said


def test_rival_models_are_drawn_by_trial_on_one_logarithmic_axis_with_their_geometric_mean():
    axes = model_comparison.draw(plotted("model_comparison")).axes
    assert [ax.get_title(loc="left") for ax in axes] == ["(a) Belt", "(b) Rendered impedance"]
    assert {ax.get_yscale() for ax in axes} == {"log"}
    assert len({ax.get_ylim() for ax in axes}) == 1, "panels are to be compared"
    points, _, links = scattered(axes[0], "Repeat")
    np.testing.assert_allclose(points[:4].T, [[0, 1, 2, 3], [1, 1, 0.01, 0.01]])
    assert links == links_to(f"belt_{k}" for k in (1, 2) for _ in range(4))
    means = next(c for c in axes[0].collections if c.get_label() == "Geometric mean")
    heights = [segment[0][1] for segment in means.get_segments()]
    np.testing.assert_allclose(heights, np.sqrt(10) * np.array([1, 1, 0.01, 0.01]))
    for label, side in (("Compensated", -1), ("Uncompensated", 1)):
        x, left = scattered(axes[1], label)[0][:4].T
        np.testing.assert_allclose(left, [1, 2, 0.1, 0.05])
        assert (np.sign(x - np.arange(4)) == side).all()


def test_models_that_were_not_held_against_other_data_are_not_drawn():
    vaf = pl.when(pl.col("experiment") == "belt").then(float("nan")).otherwise("VAF_held_out")
    (ax,) = model_comparison.draw(
        model_comparison.points(stored("model_comparison").with_columns(VAF_held_out=vaf))
    ).axes
    assert ax.get_title(loc="left") == "Rendered impedance"


def drawn_twice(name, table_csv, outputs, refused=()):
    """The files of a figure, which are the same when it is drawn again."""
    found = []
    for _ in range(2):
        draw_figure(name, table_csv, outputs, refused)
        found.append([path.read_bytes() for path in outputs])
    assert found[0] == found[1]
    return found[0]


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_fits_the_page_reads_at_8_points_and_comes_out_the_same_twice(name, tmp_path, monkeypatch):
    """PNG is the same twice on the page of `test_a_figure_without_numbers_...`."""
    found, drawn = drawing_of(name), []
    kept = replace(found, draw=lambda table: drawn.append(found.draw(table)) or drawn[-1])
    monkeypatch.setattr("osl_analysis.commands.figure.drawing_of", lambda _: kept)
    write_table(plotted(name), tmp_path / "t.csv")
    pdf, _ = drawn_twice(name, tmp_path / "t.csv", [tmp_path / f"{name}{suffix}" for suffix in (".pdf", ".svg")])
    assert b"/Type3" not in pdf
    figure: Figure = drawn[0]
    assert figure.get_figwidth() in (SINGLE_COLUMN, 7.16)
    assert {t.get_fontsize() for t in figure.findobj(lambda a: hasattr(a, "get_fontsize")) if t.get_text()} == {8.0}
    with paper_style():
        inked, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert min(inked.x0, inked.y0, width - inked.x1, height - inked.y1) > -0.01, "no lettering is cut off"


def test_a_figure_is_the_same_in_another_process_whatever_the_users_matplotlib_settings(tmp_path):
    write_table(plotted("fig5"), tmp_path / "t.csv")
    (tmp_path / "users").write_text("font.size: 20\npdf.fonttype: 3\nsavefig.bbox: tight\n")
    here, there = ([tmp_path / f"{place}.{suffix}" for suffix in ("pdf", "svg")] for place in ("here", "there"))
    draw_figure("fig5", tmp_path / "t.csv", here)
    code = (
        "from pathlib import Path; from osl_analysis.commands.figure import draw_figure; "
        "draw_figure('fig5', Path('t.csv'), [Path('there.pdf'), Path('there.svg')])"
    )
    env = os.environ | {"PYTHONHASHSEED": "2", "MATPLOTLIBRC": str(tmp_path / "users")}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=env, check=True)
    assert [path.read_bytes() for path in there] == [path.read_bytes() for path in here]


@pytest.mark.parametrize("name", FIGURES)
def test_a_table_without_a_column_is_refused_by_file_and_column_and_nothing_is_drawn(name, tmp_path):
    last = drawing_of(name).columns[-1]
    write_table(plotted(name).drop(last), tmp_path / "t.csv")
    with pytest.raises(InputError, match=rf"t\.csv: no column '{last}'"):
        draw_figure(name, tmp_path / "t.csv", [tmp_path / "f.pdf"])
    assert [path.name for path in tmp_path.iterdir()] == ["t.csv"]


def test_a_figure_without_numbers_says_so_with_trial_and_reason_and_equal_files_each_time(tmp_path):
    lost = Refusal("i_1", "raw/i_1.mcap", "ingest", "refused", "raw/i_1.mcap: $no$ such_file^", "copy it")
    write_refusals([lost], tmp_path / "fig4.csv")
    drawn_twice("fig4", tmp_path / "fig4.csv", [tmp_path / f"fig4.{s}" for s in ("pdf", "svg", "png")], [lost])
    said = others.draw_reasons(pl.DataFrame([{"figure": "fig4", "trial": "i_1", "file": "", "reason": lost.reason}]))
    title, reason = (text.get_text() for text in said.texts)
    assert (title, reason) == ("Fig. 4 is not drawn", "trial i_1: raw/i_1.mcap: $no$ such_file^")


def test_a_figure_names_below_it_the_trials_that_it_lacks(tmp_path):
    """Behind what its data are, so that nothing of the figure is covered or moved."""
    trials = [f"trial_{i}" for i in range(6)]
    draw_table("fig8", plotted("fig8"), [tmp_path / "f.svg"], trials, "Simulated data: campaign a")
    said = "Simulated data: campaign a. Without 6 refused: trial_0, trial_1, trial_2, trial_3 and 2 more"
    assert said in (tmp_path / "f.svg").read_text(encoding="utf-8")
    figure = fig8.draw(plotted("fig8"))
    box = write_footer(figure, said)
    figure.draw_without_rendering()
    assert figure.texts[-1].get_text().replace("\n", " ") == said
    assert figure.texts[-1].get_window_extent().y1 < 0, "below the page of the figure"
    assert box.y0 < 0


def test_unknown_figures_and_formats_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"no figure 'fig2'; there are fig3"):
        draw_figure("fig2", tmp_path / "t.csv", [])
    with pytest.raises(InputError, match=r"f\.jpg: figures are written as \.pdf, \.svg, \.png"):
        draw_table("fig8", plotted("fig8"), [tmp_path / "f.jpg"])


@pytest.mark.parametrize("name", [n for n, figure in FIGURES.items() if not figure.own_rule and not figure.beside])
def test_plotted_numbers_are_written_from_the_result_table_that_the_list_names(name, tmp_path):
    module, table = drawing_of(name), stored(FIGURES[name].table)
    write_table(table, tmp_path / "table.csv")
    plot_numbers(name, tmp_path / "table.csv", tmp_path / f"{name}.csv", 340.0 if FIGURES[name].option else None)
    written = read_table(tmp_path / f"{name}.csv", required=module.columns)
    assert written.equals(plotted(name).cast(dict(written.schema)))
    write_table(table.drop(module.needs[-1]), tmp_path / "table.csv")
    with pytest.raises(InputError, match=rf"table\.csv: no column '{module.needs[-1]}'"):
        plot_numbers(name, tmp_path / "table.csv", tmp_path / f"{name}.csv")


# Captions say in words what the figures show: in numbers of their tables, with names as text.


@pytest.mark.parametrize(
    ("name", "markdown"),
    [
        ("impedance_K100_B2.5", r"impedance\_K100\_B2.5"),
        ("<img src=x onerror=alert(1)>", r"\<img src=x onerror=alert(1)\>"),
        ("[l](http://x)", r"\[l\](http\://x)"),
        ("www.x.org", r"www\.x.org"),
        ("$K_d$ &lt; a--b `c` *d*", r"\$K\_d\$ \&lt; a-\-b \`c\` \*d\*"),
        ("two\nlines\u2028and\tmore", "two lines and more"),
        ("back\\slash", r"back\\slash"),
    ],
)
def test_a_name_in_markdown_is_text_sign_by_sign(name, markdown):
    assert as_text(name) == markdown


def test_numbers_have_the_digits_that_their_intervals_leave():
    assert with_interval(299.123, 298.21, 300.04, "N·m/rad") == "299.12 N·m/rad (95 % interval 298.21 to 300.04)"
    assert with_interval(-0.0012, -0.02, 0.0176, "kg·m²") == "−0.001 kg·m² (95 % interval −0.020 to 0.018)"
    assert with_interval(3.0, None, None, "N·m/rad") == "3 N·m/rad"
    assert with_sd(338.4, 20.2, "N·m/rad") == "338 ± 20 N·m/rad"
    assert rounded_number(-0.001, 2) == "0.00"


def test_doubtful_trials_are_counted_and_named_and_of_many_the_first():
    table = pl.DataFrame({"trial": [f"t_{k}" for k in range(12)], "doubtful": ["VAF 80"] * 10 + ["", None]})
    said = doubtful_said(table, "drawn open")
    assert said.startswith(r"Doubtful, drawn open: 10 of 12 fits (t\_0, t\_1,")
    assert said.endswith(r"t\_5 and 4 more), for VAF.")
    assert doubtful_said(table.tail(1), "drawn open") == "No fit is doubtful."
    assert listed_text(["a", "b", "a"]) == "a, b"


def test_each_figure_has_a_section_a_missing_one_its_reason_and_the_kind_of_data_stands_there_once(tmp_path):
    lost = Refusal("<b>i_1", "raw/i_1.mcap", "ingest", "refused", "raw/i_1.mcap: no such file", "copy it")
    tables = {name: tmp_path / f"{name}.csv" for name in ("fig4", "fig5", "fig7", "walking_page")}
    write_refusals([lost], tables["fig4"])
    write_table(plotted("fig7").clear(), tables["fig7"])
    for name in ("fig5", "walking_page"):
        write_table(plotted(name), tables[name])
    write_refusals([lost], tmp_path / "row.csv")
    shown = {"fig5": [tmp_path / "row.csv"], "walking_page": [tables["fig5"]]}
    write_captions(tables=tables, shown=shown, footer="Simulated data: campaign a_b", output=tmp_path / "c.md")
    page = (tmp_path / "c.md").read_text(encoding="utf-8")
    assert page.count(r"Simulated data: campaign a\_b.") == page.count("Simulated") == 1
    sections = {part.split("\n")[0]: part for part in page.split("\n## ")[1:]}
    assert list(sections) == ["Fig. 4", "Fig. 5", "Fig. 7", "Walking page"]
    assert r"not drawn. \<b\>i\_1: raw/i\_1.mcap: no such file." in sections["Fig. 4"]
    assert "not drawn. No trial of the campaign has the numbers" in sections["Fig. 7"]
    assert sections["Fig. 5"].endswith("Without 1 trial whose recordings or fits were refused: \\<b\\>i\\_1.\n")
    assert "Without" not in sections["Walking page"]


def test_the_metadata_of_the_tables_lead_to_the_captions_where_there_are_figures(tmp_path):
    for tables in (["tables/belt.csv", "figures/fig3.csv"], ["tables/belt.csv"]):
        write_table_metadata(dict.fromkeys(ABOUT_MEANING, "made"), tables, tmp_path / "m.json")
        content = json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))
        assert (content.get("rdfs:seeAlso") == {"@id": "figures/captions.md"}) == (len(tables) == 2)
        assert [table["url"] for table in content["tables"]] == tables


@pytest.mark.parametrize("name", FIGURES)
def test_a_caption_is_one_paragraph_in_which_no_name_of_a_file_is_markup(name, tmp_path):
    table = plotted(name)
    hostile = pl.lit("<img src=x onerror=alert(1)> *")
    columns = [column for column in ("joint", "controller", "group", "trajectory") if column in table.columns]
    trials = pl.when(pl.col("trial").is_in([MEAN_SLOPE, "ensemble"])).then("trial").otherwise(hostile + pl.col("trial"))
    if "trial" in table.columns:
        table = table.with_columns(trial=trials)
    table = table.with_columns(pl.when(pl.col(c).is_not_null()).then(hostile + pl.col(c)).alias(c) for c in columns)
    write_table(table, tmp_path / "t.csv")
    said = caption_of(name, tmp_path / "t.csv")
    assert re.findall(r"(?<!\\)[<>*]|\n|[^.]$", said) == [], said
