"""Figures show the numbers of their tables, with ticks within their limits and looks that are told
apart in grey."""

import re
from functools import cache
from itertools import product

import matplotlib as mpl
import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from matplotlib.figure import Figure

from osl_analysis.commands.figure import (
    caption_of,
    draw_figure,
    draw_table,
    plot_numbers,
    write_captions,
)
from osl_analysis.errors import InputError
from osl_analysis.figures import FIGURES, drawing_of, names, not_drawn, style, ticks
from osl_analysis.figures.captions import as_text
from osl_analysis.figures.frequency import (
    DESIRED,
    LINEAR_MODEL,
    over_amplitudes,
    response_curve,
)
from osl_analysis.figures.quasi_static import MEAN_SLOPE
from osl_analysis.figures.saved import write_footer
from osl_analysis.figures.style import LOOKS, SINGLE_COLUMN, paper_style
from osl_analysis.refusal import Refusal, write_refusals
from osl_analysis.table import read_table, write_table

fig3, fig4, fig5, fig6, fig7, fig8, fig9 = (drawing_of(f"fig{number}") for number in range(3, 10))
torque_angle = drawing_of("torque_angle")
walking_page = drawing_of("walking_page")
BELTS = [f"belt_{number:02d}" for number in range(1, 11)]


def stored(name):
    """A small made-up table: of results, or of a figure's plotted numbers."""
    return read_table(ROOT / f"tests/figure_tables/{name}.csv")


def time_series():
    time = np.arange(0, 10, 0.01)
    torque = 30 * np.sin(8 * time)
    table = pl.DataFrame(
        {"time": time, "theta_deg": torque / 5, "torque": torque, "torque_model": 0.99 * torque}
    )
    none, model = pl.lit(None, pl.String), pl.lit("second-order system")
    table = table.with_columns(doubtful=pl.lit(""), trial=pl.lit("k300"), model=model)
    condition = {"controller": pl.lit("compensated"), "K_d": 300.0, "B_d": 5.0}
    return table.with_columns(chosen=none, joint=pl.lit("ankle"), side=none, **condition)


def response_table():
    frequency_hz = np.arange(1.0, 6.0)
    admittance = np.full(5, 3.5e-3 - 2e-3j)
    labels = [(DESIRED, None), *((LINEAR_MODEL, controller) for controller in LOOKS)]
    curves = [response_curve(*label, frequency_hz, lambda _: admittance, PLACE) for label in labels]
    return fig7.points(over_amplitudes(stored("response")), curves)


def torque_angle_table():
    table = stored("torque_angle")
    return torque_angle.points(
        table.drop("joint", "side", "doubtful"), table.unique("trial", maintain_order=True)
    )


PLACE = (None, None)  # joint and side
CAMS = [f"both_cams_{5 * number:02d}mm" for number in range(11)]
PLOTTED = {
    "fig4": time_series, "torque": time_series, "fig7": response_table,
    "torque_angle": torque_angle_table,
    "fig9": lambda: fig9_points(340.0),
    "gain_grid": lambda: stored("impedance").select("K_d", "B_d", B_1_joint=pl.col("K") / 9),
}  # fmt: skip


def plotted(name):
    """The plotted numbers of a figure: of its row in `PLOTTED`, of tests/figure_tables/NAME.csv, or
    by its `points` of a result table that stands there."""
    if name in PLOTTED:
        return PLOTTED[name]()
    if (ROOT / f"tests/figure_tables/{name}.csv").is_file():
        return stored(name)
    return drawing_of(name).points(stored(FIGURES[name].table))


def texts(figure):
    return " ".join(text.get_text() for text in figure.findobj(lambda a: hasattr(a, "get_text")))


def scattered(ax, label):
    """Places (n, 2), faces (n, 4) and links (n,) of the points with that label."""
    (points,) = [artist for artist in ax.collections if artist.get_label() == label]
    return np.asarray(points.get_offsets()), points.get_facecolor(), points.get_urls()


def links_to(trials):
    return [f"../report.html#trial={trial}" for trial in trials]


def walking_fits(n=31, group="all"):
    """Perturbations `walk_1` ... of a group: K from 300 on, each 2 more; the second is doubtful."""
    number = np.arange(n)
    rows = {
        "trial": [f"walk_{k + 1}" for k in number],
        "K": 300 + 2.0 * number,
        "B": 4 + 0.02 * number,
    }
    doubtful = ["VAF 80" if k == 1 else "" for k in number]
    return pl.DataFrame(rows | {"I": 1e-3 * number, "group": group, "doubtful": doubtful})


def fig9_points(commanded_K=None, summary=None):
    table = stored("walking_summary") if summary is None else summary
    return fig9.points(table, walking_fits(), commanded_K)


