"""The report, whose signals survive packing and which says what the tables say, and the pages of
the documentation."""

import base64
import hashlib
import json
import re
import sys
import zlib
from dataclasses import replace
from html.parser import HTMLParser
from importlib import import_module
from importlib.metadata import distribution, version

import numpy as np
import polars as pl
import pytest
import scipy
import yaml
from any_motion import made_trial, noise
from bench_synthetic import belt_record, second_order, stepped_sine
from conftest import ROOT, facts_of
from markupsafe import Markup
from numpy.testing import assert_allclose
from test_bench_belt import belt_cycle
from test_bench_recorded_motion import moving_record
from tutorial_page import DOCS, FIGURE, LEFT_OUT, said_by_page

from osl_analysis.bench.belt import belt_table, fit_branches
from osl_analysis.bench.condition_tables import repeated_trials_table
from osl_analysis.bench.fit_tables import Series
from osl_analysis.bench.impedance import impedance_table, rendered_impedance
from osl_analysis.bench.transmission import transmission_of, transmission_table
from osl_analysis.campaign.configuration import read_config
from osl_analysis.campaign.origin import ABOUT_MEANING, sentence
from osl_analysis.cli import main
from osl_analysis.commands import report
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.figures import FIGURES
from osl_analysis.judge.campaign import QUALITY, campaign_findings
from osl_analysis.judge.finding import (
    Beyond,
    Finding,
    Grade,
    WordedFinding,
    findings_frame,
    findings_of_frame,
)
from osl_analysis.judge.known_findings import CHECKS, FINDINGS
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.judge.summary_findings import findings_in_summary
from osl_analysis.judge.words import words_of
from osl_analysis.refusal import Refusal
from osl_analysis.report import (
    BOKEH,
    left_out,
    methods,
    page,
    panels,
    provenance,
    shown_numbers,
    trial_page,
    trial_table,
)
from osl_analysis.report.condition_rows import condition_rows
from osl_analysis.report.headline import Example
from osl_analysis.report.headline_files import to_json, to_tex
from osl_analysis.report.headlines import headline_numbers
from osl_analysis.report.packed_tables import every_kth, packed_table
from osl_analysis.report.page_figures import (
    ShownFigure,
    caption_html,
    captions_by_title,
    inline_svg,
)
from osl_analysis.report.page_text import method_text, verdicts_text
from osl_analysis.report.panels import Pictures
from osl_analysis.report.paper_tables import conditions_table
from osl_analysis.report.reported_trial import ReportedTrial, Scope
from osl_analysis.report.typography import printed
from osl_analysis.schema import SCHEMA
from osl_analysis.stats.repeats import counted
from osl_analysis.table import write_table
from osl_analysis.yaml_settings import read_mapping

DRAWN = ("torque", "torque_model", "residual_low", "residual_high", "theta_deg")
HOSTILE = '<img src=x onerror="alert(1)"></script><b>&amp;'
IMPEDANCE = described_tables_by_name()["impedance"]


def unpack(packed):
    """The columns of a packed table, read by the description of the format alone."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed["data"])), np.uint8)
    counts = np.cumsum(
        2 ** (8 * np.arange(4)) @ planes.reshape(-1, 4, packed["rows"]), axis=1
    ).astype(np.int32)
    units = np.array([*packed["units"].values()])[:, None]
    return dict(
        zip(packed["units"], np.where(counts == -(2**31), np.nan, counts * units), strict=True)
    )


def test_a_packed_signal_is_off_by_no_more_than_half_a_count_and_keeps_its_holes():
    noisy = np.random.default_rng(1).normal(size=5000).cumsum()
    noisy[100:200] = np.nan
    table = pl.DataFrame(
        {"time": 3 + np.arange(5000) / 66, "noisy": noisy, "flat": np.full(5000, 4.2)}
    ).fill_nan(None)
    found = unpack(json.loads(json.dumps(packed_table(table))))
    for name, values in {"time": table["time"].to_numpy(), "noisy": noisy}.items():
        assert_allclose(
            found[name], values, rtol=0, atol=2**-15 * (np.nanmax(values) - np.nanmin(values))
        )
    assert_allclose(found["flat"], 4.2, rtol=1e-8)
    short = pl.DataFrame(
        {"a": [np.inf, -np.inf, np.nan, 1.25], "n": [1, 2, 3, 4], "none": [None] * 4}
    )
    read = unpack(packed_table(short))
    assert_allclose(read["a"], [np.nan, np.nan, np.nan, 1.25], rtol=1e-8)
    assert (read["n"].tolist(), np.isnan(read["none"]).all()) == ([1, 2, 3, 4], True)


ABOUT = dict(
    zip(ABOUT_MEANING, (HOSTILE, "simulated", "1.2", "abc", "made with seed 1"), strict=True)
)


def report_with(trials, **changes):
    """The content of a page, which has nothing beside its trials but `changes`."""
    nothing = {
        "about": ABOUT,
        "made_of": sentence(ABOUT),
        "overview": page.overview(trials, {}, [], ABOUT),
        "trials": trial_table.trial_table(trials),
        "conditions": [],
        "claims": [],
        "methods": written_methods(trials, {}, SETTINGS),
        "equation": "",
        "assumed": "",
        "intervals": "",
        "unnamed": "",
        "sensitivity": [],
        "absent_figures": {},
        "not_made": [],
    }
    return page.Report(**(nothing | changes))


def figure(name, **facts):
    return ShownFigure(
        **({"title": "", "caption": "", "drawing": "", "reading": ""} | facts), name=name
    )


NUMBER = dict.fromkeys(("low", "high", "interval", "draft", "doubt")) | {"unit": "%"}
FINDING = {
    "verdict": "doubtful",
    "trials": ["a"],
    "n": 2,
    "of": "impedance trials",
    "cause": HOSTILE,
}
SETTINGS = read_config(ROOT / "config/config.yaml").model_dump(mode="json")
ACCURACY = {"K": 0.02, "B": 0.05, "I": 0.2}


def fitted_rows():
    rows = {
        "amplitude_deg": [4.0, None],
        "K": [301.26, 299.5123],
        "K_low": [300.9, 299.2],
        "K_high": [301.6, 299.8],
    }
    return pl.DataFrame(
        {"trial": ["t", "t"], **rows, "VAF": [99.0, 98.0], "R2": [0.5, None], "doubtful": ["", ""]}
    )


def doubt(
    name="friction", column="coulomb_share", value=0.3, limit=0.25, table="impedance", **place
):
    return Finding(
        name, table, "t", Grade.DOUBTS, (Beyond(column, value, limit, "above"),), **place
    )


def stored_findings(*findings):
    """The findings as the page reads them from `findings.csv`."""
    worded = [WordedFinding(one, words_of(one, {})) for one in findings]
    return findings_of_frame(findings_frame(worded))


def trial(name="t", *findings, **facts):
    row = {
        "trial": name,
        "experiment": "impedance",
        "controller": HOSTILE,
        "K_d": 300.0,
        "accept": "gap",
    }
    return ReportedTrial(
        name, row, {"impedance": fitted_rows()}, stored_findings(*findings), **facts
    )


def page_of(trials):
    facts = {
        "verdict": "doubtful",
        "cause": HOSTILE,
        "says": "x",
        "size": "y",
        "remedy": "",
        "of": "trials",
        "n": 2,
    }
    summary = {"findings": [{**facts, "trials": [one.name for one in trials]}]}
    content = report_with(
        trials,
        overview=page.overview(trials, summary, [], ABOUT),
        absent_figures={"Response": "No trial has one."},
    )
    packed = {one.name: (trial_page.trial_content(one), {}) for one in trials}
    return page.written_page(content, packed)


class Page(HTMLParser):
    """Elements of a page with their attributes, the text outside scripts, and the scripts."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.text, self.scripts, self.inside = [], "", [], ""
        self.handle_endtag = lambda tag: setattr(self, "inside", "")
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.inside = tag
        self.elements.append((tag, dict(attributes)))

    def handle_data(self, data):
        if self.inside == "script":
            self.scripts.append(data)
        else:
            self.text += data


