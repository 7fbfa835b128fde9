"""The pages of the documentation: what they are made of and show, and that their links lead somewhere."""

import importlib.util
import re
import sys
from importlib import import_module
from itertools import pairwise

import pytest
import yaml
from conftest import ROOT
from tutorial_page import DOCS, FIGURE, LEFT_OUT, said_by_page

from osl_analysis.cli import main


@pytest.fixture
def site(monkeypatch):
    """The modules of the site."""
    monkeypatch.syspath_prepend(ROOT / "docs/site")
    return {name: import_module(name) for name in ("commands", "pages")}


def test_the_page_of_the_command_line_has_every_command_and_option(site):
    page = site["commands"].commands_page()
    for name, command in main.commands.items():
        part = page.split(f"\n## {name}\n")[1].split("\n## ")[0]
        options = [option for one in command.params for option in one.opts if option.startswith("--")]
        assert [option for option in options if option not in part] == [], name
    assert str(ROOT) not in page


PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)(?:#[^)]*)?\)")
EQUATION = re.compile(r"^\| [0-9–]+ \|.*\| `([\w.]+)` \|$", re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_to_a_file(page):
    assert [link for link in LINK.findall(page.read_text()) if not (page.parent / link).exists()] == []


def test_every_equation_of_the_method_leads_to_its_function():
    functions = EQUATION.findall((ROOT / "docs/method.md").read_text())
    assert len(functions) >= 10
    for name in functions:
        module, _, function = name.rpartition(".")
        assert callable(getattr(import_module(f"osl_analysis.{module}"), function)), name


def test_the_page_of_functions_finds_every_function_that_it_names(site):
    names = re.findall(r":: ([\w.]+)", site["pages"].functions_page())
    assert {f"osl_analysis.{name}" for part in site["pages"].FUNCTIONS.values() for name in part} <= set(names)


IMPERFECTIONS = (ROOT / "docs/bench_validation.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def benchmark():
    sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script there
    spec = importlib.util.spec_from_file_location("bench_imperfections", ROOT / "benchmarks/bench_imperfections.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.path.pop(0)
    return module


def test_the_page_of_imperfections_has_a_row_for_each_none_silently_wrong_and_what_is_stated_right(benchmark):
    for name, (_, cases) in benchmark.TABLES.items():
        rows = IMPERFECTIONS.partition(f"<!-- {name} -->\n")[2].partition("<!-- end -->")[0].splitlines()[2:]
        pairs = ((case.label, case.remedy and f"… {case.remedy.label}") for case in cases)
        expected = [label for pair in pairs for label in pair if label]
        labels = [line.split(" | ")[0].removeprefix("| ") for line in rows]
        assert labels == expected, f"run benchmarks/bench_imperfections.py: {name} is not its table"
        assert [line for line in rows if benchmark.SILENT in line or "| CRASH |" in line] == []
        assert all("| right |" in after for before, after in pairwise(rows) if "must be stated" in before)


def test_a_row_is_judged_by_what_a_reader_accepts_and_by_its_interval(benchmark):
    fit = {"K": 301.0, "K_se": 0.1, "K_low": 300.8, "K_high": 301.2, "doubtful": None}

    def judged(flags=(), **more):
        return benchmark.verdict(benchmark.result_of(fit | more, {"K": 300.0}, list(flags)), None)

    wrong = benchmark.result_of(fit, {"K": 300.0}, [])
    assert wrong.errors["K"] == pytest.approx((1 / 3, 10))
    assert judged() == benchmark.SILENT
    assert judged(doubtful="VAF 80 is below 95") == "doubtful"
    assert judged(["saturation (flag)"]) == "flagged"
    assert judged(K_low=299.9) == "right"


def lines_of(text):
    """Lines without the seconds that a stage took, and without blanks at the end."""
    return [re.sub(r" in \d+ s$", " in N s", line.rstrip()) for line in text]


def test_the_commands_of_the_tutorial_print_what_it_shows_and_end_with_its_figure_without_a_flag(tmp_path):
    folder = tmp_path / "a place with blanks"
    folder.mkdir()
    said = list(said_by_page(folder))
    assert [command.split()[1] for command, _, _ in said] == ["record.py", "init", "ingest", "fit", "run", "results"]
    for command, shown, printed in said:
        shown, printed = lines_of(shown), lines_of(printed)
        if LEFT_OUT in shown:
            assert [line for line in shown if line not in (*printed, LEFT_OUT)] == [], command
        else:
            assert shown == printed, command
    assert (folder / FIGURE).stat().st_size > 10_000
    assert (DOCS / "tutorial.png").exists()
    assert "flag" not in (folder / "my_campaign/results/tables/quality.csv").read_text()
    source = folder / "my_campaign/sources/csv.yaml"
    assert yaml.safe_load(source.read_text())["channels"]["torque"]["sign"] == -1
    schema = source.read_text().splitlines()[0].split("=")[1]
    assert (source.parent / schema).exists()