def fits_with_ranges():
    """Fits with ranges over amplitudes, viscous damping, and doubts of the two trials of one
    condition."""
    ends = {
        f"{q}_amplitudes_{end}": pl.col(q) + step
        for q in "KB"
        for end, step in (("low", -7.0), ("high", 5.0))
    }
    reason = pl.when(K_d=100, B_d=0).then(pl.lit("VAF 80 is below 90"))
    rubs = {
        f"B_viscous{end}": pl.col("B") + step
        for end, step in (("", -0.4), ("_low", -0.5), ("_high", -0.35))
    }
    return stored("impedance").with_columns(**ends, **rubs, doubtful=reason)


def in_amplitudes():
    """Fig. 5 of them."""
    return fig5.points(fits_with_ranges())


def both_branches():
    table, back = stored("fig3"), pl.col("trial") != MEAN_SLOPE
    returned = table.filter(back).with_columns(
        branch=pl.lit("unloading"), deviation=pl.col("deviation") - 0.5
    )
    return pl.concat([table.filter(back), returned, table.filter(~back)])


def strays(name="belt_05"):
    """Fig. 3 with one belt whose loop leaves the others."""
    away = (
        pl.when(trial=name)
        .then(pl.col("deviation") - 20 * pl.col("theta_s_deg"))
        .otherwise("deviation")
    )
    return both_branches().with_columns(deviation=away)


def left_out():
    outside = pl.col("time").is_between(2, 3) | (pl.col("time") > 9)
    return time_series().with_columns(torque_model=pl.when(~outside).then("torque_model"))


# of a condition's interval [N*m/rad]
HALF = 1.96 * pl.coalesce("total_sd", "noise_sd") / np.sqrt(2)
ENDS = {"magnitude": (pl.col("magnitude") - HALF, pl.col("magnitude") + HALF)}
ENDS["phase_deg"] = tuple(
    pl.col("phase_deg") + sign * (HALF / pl.col("magnitude")).degrees() for sign in (-1, 1)
)
APART = [  # the structures' distance from the measured impedance, by the law of cosines
    (pl.col("magnitude") ** 2 + pl.col(f"magnitude_{m}") ** 2
     - 2 * pl.col("magnitude") * pl.col(f"magnitude_{m}")
     * (pl.col(f"phase_deg_{m}") - pl.col("phase_deg")).radians().cos()).sqrt() for m in ("eq15",
     "eq9")
]  # fmt: skip
OBSERVED = ("{}", "{}_low", "{}_high", "{}_amplitudes_low", "{}_amplitudes_high")
OF_GROUP = ("estimate", "ensemble", "ensemble_low", "ensemble_high", "mean", "commanded")
SHOWN = [
    # figure, table (None: as stored), panel, its rows, horizontal axis (None: no numbers of the
    # table), vertical axis
    ("gain_grid", None, 0, True, "K_d", ("B_1_joint",)), ("torque", None, 0, True, "time",
     ("torque", "torque_model")),
    ("torque", None, 1, True, "time", (pl.col("torque") - pl.col("torque_model"),)),
    ("fig3", both_branches, 0, True, "theta_s_deg", ("torque",)),
    ("fig3", both_branches, 1, pl.col("trial") != MEAN_SLOPE, "theta_s_deg", ("deviation",)),
    ("fig4", left_out, 0, True, "time", ("theta_deg",)),
    ("fig4", left_out, 1, True, "time", ("torque", "torque_model")),
    ("fig4", left_out, 2, True, "time", (pl.col("torque") - pl.col("torque_model"),)),
    *(("fig5", in_amplitudes, k, True, None, [*(one.format(q) for one in OBSERVED), f"{q}_d"])
      for k, q in enumerate("KB")),
    ("fig5", in_amplitudes, 1, True, None, ("B_viscous",)),
    ("fig6", None, 0, True, None,
     (100 - pl.col("VAF"), 100 - pl.col("VAF").median().over("controller"))),
    *(("fig7", response_table, k, True, "frequency_hz", [one.format(q) for one in OBSERVED])
      for k, q in enumerate(("magnitude", "phase_deg"))),
    *(("fig8", None, k, True, "phase", (f"{q}_d", f"{q}_1_joint")) for k, q in enumerate("KB")),
    *(("fig9", None, k, pl.col("quantity") == q, None, OF_GROUP) for k, q in enumerate("KBI")),
    *(("fig9", None, k, pl.col("quantity") == q, None,
       (pl.col("mean") - pl.col("sd"), pl.col("mean") + pl.col("sd"))) for k,
       q in enumerate("KBI")),
    ("torque_angle", torque_angle_table, 0, True, "angle_deg", ("torque", "desired_torque")),
    ("torque_angle", torque_angle_table, 1, pl.col("branch") == "loading", "angle_deg",
     ("stiffness",)),
    *(("walking_page", None, k, pl.col("panel") == panel, "x", ("mean",))
      for k, panel in enumerate(("angle", "torque", "response angle", "response torque"))),
    *(("walking_page", None, k, pl.col("panel") == panel, "x",
       (pl.col("mean") - pl.col("sd"), pl.col("mean") + pl.col("sd"))) for k,
       panel in enumerate(("angle", "torque"))),
]  # fmt: skip