@pytest.mark.skipif(sys.version_info >= (3, 12), reason="the lock has a newer Bokeh for it")
@pytest.mark.parametrize("name", page.BOKEH_SCRIPTS)
def test_plots_are_drawn_by_the_files_of_the_package_bokeh(name):
    of_package = distribution("bokeh").locate_file(f"bokeh/server/static/js/{name}")

    assert (BOKEH / name).read_bytes() == of_package.read_bytes(), f"cp {of_package} {BOKEH}"
    assert distribution("bokeh").version == page.BOKEH_VERSION


def test_names_from_files_are_text_and_no_script_runs_but_the_two_of_the_page():
    page = Page(page_of([trial(HOSTILE, doubt(HOSTILE, HOSTILE), left_out=[HOSTILE])]))
    tags = [tag for tag, _ in page.elements]
    assert ("img" in tags, tags.count("script")) == (False, 3)
    assert not [
        name for _, attributes in page.elements for name in attributes if name.startswith("on")
    ]
    assert page.text.count(HOSTILE) >= 4
    policy = next(
        a["content"] for _, a in page.elements if a.get("http-equiv") == "Content-Security-Policy"
    )
    found = [
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        for text in page.scripts[-2:]
    ]
    assert re.findall(r"'sha256-([^']+)'", policy) == found
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert not [a for _, a in page.elements if a.get("src") or a.get("href", "#")[0] != "#"], (
        "nothing is loaded"
    )
    # a packed trial reads back with its name
    content = json.loads(zlib.decompress(base64.b64decode(json.loads(page.scripts[0])["content"])))
    assert (
        [a["data-name"] for _, a in page.elements if a.get("class") == "packed"]
        == [content["name"]]
        == [HOSTILE]
    )
    shown = content["estimates"]
    rows = [["4", "301.3 [300.9, 301.6]", "99", "0.5"], ["all", "299.5 [299.2, 299.8]", "98", "–"]]
    named = ["amplitude_deg deg", "K N·m/rad", "VAF %", "R2 "]
    assert (shown["rows"], [f"{one['name']} {one['unit']}" for one in shown["columns"]]) == (
        rows,
        named,
    )
    assert [" ".join(cells[:3]) for cells in content["columns"]][:2] == [
        "trial t text",
        "K 299.512 N·m/rad",
    ]


def written_methods(trials, tables, settings):
    """The methods text of some trials with the finding `FINDING`."""
    findings = findings_in_summary({"findings": [FINDING]})
    facts = methods.methods_content(settings, ACCURACY, tables, trials, findings)
    return methods.methods_text(facts, ABOUT)


def methods_of(trials, tables, settings):
    """The methods text as Markdown on one line, and its BibTeX."""
    text = written_methods(trials, tables, settings)
    return " ".join(text.markdown().split()), text.bibtex()


def sentences(said):
    """Of a text, parted where a word begins with a capital behind a full stop."""
    return re.split(r"(?<=[.?!]) (?=[A-Zτ])", said.partition(" ## References ")[0])


def test_the_methods_have_the_numbers_of_settings_sheet_and_tables_and_nothing_that_was_not_done():
    checks = pl.DataFrame({"check": ["rate", "gap"], "value": [249.96, 0.0], "verdict": "pass"})
    origin = {"files": {"log": {"path": "a/b.mcap", "source": "my_bench"}}}
    bench = [
        trial("a", quality=checks, provenance=origin),
        trial("b", left_out=["gap 1 s; torque"], left_out_for="gap in the recording"),
    ]
    table = {
        "excitation": ["stepped sine"] * 2,
        "commanded_deg": [2.0, 7.0],
        "interval_method": ["units"] * 2,
    }
    table["amplitude_deg"] = [None] * 2
    tables = {
        "impedance": pl.DataFrame(table),
        "phasors": pl.DataFrame({"frequency_hz": [1.0, 4.0]}),
    }
    other = json.loads(json.dumps(SETTINGS))
    other["dynamometer"] |= {"cutoff_hz": 12.5, "bench_stiffness": {"value": "218 N*m/deg"}}
    other["walking"] |= {"window_s": 0.08, "guard_s": 0.03, "bootstrap_samples": 200}
    rows = [{"experiment": "walking", "perturbed": k < 3} for k in range(7)]
    crossings = [
        ReportedTrial(f"w{k}", row, left_out=["far"] * (k == 0)) for k, row in enumerate(rows)
    ]
    walked = {"walking": pl.DataFrame({"interval_method": ["unperturbed crossings"]})}
    walked["walking_groups"] = pl.DataFrame({"group": ["a", "b"], "n_up": [1, 1], "n_down": [1, 1]})
    # a turn of 80 ms, whose middle eight tenths take 64 ms, beside noise of markers
    time = np.arange(300) / 300
    turned = 2.5 * np.clip((time - 0.5) / 0.08, 0, 1) + 0.02 * np.random.default_rng(
        1
    ).standard_normal(300)
    crossings = [
        replace(one, pictures=Pictures([], {"crossing": pl.DataFrame({"time": time,
        "platform_deg": -turned})}),
                provenance={"plates": [{}], "mocap": {"frame_rate_hz": 300.0,
                "samples_per_frame": 4}},
                quality=checks.with_columns(value=300.0))
        for one in crossings
    ]  # fmt: skip
    sines = pl.DataFrame({"excitation": ["periodic", "other", "other"], "theta_rms_deg": [2.0, 2.1,
        2.4],
                          "band_low_hz": [0.5, 0.9, 0.9], "band_high_hz": [8.0, 7.2, 7.2],
                          "fitted_s": [60.0] * 3,
                          "interval_method": ["units"] * 3,
                          "amplitude_deg": [None] * 3})  # fmt: skip
    for trials, made, chosen, shown, absent in (
        (bench, tables | {"belt": pl.DataFrame(schema=["group"])}, SETTINGS,
         ("2 trials", "250 Hz", "2 and 7°", "1 and 4 Hz", "15 Hz",
          "One of two trials was excluded: gap in the recording (1).", HOSTILE),
         "belt|transmission|actuator|walkway|platform|crossing|bootstrap|predicted|seven samples|"
         "my_bench|rendered|of this campaign|part of the period"),
        (bench, tables, other, ("12.5 Hz", "218 N·m"), "assumed to be rigid"),
        (bench, {"impedance": sines}, SETTINGS,
         ("In 1 trial of impedance the joint was moved by a periodic motion (0.5 to 8 Hz, 2° RMS,"
          " 60 s fitted per trial)",
          "(0.9 to 7.2 Hz, 2.1 to 2.4° RMS, 60 s fitted per trial)"),
         "stepped"),
        (crossings, walked, other,
         ("7 times; 6 crossings were used, and in 2 of them", "2 perturbed",
          "two groups", "80 ms", "30 ms", "200 samples",
          "by 2.5° (10–90 % rise time 63 ms; 2 with toes up, 2 down)",
          "Markers were recorded at 300 Hz and", "plates at 1200 Hz",
          "half the difference of both directions"),
         "bench|belt|load cell|plate trials|Student|mean response"),
    ):  # fmt: skip
        said, sources = methods_of(trials, made, chosen)
        assert [words for words in shown if words not in said] == []
        assert not re.search(absent, said), "this campaign has none"
        assert [one for one in sentences(said) if len(re.findall(r"\S*\w\S*", one)) > 30] == []
        assert len(re.findall(r"@\w+{(\w+),", sources)) == int(
            re.findall(r" (\d+)\. [A-Z]", said)[-1]
        )
    cff = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    own = (
        ("author", f"{{{cff['authors'][0]['name']}}}"),
        ("title", cff["title"]),
        ("year", cff["date-released"].year),
    )
    entry = ",\n  ".join(f"{field} = {{{value}}}" for field, value in own)
    assert entry in sources


