# SPDX-License-Identifier: Apache-2.0
"""A campaign of odd names and hostile texts, run as a module of another workflow."""

import csv
import io
import os
import re
import shutil
from importlib.metadata import version
from pathlib import Path
from subprocess import CompletedProcess
from zipfile import ZipFile

import pytest
import yaml
from conftest import ROOT
from snakemake.io import PeriodicityDetector
from snakemake_runs import run_forked
from test_small_campaigns import SOURCE, write_campaign

from osl_analysis.jobs.snakemake_attributes import TRIED

NOTE = (
    "=HYPERLINK(1)\n\n\\input{/etc/hostname}\n<script>alert(1)</script> [a](http://b) | c"
    " \x1b[31m $x$ ¶ [@d] \u202e {trial} <results>"
)
"""Why a trial is excluded, by somebody who means harm."""
NAMES = {
    "braces": "k{trial}.csv",
    "unknown": "{x}.csv",
    "angles": "a<results>b<y>.csv",
    "signs": "a b, 'c' \"d\" #%&$;é~.csv",
    "formula": "=1+2.csv",
    "long": f"{'n' * 200}.csv",
    "a" * 19: f"{'a' * 40}.csv",
    f"k_{'12' * 19}": "12.csv",
}
"""The recordings, by trial."""
RESULTS = "out 'é' #%&$, \"x [1]*?"
MODULE = f"""
configfile: "config.yaml"

module osl:
    snakefile: {str(ROOT / "Snakefile")!r}
    config: config

use rule * from osl as osl_*
"""