TABLE_OF = {name: table for name, table, *_ in SHOWN}


@cache
def drawn_once(name, table=None):
    """Plotted numbers, and their figure as it is written."""
    numbers = table() if table else plotted(name)
    figure = drawing_of(name).draw(numbers)
    style.lay_out(figure)
    return numbers, figure


def test_the_label_of_an_axis_stays_where_matplotlib_draws_it():
    """At the resolution of the layout, beside the numbers of the axis."""
    figure = drawing_of("fig8").draw(plotted("fig8"))
    by_matplotlib = drawing_of("fig8").draw(plotted("fig8"))

    style.lay_out(figure)
    with paper_style():
        by_matplotlib.set_dpi(style.PAPER["savefig.dpi"])
        by_matplotlib.draw_without_rendering()

    places = []
    for drawn in (figure, by_matplotlib):
        labels = [axis.get_label() for ax in drawn.axes for axis in (ax.xaxis, ax.yaxis)]
        places.append([label.get_window_extent().bounds for label in labels if label.get_text()])
    np.testing.assert_allclose(places[0], places[1], rtol=0, atol=0.01)


@pytest.mark.parametrize(("name", "table", "panel", "rows", "x", "columns"), SHOWN)
def test_every_number_of_a_figure_stands_in_its_panel_at_its_place(
    name, table, panel, rows, x, columns
):
    numbers, figure = drawn_once(name, table)

    drawn = places_in(figure.axes[panel])

    rows_of_panel = numbers.filter(rows)
    for column in columns:
        place = {"x": pl.lit(0.0) if x is None else x, "y": column}
        wanted = rows_of_panel.select(**place).drop_nulls().to_numpy()
        assert len(wanted) or column is not columns[0]
        is_there = is_near(drawn[:, 1], wanted[:, 1])
        if x is not None:
            is_there &= is_near(drawn[:, 0], wanted[:, 0])
        assert is_there.any(axis=1).all(), f"{column}: some of it is not drawn"


def places_in(ax):
    """Every place (n, 2) at which something is drawn: of lines, points, bars and edges of areas."""
    places = [line.get_xydata() for line in ax.lines]
    for part in ax.collections:
        places.append(np.asarray(part.get_offsets()))
        if np.size(part.get_offsets()) <= 2:  # no points
            places += [path.vertices for path in part.get_paths()]
    drawn = np.concatenate(places)
    return drawn[~np.isnan(drawn).any(axis=1)]  # what is not drawn is no place


def is_near(drawn, wanted):
    """Whether each of the wanted numbers (m,) is each of the drawn ones (n,), as (m, n)."""
    return np.isclose(drawn[None, :], wanted[:, None], rtol=1e-9, atol=1e-9)


def test_every_figure_has_a_row_that_says_what_it_shows():
    without_row = {*FIGURES} - {name for name, *_ in SHOWN}
    assert without_row == set(), "add a row to SHOWN for each panel"


def test_a_stiffness_is_drawn_as_doubtful_where_the_doubt_concerns_it():
    def dashes(doubt):
        table = torque_angle_table().with_columns(
            doubtful=pl.lit(doubt), desired=pl.lit(None, pl.String)
        )
        return [
            {line.get_linestyle() for line in ax.lines if len(line.get_xdata()) > 2}
            for ax in torque_angle.draw(table).axes
        ]

    assert dashes("") == [{"-"}, {"-"}]
    torque, stiffness = dashes("torque zero not stated")
    assert (torque == {"-"}, stiffness) == (False, {"-"})
    assert dashes("torque zero not stated; hysteresis")[1] != {"-"}


