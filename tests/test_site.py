"""The documentation site: what its pages are made of, and that their links lead somewhere."""

import re
from importlib import import_module

import pytest
from conftest import ROOT

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
