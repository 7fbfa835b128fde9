"""A capture is stored as Vicon Nexus stores it; `test_simulator_laboratory.py` decodes what it holds."""

import ezc3d
import numpy as np
import pytest
from conftest import ROOT
from walking_setup import PERTURBED, load_setup

from osl_analysis.simulator.vicon import write_c3d

REAL = ROOT.parent / "shared/real_data/c3d/btk_PiG_Motion3_FF.c3d"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture")
    load_setup().record(folder, PERTURBED)
    return folder / "vicon/walking_01.c3d"


def test_a_hidden_marker_is_stored_as_zeros_with_residual_minus_one(file):
    raw, hidden = file.read_bytes(), np.isnan(ezc3d.c3d(str(file))["data"]["points"][0]).T
    header = np.frombuffer(raw[:512], "<i2")
    per_frame = 4 * int(header[1]) + int(header[2])
    start = (int(header[8]) - 1) * 512
    words = np.frombuffer(raw[start : start + 4 * len(hidden) * per_frame], "<f4").reshape(len(hidden), per_frame)
    stored = words[:, : 4 * hidden.shape[1]].reshape(*hidden.shape, 4)
    assert np.frombuffer(raw[12:16], "<f4")[0] < 0, "a negative POINT:SCALE is what marks floats"
    assert hidden.any()
    assert (stored[hidden] == [0, 0, 0, -1]).all()
    assert (stored[~hidden, 3] == 0).all()


def test_a_recording_that_cannot_be_stored_leaves_the_old_file_and_no_other(file):
    before = file.read_bytes()
    with pytest.raises(ValueError, match="must have the same length as nPoints"):
        write_c3d(file, np.zeros((40, 3, 3)), np.zeros((200, 7)), {"POINT": {"LABELS": ["FOOT1"]}})
    assert file.read_bytes() == before
    assert [f.name for f in file.parent.iterdir()] == ["walking_01.c3d"]


@pytest.mark.skipif(not REAL.exists(), reason="public sample recordings are not on this machine")
def test_every_force_plate_parameter_of_a_nexus_file_is_there_with_its_type_and_sign(file):
    ours, nexus = (ezc3d.c3d(str(f))["parameters"]["FORCE_PLATFORM"] for f in (file, REAL))
    for name in set(nexus) - {"__METADATA__"}:
        assert ours[name]["type"] == nexus[name]["type"], name
    assert np.sign(ours["ORIGIN"]["value"][2, 0]) == np.sign(nexus["ORIGIN"]["value"][2, 0])