NONE, NOTE = pl.lit(None, pl.Float64), pl.lit("x")
DOUBT = pl.when(pl.col("trial").is_in(["belt_02", "belt_07", "w2"])).then(
    pl.lit("VAF 80 is below 90")
)
LETTERING = [
    # figure, table, what changes, which numbers and marks stand in the figure, and which do not
    ("fig3", both_branches, {}, ["= 685.6 (682.9 to 688.3) N·m/rad", "loop area 0.04510"],
     ["Doubtful"]),
    ("fig3", both_branches, {"K_s_low": NONE, "K_s_high": NONE, "doubtful": DOUBT},
     ["= 686 N·m/rad", "Doubtful fit ($n$ = 2)"], ["to 688"]),
    ("fig4", left_out, {"K_d": NONE, "B_d": NONE, "controller": pl.lit(None, pl.String)},
     ["Trial k300", "Not fitted"], ["$K_d$", "(doubtful)"]),
    ("fig4", time_series, {"doubtful": NOTE}, ["(doubtful)"], ["Not fitted"]),
    ("fig5", lambda: plotted("fig5").head(4),
     {"K_d": NONE, "B_d": NONE, "trial": pl.format("w{}", pl.col("K").rank())},
     ["w1.0", "w4.0"], ["Desired", "Range over amplitudes"]),
    ("fig5", in_amplitudes, {}, ["Range over amplitudes", "Open: doubtful"], [names.LINEAR_MODEL]),
    ("fig6", None, {"doubtful": NOTE}, ["48 fits of 16 trials", "Open"], []),
]  # fmt: skip


@pytest.mark.parametrize(("name", "table", "changes", "present", "absent"), LETTERING)
def test_a_figure_has_the_numbers_and_marks_of_what_is_drawn(name, table, changes, present, absent):
    numbers = table() if table else plotted(name)

    lettering = texts(drawing_of(name).draw(numbers.with_columns(**changes)))

    assert [part for part in present if part not in lettering] == []
    assert [part for part in absent if part in lettering] == []


def test_no_line_of_fig3_goes_from_the_end_of_a_cycle_to_the_next_one():
    cycle = both_branches().filter(trial="belt_01").sort("branch")
    mean = both_branches().filter(trial=MEAN_SLOPE)

    loading, _ = fig3.draw(pl.concat([cycle, cycle, mean])).axes[1].lines[1:]

    drawn = np.isfinite(loading.get_ydata())
    assert np.count_nonzero(np.diff(drawn.astype(int)) == 1) + drawn[0] == 2


def test_doubtful_belts_are_dashed_and_one_that_strays_is_named():
    belts, loops = fig3.draw(
        both_branches().with_columns(-pl.col("theta_s_deg"), doubtful=DOUBT)
    ).axes
    is_doubtful = [name in ("belt_02", "belt_07") for name in BELTS]
    branches = [a for a in loops.lines if len(a.get_xdata())][1::2]
    assert [a.is_dashed() for a in branches] == is_doubtful
    assert [a.get_url() for a in branches] == links_to(BELTS)
    assert sum(a.is_dashed() for a in belts.lines[:-1]) == 2
    loops = fig3.draw(strays()).axes[1]
    assert [a.get_text() for a in loops.texts if "belt" in a.get_text()] == ["belt_05"]


def test_a_doubtful_trial_of_torque_over_angle_is_dashed_and_each_leads_to_its_trial():
    left, right = torque_angle.draw(torque_angle_table()).axes

    assert [line.is_dashed() for line in right.lines[:11]] == [name == CAMS[3] for name in CAMS]
    assert [line.get_url() for line in left.lines[:22:2]] == links_to(CAMS)


def test_a_line_of_a_crossing_leads_to_it_and_is_dashed_where_it_is_doubtful():
    page = walking_page.draw(stored("walking_page").with_columns(doubtful=DOUBT)).axes[2]
    assert [a.get_url() for a in page.lines if a.get_alpha()] == links_to(["w1", "w2"])
    assert [a.get_ydata().max() for a in page.lines if a.is_dashed()] == pytest.approx([1.1 * 60])


@pytest.mark.parametrize("name", ["fig6", "fig7"])
def test_a_marker_leads_to_its_trial_and_is_open_where_its_fit_is_doubtful(name):
    table, figure = drawn_once(name, TABLE_OF[name])
    for ax, look in product(figure.axes, LOOKS.values()):
        check_markers(ax, look, table.drop_nulls("trial"))


def test_a_marker_above_a_desired_value_leads_to_its_trial_too():
    table, figure = drawn_once("fig5", TABLE_OF["fig5"])
    stiffness, damping = figure.axes
    for look in LOOKS.values():
        check_markers(stiffness, look, table.sort("K_d", "B_d"))
        check_markers(damping, look, table.sort("B_d", "K_d"))


def check_markers(ax, look, table):
    """Each marker of a controller leads to its row's trial, and is open where this is doubtful."""
    rows = table.filter(controller=look.label.lower())
    _, faces, links = scattered(ax, look.label)
    assert links == links_to(trial.replace(" ", "%20") for trial in rows["trial"])
    opened = (np.broadcast_to(faces, (len(links), 4)) == 1).all(axis=1)
    assert opened.tolist() == [bool(text) for text in rows["doubtful"]]


