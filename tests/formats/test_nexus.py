# SPDX-License-Identifier: Apache-2.0
"""Exports of Nexus: what the file means comes out; what cannot be trusted is refused."""

import re

import numpy as np
import pytest
from recognised_files import refusal_by, source_of

from osl_analysis.formats import nexus
from osl_analysis.ingest.raw_files import read_converted

DEVICES = """Devices
200
,,AMTI #1 - Force,,,AMTI #1 - Moment,,,AMTI #1 - CoP,,,Sync - Voltage
Frame,Sub Frame,Fx,Fy,Fz,Mx,My,Mz,Cx,Cy,Cz,1
,,N,N,N,N.mm,N.mm,N.mm,mm,mm,mm,V
5,0,1,2,-700,1000,2000,3000,0,0,0,0.5
5,1,1,2,-701,1000,2000,3000,0,0,0,0.6
6,0,1,2,-702,1000,2000,3000,0,0,0,0.7
6,1,1,2,-703,1000,2000,3000,0,0,0,0.8
"""
TRAJECTORIES = """Trajectories
100
,,Anna:TOE,,,Anna:HEEL,,,*12,,
Frame,Sub Frame,X,Y,Z,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm,mm,mm,mm
5,0,1,2,3,,,,7,8,9
6,0,10,20,30,40,50,60,7,8,9
"""
MODEL = """Model Outputs
100
,,Anna:LAnkleMoment,,
Frame,Sub Frame,X,Y,Z
,,N.mm,N.mm,N.mm
5,0,1500,0,0
6,0,1600,0,0
"""
FLOOR = [[500, 600, 0], [0, 600, 0], [0, 0, 0], [500, 0, 0]]


def nexus_source(**fields):
    usual = {
        "analogs": {"sync": {"device": "Sync - Voltage", "component": "1"}},
        "outputs": {
            "reference_ankle_moment_left": {
                "label": "LAnkleMoment",
                "component": "x",
                "unit": "N*mm/kg",
            }
        },
        "plates": {1: {"device": "AMTI #1", "corners": FLOOR, "sign": -1}},
    }
    return source_of("nexus_csv", **usual | fields)


def exported(tmp_path, text, **fields):
    path = tmp_path / "trial.csv"
    path.write_text(text)
    return read_converted(path, nexus_source(**fields)).samples


def padded(text):
    return "".join(line + "," * (20 - line.count(",")) + "\n" for line in text.splitlines())


EXPORT = "\n".join([DEVICES, TRAJECTORIES, MODEL])
DRESSES = {
    "turned round": "\n".join([MODEL, TRAJECTORIES, DEVICES]),
    "padded": padded(EXPORT),
    "tabs": EXPORT.replace(",", "\t"),
    "semicolons": EXPORT.replace(",", ";").replace("0.", "0,"),
    "crlf": EXPORT.replace("\n", "\r\n"),
    "capitals": EXPORT.replace("Frame,Sub Frame,", "FRAME,SUB FRAME,"),
    "at the origin": EXPORT.replace("3,,,,", "3,0,0,0,"),
    "devices of a subject": EXPORT.replace(",AMTI", ",Anna:AMTI"),
    "no blank lines": DEVICES + TRAJECTORIES + MODEL,
}


@pytest.mark.parametrize("text", DRESSES.values(), ids=DRESSES)
def test_one_export_in_any_dress_is_one_recording(tmp_path, text):
    samples = exported(tmp_path, text)
    np.testing.assert_allclose(samples["time"], [0, 0.005, 0.01, 0.015], rtol=1e-12)
    np.testing.assert_allclose(samples["sync"], [0.5, 0.6, 0.7, 0.8])
    np.testing.assert_allclose(samples["plate1_force_z"], [700, 701, 702, 703])
    assert samples["marker_TOE_z"].to_list() == [0.003, None, 0.03, None]
    assert samples["marker_HEEL_x"].is_nan().to_list() == [True, None, False, None]
    assert samples["reference_ankle_moment_left"].to_list() == [1.5, None, 1.6, None]
    assert not [column for column in samples.columns if "12" in column]


def test_a_draft_asks_for_the_corners_of_each_device_with_a_force(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text(EXPORT)

    (question,) = nexus.read(path, None).questions

    assert "{device: AMTI #1, corners: UNKNOWN}" in question


def test_a_plates_moment_is_about_its_centre_wherever_the_file_takes_it(tmp_path):
    """A force F at p turns with (p - c) x F about c: here p is the laboratory's origin."""
    plate = {"device": "AMTI #1", "corners": FLOOR, "sign": -1, "moment_about": [0, 0, 0]}
    at_origin = exported(
        tmp_path, DEVICES.replace("1000,2000,3000", "0,0,0"), plates={1: plate}, outputs={}
    )
    expected = np.cross([-0.25, -0.3, 0], at_origin.select("^plate1_force_.$").to_numpy())
    np.testing.assert_allclose(
        at_origin.select("^plate1_moment_.$").to_numpy(), expected, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("text", "fields", "problem"),
    [
        (DEVICES.replace("200", "fast") + TRAJECTORIES + MODEL, {}, "line 2: .*Devices.*'fast'"),
        (DEVICES.replace("5,1,", "5,2,") + TRAJECTORIES + MODEL, {}, "line 7: .* 5 "),
        (DEVICES.replace("200", "210") + TRAJECTORIES + MODEL, {}, "trial.csv: "),
        (DEVICES.replace("0.6", "") + TRAJECTORIES + MODEL, {}, "sync: nan .* 2 .* 4"),
        (DEVICES.replace("0.6", "?") + TRAJECTORIES + MODEL, {}, r"line 7, Sync - Voltage 1: '\?'"),
        (DEVICES + TRAJECTORIES.replace("Anna:HEEL", "Anna:TOE") + MODEL, {}, "'TOE' .* 2 .* 1, 2"),
        (
            EXPORT,
            {"analogs": {"sync": {"device": "EMG", "component": "1"}}},
            "'EMG 1'.*AMTI #1 - Force",
        ),
        (DEVICES[: DEVICES.index("6,1")], {"outputs": {}, "markers": []}, "trial.csv: "),
        (DEVICES.replace("N.mm", "N"), {"outputs": {}}, "unit 'N' .*N\\*m"),
    ],
)
def test_what_does_not_fit_is_refused_with_the_reason(tmp_path, text, fields, problem):
    path = tmp_path / "trial.csv"
    path.write_text(text)
    assert re.search(problem, refusal_by(read_converted, path, nexus_source(**fields)))
