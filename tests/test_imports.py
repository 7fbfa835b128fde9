"""Who may import whom: data flows one way, and the simulator shares nothing with what it is used to check."""

import re

import pytest
from conftest import ROOT

from osl_analysis.jobs.request import imported_names

PACKAGE = ROOT / "osl_analysis"
COMMON = {"errors", "trial", "measured", "compiled"}
MAY_IMPORT = {
    "model": COMMON | {"model", "parameters"},
    "simulator": COMMON
    | {"simulator", "shared_choices", "model", "parameters", "sheet", "yaml_settings", "files"}
    | {"experiments", "multisine"},
    "formats": COMMON | {"formats"},
    "ingest": COMMON | {"ingest", "formats", "memory", "plate_surface", "signals", "yaml_settings"},
    "stats": COMMON | {"stats", "signals"},
    "protocol": COMMON | {"protocol", "signals", "stats", "timebase"},
    "spectral": COMMON | {"spectral", "stats", "signals", "model", "parameters"},
    "design": COMMON | {"design", "bench", "spectral", "stats", "signals", "multisine"},
    "timebase": COMMON | {"timebase", "signals"},
    "bench": COMMON
    | {"bench", "protocol", "spectral", "stats", "second_order", "judge", "signals", "timebase"}
    | {"model", "parameters", "yaml_settings"},
    "walking": COMMON
    | {"walking", "stats", "second_order", "signals", "timebase", "yaml_settings"}
    | {"plate_surface"},
    "judge": COMMON
    | {"judge", "plate_surface", "protocol", "experiments", "files", "parameters", "refusal"}
    | {"signals", "stats", "table", "timebase", "yaml_settings"},
    "figures": COMMON | {"figures", "judge"},
    "report": COMMON | {"report", "experiments", "dictionary", "summary", "campaign", "judge"},
}


def stations(folder: str) -> set[tuple[str, str]]:
    """(module, station that it imports) for every module of ours in a folder. Modules of `config` and `jobs` are each a
    station."""
    return {
        (str(path.relative_to(PACKAGE)), re.sub(r"\.(config|jobs)(?=\.)", "", name).split(".")[1])
        for path in (PACKAGE / folder).rglob("*.py")
        for name in imported_names(path)
    }


@pytest.mark.parametrize("folder", MAY_IMPORT)
def test_a_station_imports_only_what_lies_before_it(folder):
    assert {(m, s) for m, s in stations(folder) if s not in MAY_IMPORT[folder]} == set()


def test_only_the_simulate_command_the_study_and_the_schemas_know_the_simulator():
    users = {m for m, s in stations(".") if s == "simulator" and not m.startswith(("simulator/", "study/"))}
    assert users <= {"commands/simulate.py", "commands/study.py", "commands/reference.py"}


def test_nothing_but_its_command_imports_the_study():
    users = {m for m, s in stations(".") if s == "study" and not m.startswith("study/")}
    assert users == {"commands/study.py"}


def test_commands_are_called_by_the_command_line_and_the_functions_for_notebooks_alone():
    users = {m for m, s in stations(".") if s == "commands" and not m.startswith("commands/")}
    assert users == {"cli.py", "notebook.py", "__init__.py"}


def test_nothing_but_the_front_door_imports_the_functions_for_notebooks():
    users = {m for m, s in stations(".") if s == "notebook"}
    assert users == {"__init__.py"}


def test_matplotlib_stays_in_the_figures():
    users = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if "import matplotlib" in path.read_text() or "from matplotlib" in path.read_text()
    }
    assert {user for user in users if not user.startswith("figures/")} == set()
