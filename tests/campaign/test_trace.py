# SPDX-License-Identifier: Apache-2.0
"""Results say what decides them, by values: a comment changes nothing, a value does."""

import re
import shutil
import subprocess
from importlib.metadata import version
from pathlib import Path

import pytest

from osl_analysis.base.errors import InputError
from osl_analysis.campaign import campaign_trials
from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.campaign.origin import about, changed_settings, settings_of, stated_digests
from osl_analysis.commands.report import trace_text
from osl_analysis.judge.checks import SHIPPED_QUALITY
from osl_analysis.judge.limits import SHIPPED_DOUBTFUL

SOURCE = """
format: csv
time: {column: t, unit: s}
channels:
  theta: {column: a, unit: deg}
  torque: {column: b, unit: Nm, delay: 2 ms}
"""


def campaign(folder: Path, cells: str = "90", config: str = "", source: str = SOURCE):
    """A campaign of one real trial."""
    (folder / "sources").mkdir(exist_ok=True)
    (folder / "sources/bench.yaml").write_text(source)
    (folder / "trials.csv").write_text(
        f"trial,experiment,K_d,B_d,log,log_source,accept,exclude\na,impedance,{cells},1,a.csv,bench,,\n"
        "b,impedance,90,1,b.csv,bench,rate gap,\nc,impedance,90,1,c.csv,bench,,slipped\n"
    )
    (folder / "config.yaml").write_text(
        f"simulation: null\nsheet: {folder}/trials.csv\nsources: {folder}/sources\n{config}"
    )
    return open_campaign(read_config(folder / "config.yaml"), None)


def test_a_comment_changes_no_digest_and_a_value_changes_its_own(tmp_path):
    first = stated_digests(campaign(tmp_path), [])

    said = campaign(tmp_path, source=f"# of the new bench\ndescription: mine\n{SOURCE}")
    assert stated_digests(said, []) == first
    for name, made in (
        ("source bench", {"source": SOURCE.replace("2 ms", "3 ms")}),
        ("sheet", {"cells": "60"}),
        ("configuration", {"config": "dynamometer: {cutoff_hz: 12}"}),
    ):
        changed = campaign(tmp_path, **made)
        digests = stated_digests(changed, [])
        assert [key for key in first if digests[key] != first[key]] == [name]
        assert about(changed, [])["configuration"] != about(campaign(tmp_path), [])["configuration"]


def test_a_source_file_that_is_wrong_or_missing_has_another_digest(tmp_path):
    digests = [
        campaign(tmp_path, source=text).source_digests[tmp_path / "sources/bench.yaml"]
        for text in (SOURCE, SOURCE.replace("deg", "UNKNOWN"), SOURCE.replace("deg", "furlong"))
    ]

    assert len({*digests, campaign_trials.digest_of_source(tmp_path / "none.yaml")}) == 4


def test_a_line_of_code_is_another_code(tmp_path, monkeypatch):
    package = tmp_path / "package"
    shutil.copytree(campaign_trials.PACKAGE / "stats", package)
    monkeypatch.setattr(campaign_trials, "PACKAGE", package)

    before = campaign_trials.code.__wrapped__()
    assert campaign_trials.code.__wrapped__() == before
    with (package / "repeats.py").open("a") as file:
        file.write("LARGEST_RATIO = 2.0\n")
    assert campaign_trials.code.__wrapped__() != before


def version_in(package, monkeypatch):
    monkeypatch.setattr(campaign_trials, "PACKAGE", package)
    return campaign_trials.code_version.__wrapped__()


def test_the_version_tells_the_code_by_tag_and_commit_else_by_its_digest(tmp_path, monkeypatch):
    package = tmp_path / "osl_analysis"
    package.mkdir()
    code = package / "fit.py"
    code.write_text("K = 1\n")
    release = version("osl-impedance")
    assert re.fullmatch(rf"{release}\+[0-9a-f]{{8}}", version_in(package, monkeypatch))

    def git(*words):
        identity = ("-c", "user.name=a", "-c", "user.email=a@example.org")
        subprocess.run(["git", *identity, *words], cwd=tmp_path, check=True, capture_output=True)

    git("init")
    git("add", ".")
    git("commit", "-m", "Fit")
    committed = version_in(package, monkeypatch)
    assert re.fullmatch(rf"{release}\+g[0-9a-f]{{7,}}", committed)
    code.write_text("K = 2\n")
    assert version_in(package, monkeypatch) == f"{committed}-changed"
    git("commit", "-am", "Fit better")
    git("tag", "v3.1.0")
    (tmp_path / "config.yaml").write_text("campaign: mine\n")
    git("add", ".")
    git("commit", "-m", "Add a campaign")
    assert version_in(package, monkeypatch) == "3.1.0"


def test_what_decides_verdicts_and_is_not_shipped_is_listed(tmp_path):
    loosened = "doubtful: {accuracy: {K: 0.1}}\nquality: {gap: 2 s}\n"

    changed = {row["setting"]: row for row in changed_settings(campaign(tmp_path, config=loosened))}

    assert {name: (row["default"], row["value"]) for name, row in changed.items()} == {
        "doubtful.accuracy.K": ("0.02", "0.1"),
        "quality.gap": ('"0.05 s"', '"2 s"'),
        "accept of b": (None, "rate gap"),
        "exclude of c": (None, "slipped"),
    }


def test_the_shipped_configuration_decides_by_its_defaults():
    config = read_config(Path("config/config.yaml"))

    decides = config.model_dump(mode="json", include={"doubtful", "quality"})

    assert decides == {"doubtful": SHIPPED_DOUBTFUL, "quality": SHIPPED_QUALITY}


NUMBER = {
    "value": 90.1,
    "low": 89.0,
    "high": 91.2,
    "interval": "95 %",
    "unit": "N*m/rad",
    "draft": None,
    "meaning": "stiffness",
    "n": 1,
    "n_doubtful": 1,
    "table": "impedance",
    "trials": ["a"],
}


def summary_of(folder):
    made = campaign(folder)
    return {
        "numbers": {"K_K_d_90": NUMBER},
        "settings": settings_of(made),
        "changed": changed_settings(made),
        "digest": "d1g357",
        "trace": {
            "stated": stated_digests(made, []),
            "recordings": {"a.csv": "5" * 64, "b.csv": "6" * 64},
            "trials": {
                "a": {"experiment": "impedance", "files": ["a.csv", "source bench"]},
                "b": {"experiment": "impedance", "files": ["b.csv", "source bench"]},
            },
            "code": {"version": "3.0.0", "digest": "c0de"},
            "libraries": {"numpy": "2.0"},
        },
    }


@pytest.mark.parametrize("asked", ["K_K_d_90", r"\oslKKDNineZero", "oslKKDNineZero", "90.1"])
def test_a_number_is_traced_to_its_files_trials_and_settings(tmp_path, asked):
    summary = summary_of(tmp_path)

    text = trace_text(summary, asked)

    for told in (
        "tables/impedance.csv; 1 of 2 left out as doubtful",
        "trial a: a.csv 555555555555",
        f"source bench {summary['trace']['stated']['source bench']}",
        "dynamometer.cutoff_hz 15.0",
        "accept of b",
        "digest c0de",
        "numpy 2.0",
        "digest of all: d1g357",
    ):
        assert told in text
    assert "trial b" not in text
    assert "walking.cutoff_hz" not in text


def test_a_number_that_is_none_is_told_with_the_nearest(tmp_path):
    with pytest.raises(InputError, match="K_K_d_90"):
        trace_text(summary_of(tmp_path), "K_K_d_91")
