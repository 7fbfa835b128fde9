# SPDX-License-Identifier: Apache-2.0
"""Figures show the numbers of their tables, with ticks within their limits and looks that are told
apart in grey."""

from functools import cache

import matplotlib as mpl
import numpy as np
import polars as pl
import pytest
from conftest import ROOT, refused_with

from osl_analysis.base.table import NOT_ANALYSED, read_table, write_table, write_tables
from osl_analysis.bench.frequency_response import with_errors
from osl_analysis.commands.figure import (
    draw_figure,
    plot_numbers,
    write_captions,
    write_figure,
)
from osl_analysis.commands.figure import (
    fig4 as figure_4,
)
from osl_analysis.config.impedance_trajectory import STANCE_SHARE
from osl_analysis.figures import fig4, style
from osl_analysis.figures.drawing import (
    FIGURES,
    LINEAR_MODEL,
    caption_of,
    drawn,
    look_numbers,
    plotted_numbers,
)
from osl_analysis.figures.style import DOUBLE_COLUMN, SINGLE_COLUMN, paper_style
from osl_analysis.judge.findings import Finding, findings_table
from osl_analysis.judge.joining import joined
from osl_analysis.model.compensator import CONTROLLERS, PAPER_WEIGHT

CAMS = [f"both_cams_{5 * number:02d}mm" for number in range(11)]
NULL = pl.lit(None, pl.Float64)
NO_TEXT = pl.lit(None, pl.String)


def stored(name):
    """A small made-up table: of results, or of a figure's plotted numbers."""
    return read_table(ROOT / f"tests/figure_tables/{name}.csv")


def time_series():
    time = np.arange(0, 10, 0.01)
    torque = 30 * np.sin(8 * time)
    columns = {
        "time": time,
        "theta_deg": torque / 5,
        "torque": torque,
        "torque_model": 0.99 * torque,
        "is_doubtful": False,
        "trial": "k300",
        "controller": "compensated",
        "K_d": 300.0,
        "B_d": 5.0,
        "joint": "ankle",
        "side": None,
    }
    return pl.DataFrame(columns, schema_overrides={"side": pl.String})


def responses():
    return with_errors(stored("response"))


def response_table():
    """Measured responses beside the desired one, and linear models of 3.5 - 2j mrad/(N·m)."""
    looks = look_numbers(stored("response")["controller"])
    placed = responses().with_columns(looks, joint=NO_TEXT, side=NO_TEXT)
    Y = 3.5e-3 - 2e-3j
    model = {
        "curve": LINEAR_MODEL,
        "frequency_hz": np.arange(1.0, 6.0),
        "magnitude": abs(Y),
        "phase_deg": np.rad2deg(np.angle(Y)),
    }
    models = [pl.DataFrame({"controller": controller, **model}) for controller in CONTROLLERS]
    measured = plotted_numbers("fig7", placed, None, None, PAPER_WEIGHT)
    points = pl.concat([measured, *models], how="diagonal_relaxed")
    return points.with_columns(look_numbers(points["controller"]))


def torque_angle_table():
    table = stored("torque_angle")
    trials = table.unique("trial", maintain_order=True)
    open_loops = trials.filter(pl.col("doubtful").str.contains("closure"))["trial"]
    findings = [Finding("open_loop", "torque_angle", trial) for trial in open_loops]
    return plotted_numbers("torque_angle", table, joined(trials, "torque_angle", findings))


PLOTTED = {
    "fig4": time_series,
    "fig7": response_table,
    "torque_angle": torque_angle_table,
    "fig9": lambda: plotted_numbers(
        "fig9", stored("walking_summary"), walking_fits(), SOUND, RESPONSES, 340.0
    ),
}


def plotted(name):
    """The plotted numbers of a figure: of its row in `PLOTTED`, of tests/figure_tables/NAME.csv, or
    selected from a result table that stands there."""
    if name in PLOTTED:
        return PLOTTED[name]()
    if (ROOT / f"tests/figure_tables/{name}.csv").is_file():
        return stored(name)
    return plotted_numbers(name, stored(FIGURES[name].table))


def assert_whole(figure):
    """No lettering is cut off."""
    with paper_style():
        inked, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert min(inked.x0, inked.y0, width - inked.x1, height - inked.y1) > -0.01