def segments(ax):
    """The lines (2, 2) that bars of a panel are made of, with their widths."""
    lines = []
    for bars in ax.collections:
        if hasattr(bars, "get_segments"):
            lines += [(segment, bars.get_linewidth()[0]) for segment in bars.get_segments()]
    return lines


@pytest.mark.parametrize(("panel", "symbol", "other"), [(0, "K", "B"), (1, "B", "K")])
def test_fig5_shows_each_trial_above_its_desired_value_and_beside_all_others(panel, symbol, other):
    table, figure = drawn_once("fig5", in_amplitudes)
    ax = figure.axes[panel]

    level = [segment for segment, _ in segments(ax) if segment[0][1] == segment[1][1]]
    places = []
    for controller, look in LOOKS.items():
        points, *_ = scattered(ax, look.label)
        beside = [line[0][1] for x, _ in points for line in level if line[0][0] < x < line[1][0]]
        rows = table.filter(controller=controller).sort(f"{symbol}_d", f"{other}_d")
        assert beside == rows[f"{symbol}_d"].to_list()
        np.testing.assert_allclose(points[:, 1], rows[symbol])
        places += list(points[:, 0])
    assert {*np.diff(sorted(places)).round(9)} == {1, 1.8, 3.2}
    labels = [label.get_text() for label in ax.get_xticklabels()]
    assert labels == [f"{value:g}" for value in sorted(set(table[f"{symbol}_d"]))]


def test_without_a_trial_that_is_not_doubtful_there_is_neither_median_nor_mean_slope():
    doubtful = stored("impedance").with_columns(doubtful=pl.lit("late torque"))
    belts = stored("fig3").filter(pl.col("trial") != MEAN_SLOPE)
    belts = belts.with_columns(deviation=pl.lit(None, pl.Float64), doubtful=pl.lit("late torque"))

    below = [
        label.get_text() for label in fig6.draw(fig6.points(doubtful)).axes[0].get_xticklabels()
    ]
    (text,) = fig3.draw(belts).axes[1].texts

    assert all(label.endswith("all doubtful") for label in below)
    assert text.get_text().startswith("No mean slope")


def test_fig6_has_points_that_touch_no_other():
    ax = fig6.draw(fig6.points(stored("impedance").reverse())).axes[0]

    ax.figure.draw_without_rendering()
    for look in LOOKS.values():
        printed = ax.transData.transform(scattered(ax, look.label)[0]) / ax.figure.dpi * 72
        distance = np.hypot(*(printed[:, None, :] - printed[None, :, :]).transpose(2, 0, 1))
        assert 4.8 < distance[np.triu_indices(48, 1)].min() < 6, "the largest and a small gap"


def test_fig6_has_a_perfect_fit_at_the_end_of_its_axis():
    vaf = pl.Series([float("nan"), 99.99999999, 99.0, 97.0])
    fits = stored("impedance").filter(amplitude_deg=2).head(4)

    ax = fig6.draw(fig6.points(fits.with_columns(VAF=vaf))).axes[0]

    heights = scattered(ax, "Compensated")[0][:, 1]
    np.testing.assert_allclose(heights, [1e-4, 1, 3], rtol=1e-6)
    assert ax.get_ylim()[0] > 3 > 1e-4 > ax.get_ylim()[1]
    letters = [label.get_text() for label in ax.get_yticklabels()]
    assert letters == ["≥ 99.9999", "99.999", "99.99", "99.9", "99"]


def test_fig6_shows_fits_over_all_amplitudes_where_there_are_no_others():
    whole = stored("impedance").filter(pl.col("amplitude_deg").is_null())

    assert len(fig6.points(whole)) == 32


@pytest.mark.parametrize(("name", "table", "message"), [
    ("fig5", stored("impedance").drop_nulls("amplitude_deg"), "no fit over all amplitudes"),
    ("fig6", stored("impedance").with_columns(VAF=float("nan")), "no VAF of one amplitude"),
    ("fig7", pl.DataFrame({"K_d": [100.0, 200.0], "B_d": 0.0}), "2 desired impedances"),
    ("fig9", stored("walking_summary").with_columns(mean=pl.lit(None, pl.Float64)),
     "no perturbation has a fit"),
])  # fmt: skip
def test_a_table_without_what_a_figure_shows_is_refused(name, table, message):
    beside = {"fig7": [[]], "fig9": [walking_fits(0)]}.get(name, [])
    with pytest.raises(InputError, match=message):
        drawing_of(name).points(table, *beside)


