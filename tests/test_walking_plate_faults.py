"""A plate that fails during a stance is refused with its channel, and one of type 1 on a moving platform."""

from pathlib import Path

import numpy as np
import pytest
from test_quality_plates import TIME, load, trial_of, type_2, type_3

from osl_analysis.errors import InputError
from osl_analysis.trial import Trial
from osl_analysis.walking.events import Stance
from osl_analysis.walking.plate import check_plate, check_type_on_platform

STANCE = Stance(0.2, 0.8)
BODY = np.array([0.0, 700.0])


def clipped(path: Path, limit: float) -> Trial:
    channels = type_3(*load())
    channels[:, 5] = np.clip(channels[:, 5], -limit, limit)
    return trial_of(path, 3, channels)


def test_a_sensor_at_its_limit_is_refused_with_its_time(tmp_path: Path) -> None:
    trial = clipped(tmp_path / "a.c3d", 200.0)
    with pytest.raises(InputError, match=r"channel A6 of force plate 1 stays at -?200 from 0\.\d+ s to 0\."):
        check_plate(trial, 1, STANCE, BODY)


def test_a_limit_outside_the_stance_or_of_another_plate_does_not_matter(tmp_path: Path) -> None:
    trial = clipped(tmp_path / "a.c3d", 200.0)
    check_plate(trial, 1, Stance(0.9, 1.5), BODY)
    check_plate(trial, 2, STANCE, BODY)
    check_plate(clipped(tmp_path / "b.c3d", 2000.0), 1, STANCE, BODY)


def test_a_dead_channel_is_refused(tmp_path: Path) -> None:
    channels = type_2(*load())
    channels[:, 3] = 12.0
    with pytest.raises(InputError, match=r"channel A4 of force plate 1 repeats one value from .* it is dead"):
        check_plate(trial_of(tmp_path / "a.c3d", 2, channels), 1, STANCE, BODY)


def test_a_force_of_a_lorry_is_refused(tmp_path: Path) -> None:
    trial = trial_of(tmp_path / "a.c3d", 2, type_2(*load()))
    with pytest.raises(InputError, match=r"plate 1 reads up to 7e\+05 N, expected less than 8000 N under a person"):
        check_plate(trial, 1, STANCE, 1e3 * BODY)


def test_type_1_is_refused_on_a_moving_platform(tmp_path: Path) -> None:
    pressure = np.column_stack([np.zeros((TIME.size, 2)), -700 + 0 * TIME, 0.01 * np.sin(TIME), 0 * TIME, 0 * TIME])
    trial = trial_of(tmp_path / "a.c3d", 1, pressure, plate_units={"force": "N", "moment": "N*m", "length": "m"})
    with pytest.raises(InputError, match=r"of type 1 .* export it as type 2, 3 or 4"):
        check_type_on_platform(trial, 1)
    check_type_on_platform(trial_of(tmp_path / "b.c3d", 2, type_2(*load())), 1)
