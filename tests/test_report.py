"""The report, whose signals survive packing and which says what the tables say, and the pages of
the documentation."""

import re
from importlib import import_module

import pytest
from conftest import ROOT

from osl_analysis.figures import FIGURES
from osl_analysis.report.typography import printed


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


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_says_in_two_or_three_sentences_how_to_read_it(name):
    reading = FIGURES[name].reading

    assert re.search(r"\. Good: .+\. Bad: ", reading), "write `What it is. Good: ... Bad: ...`"
    assert reading.endswith(".")
    assert len(reading.split()) <= 75


@pytest.fixture
def site(monkeypatch):
    """The modules of the site."""
    monkeypatch.syspath_prepend(ROOT / "docs/site")
    return {name: import_module(name) for name in ("commands", "pages", "settings")}


PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "docs").glob("*.md")),
]
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)(?:#[^)]*)?\)")


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