def texts(figure):
    return " ".join(text.get_text() for text in figure.findobj(lambda a: hasattr(a, "get_text")))


def scattered(ax, label):
    """Places (n, 2), faces (n, 4) and links (n,) of the points with that label."""
    (points,) = [artist for artist in ax.collections if artist.get_label() == label]
    return np.asarray(points.get_offsets()), points.get_facecolor(), points.get_urls()


def links_to(trials):
    return [f"../report.html#trial={trial}" for trial in trials]


def walking_fits(n=31):
    """Perturbations `walk_1` ... of a group: K from 300 on, each 2 more; the second is doubtful."""
    number = np.arange(n)
    rows = {
        "trial": [f"walk_{k + 1}" for k in number],
        "K": 300 + 2.0 * number,
        "B": 4 + 0.02 * number,
    }
    fits = pl.DataFrame(rows | {"I": 1e-3 * number, "group": "all", "doubtful": ""})
    return joined(fits, "walking", [Finding("unexplained_torque", "walking", "walk_2")])


SOUND = pl.DataFrame(
    {"group": "all", "doubtful": "", "n_unperturbed": 12, "onset_phase": 0.386, "n": 31}
)
"""Groups without a doubt."""
RESPONSES = pl.DataFrame(
    {"group": "all", "trial": "ensemble", "time": np.arange(-3, 40) / 300, "torque_model": 1.0}
).with_columns(torque_model=pl.when(pl.col("time").is_between(0, 0.099)).then("torque_model"))
"""The mean response, fitted for 100 ms."""


def in_amplitudes(name="fig5"):
    """Fig. 5, or its supplement, of fits with ranges over amplitudes, viscous damping, and doubts
    of the two trials of one condition."""
    ends = {
        f"{q}_range_{end}": pl.col(q) + step
        for q in "KB"
        for end, step in (("low", -7.0), ("high", 5.0))
    }
    fits = stored("impedance").with_columns(**ends, B_viscous=pl.col("B") - 0.4)
    trials_of_condition = fits.filter(K_d=100, B_d=0)["trial"].unique()
    findings = [Finding("unexplained_torque", "impedance", trial) for trial in trials_of_condition]
    return plotted_numbers(name, joined(fits, "impedance", findings))


def errors_in_amplitudes():
    return in_amplitudes("impedance_errors")


def both_branches():
    table = stored("fig3")
    returned = table.with_columns(branch=pl.lit("unloading"), torque=pl.col("torque") - 0.5)
    return pl.concat([table, returned])


def left_out():
    outside = pl.col("time").is_between(2, 3) | (pl.col("time") > 9)
    return time_series().with_columns(torque_model=pl.when(~outside).then("torque_model"))


