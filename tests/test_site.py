"""The documentation site: what its pages are made of, and what the check of the built site finds."""

import re
import sys
from importlib import import_module

import pytest
from conftest import ROOT

from osl_analysis.cli import main

PAGE = "<html><body><h1 id='top'>{title}</h1><a href='{link}'>a</a>{more}</body></html>"


@pytest.fixture(scope="module")
def site():
    """The modules of the site."""
    sys.path.insert(0, str(ROOT / "docs/site"))
    found = {name: import_module(name) for name in ("check", "commands", "pages")}
    sys.path.pop(0)
    return found


FAULTS = {
    "<a href='none.html'>b</a>": ["index.html: none.html leads nowhere"],
    "<a href='second.html#none'>b</a>": ["index.html: second.html#none leads to no heading"],
    "<a href='second.html#t%6Fp'>b</a>": [],
    "<script src='https://cdn.example/x.js'></script>": ["index.html: loads https://cdn.example/x.js from a network"],
    "<link href='//fonts.example/x.css'>": ["index.html: loads //fonts.example/x.css from a network"],
    "<a href='https://example.org'>b</a>": [],
    "<img src='none.png'>": ["index.html: none.png leads nowhere"],
    "<math><merror>x</merror></math>": ["index.html: 1 equations cannot be drawn"],
}


def test_the_check_of_the_built_site_finds_each_planted_fault(site, tmp_path):
    (tmp_path / "second.html").write_text(PAGE.format(title="second", link="index.html", more=""))
    for fault, said in FAULTS.items():
        (tmp_path / "index.html").write_text(PAGE.format(title="first", link="second.html#top", more=fault))
        assert list(site["check"].faults(tmp_path)) == said, fault
    (tmp_path / "index.html").write_text(PAGE.format(title="first", link="#top", more=""))
    (tmp_path / "site.css").write_text("@font-face { src: url('https://fonts.example/x.woff'); }")
    said = ["second.html: no link leads to this page", "site.css: loads something from a network"]
    assert list(site["check"].faults(tmp_path)) == said


def test_the_page_of_the_command_line_has_every_command_and_option(site):
    page = site["commands"].commands_page()
    for name, command in main.commands.items():
        part = page.split(f"\n## {name}\n")[1].split("\n## ")[0]
        options = [option for one in command.params for option in one.opts if option.startswith("--")]
        assert [option for option in options if option not in part] == [], name
        for row in re.findall(r"^\|.*$", part, re.MULTILINE):
            assert len(re.findall(r"(?<!\\)\|", row)) == 3, row
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


def test_the_first_page_of_the_site_leads_to_every_page():
    linked = {(ROOT / "docs" / link).resolve() for link in LINK.findall((ROOT / "docs/index.md").read_text())}
    pages = {*(ROOT / "docs").glob("*.md"), *(ROOT / "docs/site").glob("*.md")} - {ROOT / "docs/index.md"}
    assert pages - linked == set()