def test_the_methods_in_LaTeX_have_symbols_citations_and_the_names_of_users_as_TeX_reads_them():
    marked = ["The 50 % of a_1 & ⟨τ = K_d θ̇⟩ at 15 Hz [@fornberg1988]."]
    text = methods.MethodsText(marked, {"fornberg1988": methods.SOURCES["fornberg1988"]})

    paragraph = text.latex().partition("\n\n")[2].strip()

    assert paragraph == (
        r"The 50~\% of a\_1 \& $\tau = K_{\mathrm{d}} \dot\theta$ at 15~Hz~\cite{fornberg1988}."
    )
    assert text.paragraphs == ["The 50 % of a_1 & τ = K_d θ̇ at 15 Hz [1]."]
    assert text.references[0].endswith(
        " 51, 699–706. 1988. https://doi.org/10.1090/S0025-5718-1988-0935077-0"
    )


def test_a_thinned_signal_keeps_the_ends_of_ranges():
    table = pl.DataFrame({"time": np.arange(4000.0), "residual_low": 0.0, "residual_high": 0.0})
    table[1237, "residual_high"] = 5.0
    table[2001, "residual_low"] = -5.0
    thinned = every_kth(table, 10)
    assert thinned["time"].to_list() == list(range(0, 4000, 10))
    assert (thinned["residual_low"].min(), thinned["residual_high"].max()) == (-5.0, 5.0)
    assert every_kth(table.head(399), 10).height == 399, "200 rows are left"


def test_units_symbols_powers_and_minus_signs_are_set_in_one_way_and_names_are_left():
    said = printed(
        "-0.2 N*m*s/rad, [-720, +1e-07] kg*m^2, `delay`, K_d theta + B_d omega, a-1, theta_m"
    )
    assert said == "−0.2 N·m·s/rad, [−720, +1·10⁻⁷] kg·m², “delay”, K_d θ + B_d ω, a-1, theta_m"
    assert [printed(one) for one in ("1", "N*m/deg", "torque - model")] == [
        "",
        "N·m/deg",
        "torque − model",
    ]


def test_verdicts_and_counts_sorting_by_the_unrounded_value_and_conditions_that_differ():
    gap = doubt("gap_in_recording", "gap", 0.095, 0.05, QUALITY)
    trials = [
        trial("a"), trial("e", gap), trial("b", doubt(), gap),
        trial("c", left_out=["gap 1 s"]), trial("d", left_out=["x"], refused=True),
    ]  # fmt: skip
    table = trial_table.trial_table(trials)
    kinds = ["clear", "flagged", "doubtful", "excluded", "refused"]
    assert table.counts == dict.fromkeys(kinds, 1) | {"doubtful in part": 0}
    assert [row.verdict for row in table.rows] == kinds[::-1], "the worst first"
    *_, doubtful, flagged, _ = table.rows
    assert (flagged.causes, doubtful.causes) == (["gap in the recording"], ["friction"])
    assert trials[1].doubts[0].numbers == [["gap", "0.095", "above 0.05", CHECKS["gap"].meaning]]
    assert doubtful.estimates[1] == shown_numbers.ShownEstimate(
        "K", "299.5", "[299.2, 299.8]", [299.5123, 299.2, 299.8]
    )
    assert [one.name for one in table.left_out] == ["c", "d"]
    assert (trials[2].condition(), doubtful.condition) == (f"controller {HOSTILE}, K_d 300", "")
    assert (
        replace(trials[0], row={"perturbed": False, "part": 2}).condition() == "unperturbed, part 2"
    )
    two = [replace(trials[0], row=trials[0].row | {"K_d": K_d}) for K_d in (1.0, 2.0)]
    assert [row.condition for row in trial_table.trial_table(two).rows] == [
        "K_d 1",
        "K_d 2",
    ]


def test_the_page_begins_with_what_was_done_its_verdict_and_the_figure_that_matters():
    row = {"experiment": "walking", "joint": "knee", "log": "a.mcap", "mocap": "a.c3d"}
    walks = [ReportedTrial(f"w{up}", {"trial": f"w{up}", "perturbed": up, **row}) for up in (0, 1)]
    trials = [*walks, trial("t", doubt()), trial("r", left_out=["x"], refused=True)]
    figures = [figure(name) for name in ("fig3", "fig5", "walking_page")]
    number = NUMBER | {"n": 4, "value": 2.0, "of": "", "meaning": "x", "begins": "It is"}
    line = {"cause": "friction", "says": "it does", "remedy": "use it", "trials": ["t", "all"]}
    line |= {"verdict": "doubtful", "of": "impedance trials"}
    found = page.overview(trials, {"numbers": {"K": number}, "findings": [line]}, figures, ABOUT)
    assert found.what_was_done.startswith(
        "4 simulated trials of the knee: 2 walking (1 perturbed) and 2 impedance (MCAP and"
    )
    assert found.verdicts == "1 of 4 trials is doubtful: friction. 1 was refused."
    assert found.answers == ["It is 2.00\xa0% (n = 4)."]
    assert [one.name for one in found.main_figures] == ["fig5"]
    assert [one.name for one in found.further_figures] == ["fig3", "walking_page"]
    assert found.findings[0].trials == [("t", "it is 30 % of the damping")]
    unsure = [
        {"verdict": "not checked", "of": "trials", "trials": ["t"], "cause": cause}
        for cause in "abcdd"
    ]
    of_group = {
        "verdict": "doubtful",
        "of": "walking groups",
        "trials": ["all"],
        "cause": "reflex or voluntary response",
    }
    walking = page.overview(walks, {"findings": [of_group, *unsure]}, figures, ABOUT)
    assert walking.main_figures[0].name == "walking_page", "nothing was desired"
    said = (
        "The walking K is doubtful: reflex or voluntary response. Not checked, and in no interval:"
        " a, b, c and 1 more."
    )
    assert said in walking.verdicts