def test_an_admittance_is_drawn_by_its_size_and_phase_over_logarithmic_axes():
    numbers, figure = drawn_once("fig7", response_table)

    polar = np.hypot(3.5e-3, 2e-3), np.rad2deg(np.arctan2(-2, 3.5))
    assert numbers.select("magnitude", "phase_deg").row(-1) == pytest.approx(polar)
    letters = [tick.get_text() for tick in figure.axes[0].get_yticklabels()]
    assert letters == ["3.5", "4", "4.5", "5"], "in thousandths"


def test_inertia_whose_sign_tells_is_drawn_from_zero():
    _, figure = drawn_once("fig9")

    stiffness, damping, inertia = figure.axes
    assert stiffness.get_ylim()[0] > 250
    assert damping.get_ylim()[0] > 2
    assert inertia.get_ylim()[0] <= 0
    assert "10$^{-3}$ kg·m$^2$" in inertia.get_ylabel()
    assert inertia.yaxis.get_major_formatter()(0.025) == "25"


def test_what_was_not_fitted_is_shaded_and_no_line_crosses_a_gap():
    lost = time_series().filter(~pl.col("time").is_between(2, 3))

    for ax in fig4.draw(lost).axes:
        assert np.isnan(ax.lines[-1].get_ydata()).sum() == 1
    for ax in drawn_once("fig4", left_out)[1].axes:
        spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in ax.patches]
        np.testing.assert_allclose(spans, [(2, 3), (9.01, 9.99)], atol=1e-9)


def three_groups():
    """K of the second group is twice that of the first, the third has no result; crossings may have
    no fit or group."""
    one = stored("walking_summary").with_columns(group=pl.lit("K_d 200"), commanded=pl.lit(200.0))
    two = one.with_columns(
        pl.col("mean", "low", "high") * 2, group=pl.lit("K_d 400"), commanded=pl.lit(400.0)
    )
    none = one.with_columns(mean=None, low=None, high=None, group=pl.lit("K_d 600"))
    lost = walking_fits(3).with_columns(
        K=pl.Series([None, np.nan, 310.0]), group=pl.Series(2 * ["K_d 400"] + [None])
    )
    fits = [walking_fits(31, "K_d 200"), walking_fits(31, "K_d 400"), lost]
    return pl.concat([one, two, none], how="diagonal_relaxed"), pl.concat(fits)


def test_fig9_shows_every_group_with_a_result_and_what_it_was_commanded():
    summary, fits = three_groups()

    table = fig9.points(summary, fits, 340.0)

    panel, _, lowest = fig9.draw(table).axes
    estimates = [line.get_ydata()[0] for line in panel.lines if line.get_marker() == "s"]
    commands = [line.get_ydata()[0] for line in panel.lines if line.get_label() == "Commanded"]
    assert table["estimate"].count() == table["estimate"].is_finite().sum() == 3 * 62
    assert (estimates, commands) == ([338.0, 676.0], [200.0, 400.0])
    groups = [label.get_text() for label in lowest.get_xticklabels()]
    assert groups == ["$K_d$ 200 (31)", "$K_d$ 400 (31)"]


def test_the_sheet_s_command_goes_before_the_campaign_s():
    sheet = stored("walking_summary").with_columns(commanded=pl.lit(200.0))

    def commanded(table):
        return table.filter(pl.col("commanded").is_not_null(), quantity="K")["commanded"].unique()

    assert commanded(fig9_points(340.0)).to_list() == [340.0]
    assert commanded(fig9_points(340.0, sheet)).to_list() == [200.0]


def test_fig8_shows_stance_alone():
    gains = stored("gains")
    swing = gains.tail(1).with_columns(phase=pl.lit(0.63), K_d=pl.lit(1e6))

    assert fig8.points(pl.concat([gains, swing])).equals(fig8.points(gains))
    assert len(fig8.points(swing.with_columns(phase=0.62))) == 1


def test_groups_have_a_page_each():
    page = stored("walking_page")
    axes = walking_page.draw(
        pl.concat([page, page.with_columns(group=pl.lit("slow"), mean=2 * pl.col("mean"))])
    ).axes
    (one,), (two,) = (
        [a.get_ydata() for a in ax.lines if a.get_label() == "Mean response"]
        for ax in (axes[2], axes[6])
    )
    np.testing.assert_allclose(two, 2 * one)
    windows = [[(p.get_x(), p.get_x() + p.get_width()) for p in ax.patches] for ax in axes[:4:2]]
    assert windows == [[(26, 34), (40, 54)], [(-100, -40), (0, 100)]]


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_fits_the_page_and_reads_at_8_points(name):
    _, figure = drawn_once(name, TABLE_OF.get(name))

    texts_of_figure = figure.findobj(lambda artist: hasattr(artist, "get_fontsize"))
    sizes = {text.get_fontsize() for text in texts_of_figure if text.get_text()}
    with paper_style():
        inked, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    margins = (inked.x0, inked.y0, width - inked.x1, height - inked.y1)
    assert width in (SINGLE_COLUMN, 7.16)
    assert sizes == {8.0}
    assert min(margins) > -0.01, "no lettering is cut off"


