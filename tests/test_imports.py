"""What is imported where: the simulator shares nothing with what it is used to check, and a door
opens without what only some of its rooms need."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from functools import cache

import pytest
from conftest import ROOT

from osl_analysis.errors import EXTRAS

PACKAGE, DOORS = ROOT / "osl_analysis", {"cli", "notebook"}
GROUND = {path.stem for path in PACKAGE.glob("*.py")} - DOORS - {"__init__"}
"""Modules that every package may import."""


def imported(node: ast.AST) -> list[str]:
    """The dotted names below `osl_analysis.` that a statement imports."""
    if isinstance(node, ast.ImportFrom) and f"{node.module}.".startswith("osl_analysis."):
        above = f"{node.module}.".removeprefix("osl_analysis.")
        return [above + name.name for name in node.names]
    if isinstance(node, ast.Import):
        names = [name.name for name in node.names]
        below = [name for name in names if name.startswith("osl_analysis.")]
        return [name.removeprefix("osl_analysis.") for name in below]
    return []


def statements(node: ast.AST) -> Iterator[ast.stmt]:
    """Every statement below a node; an import is no part of an expression."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            yield child
            yield from statements(child)


@cache
def imports() -> set[tuple[str, str]]:
    """(module, package or module of the ground that it imports) for every module of ours."""
    return {
        (str(path.relative_to(PACKAGE)), name.split(".")[0])
        for path in PACKAGE.rglob("*.py")
        for node in statements(ast.parse(path.read_text()))
        for name in imported(node)
    }


def test_the_simulator_shares_nothing_with_what_it_is_used_to_check():
    allowed = {"config", "model", "simulator"} | GROUND
    assert [(m, s) for m, s in imports() if m.startswith("simulator/") and s not in allowed] == []


def test_a_library_of_an_extra_is_imported_where_one_line_says_what_to_install():
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    of_extra = defaultdict(set)
    for library, extra in EXTRAS.items():
        of_extra[extra].add(library)
    named = {
        extra: {re.match(r"[\w-]+", one)[0].lower() for one in needs}
        for extra, needs in asked.items()
    }
    assert {extra: named[extra] for extra in named.keys() - {"dev", "docs", "peers"}} == of_extra
    plain = re.compile(rf"^\s*(?:import|from) (?:{'|'.join(EXTRAS)})\b", re.MULTILINE)
    assert [path for path in PACKAGE.rglob("*.py") if plain.search(path.read_text())] == []


def test_the_container_has_the_lock_and_all_that_the_package_is_built_from():
    """What it copies exists, and is what `pyproject.toml` and its build name."""
    copied = set()
    for line in re.findall(r"(?m)^COPY (.*) \S+$", (ROOT / "Containerfile").read_text()):
        copied.update(line.split())
    assert [name for name in copied if not (ROOT / name).exists()] == []

    described = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = described["tool"]["hatch"]["build"]["targets"]["wheel"]
    project = described["project"]
    built_from = {*wheel["packages"], *wheel["force-include"], *project["license-files"]}
    assert copied == built_from | {project["readme"], "pyproject.toml", "requirements.lock"}


SLOW = (
    "scipy.special",
    "scipy.signal",
    "scipy.stats",
    "matplotlib",
    "numba",
    "pint",
    "snakemake",
)


@pytest.mark.parametrize(("modules", "more"), [
    ("cli", ["numpy", "polars", "pandas", "pydantic", "ruamel"]),
    ("trial table", ["pandas", "pydantic", "scipy"]),
    ("notebook commands.run commands.simulate"
     " commands.bench commands.fit commands.walking commands.walking_summary", []),
])  # fmt: skip
def test_a_door_opens_without_what_only_some_of_its_rooms_need(modules, more):
    """What takes tenths of a second to import is imported where it is used."""
    code = "; ".join(f"import osl_analysis.{name}" for name in modules.split())
    code += f"; import sys; print([name for name in {[*SLOW, *more]} if name in sys.modules])"
    told = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert told.stdout.strip() == "[]"