OBSERVED = ("{}", "{}_low", "{}_high", "{}_range_low", "{}_range_high")
IS_MEAN = pl.col("estimator") == "mean of perturbations"
RESIDUAL = pl.col("torque") - pl.col("torque_model")
WITHIN_SD = (pl.col("mean") - pl.col("sd"), pl.col("mean") + pl.col("sd"))
SHOWN = [
    # figure, table (None: as stored), panel, its rows, horizontal axis (None: no numbers of the
    # table), vertical axis
    ("fig3", both_branches, 0, True, "theta_s_deg", ("torque",)),
    ("fig3", both_branches, 1, True, "theta_s_deg",
     (pl.col("torque") - pl.col("mean_slope") + pl.col("loop_shift"),)),
    ("fig4", left_out, 0, True, "time", ("theta_deg",)),
    ("fig4", left_out, 1, True, "time", ("torque", "torque_model")),
    ("fig4", left_out, 2, True, "time", (RESIDUAL,)),
    *(("fig5", in_amplitudes, k, True, None,
       [*(one.format(q) for one in OBSERVED), f"{q}_d"]) for k, q in enumerate("KB")),
    ("impedance_errors", errors_in_amplitudes, 0, pl.col("K_d") > 0, None,
     [100 * (pl.col(one.format("K")) / pl.col("K_d") - 1) for one in (*OBSERVED, "K_d_rendered")]),
    ("impedance_errors", errors_in_amplitudes, 1, True, None,
     [pl.col(one.format("B")) - pl.col("B_d")
      for one in (*OBSERVED, "B_d_rendered", "B_viscous")]),
    ("fig6", None, 0, True, None,
     (100 - pl.col("VAF"), 100 - pl.col("VAF").median().over("controller"))),
    *(("fig7", response_table, k, True, "frequency_hz", [one.format(q) for one in OBSERVED])
      for k, q in enumerate(("magnitude", "phase_deg"))),
    ("fig7", response_table, 2, True, "frequency_hz", [one.format("Z_error") for one in OBSERVED]),
    *(("fig8", None, k, True, "stance", (f"{q}_d", f"{q}_1_joint")) for k, q in enumerate("KB")),
    *(("fig9", None, k, ~IS_MEAN & (pl.col("quantity") == q), None,
       ("mean", "low", "high", "commanded")) for k, q in enumerate("KBI")),
    *(("fig9", None, k, IS_MEAN & (pl.col("quantity") == q), None, ("mean", *WITHIN_SD))
      for k, q in enumerate("KBI")),
    ("torque_angle", torque_angle_table, 0, True, "angle_deg", ("torque", "desired_torque")),
    ("torque_angle", torque_angle_table, 1, pl.col("branch") == "loading", "angle_deg",
     ("stiffness",)),
    *(("walking_page", None, k, pl.col("panel") == panel, "x", ("mean",))
      for k, panel in enumerate(("angle", "torque", "response angle", "response torque"))),
    *(("walking_page", None, k, pl.col("panel") == panel, "x", WITHIN_SD)
      for k, panel in enumerate(("angle", "torque"))),
]  # fmt: skip


TABLE_OF = {name: table for name, table, *_ in SHOWN}


@cache
def drawn_once(name, table):
    """Plotted numbers, and their figure as it is written."""
    numbers = table() if table else plotted(name)
    figure = drawn(name, numbers)
    with paper_style():
        figure.draw_without_rendering()
    return numbers, figure


@pytest.mark.parametrize(("name", "table", "panel", "rows", "x", "columns"), SHOWN)
def test_every_number_of_a_figure_stands_in_its_panel_at_its_place(
    name, table, panel, rows, x, columns
):
    numbers, figure = drawn_once(name, table)

    shown = places_in(figure.axes[panel])

    rows_of_panel = numbers.filter(rows)
    for column in columns:
        place = {"x": pl.lit(0.0) if x is None else x, "y": column}
        wanted = rows_of_panel.select(**place).drop_nulls().to_numpy()
        assert len(wanted) or column is not columns[0]
        is_there = is_near(shown[:, 1], wanted[:, 1])
        if x is not None:
            is_there &= is_near(shown[:, 0], wanted[:, 0])
        assert is_there.any(axis=1).all(), f"{column}: some of it is not drawn"


def places_in(ax):
    """Every place (n, 2) at which something is drawn: of lines, points, bars and edges of areas."""
    places = [line.get_xydata() for line in ax.lines]
    for part in ax.collections:
        places.append(np.asarray(part.get_offsets()))
        if np.size(part.get_offsets()) <= 2:  # no points
            places += [path.vertices for path in part.get_paths()]
    shown = np.concatenate(places)
    return shown[~np.isnan(shown).any(axis=1)]  # what is not drawn is no place


def is_near(shown, wanted):
    """Whether each of the wanted numbers (m,) is each of the drawn ones (n,), as (m, n)."""
    return np.isclose(shown[None, :], wanted[:, None], rtol=1e-9, atol=1e-9)


def test_every_figure_has_a_row_that_says_what_it_shows():
    without_row = {*FIGURES} - {name for name, *_ in SHOWN}
    assert without_row == set(), "add a row to SHOWN for each panel"


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_fits_the_page_and_reads_at_8_points(name):
    _, figure = drawn_once(name, TABLE_OF.get(name))

    texts_of_figure = figure.findobj(lambda artist: hasattr(artist, "get_fontsize"))
    sizes = {text.get_fontsize() for text in texts_of_figure if text.get_text()}
    assert figure.get_size_inches()[0] in (SINGLE_COLUMN, DOUBLE_COLUMN)
    assert sizes == {8.0}
    assert_whole(figure)


