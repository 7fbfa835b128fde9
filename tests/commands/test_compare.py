# SPDX-License-Identifier: Apache-2.0
"""Two campaigns side by side: numbers, settings and recordings."""

import math
import re
from dataclasses import replace

import pytest
from conftest import refused_with

from osl_analysis.base.table import read_table
from osl_analysis.commands.compare import compare_campaigns, compared
from osl_analysis.report.numbers import RANGE, Number, to_json

ABOUT = dict.fromkeys(("campaign", "version", "configuration", "recorded"), "x")
ABOUT["data"] = "simulated"
K = Number("K", 300.0, 297.0, 303.0, "units", "N*m/rad", "stiffness", None, 1, 0, 0)


def write_summary(folder, *numbers, recorded="", **settings):
    """The summary of a campaign with recordings of these SHA-256."""
    recordings = {f"file {digest}": digest for digest in recorded}
    content = {"settings": settings, "trace": {"recordings": recordings}}
    text = to_json(ABOUT, numbers, content)
    folder.mkdir()
    (folder / "summary.json").write_text(text)
    return folder


def test_the_half_width_of_a_difference_is_the_root_of_the_sum_of_squares_of_both():
    row = compared(K, replace(K, value=310.0, low=306.0, high=314.0))

    assert row["difference"] == 10
    assert row["difference_high"] - row["difference"] == pytest.approx(math.hypot(3, 4))
    assert row["difference"] - row["difference_low"] == pytest.approx(math.hypot(3, 4))


@pytest.mark.parametrize("other", [replace(K, interval=RANGE), replace(K, low=None, high=None)])
def test_a_difference_without_two_intervals_has_none(other):
    assert "difference_low" not in compared(K, other)


def test_the_settings_that_differ_are_named_and_the_table_is_written(tmp_path):
    a = write_summary(tmp_path / "a", K, cutoff_hz="15", order="4")
    b = write_summary(tmp_path / "b", replace(K, value=310.0), cutoff_hz="12", order="4")

    _, text = compare_campaigns((a, b), tmp_path / "out")

    assert re.search("cutoff_hz.* 15 .* 12 ", text)
    assert "order" not in text
    written = read_table(tmp_path / "out/comparison.csv")
    assert written.select("quantity", "A_low", "B", "difference").rows() == [("K", 297, 310, 10)]


@pytest.mark.parametrize(("of_b", "K_of_b", "told"), [
    ("1", 300.0, "the same recordings.* listed: 1 of 1 numbers"),
    ("12", 310.0, "1 common recordings.* listed: 0 of 1 numbers"),
    ("2", 300.0, ""),
])  # fmt: skip
def test_differences_between_shared_recordings_have_no_interval(tmp_path, of_b, K_of_b, told):
    a = write_summary(tmp_path / "a", K, recorded="1")
    b = write_summary(tmp_path / "b", replace(K, value=K_of_b), recorded=of_b)

    table, text = compare_campaigns((a, b), tmp_path / "out")

    assert re.search(told, text)
    assert ("A and B hold" in text) == bool(told)
    assert ("stiffness" in text) == ("1 of 1 numbers" not in text), "what differs is shown"
    assert table["difference_low"].null_count() == bool(told)


def test_groups_without_a_counterpart_are_named(tmp_path):
    a = write_summary(tmp_path / "a", K, replace(K, name="K_slow", subject="slow"))
    b = write_summary(tmp_path / "b", K, replace(K, name="K_s", meaning="belt"))

    _, text = compare_campaigns((a, b), tmp_path / "out")

    assert re.findall("in (.) alone, .*: (.*)", text) == [("A", "slow"), ("B", "belt")]


def test_a_folder_is_not_compared_with_itself_nor_with_one_without_common_numbers(tmp_path):
    a = write_summary(tmp_path / "a", K)
    other = write_summary(tmp_path / "b", replace(K, name="K_s"))

    for b, reason in ((a, str(a)), (other, f"{a}.*{other}")):
        with refused_with(reason):
            compare_campaigns((a, b), tmp_path / "out")
    assert not (tmp_path / "out").exists()