def test_the_page_begins_with_the_crossings_that_are_used():
    row = {"experiment": "walking", "joint": "ankle"}
    walks = [ReportedTrial(f"w{k}", {**row, "perturbed": k < 2}) for k in range(3)]
    lost = ReportedTrial("w3", {**row, "perturbed": True}, left_out=["far"])

    text = page.overview([*walks, lost, trial("t")], {}, [], ABOUT).what_was_done

    assert "4 walking (3 used, 2 of them perturbed) and 1 impedance" in text


def test_findings_stand_by_what_they_change_the_largest_first_and_those_of_no_size_last():
    line = FINDING | {"says": "", "size": "", "remedy": "", "trials": []}
    sizes = [{}, {"B_size": 3.0}, {"K_size": 2.0}, {"K_size": -10.0, "I_size": None}]
    findings = [line | size | {"cause": str(k)} for k, size in enumerate(sizes)]

    found = page.overview([trial()], {"findings": findings}, [], ABOUT).findings

    assert [one.finding.cause for one in found] == ["3", "2", "1", "0"]
    assert [one.changes for one in found] == [
        "K by up to 10 N*m/rad", "K by up to 2 N*m/rad", "B by up to 3 N*m*s/rad", "",
    ]  # fmt: skip


def test_the_map_has_a_row_for_each_cause_that_a_trial_does_not_pass():
    gap = doubt("gap_in_recording", "gap", 0.2, 0.05, QUALITY)
    note = Finding(
        "negative_inertia", "impedance", "t", Grade.NOTES, title="I is significantly negative"
    )
    of_phasors = doubt(table="phasors", frequency_hz=3.0)
    trials = [trial("b", of_phasors, gap), trial("a", doubt(), doubt(amplitude_deg=4.0), note)]
    trials[0] = replace(trials[0], row=trials[0].row | {"K_d": 400.0})
    (group,) = page.check_map([*trials, trial("c", left_out=["x"])])
    assert group.trials == [("a", "doubtful"), ("c", "excluded"), ("b", "flagged")]
    assert {cause: [state for _, state in row] for cause, row in group.rows} == {
        "friction": ["doubtful", "passed", "doubtful in part"],
        "gap in the recording": ["passed", "passed", "flagged"],
        "I is significantly negative": ["remark", "passed", "passed"],
    }
    groups = {
        name: {"walking": pl.DataFrame({"group": [of]})}
        for name, of in zip("uv", "AB", strict=True)
    }
    walks = [replace(trial(name), tables=tables) for name, tables in groups.items()]
    known = [{"of": "walking groups", "verdict": "not checked", "cause": "x", "trials": ["B", "C"]}]
    (group,) = page.check_map(walks, findings_in_summary({"findings": known}))
    assert group.rows == [("x", [("u", "passed"), ("v", "not checked")])]


def test_doubts_say_whether_they_are_about_the_whole_trial_and_with_which_numbers():
    part = doubt("model_misfit", "R2", 0.1, 0.9, amplitude_deg=4.0)
    numbers = Beyond("B_change", 0.291, 0.25, "above"), Beyond("coulomb_share", 1.03, 0.5, "above")
    own, inherited = (
        doubt("x", "x", 2, 1, "phasors", amplitude_deg=2.0, frequency_hz=3.0),
        replace(part, inherited="y"),
    )
    findings = stored_findings(part, replace(doubt(), evidence=numbers), own, inherited)
    found = replace(trial(), findings=findings).doubts
    assert [(one.where, one.scope, one.cause) for one in found] == [
        ("4 deg", Scope.PART_OF_FIT, "model that does not fit"),
        ("all amplitudes", Scope.WHOLE_FIT, "friction"),
        ("phasors, 2 deg, 3 Hz", Scope.OTHER_TABLE, "x"),
    ]
    assert found[1].says == FINDINGS["friction"].says
    meanings = [IMPEDANCE.columns[name].meaning for name in ("B_change", "coulomb_share")]
    limits = ("B_change", "0.291", "above 0.25"), ("coulomb_share", "1.03", "above 0.5")
    assert found[1].numbers == [
        [*limit, meaning] for limit, meaning in zip(limits, meanings, strict=True)
    ]


def test_provenance_says_file_hash_channel_and_conversion():
    origin = {
        "file": "log",
        "topic": "/wrench",
        "field": "torque.z",
        "unit": "Nm",
        "si_unit": "N*m",
    }
    marker = {"label": "A", "file": "mocap", "unit": "mm", "si_unit": "m"}
    columns = {
        "torque": origin | {"sign": -1, "scale": 2.00001, "offset": 0.5, "resolution": "16 bit"}
    }
    columns |= {f"marker_A_{axis}": marker | {"component": axis} for axis in "xyz"}
    files = {"log": {"path": "a.mcap", "bytes": 12, "sha256": "ff", "source": "mine"}}
    clock = {"offset": 0.5, "edges": 18, "nothing": None, "parts": [{"a": 1, "b": 2}, {"a": 3}]}
    found = provenance.provenance_content({"files": files, "columns": columns, "clock": clock})
    assert found["files"] == [["log", "a.mcap", "12", "ff", "mine"]]
    assert found["signals"] == [
        ["torque", "log",
         "topic /wrench, field torque.z, unit Nm, si_unit N*m, sign -1, scale 2.00001, offset 0.5, "
         "resolution 16 bit"], ["marker_A", "mocap", "label A, unit mm, si_unit m"],
    ]  # fmt: skip
    assert found["facts"] == [
        ["clock offset", "0.5"],
        ["clock edges", "18"],
        ["clock parts", "a 1, b 2; a 3"],
    ]


def test_a_figure_keeps_to_its_own_identifiers_and_opens_trials():
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    svg = (
        f'<svg {spaces} width="252pt" height="100pt"><metadata/><defs><path id="p1"/><clipPath'
        ' id="c"/></defs><g clip-path="url(#c)"><use xlink:href="#p1"/></g><a'
        ' xlink:href="../report.html#trial=a%26b%3C" target="_blank"><path d="M0 0"/></a></svg>'
    )
    found = inline_svg(svg, "fig5", "Fig. 5")
    parts = (
        'id="fig5-p1"',
        'xlink:href="#fig5-p1"',
        "url(#fig5-c)",
        'xlink:href="#trial=a%26b%3C"',
        'tabindex="-1"',
    )
    assert [part for part in (*parts, "<title>a&amp;b&lt;</title>") if part not in found] == []
    assert ("target" in found, "metadata" in found, 'viewBox="0 0 252 100"' in found) == (
        False,
        False,
        True,
    )
    assert [
        f'class="{word}"' in inline_svg(svg.replace("252", pt), "x", "")
        for pt, word in (("252", "narrow"), ("515", "wide"))
    ] == [True] * 2


def test_a_caption_is_text_with_indices():
    said = "<i>K<sub>d</sub></i> of &lt;img&gt; a_1, <i>K\u0302</i> &amp; <i>10<sup>-3</sup></i>"
    assert caption_html(r"$K_d$ of \<img\> a\_1, $\hat{K}$ & $10^{-3}$") == said
    text = "# Captions\n\nx\n\n## Fig. 3\n\nOne.\n\n## Fig. 4\n\nTwo.\n"
    assert captions_by_title(text) == {"Fig. 3": "One.", "Fig. 4": "Two."}


