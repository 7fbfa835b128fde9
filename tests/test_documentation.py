"""The documents name files, functions and pages that exist."""

import re
from importlib import import_module

import pytest
from conftest import ROOT

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


def test_the_map_of_the_code_names_every_room():
    rooms = {path.parent.name for path in (ROOT / "osl_analysis").glob("*/__init__.py")}
    readme = (ROOT / "README.md").read_text()
    assert {room for room in rooms if f"  {room}/" not in readme} == set()


def test_the_first_page_of_the_site_leads_to_every_page():
    linked = {(ROOT / "docs" / link).resolve() for link in LINK.findall((ROOT / "docs/index.md").read_text())}
    pages = {*(ROOT / "docs").glob("*.md"), *(ROOT / "docs/site").glob("*.md")} - {ROOT / "docs/index.md"}
    assert pages - linked == set()
