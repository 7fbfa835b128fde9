# SPDX-License-Identifier: Apache-2.0
"""The ankle torque of published overground gait, beside the laboratory's own moment."""

import numpy as np
import polars as pl
import pytest

from osl_analysis.base.trial import read_trial, write_trial
from osl_analysis.commands.trials import checked_trial
from osl_analysis.walking.geometry import ankle_torque
from osl_analysis.walking.plate import (
    find_stances,
    recorded_corners,
    recorded_wrench,
    wrench_reader,
)
from osl_analysis.walking.poses import marker_tracks

SOURCE = """
format: c3d
markers: all
plates: all
outputs:
  reference_ankle_moment_left: {label: LAnkleMoment, component: x, unit: "N*mm/kg"}
  reference_ankle_moment_right: {label: RAnkleMoment, component: x, unit: "N*mm/kg"}
"""
MASS = 74.0  # [kg] of the recording
LOADED_N = 50.0


@pytest.fixture(scope="module")
def recorded(recordings, tmp_path_factory):
    folder = tmp_path_factory.mktemp("published")
    (folder / "plug_in_gait.yaml").write_text(SOURCE)
    row = {"trial": "pig", "mocap": "btk_PiG_Motion3_FF.c3d", "mocap_source": "plug_in_gait"}
    write_trial(checked_trial(row, recordings / "c3d", folder), folder / "pig.parquet")
    return read_trial(folder / "pig.parquet")


def moments_over_stance(trial, side, plate):
    """Our moment and the laboratory's [N*m/kg], while the foot loads a plate.

    Plug-in Gait stores the ankle's centre (TIO), and a point to its left on the tibia's
    mediolateral axis (TIL).
    """
    letter = side[0].upper()
    time, points = marker_tracks(trial, [f"{letter}TIO", f"{letter}TIL"])
    axis = points[:, 1] - points[:, 0]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    wrench = wrench_reader(*recorded_wrench(trial, plate), time)(0.0)
    centre = recorded_corners(trial, plate).mean(axis=0)
    moment = ankle_torque(wrench, centre, points[:, 0], axis) / MASS
    reference = trial.arrays(f"reference_ankle_moment_{side}")[1]
    (stance,) = find_stances(time, wrench[:, 2], LOADED_N, LOADED_N, 0.3)
    inside = (time > stance.heel_strike) & (time < stance.toe_off)
    used = inside & np.isfinite(moment) & np.isfinite(reference)
    return moment[used], reference[used]


@pytest.mark.recordings
@pytest.mark.parametrize(("side", "plate"), [("left", 1), ("left", 3), ("right", 2)])
def test_agrees_with_plug_in_gait_as_the_published_reference_does(
    recordings, recorded, side, plate
):
    """The reference is half a frame late: without delay slope and peak move by below 1 %."""
    table = pl.read_csv(recordings / "reference/ankle_moment.csv")
    (published,) = table.filter(side=side[0].upper(), plate=plate - 1).to_dicts()

    moment, reference = moments_over_stance(recorded, side, plate)

    peak = int(np.argmax(reference))
    assert np.corrcoef(moment, reference)[0, 1] > 0.998
    assert moment @ reference / (moment @ moment) == pytest.approx(-published["slope"], rel=0.01)
    assert 1e3 * moment[peak] == pytest.approx(
        published["own_quasistatic_at_peak_Nmm_per_kg"], rel=0.01
    )