DOUBT = pl.col("trial").is_in(["belt_02", "belt_07", "w2"])
ALL_DOUBTFUL = pl.lit(True)


LETTERING = [
    # figure, table, what changes, which numbers and marks stand in the figure, and which do not
    ("fig3", both_branches, {"is_doubtful": DOUBT}, ["682.9", "688.3", "oubtful"], []),
    ("fig3", both_branches, {"is_doubtful": ALL_DOUBTFUL}, ["ll trials are doubtful"], ["682.9"]),
    ("fig4", left_out, {"K_d": NULL, "B_d": NULL, "controller": NO_TEXT}, ["k300"], ["doubtful"]),
    ("fig4", time_series, {"is_doubtful": ALL_DOUBTFUL}, ["doubtful"], []),
    ("fig6", lambda: plotted("fig6"), {"is_doubtful": ALL_DOUBTFUL}, ["doubtful"], []),
]


@pytest.mark.parametrize(("name", "table", "changes", "present", "absent"), LETTERING)
def test_a_figure_has_the_numbers_and_marks_of_what_is_drawn(name, table, changes, present, absent):
    lettering = texts(drawn(name, table().with_columns(**changes)))

    assert [part for part in present if part not in lettering] == []
    assert [part for part in absent if part in lettering] == []


# A doubtful fit is open, dotted or dashed, and each leads to its trial.


@pytest.mark.parametrize(
    ("name", "panel", "order", "doubt"),
    [
        ("fig5", 0, ("K_d", "B_d"), "K_is_doubtful"),
        ("fig5", 1, ("B_d", "K_d"), "B_is_doubtful"),
        ("fig6", 0, (), "is_doubtful"),
        ("fig7", 0, (), "is_doubtful"),
        ("fig7", 1, (), "is_doubtful"),
    ],
)
def test_a_marker_leads_to_its_trial_and_is_open_where_its_fit_is_doubtful(
    name, panel, order, doubt
):
    table, figure = drawn_once(name, TABLE_OF[name])

    for controller in CONTROLLERS:
        rows = table.drop_nulls("trial").filter(controller=controller)
        rows = rows.sort(order, maintain_order=True) if order else rows
        _, faces, links = scattered(figure.axes[panel], controller)
        is_open = (np.broadcast_to(faces, (len(links), 4)) == 1).all(axis=1)
        assert links == links_to(trial.replace(" ", "%20") for trial in rows["trial"])
        assert is_open.tolist() == rows[doubt].to_list()


@pytest.mark.parametrize(
    ("name", "table", "trials"),
    [
        ("torque_angle", torque_angle_table, [CAMS[3]]),
        ("walking_page", lambda: stored("walking_page"), ["w2"]),
    ],
)
def test_a_curve_leads_to_its_trial_and_differs_where_its_fit_is_doubtful(name, table, trials):
    sound = table().with_columns(is_doubtful=pl.lit(False))
    doubted = sound.with_columns(is_doubtful=pl.col("trial").is_in(trials).fill_null(False))

    styles = linked_styles(drawn(name, sound))
    marked = linked_styles(drawn(name, doubted))

    assert {url for url in styles if marked[url] != styles[url]} == {*links_to(trials)}


def linked_styles(figure):
    """The style of each curve, by the trial to which it leads."""
    lines = [line for ax in figure.axes for line in ax.lines]
    return {line.get_url(): line.get_linestyle() for line in lines if line.get_url()}


def test_no_line_of_fig3_goes_from_the_end_of_a_cycle_to_the_next_one():
    cycle = both_branches().filter(trial="belt_01").sort("branch")

    loops = drawn("fig3", pl.concat([cycle, cycle])).axes[1]
    (loading,) = [line for line in loops.lines if line.get_label() == "Loading"]

    is_drawn = np.isfinite(loading.get_ydata())
    assert np.count_nonzero(np.diff(is_drawn.astype(int)) == 1) + is_drawn[0] == 2


# Places


def test_fig6_has_a_perfect_fit_at_the_end_of_its_axis():
    vaf = pl.Series([float("nan"), 99.99999999, 99.0, 97.0])
    fits = stored("impedance").filter(amplitude_deg=2).head(4).with_columns(VAF=vaf)

    ax = drawn("fig6", plotted_numbers("fig6", fits)).axes[0]

    assert ax.get_ylim()[0] > 3 > 1e-4 > ax.get_ylim()[1]
    assert 1e-4 in scattered(ax, "compensated")[0][:, 1]