def test_the_model_of_a_series_is_that_of_the_fit_in_the_samples_that_the_fit_uses():
    """The VAF over them is the one of the table, which the fit computes from its own rows."""
    stepped = stepped_sine(second_order, noise=0.3)
    theta_s, torque = belt_cycle(K_s2=3000, coulomb=0.3)
    rng = np.random.default_rng(4)
    belt = fit_branches(
        belt_record(
            theta_s, torque + 30 * np.gradient(theta_s) + 0.02 * rng.normal(size=len(torque))
        )
    )
    any_motion = moving_record(made_trial(rng, noise(rng, duration=20.0)))
    moving, sines = (rendered_impedance(one) for one in (any_motion, stepped))
    losses = transmission_of(stepped)
    for series, table in (
        (sines[0].series(), impedance_table(*sines)), (losses.series(), transmission_table(losses)),
        (belt.series(), belt_table(belt)), (moving[0].series(), impedance_table(*moving)),
    ):  # fmt: skip
        rest, torque = (
            (series.torque - series.torque_model)[series.fitted],
            series.torque[series.fitted],
        )
        assert 100 * (1 - np.var(rest) / np.var(torque)) == pytest.approx(
            table["VAF"][-1], abs=1e-6
        )
        assert 0.1 < series.fitted.mean() < 0.95


def test_a_report_says_of_each_trial_what_became_of_it(tmp_path, monkeypatch):
    """One is flagged, one refused, one has no result though a fit belongs to it, as one has no
    crossing; one stood."""
    (tmp_path / "summary.csv").write_text(json.dumps({"tables_schema": SCHEMA, "numbers": {}}))
    lost = dict.fromkeys(("value", "unit", "threshold")) | {
        "trial": "b_2",
        "check": "refused",
        "remark": "no footer",
    }
    gap = {
        "trial": "b_1",
        "check": "gap",
        "value": 1.0,
        "unit": "s",
        "threshold": 0.5,
        "remark": "",
        "verdict": "flag",
    }
    belt, refused = {"trial": "b_1", "K_s": 9.0}, lost | {"verdict": "refused"}
    made = {"verdicts": [gap, refused], "excluded": [lost], "belt": [belt]}
    for name, rows in (
        made | {"series": [dict.fromkeys(DRAWN, 1.0) | {"time": k / 5} for k in range(11)]}
    ).items():
        write_table(pl.DataFrame(rows), tmp_path / f"{name}.csv")
    given = {
        name: tmp_path / f"{name}.csv"
        for name in (*made, "series", "summary", "output", "findings", "states")
    }
    given |= {f"methods_{form}": tmp_path / f"methods.{form}" for form in ("md", "tex", "bib")}
    given["accuracy"] = ACCURACY
    write_table(
        pl.DataFrame({"setting": ["walking.side"], "value": ["right"], "state": ["assumed"]}),
        given["states"],
    )
    given |= {"series": {"b_1": given["series"]}, "tables": {"belt": given.pop("belt")}}
    found = campaign_findings({}, pl.DataFrame([gap]), DoubtfulFits())
    write_table(findings_frame(found), given["findings"])
    of_table, seen = Refusal("", "t.csv", "j", "refused", "why", "what"), []
    given |= {"trials": {}, "crossings": {}, "figures": {}, "about": ABOUT, "settings": SETTINGS}
    given["refused"] = [of_table, replace(of_table, trial="b_2")]
    monkeypatch.setattr(report, "written_page", lambda *content: seen.extend(content) or "")
    kinds = {"b_1": "belt", "b_2": "belt", "b_3": "belt", "w": "walking", "s": "static"}
    sheet = {name: {"trial": name, "experiment": kind} for name, kind in kinds.items()}
    report.write_report(report.ReportFiles(sheet=sheet, **given))
    said = {row.name: (row.verdict, row.doubt[:40]) for row in seen[0].trials.rows}
    none = ("refused", "it has no result, because b_2 was refuse")
    assert said.pop("b_1") == (
        "flagged",
        "its recording: gap in the recording: samples are missing"[:40],
    )
    assert said == {"b_2": ("refused", "no footer"), "b_3": none, "w": none, "s": ("clear", "")}
    assert (seen[0].claims, seen[0].not_made) == ([], [of_table])
    in_md, in_tex, in_bib = (given[f"methods_{form}"].read_text() for form in ("md", "tex", "bib"))
    for text in (in_md, in_tex):
        assert ("3 trials of belt" in text, "transmission" in text) == (True, False)
    counted = "Three of five trials were excluded: missing trial that its fit needs (2),"
    assert f"{counted} recording that could not be analysed (1)." in in_md
    words = re.sub(r"\$[^$]*\$|\\cite{\w+}", "", in_tex.partition("\n")[2])
    assert re.findall(r"(?<!\\)[%&_#]|[θτ·²°−–]", words) == []
    assert set(re.findall(r"\\cite{(\w+)}", in_tex)) == set(re.findall(r"@\w+{(\w+)", in_bib))
    assert seen[0].assumed == "Assumed, since nobody stated it: the right leg."
    own, other = (seen[1][name][0] for name in ("b_1", "b_2"))
    assert (len(own["quality"]), other["quality"]) == (1, [])
    (left,) = own["panels"][1]["drawn"]
    assert (left["y"], left["high"], left["kind"]) == ("residual_low", "residual_high", "range")
    assert [one["where"] for one in own["panels"][3]["drawn"]] == ["", ""], "the whole loop"


def shown(row, symbol):
    """An estimate of a condition as the page shows it, and its interval."""
    return row.estimates[symbol].text, row.estimates[symbol].interval


def test_every_condition_has_K_B_and_I_with_intervals_and_what_is_doubted():
    """Trials of one condition are one row with Student's interval; a group of walking is one of its
    own."""
    ends = {"_low": -0.5, "_high": 0.5}
    rows = [
        {"trial": name, "amplitude_deg": size, "controller": "c", "K_d": K_d, "B_d": None}
        | {
            f"{x}{end}": x_is + by
            for x, x_is in zip("KBI", (K, -5.0, 0.02), strict=True)
            for end, by in ({"": 0} | ends).items()
        }
        for name, K_d, K in (("a", 100.0, 99.0), ("b", 100.0, 101.0), ("t", 300.0, 290.0))
        for size in (4.0, None)
    ]
    walking = [
        {
            "group": "all",
            "quantity": x,
            "estimator": "ensemble",
            "mean": 340.0,
            "low": 330.0,
            "high": 350.0,
        }
        for x in "KBI"
    ]
    tables = {
        "impedance": pl.DataFrame(rows, infer_schema_length=None),
        "walking_summary": pl.DataFrame(walking),
    }
    late = replace(doubt(), without={"K": 290.0, "B": 4.5, "I": 0.02})
    unsure = Finding("late_torque_unseen", "impedance", "t", Grade.UNCHECKED)
    walk, several, alone = condition_rows(
        tables, {"t": stored_findings(late, doubt(amplitude_deg=4.0), unsure, unsure)}
    )
    assert [one.n_unchecked for one in (walk, several, alone)] == [0, 0, 1]
    for stated in (0.0, 0.1):
        bench = {"impedance": tables["impedance"].with_columns(K_se_bench=pl.lit(stated))}
        assert ("trials of the bench share are not" in method_text(SETTINGS, bench)) == (
            stated == 0
        )
    half = scipy.stats.t.ppf(0.975, 1) * 2**0.5 / 2**0.5
    assert (walk.condition, shown(walk, "K")) == ("walking", ("340", "[330, 350]"))
    assert (several.condition, several.trials, several.doubt) == ("K_d 100", ["a", "b"], "")
    assert shown(several, "K") == ("100", f"[{100 - half:.0f}, {100 + half:.0f}]")
    assert (alone.estimates["B"].text, alone.doubt) == (
        "−5.00",
        "friction (with it in the model K 290, B 4.5 and I 0.02)",
    )
    both = {name: stored_findings(replace(doubt(), subject=name)) for name in "ab"}
    assert condition_rows(tables, both | {"b": []})[1].doubt == "friction (1 of 2)"