def test_a_figure_is_the_same_whatever_the_users_matplotlib_settings(tmp_path):
    plain, other = ([tmp_path / f"{n}.{suffix}" for suffix in ("pdf", "svg")] for n in "ab")
    draw_table("fig8", plotted("fig8"), plain)

    with mpl.rc_context({"font.size": 20, "pdf.fonttype": 3, "savefig.bbox": "tight"}):
        draw_table("fig8", plotted("fig8"), other)

    assert [path.read_bytes() for path in other] == [path.read_bytes() for path in plain]
    assert b"/Type3" not in plain[0].read_bytes()


def test_a_figure_without_numbers_says_so_with_trial_and_reason(tmp_path):
    lost = Refusal(
        "i_1", "raw/i_1.mcap", "ingest", "refused", "raw/i_1.mcap: $no$ such_file^", "copy it"
    )
    write_refusals([lost], tmp_path / "fig4.csv")
    outputs, found = [tmp_path / f"fig4.{suffix}" for suffix in ("pdf", "svg", "png")], []
    for _ in range(2):
        draw_figure("fig4", tmp_path / "fig4.csv", outputs, [lost])
        found.append([path.read_bytes() for path in outputs])
    assert found[0] == found[1]
    columns = {"figure": "fig4", "trial": "i_1", "file": "x", "reason": [lost.reason]}
    said = not_drawn.draw_not_drawn.draw(pl.DataFrame(columns))
    assert f"trial i_1: {lost.reason}" in texts(said)


def test_a_footer_stands_below_the_page_and_covers_nothing():
    figure = fig8.draw(plotted("fig8"))

    box = write_footer(figure, 30 * "Simulated data. ")

    figure.draw_without_rendering()
    footer = figure.texts[-1].get_window_extent()
    assert footer.y1 < 0
    assert footer.x0 >= 0
    assert box.y0 < 0


def test_an_unknown_figure_is_refused_with_those_that_there_are(tmp_path):
    with pytest.raises(InputError, match=r"no figure 'fig2'; there are fig3"):
        draw_figure("fig2", tmp_path / "t.csv", [])


def test_a_figure_is_written_in_three_formats_alone(tmp_path):
    with pytest.raises(InputError, match=r"f\.jpg: figures are written as \.pdf, \.svg, \.png"):
        draw_table("fig8", plotted("fig8"), [tmp_path / "f.jpg"])


@pytest.mark.parametrize("name", ["fig5", "fig7", "fig8", "torque_angle"])
def test_a_table_without_a_column_that_a_figure_needs_is_refused(name, tmp_path):
    *columns, missing = drawing_of(name).needs
    write_table(pl.DataFrame(dict.fromkeys(columns, 1.0)), tmp_path / "t.csv")

    with pytest.raises(InputError, match=rf"t\.csv: no column '{missing}'"):
        plot_numbers(name, tmp_path / "t.csv", tmp_path / "f.csv")


# Captions say what the figures show, and what is doubtful, with names as text.


@pytest.mark.parametrize(("name", "markdown"), [
    ("<img src=x onerror=alert(1)>", r"\<img src=x onerror=alert(1)\>"),
    ("[l](http://x) www.x.org", r"\[l\](http\://x) www\.x.org"),
    ("$K_d$ &lt; a--b `c` *d*", r"\$K\_d\$ \&lt; a-\-b \`c\` \*d\*"),
    ("two\nlines\u2028and\tmore\\", r"two lines and more\\"),
])  # fmt: skip
def test_a_name_in_markdown_is_text_sign_by_sign(name, markdown):
    assert as_text(name) == markdown


def test_each_figure_has_a_section_and_a_missing_one_its_reason(
    tmp_path,
):
    lost = Refusal(
        "<b>i_1", "raw/i_1.mcap", "ingest", "refused", "raw/i_1.mcap: no such file", "copy it"
    )
    tables = {name: tmp_path / f"{name}.csv" for name in ("fig4", "fig5", "fig7")}
    for name in ("fig4", "row"):
        write_refusals([lost], tmp_path / f"{name}.csv")
    write_table(plotted("fig7").clear(), tables["fig7"])
    write_table(plotted("fig5"), tables["fig5"])
    shown = {"fig5": [tmp_path / "row.csv"]}
    write_captions(
        tables=tables, shown=shown, footer="Simulated data: campaign a_b", output=tmp_path / "c.md"
    )
    page = (tmp_path / "c.md").read_text(encoding="utf-8")
    assert page.count(r"Simulated data: campaign a\_b.") == page.count("Simulated") == 1
    sections = {part.split("\n")[0]: part for part in page.split("\n## ")[1:]}
    assert list(sections) == ["Fig. 4", "Fig. 5", "Fig. 7"]
    assert r"not drawn. \<b\>i\_1: raw/i\_1.mcap: no such file." in sections["Fig. 4"]
    assert "not drawn. No impedance trial has a frequency response" in sections["Fig. 7"]
    assert sections["Fig. 5"].endswith(
        "Without 1 trial whose recordings or fits were refused: \\<b\\>i\\_1.\n"
    )


