# SPDX-License-Identifier: Apache-2.0
"""Files that are written completely or not at all; limits of memory."""

import errno
import ntpath
import re
from pathlib import Path

import polars as pl
import pytest
from conftest import refused_with
from polars.testing import assert_frame_equal

from osl_analysis.base.errors import WriteError, listing
from osl_analysis.base.files import ROOT, atomic_path, check_name, default_config, seen_from
from osl_analysis.base.memory import VARIABLE, allowed_memory
from osl_analysis.base.table import read_table, read_tables


def fail_as_the_system():
    raise OSError(errno.ENOSPC, "No space left on device")


def fail_as_polars():
    raise pl.exceptions.ComputeError("IO error: no space (os error 28)")


def fail_as_a_library_that_has_the_system_s_error_as_its_cause():
    try:
        fail_as_the_system()
    except OSError as error:
        raise RuntimeError("the library's own words") from error


@pytest.mark.parametrize(
    "fail",
    [
        fail_as_the_system,
        fail_as_polars,
        fail_as_a_library_that_has_the_system_s_error_as_its_cause,
    ],
)
def test_a_full_disk_is_told_with_the_file_that_was_to_be_written(tmp_path, fail):
    target = tmp_path / "table.csv"

    with (
        pytest.raises(WriteError, match=rf"{re.escape(str(target))}:.*\(No space left on device\)"),
        atomic_path(target),
    ):
        fail()


def test_an_error_of_another_file_within_the_block_stays_as_it_is(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "table.csv"):
        (tmp_path / "recording.csv").read_text()


def test_a_name_that_is_not_utf_8_is_refused_and_can_be_listed():
    with refused_with(r"k\\udcff: its name"):
        check_name(Path("k\udcff"))

    assert listing(["k\udcff"]).isprintable()


def test_a_file_that_was_written_completely_replaces_the_older_one(tmp_path):
    target = tmp_path / "table.csv"
    target.write_text("old")

    with atomic_path(target) as temporary:
        temporary.write_text("new")

    assert target.read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


def test_tables_are_read_below_one_another_as_each_of_them(tmp_path):
    contents = {
        "a": "trial,K,note\n01,1,x\n",
        "b": 'trial,K,note\n02,2.5,"two\nlines"',  # no break behind the last line
        "none": "trial,K,note\n",
        "other": "trial,B\n03,4\n",
        "again": "trial,K,note\n04,,\n",
    }
    paths = [tmp_path / f"{name}.csv" for name in contents]
    for path, content in zip(paths, contents.values(), strict=True):
        path.write_text(content)

    together = read_tables(paths)

    one_by_one = pl.concat([read_table(path) for path in paths], how="diagonal_relaxed")
    assert_frame_equal(together, one_by_one)
    assert together["trial"].to_list() == ["01", "02", "03", "04"]


def test_of_tables_that_are_read_together_the_wrong_one_is_named(tmp_path):
    (tmp_path / "a.csv").write_text("K,B\n1,2\n")
    (tmp_path / "b.csv").write_text("K,B\n1,2,3\n")

    with refused_with(r"b\.csv:.*a CSV table"):
        read_tables([tmp_path / "a.csv", tmp_path / "b.csv"])


def test_the_memory_that_is_stated_is_in_megabytes(monkeypatch):
    monkeypatch.setenv(VARIABLE, "250")

    assert allowed_memory() == 250e6


@pytest.mark.parametrize("text", ["much", "0", "-3", "1e300"])
def test_memory_that_is_no_number_of_megabytes_is_refused(monkeypatch, text):
    monkeypatch.setenv(VARIABLE, text)

    with refused_with(f"{VARIABLE}={text}:"):
        allowed_memory()


def test_a_folder_on_another_drive_of_windows_is_named_from_the_root(monkeypatch, tmp_path):
    recordings = tmp_path / "recordings"
    assert seen_from(tmp_path / "campaign", recordings) == Path("../recordings")

    monkeypatch.setattr(
        "os.path.relpath", lambda *_: ntpath.relpath("D:/recordings", "C:/campaign")
    )
    assert seen_from(tmp_path / "campaign", recordings) == recordings


def test_the_default_is_that_of_a_clone_here_and_no_other_workflow_s(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    shipped = ROOT / "config/config.yaml"
    here = tmp_path / "config/config.yaml"
    here.parent.mkdir()

    here.write_text("campaign: other\nthreads: 4\n")
    assert default_config() == shipped

    (tmp_path / "osl_analysis").mkdir()
    assert default_config().resolve() == here
