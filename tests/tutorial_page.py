"""`python tests/tutorial_page.py FOLDER` follows docs/tutorial.md, prints what it prints, and
copies the picture."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

from click.testing import CliRunner
from snakemake_runs import run_forked

from osl_analysis.cli import main

DOCS = Path(__file__).parent.parent / "docs"
PAGE, FIGURE = DOCS / "tutorial.md", "my_campaign/results/figures/fig5.png"
BLOCK, LEFT_OUT = re.compile(r"```(\w*)\n(.*?)```\n", re.DOTALL), "…"
"""A line of the page for lines that are printed and not shown."""


def said_by_page(folder: Path) -> Iterator[tuple[str, list[str], list[str]]]:
    """Each command of the page, the lines that it shows, and those printed; files are written as
    the page says."""
    here = folder
    for kind, text in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        if kind == "python":
            (folder / "record.py").write_text(text, encoding="utf-8")
        elif kind == "yaml":
            edit(folder / "my_campaign", text)
        else:
            for part in text.removeprefix("$ ").split("\n$ "):
                command, *shown = part.strip().splitlines()
                if command.startswith("cd "):
                    here = here / command.split()[1]
                else:
                    yield command, shown, printed_by(command.split(), here).strip().splitlines()


def printed_by(command: list[str], folder: Path) -> str:
    """What a command prints. Those of the package are called in processes that have the imports."""
    if command[:2] == ["osl-analysis", "run"]:
        return run_forked(command, folder).stdout
    if command[0] == "osl-analysis":
        with chdir(folder):
            return (
                CliRunner()
                .invoke(main, command[1:], catch_exceptions=False, standalone_mode=False)
                .output
            )
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    return subprocess.run(command, cwd=folder, env=os.environ | {"PATH": path}, text=True,
        check=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT).stdout  # fmt: skip


def edit(campaign: Path, text: str) -> None:
    """Write a line of the page in place of the line of this signal in the source file, or below the
    configuration."""
    source, config = campaign / "sources/csv.yaml", campaign / "config.yaml"
    key = text.split(":")[0] + ":"
    lines = source.read_text(encoding="utf-8").splitlines(keepends=True)
    if any(line.startswith(key) for line in lines):
        source.write_text(
            "".join(text if line.startswith(key) else line for line in lines), encoding="utf-8"
        )
    else:
        config.write_text(config.read_text(encoding="utf-8") + text, encoding="utf-8")


if __name__ == "__main__":
    place = Path(sys.argv[1])
    place.mkdir(parents=True)
    for command, _, printed in said_by_page(place):
        print(f"$ {command}", *printed, sep="\n")
    shutil.copy(place / FIGURE, DOCS / "tutorial.png")
