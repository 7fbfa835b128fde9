"""Force plates under quality control: raw channels before any rotation, and the centre of pressure under load."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c3d_builder import REAL_DATA, write_c3d

from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.judge.recording import examine, travel
from osl_analysis.judge.table import CheckResult, Commanded
from osl_analysis.trial import Array, Trial

RATE, FRAMES = 500, 200
TIME = np.arange(5 * FRAMES) / RATE
STANCE = np.clip(np.minimum(TIME - 0.2, 0.8 - TIME) / 0.05, 0, 1)
ROLL = np.interp(TIME, [0.2, 0.8], [-0.08, 0.14])  # centre of pressure along x [m]


def load(roll: Array = ROLL, seed: int = 1) -> tuple[Array, Array]:
    """Force and moment (n, 3) on the plate in its axes (z down): 700 N that rolls along x, with noise."""
    rng, vertical = np.random.default_rng(seed), -700 * STANCE * (1 + 0.1 * np.sin(10 * TIME))
    force = np.column_stack([60 * STANCE * np.sin(10 * (TIME - 0.5)), 20 * STANCE, vertical])
    moment = np.column_stack([0.02 * vertical, -roll * vertical, 0.0 * TIME])
    return force + rng.normal(0, 1.0, force.shape), moment + rng.normal(0, 0.1, moment.shape)


def trial_of(path: Path, channels: Array, **source: Any) -> Trial:
    """The C3D of one level plate of 0.6 m by 0.4 m, as ingest reads it."""
    corners = np.array([[300.0, -200, 0], [-300, -200, 0], [-300, 200, 0], [300, 200, 0]])  # z down: y to the right
    plate = {"USED": np.array([1]), "TYPE": np.array([2]), "CORNERS": corners.T[:, :, None], "ORIGIN": np.zeros((3, 1))}
    facts = {f"FORCE_PLATFORM__{name}": fact for name, fact in plate.items()}
    facts |= {"FORCE_PLATFORM__CHANNEL": np.arange(1, 7)[:, None], "ANALOG__UNITS": ["N"] * 3 + ["Nm"] * 3}
    write_c3d(path, np.ones((FRAMES, 1, 4)), channels, **facts)
    recording = FORMATS["c3d"].read(path, FORMATS["c3d"].source(format="c3d", **source))
    return Trial("walk", recording.samples, recording.facts)


def checked(trial: Trial, experiment: str = "walking") -> dict[str, CheckResult]:
    return examine(trial, experiment, Commanded((2,), (1,), 3))


def test_a_sound_plate_passes_and_a_clipped_raw_channel_is_named_with_its_time(tmp_path: Path) -> None:
    channels = np.hstack(load())
    found = checked(trial_of(tmp_path / "a.c3d", channels))
    assert ((found["saturation"].value or 0) < 5, (found["stuck"].value or 0) < 0.05) == (True, True)
    assert found["pressure_centre"] == CheckResult(0.0, "")
    far = channels + 1e3 * np.outer(np.isin(np.arange(TIME.size), (150, 250, 350)) * 3, [0, 0, 0, 0, 1, 0])
    assert checked(trial_of(tmp_path / "a.c3d", far))["pressure_centre"].value == 0.0, "3 of 300 samples do not count"
    # 5th to 95th percentile of a steady roll of 0.22 m
    assert found["pressure_travel"].value == pytest.approx(0.9 * 0.22, rel=0.08)
    channels[:, 4] = np.clip(channels[:, 4], -60.0, 60.0)
    trial = trial_of(tmp_path / "a.c3d", channels)
    result = checked(trial)["saturation"]
    assert (result.remark, (result.value or 0) > 20) == ("plate1 channel A5", True)
    facts = trial.provenance["plates"][0]["channels"][4]
    assert abs(facts["clipped_at"]) == 60.0
    assert 0.2 < facts["clipped_from_s"] < facts["clipped_to_s"] < 0.8
    assert facts["clipped_to_s"] - facts["clipped_from_s"] == pytest.approx((facts["clipped_samples"] - 1) / RATE)


def test_a_raw_channel_that_stands_while_the_plate_is_loaded_is_stuck(tmp_path: Path) -> None:
    channels = np.hstack(load())
    channels[:, 4] = 37.5
    found = checked(trial_of(tmp_path / "a.c3d", channels))
    assert (found["stuck"].value, found["stuck"].remark) == (pytest.approx(TIME[-1], abs=1e-9), "plate1 channel A5")
    for top, change, told in ((1000, 150, 0), (1000, 250, 250), (100, 40, 0), (100, 60, 600)):  # a fifth, and 50 N
        channels = np.outer(np.linspace(0, top, TIME.size), [1e-4, 1e-4, -1, 1e-4, 1e-4, 1e-4])
        channels[: TIME.size * change // top, 4] = 5.0
        facts = trial_of(tmp_path / "b.c3d", channels).provenance["plates"][0]["channels"][4]
        assert (facts["stands_samples"], facts["stands_to_s"]) == (told, (told - 1) / RATE if told else None)


def test_a_plate_whose_moments_stand_still_has_a_centre_of_pressure_outside_or_at_rest(tmp_path: Path) -> None:
    force, moment = load()
    moments = {"a": 0 * moment + [0, 840.0, 0], "b": 0 * moment, "c": moment}
    outside, dead, sound = (trial_of(tmp_path / f"{one}.c3d", np.hstack((force, x))) for one, x in moments.items())
    second = {name: name.replace("plate1", "plate2") for name in sound.samples.columns if name.startswith("plate1")}

    def beside_a_sound_one(trial: Trial) -> Trial:
        both = trial.samples.hstack(sound.samples.select(*second).rename(second))
        plates = [trial.provenance["plates"][0], sound.provenance["plates"][0] | {"plate": 2}]
        return Trial("t", both, trial.provenance | {"plates": plates})

    for of in (lambda trial: trial, beside_a_sound_one):  # the worse one of two
        far, still = checked(of(outside))["pressure_centre"], checked(of(dead))["pressure_travel"]
        assert (far.value or 0) > 840 / 770 - 0.3  # at the largest force
        assert "a moment channel is dead, clipped or of the other sign" in far.remark
        assert (still.value, still.remark[:6]) == (pytest.approx(0, abs=0.005), "plate1")


def test_moments_a_thousand_times_too_large_or_too_small_are_named(tmp_path: Path) -> None:
    force, moment = load()
    large = trial_of(tmp_path / "a.c3d", np.hstack((force, 1e3 * moment)))
    assert "moments look a thousand times too large; state `plate_units`" in checked(large)["pressure_centre"].remark
    units = {"force": "N", "moment": "N*mm"}
    mended = trial_of(tmp_path / "a.c3d", np.hstack((force, 1e3 * moment)), plate_units=units)
    assert checked(mended)["pressure_centre"].value == 0
    small = checked(trial_of(tmp_path / "b.c3d", np.hstack((force, 1e-3 * moment))))["pressure_travel"]
    assert "a thousand times too small" in small.remark
    assert travel(np.array([[0.0, 0.0], [3.0, 4.0]])) == pytest.approx(0.9 * 5)


def test_a_plate_on_which_nobody_stands_is_not_judged(tmp_path: Path) -> None:
    force, moment = load()
    trial = trial_of(tmp_path / "a.c3d", 0.05 * np.hstack((force, moment)))
    assert checked(trial)["pressure_centre"] == CheckResult(None, "not applicable: no plate is stood on")
    assert checked(trial, "plate")["pressure_centre"].remark == "not applicable: nobody stands on a plate"


@pytest.mark.skipif(not (REAL_DATA / "c3d").is_dir(), reason="real data are not here")
def test_real_plates_pass() -> None:
    for name in ("btk_PiG_Motion3_FF.c3d", "opensim_jogging_300_1500.c3d", "c3dorg_s10_TYPE-4.C3D"):
        recording = FORMATS["c3d"].read(REAL_DATA / "c3d" / name, FORMATS["c3d"].source(format="c3d", markers=()))
        found = checked(Trial(name, recording.samples, recording.facts), "overground")
        assert found["pressure_centre"].value == pytest.approx(0, abs=0.01), name
        assert (found["saturation"].value or 0) < 5, name