@pytest.mark.parametrize("name", FIGURES)
def test_a_caption_is_one_paragraph_in_which_no_name_of_a_file_is_markup(name, tmp_path):
    table, hostile = plotted(name), pl.lit("<img src=x onerror=alert(1)> *")
    columns = [
        column
        for column in ("joint", "controller", "group", "trajectory")
        if column in table.columns
    ]
    trials = (
        pl.when(pl.col("trial").is_in([MEAN_SLOPE, "ensemble"]))
        .then("trial")
        .otherwise(hostile + pl.col("trial"))
    )
    if "trial" in table.columns:
        table = table.with_columns(trial=trials)
    table = table.with_columns(
        pl.when(pl.col(c).is_not_null()).then(hostile + pl.col(c)).alias(c) for c in columns
    )
    write_table(table, tmp_path / "t.csv")
    said = caption_of(name, tmp_path / "t.csv")
    assert re.findall(r"(?<!\\)[<>*]|\n|[^.]$", said) == [], said


@pytest.mark.parametrize(("low", "high", "most", "expected"), [
    (1, 5, 6, [1, 2, 5]), (0.5, 6, 8, [0.5, 1, 2, 5]), (0.01, 100, 5, [0.01, 0.1, 1, 10, 100]),
    (0.1, 15, 8, [0.1, 0.2, 0.5, 1, 2, 5, 10]), (1e-4, 1e5, 5, [1e-4, 1e-2, 1, 1e2, 1e4]),
    (2.9, 3.11, 5, [2.9, 3.0, 3.1]), (0.012, 0.8, 4, [0.03, 0.1, 0.3]),
    (0.029, 3.1, 4, [0.1, 1]),
])  # fmt: skip
def test_ticks_of_a_logarithmic_axis_are_round(low, high, most, expected):
    axis = Figure().subplots().xaxis

    ticks.label_log_axis(axis, (low, high), most)

    assert axis.get_ticklocs() == pytest.approx(expected)


@pytest.mark.parametrize("phases", [[-10, -70], [12, 80], [0, 0]])
def test_0_stands_on_an_axis_of_phases(phases):
    ax = Figure().subplots()
    ax.plot(phases)

    ticks.label_phase_axis(ax)

    lowest, highest = ax.get_ylim()
    assert lowest < 0 < highest
    assert lowest <= min(phases) <= max(phases) <= highest
    assert 0 in np.round(ax.get_yticks(), 9)


def test_a_single_frequency_stands_in_the_middle_of_its_axis():
    ax = Figure().subplots()
    ax.plot([0, 0])

    ticks.label_frequency_axis(ax, pl.Series([3.0]), 6)

    low, high = ax.get_xlim()
    assert 1 < 3 / low == pytest.approx(high / 3)
    assert 3.0 in ax.get_xticks()


def test_no_two_controllers_look_alike():
    controllers = ["compensated", "uncompensated", *(f"c{number}" for number in range(12)), None]
    numbers = pl.Series("look", [None, None, *range(12), None], dtype=pl.Int64)

    looks = names.looks_in(pl.DataFrame({"controller": controllers}).with_columns(numbers))

    assert len({(look.colour, look.marker) for look in looks.values()}) == 15
    alone = names.looks_in(pl.DataFrame({"controller": ["c1"], "look": [1]}))
    assert alone["c1"] == looks["c1"], "the same in every figure"


def test_looks_are_numbered_by_the_names_of_further_controllers():
    numbers = names.look_numbers(pl.Series(["pd", "compensated", "a", None]))

    assert numbers.to_list() == [1, None, 0, None]


def test_a_long_name_is_drawn_with_its_beginning_and_end():
    assert names.drawn_name(20 * "a" + 20 * "b") == 18 * "a" + "…" + 9 * "b"


def test_the_words_of_an_svg_need_no_font(tmp_path):
    draw_table("fig5", plotted("fig5"), [tmp_path / "f.svg"])

    drawing = (tmp_path / "f.svg").read_text()

    assert "<text" not in drawing
    assert "<!-- Uncompensated -->" in drawing