def test_fig6_shows_fits_over_all_amplitudes_where_there_are_no_others():
    whole = stored("impedance").filter(pl.col("amplitude_deg").is_null())

    assert len(plotted_numbers("fig6", whole)) == 32


def test_what_was_not_fitted_is_shaded():
    for ax in drawn_once("fig4", left_out)[1].axes:
        (ground,) = ax.collections
        spans = [
            (path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in ground.get_paths()
        ]
        np.testing.assert_allclose(spans, [(2, 3), (9.01, 9.99)], atol=1e-9)


@pytest.mark.parametrize(
    ("fitted_s", "shown_s"),
    [
        ([(3, 13), (16, 18)], (3, 13)),
        ([(2, 4), (7, 14)], (4, 14)),  # what lies between is shown, too
        ([(0, 19)], (9, 19)),  # the last of equals
        ([(3, 8)], (3, 8)),
    ],
)
def test_fig4_shows_the_ten_seconds_of_which_most_is_fitted(fitted_s, shown_s):
    time = np.arange(0, 2000) / 100
    is_fitted = np.any([(time >= begin) & (time <= end) for begin, end in fitted_s], axis=0)
    torque = np.where(is_fitted, 1.0, np.nan)
    series = pl.DataFrame({"time": time, "torque": time, "torque_model": torque})

    points = fig4.points(series.fill_nan(None))

    assert (points["torque"].min(), points["torque"].max()) == shown_s
    assert points["time"].to_list() == pytest.approx(points["torque"] - shown_s[0])


def test_fig4_shows_the_first_trial_that_is_not_doubtful(tmp_path):
    names = ["i_1", "i_2", "i_3"]
    fits = pl.concat(time_series().head(1).with_columns(trial=pl.lit(name)) for name in names)
    fits = fits.drop("time", "theta_deg", "torque", "torque_model", "is_doubtful")
    write_table(fits.with_columns(amplitude_deg=NULL), tmp_path / "impedance.csv")
    series = [tmp_path / f"{name}.zip" for name in names]
    for number, archive in enumerate(series):
        signals = time_series().select("time", "theta_deg", "torque_model", torque=pl.lit(number))
        write_tables({archive / "series.csv": signals})
    doubts = [Finding("friction", "impedance", name) for name in names]

    shown = []
    for count in (0, 1, 3):  # doubtful ones; where all are, the first is shown
        findings_table(doubts[:count]).write_parquet(tmp_path / "findings.parquet")
        numbers = figure_4(series, tmp_path / "impedance.csv", "", [tmp_path / "findings.parquet"])
        shown.append((numbers["trial"][0], numbers["torque"][0]))

    assert shown == [("i_1", 0), ("i_2", 1), ("i_1", 0)]


def test_fig9_shows_every_group_with_a_result_and_what_it_was_commanded():
    """The third has no result; crossings may have no fit or group."""
    names = ("K_d 200", "K_d 400", "K_d 600")
    groups, fits, *beside = (
        pl.concat(table.with_columns(group=pl.lit(name)) for name in names)
        for table in (stored("walking_summary"), walking_fits(), SOUND, RESPONSES)
    )
    known = pl.when(pl.col("group") != names[2]).then("mean")
    commanded = pl.col("group").str.tail(3).cast(pl.Float64)
    lost = walking_fits(2).with_columns(K=pl.Series([None, np.nan]), group=NO_TEXT)

    table = plotted_numbers(
        "fig9",
        groups.with_columns(mean=known, commanded=commanded),
        pl.concat([fits, lost]),
        *beside,
        340.0,
    )

    panel, _, lowest = drawn("fig9", table).axes
    commands = [line.get_ydata()[0] for line in panel.lines if line.get_label() == "Commanded"]
    assert table["trial"].count() == table.drop_nulls("trial")["mean"].is_finite().sum() == 3 * 62
    assert commands == [200.0, 400.0]
    assert [label.get_text() for label in lowest.get_xticklabels()] == ["K_d 200", "K_d 400"]


def test_fig8_shows_stance_alone():
    assert f"the first {100 * STANCE_SHARE:g} % of" in " ".join(FIGURES["fig8"].caption)
    gains = stored("gains")
    swing = gains.tail(1).with_columns(phase=0.63, K_d=1e6)

    assert plotted_numbers("fig8", pl.concat([gains, swing])).equals(plotted_numbers("fig8", gains))
    assert len(plotted_numbers("fig8", swing.with_columns(phase=0.62))) == 1


def test_no_two_controllers_look_alike():
    controllers = [*CONTROLLERS, *(f"c{number}" for number in range(12)), None]
    table = pl.DataFrame({"controller": controllers})
    table = table.with_columns(look_numbers(table["controller"]))

    looks = style.by_controller(table)

    assert len({(look.colour, look.marker) for look, _ in looks}) == 15
    assert style.by_controller(table.filter(controller="c1"))[0][0] == looks[3][0]


# Files


def test_a_figure_is_the_same_whatever_the_users_matplotlib_settings(tmp_path):
    plain, other = ([tmp_path / f"{n}.{suffix}" for suffix in ("pdf", "svg")] for n in "ab")
    write_figure(drawn("fig8", plotted("fig8")), plain, "Simulated data")

    with mpl.rc_context({"font.size": 20, "pdf.fonttype": 3, "savefig.bbox": "tight"}):
        write_figure(drawn("fig8", plotted("fig8")), other, "Simulated data")

    assert [path.read_bytes() for path in other] == [path.read_bytes() for path in plain]
    assert b"/Type3" not in plain[0].read_bytes()


def write_lost(path):
    """Write a table of a trial that was not analysed."""
    reason = "raw/i_1.mcap: $no$ such_file^; copy it there"
    pl.DataFrame([{"trial": "i_1", "reason": reason, "status": NOT_ANALYSED}]).write_csv(path)


def test_a_figure_without_numbers_says_so_with_trial_and_reason(tmp_path):
    write_lost(tmp_path / "fig4.csv")

    draw_figure("fig4", tmp_path / "fig4.csv", [tmp_path / "fig4.svg", tmp_path / "fig4.pdf"])

    drawing = (tmp_path / "fig4.svg").read_text()
    assert "Fig. 4" in drawing
    assert "i_1: raw/i_1.mcap: $no$ such_file^" in drawing


def test_each_figure_has_its_width_and_its_caption_of_what_is_drawn(tmp_path):
    name = "impedance_errors"
    tables = {"fig4": tmp_path / "fig4.csv", name: tmp_path / f"{name}.csv"}
    write_lost(tables["fig4"])
    write_table(plotted(name).with_columns(B_viscous=NULL), tables[name])
    draw_figure(name, tables[name], [tmp_path / f"{name}.svg"])

    write_captions(
        tables=tables,
        footer="Simulated data",
        markdown=tmp_path / "c.md",
        tex=tmp_path / "c.tex",
    )

    _, lost_figure, drawn_figure = (tmp_path / "c.md").read_text(encoding="utf-8").split("\n## ")
    assert "i_1: raw/i_1.mcap" in lost_figure
    assert "One column wide" in drawn_figure
    assert "Thick bars are 95 % intervals" in drawn_figure
    assert "Crosses" not in drawn_figure


def test_viscous_damping_is_drawn_where_every_controller_has_it():
    fits = stored("impedance").with_columns(
        B_viscous=pl.when((pl.col("controller") == "uncompensated") | (pl.col("B_d") == 5)).then(
            1.0
        )
    )

    shown = plotted_numbers("impedance_errors", fits).drop_nulls("B_viscous")

    assert {*shown["B_d"]} == {5.0}
    assert shown["controller"].n_unique() == 2
    alone = plotted_numbers("impedance_errors", fits.filter(controller="uncompensated"))
    assert alone["B_viscous"].null_count() == 0


def test_the_larger_the_amplitude_the_larger_the_marker_of_fig6():
    table, figure = drawn_once("fig6", None)

    (points,) = [c for c in figure.axes[0].collections if c.get_label() == "compensated"]

    amplitudes = table.filter(controller="compensated")["amplitude_deg"]
    diameters = np.sqrt(points.get_sizes())
    assert diameters == pytest.approx(amplitudes * diameters.max() / 6)


def test_the_caption_of_fig9_says_how_many_crossings_at_which_phase_are_fitted_for_how_long():
    numbers, figure = drawn_once("fig9", None)

    caption = " ".join(caption_of("fig9", numbers))

    for part in ("31 perturbed", "12 unperturbed", "39 % of stance", "100 ms", "VAF"):
        assert part in caption
    labels = [label.get_text() for label in figure.axes[0].get_xticklabels()]
    assert labels == [
        "One perturbation",
        "Mean ± SD",
        "Mean response, 95 %",
        "Predicted gait, 95 %",
    ]


def test_fig7_has_a_tick_at_each_measured_frequency_and_three_of_the_magnitude():
    numbers, figure = drawn_once("fig7", response_table)

    measured_hz = numbers.drop_nulls("trial")["frequency_hz"].unique().sort()
    magnitude, *_, lowest = figure.axes

    assert lowest.get_xticks().tolist() == measured_hz.to_list()
    low, high = sorted(magnitude.get_ylim())
    assert ((magnitude.get_yticks() >= low) & (magnitude.get_yticks() <= high)).sum() >= 3


@pytest.mark.parametrize(("low", "high"), [(2.8, 6.6), (0.9, 12.0), (1e-4, 30.0), (0.31, 0.33)])
def test_a_logarithmic_axis_has_three_ticks_or_more_and_not_a_crowd(low, high):
    ticks = style.LogTicks().tick_values(low, high)

    on_axis = [tick for tick in ticks if low <= tick <= high]
    assert 3 <= len(on_axis) <= 9


def test_no_two_loops_of_fig3_have_the_same_place():
    curves = pl.concat(
        pl.DataFrame(
            {
                "trial": f"belt_{k}",
                "branch": "loading",
                "theta_s_deg": [0.0, 2.0, 5.0],
                "torque": [0.0, 20.0 + k, 50.0 + 2 * k],
            }
        )
        for k in range(4)
    )
    belts = pl.DataFrame(
        {
            "trial": [f"belt_{k}" for k in range(4)],
            "K_s": [600.0, 610.0, 620.0, 630.0],
            "joint": "ankle",
            "side": "",
            "doubtful": "",
        }
    )
    summary = pl.DataFrame(
        {
            "quantity": ["K_s"],
            "joint": "ankle",
            "side": "",
            "mean": 615.0,
            "low": 600.0,
            "high": 630.0,
        }
    )

    table = plotted_numbers("fig3", curves, belts, summary)

    shifts = table.unique("trial").sort("trial")["loop_shift"].to_list()
    step = shifts[1] - shifts[0]
    assert shifts == pytest.approx([0, step, 2 * step, 3 * step])
    assert step >= 1.0  # the median height of the loops, at least


@pytest.mark.parametrize(
    ("name", "table", "others"),
    [
        ("fig6", stored("impedance").with_columns(VAF=float("nan")), []),
        (
            "fig9",
            stored("walking_summary").with_columns(mean=NULL),
            [walking_fits(0), SOUND, RESPONSES],
        ),
    ],
)
def test_a_table_without_what_a_figure_shows_gives_no_points(name, table, others):
    assert plotted_numbers(name, table, *others).is_empty()


def test_a_figure_that_is_none_is_refused_with_those_that_are():
    with refused_with(r"figure 'fig2';.*fig3"):
        plotted_numbers("fig2", stored("gains"))


def test_a_figure_is_written_in_three_formats_alone(tmp_path):
    with refused_with(r"f\.jpg: figures.*\.pdf, \.svg, \.png"):
        write_figure(drawn("fig8", plotted("fig8")), [tmp_path / "f.jpg"])


@pytest.mark.parametrize(("name", "missing"), [("fig5", "joint"), ("fig8", "K_d")])
def test_a_table_without_a_column_that_a_figure_needs_is_refused(name, missing, tmp_path):
    table = stored(FIGURES[name].table).drop(missing, strict=False)
    write_table(table, tmp_path / "t.csv")

    with refused_with(rf"t\.csv:.*'{missing}'"):
        plot_numbers(name, tmp_path / "t.csv")