def asked(folder: Path, *options: str) -> CompletedProcess[str]:
    command = ["snakemake", "--snakefile", "module.smk", "--force-use-threads", *options]
    return run_forked(command, folder)


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The campaign after its first run. `signs` has a gap, for which it is left out, `long` is cut
    so that it cannot be read."""
    folder = tmp_path_factory.mktemp("odd")
    write_campaign(folder, {"spring": "torque_angle"})
    header, *lines = (folder / "spring.csv").read_text().splitlines()
    raw, sources = folder / "raw{1}<z>", folder / "sources{2}"
    raw.mkdir()
    sources.mkdir()
    (sources / "s{3}.yaml").write_text(yaml.safe_dump(SOURCE))
    rows = [["trial", "experiment", "log", "log_source", "exclude"]]
    for number, (trial, name) in enumerate(NAMES.items()):
        (raw / name).write_text("\n".join([header, *lines[number:]]))  # no two are alike
        rows.append([trial, "torque_angle", name, "s{3}", ""])
    rows.append(["noted", "torque_angle", NAMES["braces"], "s{3}", NOTE])
    gap = raw / NAMES["signs"]
    gap.write_text(re.sub(r"\n30\.[0-4].*", "", gap.read_text()))
    cut = raw / NAMES["long"]
    cut.write_text(cut.read_text()[:60])
    shutil.copy(raw / NAMES["braces"], raw / "{of no row}<q>.csv")
    with (folder / "trials.csv").open("w", newline="") as sheet:
        csv.writer(sheet).writerows(rows)
    own = {
        "campaign": "odd",
        "raw_data": raw.name,
        "sheet": "trials.csv",
        "sources": sources.name,
        "results": RESULTS,
        "simulation": None,
        "parameters": None,
        "impedance_trajectory": None,
        "recorded": "{x}\n\\input{y} <b>",
        "quality": {"exclude": ["gap"]},
        "failed_trials": "accept",
    }
    (folder / "config.yaml").write_text(yaml.safe_dump(own))
    (folder / "module.smk").write_text(MODULE)
    ended = asked(folder, "--cores", "1", "osl_reproduce-all")
    assert not ended.returncode, ended.stdout
    (folder / "said.txt").write_text(ended.stdout)
    return folder


def test_every_odd_name_is_worked_with(odd):
    for trial in NAMES:
        fit = (odd / RESULTS / f"fits/torque_angle/{trial}.csv").read_text()
        assert ("not analysed" in fit) == (trial == "long"), fit


def test_a_second_run_as_a_module_has_nothing_to_do(odd):
    assert "Nothing to be done" in asked(odd, "-n", "osl_reproduce-all").stdout


@pytest.mark.parametrize("file", ["raw{1}<z>/k{trial}.csv", "sources{2}/s{3}.yaml"])
def test_a_change_of_a_file_that_snakemake_takes_for_a_pattern_is_seen(odd, tmp_path, file):
    shutil.copytree(odd, tmp_path / "odd")
    changed = tmp_path / "odd" / file
    changed.write_text(changed.read_text().replace("N*m", "N*cm").replace("\n1.0,", "\n1.00,", 1))
    os.utime(changed)

    said = asked(tmp_path / "odd", "-n", "osl_reproduce-all").stdout

    assert re.search(rf"osl_ingest +{1 if 'trial' in file else len(NAMES)}\n", said), said


def test_a_folder_of_results_that_means_several_is_refused_by_its_setting(odd):
    ended = asked(odd, "-n", "--config", "results=out{1}")

    assert ended.returncode
    assert "results = out{1} has one of the signs {}<>" in ended.stdout


def test_no_text_of_a_person_is_code_of_an_output(odd):
    results = odd / RESULTS
    texts = {file: file.read_text() for file in results.rglob("*.*") if file.suffix in SAFE}

    assert {file.suffix for file in texts} == {*SAFE}
    assert r"{recorded \{x\} \textbackslash{}input\{y\} <b>}" in texts[results / "numbers.tex"]
    for file, text in texts.items():
        assert SAFE[file.suffix](text), file
    assert not re.search(r"[\x00-\x08\x0b-\x1f\u202e]", (results / "brief.txt").read_text())


def has_no_command(text: str) -> bool:
    """Whether LaTeX takes no line of a person for a command."""
    return r"\input" not in re.sub(r"(?m)(?<!\\)%.*$", "", text)


def has_no_formula(text: str) -> bool:
    return not any(
        re.match(r"[=+@\t\r]|-(?![\d.])", cell)
        for row in csv.reader(io.StringIO(text))
        for cell in row
    )


SAFE = {
    ".tex": has_no_command,
    ".csv": has_no_formula,
    ".md": lambda text: not re.search(r"<script|<b>|\]\(http://b", text),
    ".html": lambda text: "<script>alert" not in text and "\x1b" not in text,
}
"""Whether a text is harmless, by the suffix of its file."""


def test_files_of_a_refused_trial_have_the_columns_of_those_of_a_sound_one(odd):
    results = odd / RESULTS
    for place in ("quality/{}.csv", "fits/torque_angle/{}.csv"):
        sound, refused = (
            (results / place.format(trial)).read_text().split("\n")[0]
            for trial in ("braces", "long")
        )
        assert refused == sound
    tables = []
    for trial in ("braces", "long"):
        archive = ZipFile(results / f"fits/torque_angle/{trial}.zip")
        tables.append({name: archive.read(name).split(b"\n")[0] for name in archive.namelist()})
    assert tables[1].pop("not_analysed.csv")
    assert tables[1] == tables[0]


@pytest.mark.parametrize("name", ["a" * 20, "k_" + "12" * 25, "a" * 19, "k_" + "12" * 19, "run_01"])
def test_a_name_that_snakemake_would_stop_at_is_refused(odd, tmp_path, name):
    folder = tmp_path / "odd"
    shutil.copytree(odd, folder, ignore=shutil.ignore_patterns("out*"))
    sheet = folder / "trials.csv"
    sheet.write_text(sheet.read_text().replace("braces,", f"{name},", 1))

    said = asked(folder, "-n", "osl_reproduce-all").stdout

    is_refused = f"the name of trial '{name}' ends in 20 times" in said
    assert is_refused == (PeriodicityDetector().is_periodic(name) is not None), said


def test_nothing_of_snakemake_s_classes_is_imported_to_be_replaced():
    """Rules import its error and its check of versions, `osl-analysis run` its command line."""
    internal = re.compile(r"^ *(?:from|import) (snakemake(?!_interface)\S*)", re.MULTILINE)
    files = [*ROOT.glob("osl_analysis/**/*.py"), *ROOT.glob("rules/*.smk"), ROOT / "Snakefile"]

    imported = {name for file in files for name in internal.findall(file.read_text())}

    assert imported == {"snakemake.cli", "snakemake.exceptions", "snakemake.utils"}


def test_what_snakemake_does_not_document_was_tried_with_this_release():
    minor = tuple(map(int, version("snakemake").split(".")[:2]))

    oldest, newest = (tuple(map(int, release.split("."))) for release in TRIED)
    assert oldest <= minor <= newest, "try it, and raise the second of TRIED"
