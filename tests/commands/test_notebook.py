# SPDX-License-Identifier: Apache-2.0
"""`import osl_analysis as osl`: the numbers of a campaign's tables, results that cannot change,
errors of one line."""

import base64
import pickle
from dataclasses import FrozenInstanceError, replace
from functools import cache
from html import escape

import numpy as np
import polars as pl
import pytest
from any_motion import made_trial, multisine
from bench_recordings import RATE, RECORDINGS
from bench_synthetic import PROTOCOL as SINES
from conftest import joint_trial, least_squares_alone, refused_with
from matplotlib.figure import Figure
from polars.testing import assert_frame_equal
from shipped import DEVICE

import osl_analysis as osl
from osl_analysis.base.table import read_table, write_table
from osl_analysis.base.trial import write_trial
from osl_analysis.campaign.configuration import FrequencyResponseFigure, read_config
from osl_analysis.commands import figure, tables
from osl_analysis.commands import fit as fits
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.ingest.quality import Commanded, measure_quality
from osl_analysis.judge.recording_checks import measured_table

pytestmark = pytest.mark.usefixtures("in_root")
DESIRED = osl.DesiredImpedance("compensated", 300.0, 5.0)
AMPLITUDES = [float(np.rad2deg(amplitude)) for amplitude in SINES.amplitudes]
SHORT = f"dynamometer: {{amplitudes_deg: {AMPLITUDES}, frequencies_hz: [1, 3, 5], cycles: 9}}\n"
SHORT += "quality: {rate: 123 Hz}\n"


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A configuration with a short stepped sine, and a curve of torque over angle."""
    path = tmp_path_factory.mktemp("settings") / "short.yaml"
    path.write_text(
        SHORT
        + "torque_angle: {zero: none, desired: {line: {angle_deg: [-10, 10], torque: [-35, 35]}}}\n"
    )
    return path


@cache
def bench_trial(experiment):
    """A trial of each experiment, of a joint that is known."""
    rng = np.random.default_rng(3)
    if experiment in ("any motion", "friction"):
        motion = multisine(rng)
        return made_trial(
            rng, motion, more=10 * np.tanh(50 * motion[1][1]) * (experiment == "friction")
        )
    if experiment in RECORDINGS:
        return osl.Trial("made", pl.DataFrame(RECORDINGS[experiment]))
    time = np.arange(round(40 * RATE)) / RATE
    theta = np.deg2rad(10) * np.sin(2 * np.pi * time / 10)
    torque = 200 * theta + 3 * np.cos(2 * np.pi * time / 10) + 0.05 * rng.standard_normal(len(time))
    return joint_trial(time, theta, torque)


def campaign_files(experiment, folder, config_path):
    """The tables of one trial as the job of a campaign writes them, by name;
    `fits/NAME/made.csv`."""
    config = read_config(config_path)
    name = "impedance" if experiment in ("any motion", "friction") else experiment
    write_trial(bench_trial(experiment), folder / "made.parquet")
    condition = {"impedance": DESIRED, "torque_angle": {"desired": "line"}}.get(name)
    trial = osl.read_trial(folder / "made.parquet")
    tables = fits.run_fit(name, trial, DEVICE, config, condition).everything()
    files = {
        table.name: folder / f"fits/{table.name}/made.csv" for table in EXPERIMENTS[name].tables
    }
    for table, path in files.items():
        write_table(tables[table], path)
    return files


def assert_same(table, path, folder):
    """A table in memory and a file of a campaign are the same to the last digit, but for what the
    sheet alone has."""
    write_table(table, folder / "mine.csv")
    theirs = read_table(path).drop({"joint", "side"} - {*table.columns}, strict=False)
    assert_frame_equal(
        read_table(folder / "mine.csv"), theirs, check_column_order=False, check_exact=True
    )
    assert table.height


CONDITIONS = {
    "impedance": {"desired": DESIRED},
    "any motion": {"desired": DESIRED},
    "belt": {},
    "transmission": {},
    "actuator": {},
    "torque_angle": {"curve": "line"},
}


@pytest.mark.parametrize("motion", CONDITIONS)
def test_the_fit_of_a_trial_is_the_row_of_the_campaign_to_the_last_digit(motion, tmp_path, short):
    files = campaign_files(motion, tmp_path, short)
    experiment = "impedance" if motion == "any motion" else motion
    fit = osl.fit(bench_trial(motion), experiment, config=short, **CONDITIONS[motion])

    made = tmp_path / f"tables/{fit.experiment}.csv"
    limits = read_config(short).doubtful.of(fit.experiment)
    rows = [files[fit.experiment]]
    budget = [file for name, file in files.items() if name == "budget"]
    findings = tmp_path / "findings.parquet"
    write_table(tables.judge_table(fit.experiment, limits, rows, budget), findings)
    write_table(tables.gather(rows, fit.experiment, [findings]), made)
    finding_columns = tables.unpublished(fit.table, fit.experiment)
    assert_same(fit.table.drop(finding_columns, strict=False), made, tmp_path)
    if fit.curves is not None:
        assert_same(
            fit.curves,
            next(path for name, path in files.items() if name.endswith("curves")),
            tmp_path,
        )
    # over all amplitudes
    last = fit.table.drop("doubtful", "remarks", strict=False).to_dicts()[-1]
    assert {name: getattr(fit, name) for name in last} == last
    for name in (one for one in last if f"{one}_low" in last):
        ends = np.array([last[f"{name}_low"], last[f"{name}_high"]], float)  # None: nan
        assert getattr(fit, f"{name}_interval") == pytest.approx(ends, abs=0, nan_ok=True)


def test_a_fit_of_a_file_is_that_of_its_trial_and_can_be_pickled(tmp_path, short):
    trial = bench_trial("belt")
    write_trial(trial, tmp_path / "made.parquet")

    from_file = osl.fit(str(tmp_path / "made.parquet"), "belt", config=str(short))

    stored = pickle.loads(pickle.dumps(from_file))
    assert_frame_equal(stored.table, osl.fit(trial, "belt", config=short).table, check_exact=True)


@least_squares_alone
def test_the_response_of_a_stepped_sine_is_that_of_the_campaign_and_fig_7(tmp_path, short):
    files = campaign_files("impedance", tmp_path, short)
    config = read_config(short)
    response = tmp_path / "tables/response.csv"
    findings = tmp_path / "findings.parquet"
    limits = config.doubtful.of("impedance")
    judged = tables.judge_table("impedance", limits, [files["impedance"]], [files["budget"]])
    write_table(judged, findings)
    found = osl.frequency_response(bench_trial("impedance"), DESIRED, config=short)
    for places in ({"made": {"joint": "ankle", "side": None}}, {}):
        table = tables.gather([files["response"]], "response", [findings], places=places)
        write_table(table, response)
        if places:
            choice = FrequencyResponseFigure(K_d=300.0, B_d=5.0)
            plotted = figure.fig7(response, DEVICE, choice, config.gain_weight, [findings])
            write_table(plotted, tmp_path / "fig7.csv")
    assert_same(found.table, response, tmp_path)
    assert_same(
        found.plotted.with_columns(chosen=pl.lit(None, pl.String)), tmp_path / "fig7.csv", tmp_path
    )
    assert set(found.plotted["curve"]) == {"observed", "desired", "linear model"}
    assert isinstance(osl.plot_frequency_response(found), Figure)


@least_squares_alone
def test_a_window_is_all_that_is_fitted(short):
    trial = bench_trial("any motion")

    whole = osl.frequency_response(trial, DESIRED, config=short)
    part = osl.frequency_response(trial, DESIRED, "10-25", short)

    assert not part.table.equals(whole.table)
    fit = osl.fit(trial, desired=DESIRED, windows="10-25", config=short)
    assert fit.fitted_s == pytest.approx(15, abs=0.8)


def test_the_check_of_a_trial_is_the_campaign_s_and_accepts_nothing(tmp_path, short):
    config = read_config(short)
    trial = bench_trial("actuator")
    slow = replace(trial, samples=trial.samples.with_columns(pl.col("time") * 50))
    commanded = Commanded(**{name: getattr(config.dynamometer, name) for name in PROTOCOL})
    write_table(
        measured_table("made", measure_quality(slow, "actuator", commanded)),
        tmp_path / "measured.csv",
    )
    judged = tables.judge([tmp_path / "measured.csv"], config.quality, {})
    write_table(judged, tmp_path / "quality.csv")
    found = osl.check(slow, "actuator", config=short)
    assert_same(found, tmp_path / "quality.csv", tmp_path)
    assert dict(found.select("check", "verdict").rows())["rate"] != "pass"


def test_a_fit_shows_its_doubts_and_runs_nothing_of_a_name(short, tmp_path):
    strict = tmp_path / "strict.yaml"
    stated = short.read_text().replace("123 Hz", "9999 Hz, exclude: [rate]")
    strict.write_text(f"{stated}doubtful: {{impedance: {{above: {{fitted_s: 1}}}}}}\n")
    doubtful = osl.fit(bench_trial("friction"), config=strict)
    assert "friction" in {finding.cause for finding in doubtful.findings[-1]}
    (doubt, *_) = doubtful.doubtful.splitlines()
    assert doubt.startswith("slow sampling")
    assert f"doubtful: {doubt}" in repr(doubtful)
    shown = doubtful._repr_html_()
    assert escape(f"doubtful: {doubt}") in shown
    assert base64.b64decode(shown.partition("base64,")[2].partition('"')[0])[:4] == b"\x89PNG"
    fit = osl.fit(
        replace(bench_trial("transmission"), name="<script>a\x1b[2J"), "transmission", config=short
    )
    page = fit._repr_html_()
    assert ("oubtful" in page, "\x1b" in page, "<script" in page) == (False, False, False)
    assert "fixture" in fit.remarks  # which no recording tells
    assert "<img" not in replace(fit, series=fit.series.clear())._repr_html_()


def test_a_table_is_one_of_pandas_without_pyarrow():
    made = osl.to_pandas(pl.DataFrame({"a": [1, None], "b": ["x", None], "c": [True, False]}))

    assert [str(made.dtypes[name]) for name in ("a", "c")] == ["float64", "bool"]
    assert made["b"].isna().to_list() == [False, True]


def test_a_figure_is_in_the_paper_s_style_and_a_result_cannot_be_changed(short):
    fit = osl.fit(bench_trial("belt"), "belt", config=short)
    drawn = osl.plot_torque(fit)
    assert drawn._repr_png_()[:4] == b"\x89PNG"
    for line, name in zip(drawn.axes[0].lines, ("torque", "torque_model"), strict=True):
        assert list(line.get_ydata()) == fit.series[name].to_list()
    with pytest.raises(FrozenInstanceError):
        fit.K_s = 1.0
    curve = osl.fit(bench_trial("torque_angle"), "torque_angle", config=short)
    assert osl.plot_torque_angle(curve).axes
    with refused_with("made, made"):
        osl.plot_torque_angle(curve, curve)


REFUSED = {
    "int": lambda t: osl.fit(3),
    "torque_angle`": lambda t: osl.plot_torque_angle(),
    "'theta'.*String": lambda t: osl.check(osl.Trial("a", t.samples.cast({"theta": pl.String}))),
    "trial a: .*'time'": lambda t: osl.Trial("a", t.samples.drop("time")),
    "impedence.*'impedance'": lambda t: osl.check(t, "impedence"),
    "belt": lambda t: osl.fit(t, "belt", desired=DESIRED),
    "'opensourceleg'": lambda t: osl.read_recording("README.md", "opensourcelegs"),
    "place/summary.json: ": lambda t: osl.read_summary("place"),
    "`torque_angle`": lambda t: osl.plot_torque_angle(osl.fit(t)),
    "walking_01": lambda t: osl.simulate_trial("x", "walking_01"),
    "'impedance_1'": lambda t: osl.simulate_trial("x", "impedance_1"),
    "DesiredImpedance": lambda t: osl.fit(t, desired={"K_d": 300.0}),
    "windows: '' ": lambda t: osl.fit(t, windows=""),
}


@pytest.mark.parametrize("said", REFUSED)
def test_a_mistake_is_told_in_one_line(said):
    with refused_with(said):
        REFUSED[said](bench_trial("any motion"))