def test_friction_stands_beside_B_and_a_doubt_names_the_B_that_it_leaves():
    """What explains a misfit beside certain friction leaves the B without it; a late torque the B
    that holds it."""
    rows = fitted_rows().with_columns(
        *(pl.lit(x).alias(f"{name}{end}") for name in "BI" for end, x in (("", 2.4), ("_low", 1.8),
        ("_high", 3.0))),
        B_viscous=pl.lit(1.9), B_viscous_low=pl.lit(1.88), B_viscous_high=pl.lit(1.92),
        f_C=pl.lit(0.25),
    )  # fmt: skip
    path, late = (
        replace(doubt(cause), without={"B": 1.91}) for cause in ("torque_path", "late_torque")
    )
    for finding, said in ((path, "B_viscous 1.91"), (late, "B 1.91")):
        (found,) = condition_rows({"impedance": rows}, {"t": stored_findings(finding)})
        assert [found.estimates[name].text for name in ("B", "B_viscous", "f_C")] == [
            "2.40",
            "1.900",
            "0.25",
        ]
        assert found.doubt == f"{finding.cause} (with it in the model {said})"
    (none,) = condition_rows(
        {"impedance": rows.with_columns(B_viscous=pl.lit(None, pl.Float64))},
        {"t": stored_findings(path)},
    )
    assert ("B_viscous" in none.estimates, none.doubt) == (
        False,
        "torque path (with it in the model B 1.91)",
    )


@pytest.mark.parametrize("n", [4, 20])
def test_a_trial_without_a_stated_condition_is_alone_everywhere(n):
    """Trials whose estimates are equal may each have been asked for another impedance."""
    common = {
        "amplitude_deg": None,
        "controller": None,
        "K_d": None,
        "B_d": None,
        "excitation": "multisine",
        "band_low_hz": 0.1,
        "band_high_hz": 5.0,
        "VAF": 99.0,
        "interval_method": "units",
        "B_viscous": None,
        "f_C": None,
    }
    for symbol in "KBI":
        common |= {symbol: 62.0, f"{symbol}_low": 61.0, f"{symbol}_high": 63.0}
    trials = [f"t{k}" for k in range(n)]
    rows = [{"trial": trial, "doubtful": "", **common} for trial in trials]
    rows[2]["doubtful"] = "late torque"
    texts = ("amplitude_deg", "K_d", "B_d", "B_viscous", "f_C")
    schema = {"controller": pl.String, **dict.fromkeys(texts, pl.Float64)}
    table = pl.DataFrame(rows, schema_overrides=schema)

    conditions = condition_rows({"impedance": table}, {})
    numbers = facts_of(headline_numbers({"impedance": table}, Example(K_d=None, B_d=None)))
    named = [(one.subject, one.n) for one in numbers if one.name.startswith("K_example")]

    assert [one.trials for one in conditions] == [[trial] for trial in trials]
    assert conditions[0].condition == "trial t0, multisine, 0.1 to 5 Hz"
    assert named == ([(trial, 1) for trial in trials] if n < 8 else [])
    assert repeated_trials_table(table).is_empty()
    assert len(counted(table)) == n, "the doubtful one is no repeat of a sound one"
    paper = conditions_table(table).to_markdown("made")
    assert all(f"| {trial} |" in paper for trial in trials)


def test_trials_of_one_stated_condition_are_repeats():
    row = {"controller": "c", "K_d": 60.0, "B_d": 1.0, "amplitude_deg": None, "doubtful": ""}
    rows = [{"trial": f"t{k}", "K": 62.0 + k, "band_low_hz": 1.0, **row} for k in range(3)]
    table = pl.DataFrame([{**row, "band_high_hz": 5.0} for row in rows])
    assert repeated_trials_table(table)["quantity", "mean", "n"].rows() == [("K", 63.0, 3)]


def test_a_cause_has_one_count_in_the_verdict_the_map_and_the_row_of_its_condition():
    """A trial that is flagged too is one of those that are doubtful in part."""
    part, flag = doubt("zero", amplitude_deg=2.0), doubt("frozen_signal", "stuck", table="quality")
    trials = [trial("a", part), trial("b", part, flag), trial("c", part)]
    assert verdicts_text(trials, ()).startswith(
        "3 of 3 trials are doubtful in part: zero. 1 of 3 trials is flagged: frozen signal."
    )
    (cause, cells), *_ = page.check_map(trials)[0].rows
    assert (cause, [state for _, state in cells]) == ("zero", ["doubtful in part"] * 3)
    groups = {"estimator": ["ensemble"] * 3, "group": ["all"] * 3, "quantity": ["K", "B", "I"]}
    summary = pl.DataFrame(groups).with_columns(mean=300.0, low=290.0, high=310.0)
    names = {"a": "stance that changes", "b": "", "c": None}  # c has no fit
    walked = pl.DataFrame({"trial": [*names], "group": ["all"] * 3, "doubtful": [*names.values()]})
    known = {"a": stored_findings(doubt("stance that changes", "stance_change", table="walking"))}
    (row,) = condition_rows({"walking_summary": summary, "walking": walked}, known)
    assert row.doubt == "of 2 perturbations stance that changes (1)"


def test_two_devices_are_told_with_their_rates_and_how_they_were_joined():
    base = pl.DataFrame(
        {"signals": ["theta", "torque"], "rate_hz": [1000.0, 800.0], "grid_rate_hz": [1000.0] * 2}
    )
    row = {"trial": "t", "experiment": "impedance"}
    one = ReportedTrial("t", row, {"impedance": fitted_rows(), "timebase": base})
    found = methods.recorded_of([one])["impedance"]
    assert (found["streams"], found["grids"]) == (
        {"theta": [1000.0], "torque": [800.0]},
        [1000.0] * 2,
    )
    said, _ = methods_of([one], {}, SETTINGS)
    assert "Separate devices sampled joint angle at 1000 Hz and torque at 800 Hz." in said
    assert "Cubic splines brought both to one grid of 1000 Hz." in said
    alike = ReportedTrial(
        "t", row, {"impedance": fitted_rows(), "timebase": base.with_columns(rate_hz=800.0)}
    )
    said, _ = methods_of([alike], {}, SETTINGS)
    assert "Separate devices" not in said


