# SPDX-License-Identifier: Apache-2.0
"""The first minute: what the README shows of Python is what it prints."""

import re
import subprocess
import sys

import pytest
from conftest import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
MOST_WORDS = 900
RECORDING = ROOT / "docs/five_minutes/k300.csv"
K_TRUE, B_TRUE, I_TRUE = 279.0, 1.4, 0.03  # of docs/five_minutes/record.py


def block_after(heading, kind):
    """The first block of this kind below a heading."""
    text = README.partition(f"## {heading}\n")[2]
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return next(block for language, block in blocks if language == kind)


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("readme")
    (folder / RECORDING.name).write_bytes(RECORDING.read_bytes())
    program = block_after("One recording", "python")
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=True
    )
    assert (folder / "k300.png").stat().st_size > 10_000
    return done.stdout.splitlines()


def test_the_lines_of_python_print_what_the_readme_shows(printed):
    shown = block_after("One recording", "").splitlines()

    assert len(shown) >= 5
    for pattern, line in zip(shown, printed, strict=False):
        assert re.fullmatch(re.escape(pattern).replace("…", ".*"), line), line


def test_the_estimates_of_the_readme_hold_what_made_the_recording(printed):
    ends = [re.search(r"\(([\d.]+) to ([\d.]+)\)", line) for line in printed[1:4]]

    for truth, interval in zip((K_TRUE, B_TRUE, I_TRUE), ends, strict=True):
        assert float(interval[1]) <= truth <= float(interval[2])


def test_the_readme_is_read_in_a_few_minutes():
    assert len(README.split()) <= MOST_WORDS
