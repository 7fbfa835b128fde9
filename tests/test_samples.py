"""What ingest says to a folder of recordings, as a table that no stranger's text can break."""

import re

import numpy as np
import pytest
from c3d_builder import REAL_DATA, write_c3d
from conftest import ROOT
from mcap_builder import stamped, write_log

from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands.inspect import SUFFIXES, escaped, samples_table
from osl_analysis.errors import InputError
from osl_analysis.judge.table import QualityRules

RULES = read_section(ROOT / "config/config.yaml", "quality", QualityRules)


def rows(folder):
    """The table's cells by file."""
    lines = samples_table(folder, RULES).splitlines()[2:]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    return {file: rest for file, *rest in cells}


def test_what_is_read_is_told_with_rates_and_gaps_and_what_is_refused_with_the_reason_and_without_the_folder(tmp_path):
    """A capture, a log, an invalid one of each, a table, and files that are not read."""
    positions = np.concatenate([np.linspace(1, 2, 300).reshape(100, 1, 3), np.zeros((100, 1, 1))], axis=2)
    positions[40:65] = 0.0
    write_c3d(tmp_path / "walk.c3d", positions, rate=100.0, POINT__LABELS=["a|<b>"])
    log = [stamped(k * 1_000_000 + (k > 5) * 7_000_000, angle=0.0, torque=1.0, sync=False) for k in range(10)]
    write_log(tmp_path / "bench.mcap", log)
    for name, content in (
        ("broken.C3D", b"no C3D file"), ("broken.mcap", b"no MCAP file"), ("table.csv", b"a,b\n1,2\n"),
        ("lab.tdms", b"TDSm\0\0"), ("lab.xlsx", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(500)), ("a.md", b"nothing"),
    ):  # fmt: skip
        (tmp_path / name).write_bytes(content)
    found = rows(tmp_path)
    assert found["bench.mcap"][0] == "mcap"
    assert found["bench.mcap"][1] == "/lab: 10 messages at 1000 Hz, numbers in each: 3; 1 gaps, the longest 0.008 s"
    assert found["walk.c3d"][1] == "frames: 100, from 1 on, at 100 Hz<br>1 x marker at 100 Hz; 25.0% missing"
    assert "ok<br>marker\\_gap: 0.25 s, threshold 0.2 (a\\|&lt;b&gt;" in found["walk.c3d"][2]
    assert found["table.csv"] == ["csv", "rows: 1<br>2 x column", ""]
    assert found["broken.C3D"][2].startswith("refused: not a C3D file")
    assert found["broken.mcap"][2].startswith("refused: not an MCAP file")
    assert found["lab.tdms"][2].startswith("refused: the TDMS file ")
    assert found["lab.xlsx"][2] == "refused: an Excel workbook, which is not read; save its sheet as 'CSV UTF-8'"
    assert str(tmp_path) not in samples_table(tmp_path, RULES)


def test_a_capture_whose_plates_are_refused_is_tried_without_them_and_refused_once(tmp_path):
    points = np.ones((200, 2, 4)) * [1, 2, 3, 0]
    plates = {"FORCE_PLATFORM__USED": np.array([1]), "FORCE_PLATFORM__TYPE": np.array([9])}
    write_c3d(tmp_path / "plate.c3d", points, **plates)
    write_c3d(tmp_path / "twice.c3d", points, POINT__LABELS=["TOE", "TOE"])
    said = {file: cells[2].split("<br>") for file, cells in rows(tmp_path).items()}
    assert said["plate.c3d"][0].startswith("refused: plate 1: FORCE\\_PLATFORM:CORNERS")
    assert said["plate.c3d"][1] == "ok without plates"
    assert [line for line in said["twice.c3d"] if "refused" in line] == [
        "refused: marker 'TOE' occurs 2 times; rename them, or list others in the source file"
    ]


def test_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"no recordings below it \(\..*\.mcap, \.bag, \.db3, .*\.csv\)"):
        samples_table(tmp_path, RULES)


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="no real data")
def test_the_page_in_the_documentation_names_every_real_sample():
    page = (ROOT / "docs/real_samples.md").read_text()
    samples = [p for p in REAL_DATA.rglob("*") if p.suffix.lower() in SUFFIXES]
    assert len(samples) >= 30
    assert [p.name for p in samples if escaped(p.name) not in page] == []