def test_each_stated_condition_has_its_own_numbers_and_macros():
    rows = [
        {"trial": f"{K_d}", "K_d": K_d, "B_d": 2.0, "K": K}
        for K_d, K in ((200.0, 190.0), (350.0, 332.0))
    ]
    ends = {
        f"{x}{end}": pl.col("K")
        for x in ("B", "I", "B_viscous", "f_C", "K")
        for end in ("_low", "_high", "")
    }
    more = {
        "controller": pl.lit("c"),
        "interval_method": pl.lit("units"),
        "doubtful": pl.lit(""),
        "VAF": 99.0,
    }
    table = pl.DataFrame(rows).with_columns(**ends, **more, amplitude_deg=pl.lit(None, pl.Float64))
    example = Example(200.0, 2.0, "the first")
    numbers = facts_of(headline_numbers({"impedance": table}, example))
    K = {one.meaning: (one.value, one.macro) for one in numbers if one.name.startswith("K_example")}
    assert K == {
        "K for K_d = 200, B_d = 2 (that of the first), c": (190.0, "CExampleStiffness"),
        "K for K_d = 200, B_d = 2, c": (190.0, "CExampleStiffnessKdTwoZeroZeroBdTwo"),
        "K for K_d = 350, B_d = 2, c": (332.0, "CExampleStiffnessKdThreeFiveZeroBdTwo"),
    }
    many = pl.concat([table.with_columns(B_d=pl.lit(float(k))) for k in range(9)])
    said = headline_numbers({"impedance": many}, Example(200.0, 2.0))
    in_summary = json.loads(to_json({}, said))["numbers"]
    assert len([name for name in in_summary if name.startswith("K_example")]) == 1, (
        "a table tells of more"
    )
    assert to_tex(ABOUT, said).count("ExampleStiffness") == 3 * 19  # with both ends


def test_crossings_are_drawn_in_degrees_the_residual_is_measured_minus_model():
    angles = {"theta": [0.0, np.pi], "platform": [np.pi / 2, 0.0]}
    crossing = pl.DataFrame({"time": [5.0, 5.1], **angles, "torque": [1.0, 2.0]})
    table = (
        panels.crossing_pictures(crossing)
        .tables["crossing"]
        .select("time", "theta_deg", "platform_deg")
    )
    assert_allclose(table.to_numpy(), [[0, 0, 90], [0.1, 180, 0]], atol=1e-9)
    response = pl.DataFrame(
        {"time": [0.01], "theta_deg": [1.0], "torque": [5.0], "torque_model": [3.0]}
    )
    row = panels.isolated_pictures(response).tables["isolated"].drop("time").row(0, named=True)
    assert row == {
        "theta_deg": 1.0,
        "torque": 5.0,
        "torque_model": 3.0,
        "time_ms": 10.0,
        "residual": 2.0,
    }
    samples = pl.DataFrame({"time": 5 + np.arange(6001.0)}).with_columns(
        pl.lit(1.0).alias(name) for name in "abcde"
    )
    raw = panels.recorded_pictures(samples, dict.fromkeys("abcde", "N")).tables["N"]
    assert (raw.shape, raw["time"][0]) == ((2001, 5), 0), "3000 rows and four lines at most"


def test_the_fitted_line_of_phasors_is_the_admittance_of_a_second_order_system():
    # the natural frequency, where the admittance is 1/(B w), 90 degrees late
    w = np.sqrt(200 / 0.05)
    phasors = pl.DataFrame({"amplitude_deg": [2.0, 2.0], "frequency_hz": [w / 2 / np.pi, 100.0]})
    pictures = panels.phasor_pictures(phasors, {"K": 200.0, "B": 4.0, "I": 0.05})
    assert pictures.tables["model"].row(0) == pytest.approx((w / 2 / np.pi, 1 / (4 * w), -90))
    found = [
        (one["log_y"], *(one["drawn"][0][end] for end in ("low", "high")))
        for one in pictures.panels
    ]
    assert found == [
        (log, f"{y}_low", f"{y}_high") for log, y in ((True, "Y_magnitude"), (False, "Y_phase_deg"))
    ]
    drawn = [
        [one["y"] for one in each["drawn"]] for each in panels.response_pictures(phasors).panels
    ]
    assert drawn == [[y, f"{y}_eq15"] for y in ("magnitude", "phase_deg")]


def test_a_claim_stands_with_its_limit_and_a_long_caption_is_folded_behind_two_sentences():
    number = NUMBER | {"n": 5.0, "low": 6.0, "high": 7.0, "interval": "95 %", "value": 6.5}
    number |= {
        "claim": "it is negligible",
        "quantity": "x/y",
        "wanted": "below",
        "target": 10.0,
        "margin": None,
    }
    number |= {"verdict": "holds", "subject": None, "joint": "knee", "side": None, "unit": "%"}
    near = {
        **number,
        "claim": "z is 9",
        "quantity": "z",
        "wanted": None,
        "target": 9.0,
        "margin": 2.0,
    }
    own = {**number, "claim": "of a trial", "subject": "t"}
    fig5 = figure(
        "fig5",
        title="Fig. 5",
        reading="Good: on it. Bad: <beside> it.",
        caption=Markup("By Eq. 15 this. That. " + 99 * "Long. "),
    )
    content = report_with(
        [trial()],
        overview=page.overview([trial()], {}, [fig5], ABOUT),
        claims=page.claim_rows(pl.DataFrame([number, near, own])),
    )
    said = " ".join(Page(page.written_page(content, {})).text.split())
    assert [(one.claim, one.where, one.limit) for one in content.claims] == [
        ("it is negligible", "knee", "below 10 %"), ("z is 9", "knee", "9 ± 2 %"),
    ]  # fmt: skip
    assert re.search(
        r"It is negligible \(knee\) ?x/y 6.50 %.{,40}n\s=\s5 ?below 10 % ?holds ?Z is 9", said
    )
    said = said.replace("\xa0", " ")
    assert "By Eq. 15 this. That. More about it, and its numbersLong. Long." in said
    assert "How to read this, good and badGood: on it. Bad: <beside> it." in said


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_says_in_two_or_three_sentences_how_to_read_it(name):
    reading = FIGURES[name].reading

    assert re.search(r"\. Good: .+\. Bad: ", reading), "write `What it is. Good: ... Bad: ...`"
    assert reading.endswith(".")
    assert len(reading.split()) <= 75


def test_a_cell_has_its_number_in_full_whatever_it_shows():
    shown = Page(page_of([trial()]))
    content = trial_page.trial_content(trial())

    (cell,) = [one for tag, one in shown.elements if tag == "td" and one.get("data-of") == "K"]
    head = next(one for tag, one in shown.elements if tag == "th" and "N·m/rad" in one.values())

    numbers = [cell[f"data-{name}"] for name in ("value", "low", "high")]
    assert (numbers, head["data-unit"]) == (["299.5123", "299.2", "299.8"], "N·m/rad")
    assert content["estimates"]["rows"][1][1] == "299.5 [299.2, 299.8]"
    assert content["estimates"]["values"][1][1] == [299.5123, 299.2, 299.8]
    assert content["column_values"][1] == [None, [299.5123]]


