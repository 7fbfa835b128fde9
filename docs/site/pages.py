"""What the site shows beside docs/*.md: files of the top folder, all commands, functions, and the
navigation."""

import os
import re
from importlib import import_module
from pathlib import Path

from commands import commands_page
from settings import settings_page

import osl_analysis
from osl_analysis.commands.reference import described_checks
from osl_analysis.dictionary import described_tables, file_at
from osl_analysis.report.numbers import ENTRIES
from osl_analysis.report.text_tables import markdown_table

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FILES = {
    "site/overview": "README.md",
    "site/contributing": "CONTRIBUTING.md",
    "site/changes": "CHANGELOG.md",
    "site/results": "results/README.md",
}
"""Pages that are a file from elsewhere."""
PAGE_OF = {ROOT / file: f"{page}.md" for page, file in FILES.items()}
LINK = re.compile(r"\]\((?!https?:|mailto:|#)([^)#\s]+)")
NAVIGATED = re.compile(r"\[([^]]+)\]\(([\w/]+)\.md\)")
FUNCTIONS = {
    "Trials and signals": (
        "trial.Trial", "trial.read_trial", "trial.write_trial", "signals.sampling_rate",
        "signals.LowPass",
        "signals.Motion", "signals.filtered_motion", "signals.differentiate",
    ),
    "Fits": (
        "walking.impedance_fit.impedance_columns", "walking.impedance_fit.fit_without_offset",
        "stats.regression.linear_fit",
        "stats.regression.LinearFit",
    ),
    "Frequency response": (
        "spectral.periods.find_repetition", "spectral.periods.periodic_motion",
        "spectral.response.periodic_response",
    ),
    "The drivetrain": (
        "model.drivetrain.DrivetrainParameters", "model.drivetrain.motor_friction",
        "model.drivetrain.actuator_torque",
        "model.drivetrain.belt_deflection", "model.drivetrain.belt_torque",
        "model.drivetrain.joint_admittance", "model.drivetrain.desired_admittance",
        "model.drivetrain.RationalFunction",
    ),
    "The controller": (
        "model.compensator.select_gains", "model.compensator.compensated_gains",
        "model.compensator.uncompensated_gains", "model.compensator.stiffness_gain",
        "model.compensator.motor_current", "model.compensator.Gains",
        "model.compensator.optimal_damping",
    ),
}  # fmt: skip
"""What the page of functions has below the public names of the package, by heading."""


def fill_page(app, page, source):
    """Replace the text of a page that is made here, correct its links, and turn the links of the
    first page into the navigation. Sphinx calls it when it has read a page; `source` is a list with
    its text."""
    text = source[0]
    if page in FILES:
        text = with_links(ROOT / FILES[page], page).replace("# osl-analysis\n", "# Overview\n", 1)
    elif page == "site/commands":
        text = text.partition("\n")[0] + "\n\n" + commands_page()
    elif page == "site/tables":
        text = f"{text}\n{described_tables_page()}"
    elif page == "site/settings":
        text = f"{text}\n{settings_page()}"
    elif page == "site/functions":
        text = text + functions_page()
    else:
        text = corrected(text, (DOCS / page).parent, DOCS / f"{page}.md")
    if page == "index":
        text = navigated(text)
    source[0] = text


def described_tables_page():
    """Unit and meaning of every column of every table, of every check and of every entry of the
    summary, in Markdown."""
    sections = []
    for table in described_tables():
        columns = [(f"`{one.name}`", one.unit, one.meaning) for one in table.columns.values()]
        gathered = f" `{file_at(table.also)}` holds the rows of one trial." if table.also else ""
        sections.append(f"## `{file_at(table.place)}`\n\nRows: {table.rows}.{gathered}")
        sections.append(markdown_table([("column", "unit", "meaning"), *columns]))
    checks = [(f"`{name}`", unit, meaning) for name, unit, meaning in described_checks()]
    entries = [(f"`{one.name}`", one.unit, one.meaning) for one in ENTRIES]
    return "\n\n".join(
        [
            *sections,
            "## Checks of quality control",
            markdown_table([("check", "unit", "meaning of its value"), *checks]),
            "## Entries of `summary.json`",
            "Beside those of `claims.csv` that are about the campaign, by their `name`:",
            markdown_table([("entry", "unit", "meaning"), *entries]),
        ]
    )


def with_links(file, page):
    """The text of a file of the project, its links as seen from a page of the site."""
    return corrected(file.read_text(encoding="utf-8"), (DOCS / page).parent, file)


def corrected(text, folder, file):
    """The text of a file, its relative links as seen from a folder; a link to a file of `FILES`
    leads to its page."""

    def link(match):
        target = Path(os.path.normpath(file.parent / match[1]))
        target = DOCS / PAGE_OF.get(target, target)
        return "](" + Path(os.path.relpath(target, folder)).as_posix()

    return LINK.sub(link, text)


def navigated(text):
    """The first page, with a table of contents from the links below each of its headings."""
    first, *parts = re.split(r"(?m)^(?=## )", text)
    made = [first]
    for part in parts:
        entries = "\n".join(f"{title} <{page}>" for title, page in NAVIGATED.findall(part))
        caption = part.partition("\n")[0].removeprefix("## ")
        contents = f"```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{entries}\n```\n"
        made.append(f"{part.rstrip()}\n\n{contents if entries else ''}\n")
    return "".join(made)


def functions_page():
    """Directives that write the docstrings of the functions and types: those of the package, then
    those below them."""
    public = [one_function(f"osl_analysis.{name}") for name in getattr(osl_analysis, "__all__", ())]
    parts = {"Public names": sorted(public, key=lambda one: "autoclass" in one)} if public else {}
    for heading, names in FUNCTIONS.items():
        parts[heading] = [one_function(f"osl_analysis.{name}") for name in names]
    return "".join(
        f"\n## {heading}\n\n```{{eval-rst}}\n" + "\n\n".join(directives) + "\n```\n"
        for heading, directives in parts.items()
    )


def one_function(name):
    """The directive for a function or a type."""
    module, _, own = name.rpartition(".")
    if isinstance(getattr(import_module(module), own), type):
        return f".. autoclass:: {name}\n   :members:"
    return f".. autofunction:: {name}"
