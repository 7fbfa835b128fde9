# SPDX-License-Identifier: Apache-2.0
"""What is imported where: the simulator shares nothing with what it is used to check, and a door
opens without what only some of its rooms need."""

import re
import subprocess
import sys
import tomllib

import pytest
from conftest import ROOT


def test_the_simulator_shares_nothing_with_what_it_is_used_to_check():
    """A package that is not named here would be wrong in the same way."""
    package = ROOT / "osl_analysis"
    allowed = {"base", "config", "model", "simulator"}
    code = "".join(path.read_text() for path in (package / "simulator").glob("*.py"))

    used = set(re.findall(r"(?:from|import) osl_analysis\.(\w+)", code))

    assert used - allowed == set()


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


@pytest.mark.parametrize(
    ("door", "more"),
    [
        ("import osl_analysis.cli", ["numpy", "polars", "pandas", "pydantic", "ruamel"]),
        ("from osl_analysis import Trial, to_pandas", ["pandas", "pydantic", "scipy"]),
        ("from osl_analysis import *", []),
    ],
)
def test_a_door_opens_without_what_only_some_of_its_rooms_need(door, more):
    """What takes tenths of a second to import is imported where it is used."""
    code = f"{door}; import sys; print([name for name in {[*SLOW, *more]} if name in sys.modules])"
    message = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert message.stdout.strip() == "[]"
