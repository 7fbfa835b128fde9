"""The captions say in words what the figures show: in numbers of their tables, with names as text."""

import json
import re

import polars as pl
import pytest
from test_figures import plotted

from osl_analysis.campaign.campaign import ABOUT_MEANING
from osl_analysis.commands.figure import caption_of, write_captions
from osl_analysis.commands.tables import write_table_metadata
from osl_analysis.figures import FIGURES
from osl_analysis.figures.names import as_text, doubtful_said, listed_text, rounded_number, with_interval, with_sd
from osl_analysis.figures.quasi_static import MEAN_SLOPE
from osl_analysis.refusal import Refusal, write_refusals
from osl_analysis.table import write_table


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