def test_a_trial_is_left_out_by_what_became_of_it():
    late = {
        "trial": "late",
        "check": "gap",
        "value": 1.0,
        "unit": "s",
        "threshold": 0.5,
        "remark": "theta",
    }
    cut = dict.fromkeys(late) | {"trial": "cut", "check": "refused", "remark": "no footer"}
    rows = pl.DataFrame(
        [cut, late, late, cut | {"trial": "hung", "check": "failed"}], infer_schema_length=None
    )
    crossings = pl.DataFrame(
        {"trial": ["walk", "fine", "lacks"], "status": "used", "reason": ["no step", None, None]}
    )
    fits = pl.DataFrame({"trial": ["fine"], "excluded": [None]})
    tables = {"walking": fits, "walking_crossings": crossings}
    row = {"experiment": "walking", "perturbed": True}
    sheet = dict.fromkeys(("late", "hung", "cut", "new", "walk", "fine", "lacks"), row)
    found = left_out.left_out_trials(sheet, rows, tables, {"late": "again", "new": "why"})
    not_analysed = "recording that could not be analysed"
    assert (found.pop("late"), found.pop("hung")) == (
        (False, "gap in the recording", ["gap 1 s, threshold 0.5: theta"]),
        (True, not_analysed, ["no footer"]),
    )
    assert found == {
        "cut": (True, not_analysed, ["no footer"]),
        "new": (True, not_analysed, ["why"]),
        "walk": (False, not_analysed, ["no step"]),
        "lacks": (
            True,
            "missing trial that its fit needs",
            ["it has no result, because cut, late, hung, ... (5 in all) were refused or excluded"],
        ),
    }


@pytest.mark.parametrize("most", [7, 10_000])
def test_no_outlier_of_a_long_residual_is_lost_and_no_model_drawn_where_nothing_is_fitted(most):
    random, n = np.random.default_rng(4), 40_003
    torque, modelled, fitted = (
        random.standard_normal(n),
        random.standard_normal(n),
        random.random(n) < 0.7,
    )
    table = Series(5 + np.arange(n) / 1000, torque, modelled, np.full(n, np.pi), fitted).table(most)
    step = -(-n // most)
    assert_allclose(table["time"].to_numpy(), np.arange(0, n, step) / 1000, atol=1e-9)
    assert_allclose(table["theta_deg"].to_numpy(), 180, rtol=1e-6)
    np.testing.assert_array_equal(table["torque_model"].is_null(), ~fitted[::step])
    own = [(torque - modelled)[k : k + step][fitted[k : k + step]] for k in range(0, n, step)]
    low, high = ([f(part) if part.size else None for part in own] for f in (np.min, np.max))
    for name, expected in (("residual_low", low), ("residual_high", high)):
        assert (
            table[name].to_list()
            == pl.Series(expected, dtype=pl.Float64).round_sig_figs(7).to_list()
        )


@pytest.fixture
def site(monkeypatch):
    """The modules of the site."""
    monkeypatch.syspath_prepend(ROOT / "docs/site")
    return {name: import_module(name) for name in ("commands", "pages", "settings")}


def test_the_page_of_the_command_line_has_every_command_and_option(site):
    page = site["commands"].commands_page()
    for name, command in main.commands.items():
        part = page.split(f"\n## {name}\n")[1].split("\n## ")[0]
        options = [
            option for one in command.params for option in one.opts if option.startswith("--")
        ]
        assert [option for option in options if option not in part] == [], name
    assert str(ROOT) not in page


def test_the_page_of_settings_has_every_setting_of_the_configuration_with_its_default(site):
    page = site["settings"].settings_page()
    config = read_mapping(ROOT / "config/config.yaml")

    of_section = {part.partition("`")[0]: part for part in page.split("\n### `")}
    sections = {name: fields for name, fields in config.items() if isinstance(fields, dict)}

    assert [name for name in config if f"`{name}`" not in page] == []
    for section in sections.keys() - {"doubtful", "quality"}:
        part = of_section[section]
        assert [name for name in sections[section] if f"| `{name}" not in part] == [], section
    assert "| `cutoff_hz` | Hz | `15` | Cut-off of one run" in of_section["dynamometer"]
    assert "| `B` | N\\*m\\*s/rad | `null` | Margin within" in of_section["claims"]
    assert "certain_clock_drift_ppm: 0.5 " in of_section["doubtful"]


PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "docs").glob("*.md")),
]
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)(?:#[^)]*)?\)")


def test_codemeta_says_what_the_citation_says():
    cff = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    meta = json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))
    same = {"name": "title", "version": "version", "datePublished": "date-released"}
    assert {key: meta[key] for key in same} == {key: str(cff[of]) for key, of in same.items()}
    assert meta["license"] == f"https://spdx.org/licenses/{cff['license']}"
    assert [one["name"] for one in meta["author"]] == [one["name"] for one in cff["authors"]]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_to_a_file(page):
    assert [
        link for link in LINK.findall(page.read_text()) if not (page.parent / link).exists()
    ] == []


EQUATION = re.compile(r"^\| [0-9–]+ \|.*\| `([\w.]+)` \|$", re.MULTILINE)


def test_every_equation_of_the_method_leads_to_its_function():
    functions = EQUATION.findall((ROOT / "docs/method.md").read_text())
    assert len(functions) >= 10
    for name in functions:
        module, _, function = name.rpartition(".")
        assert callable(getattr(import_module(f"osl_analysis.{module}"), function)), name


def test_the_page_of_functions_finds_every_function_that_it_names(site):
    names = re.findall(r":: ([\w.]+)", site["pages"].functions_page())
    assert {
        f"osl_analysis.{name}" for part in site["pages"].FUNCTIONS.values() for name in part
    } <= set(names)


def test_the_pictures_of_the_readme_are_of_this_version_and_configuration_and_of_this_page(
    in_root, monkeypatch
):
    monkeypatch.syspath_prepend(ROOT / "docs")
    pictures = import_module("make_pictures")
    of_now = pictures.sources()
    assert {name: pictures.taken(ROOT / "docs" / name) for name in of_now} == of_now, (
        "run `make pictures`"
    )
    monkeypatch.setattr(
        pictures, "default_config", lambda: ROOT / "config/campaigns/excitations/config.yaml"
    )
    assert not pictures.sources().items() & of_now.items(), "another configuration"
    readme = (ROOT / "README.md").read_text()
    assert f"osl_analysis-{version('osl-analysis')}-py3-none-any.whl" in readme
    assert [name for name in of_now if f"](docs/{name})" not in readme.partition("\n## ")[0]] == []


def lines_of(text):
    """Lines without the seconds that a stage took, and without blanks at the end."""
    return [re.sub(r" in \d+ s$", " in N s", line.rstrip()) for line in text]


def test_the_commands_of_the_tutorial_print_what_it_shows_and_end_with_its_figure_without_a_flag(
    tmp_path,
):
    folder = tmp_path / "a place with blanks"
    folder.mkdir()
    said = list(said_by_page(folder))
    assert [command.split()[1] for command, _, _ in said] == [
        "record.py",
        "init",
        "fit",
        "run",
        "results",
    ]
    for command, shown, seen in said:
        shown, seen = lines_of(shown), lines_of(seen)
        if LEFT_OUT in shown:
            assert [line for line in shown if line not in (*seen, LEFT_OUT)] == [], command
        else:
            assert shown == seen, command
    assert (folder / FIGURE).stat().st_size > 10_000
    assert (DOCS / "tutorial.png").exists()
    assert "flag" not in (folder / "my_campaign/results/tables/quality.csv").read_text()
    source = folder / "my_campaign/sources/csv.yaml"
    assert yaml.safe_load(source.read_text())["channels"]["torque"]["sign"] == -1
    assert (source.parent / source.read_text().splitlines()[0].split("=")[1]).exists()
