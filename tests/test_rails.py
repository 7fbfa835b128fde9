"""Sensors at the end of their range: stated in the source file, or seen in the recording."""

import numpy as np
import polars as pl
import pytest
from bench_synthetic import second_order, stepped_sine

from osl_analysis.commands.trials import ingest_trial
from osl_analysis.errors import InputError
from osl_analysis.ingest.source import Conversion
from osl_analysis.judge.recording import (
    is_command,
    longest_clipped_angle,
    samples_at_rail,
    stated_range,
)
from osl_analysis.trial import Trial
from osl_analysis.yaml_settings import validated

RATE = 500.0


def moved(theta_of, noise=0.05):
    """Time, recorded angle and torque of a stepped sine."""
    record = stepped_sine(second_order, noise)
    return record.time, theta_of(record.theta), (record.time, record.torque)


@pytest.mark.parametrize("bits", [12, 14, 18])
def test_a_rounded_sine_is_not_clipped_and_one_that_sticks_at_an_end_is(bits):
    step = 2 * np.pi / 2**bits

    def rounded(theta):
        return np.rint(theta / step) * step

    assert longest_clipped_angle(*moved(rounded)) == 0
    for end in (0.09, 0.07):
        clipped = longest_clipped_angle(*moved(lambda theta, end=end: rounded(np.minimum(theta, end))))
        flat = 2 * np.arccos(end / 0.1) / (2 * np.pi) * RATE  # of the slowest sine, 1 Hz
        assert clipped == pytest.approx(flat, rel=0.02, abs=2)


def test_a_commanded_current_at_its_level_is_no_rail_and_a_measured_one_that_is_clipped_is():
    time = np.arange(2000) / RATE
    levels = np.repeat([3.0, -2.0, 3.0, 1.0], 500)
    measured = np.minimum(4 * np.sin(7 * time) + 0.02 * np.random.default_rng(1).standard_normal(2000), 3.0)
    made = Trial("made", pl.DataFrame({"time": time, "current": levels}))
    assert is_command(levels)
    assert samples_at_rail(made, "current") == 0
    assert samples_at_rail(Trial("made", pl.DataFrame({"time": time, "current": measured})), "current") > 50


def stating(text, **conversion):
    source = validated({"unit": "N*m", "range": text, **conversion}, Conversion, "source.yaml")
    return source.origin("torque")["range"]


def test_a_stated_range_is_that_of_the_sensor_whatever_its_sign_and_offset():
    assert stating("60 N*m") == [-60, 60]
    assert stating(["-20 N*m", "100 N*m"]) == [-20, 100]
    assert stating(["-20 N*m", "100 N*m"], sign=-1) == [-100, 20]
    assert stating("600 N*cm", unit="N*cm", offset=-50) == pytest.approx([-6.5, 5.5])
    assert stating("10 lbf*ft") == pytest.approx([-13.558, 13.558], rel=1e-4)
    for wrong in ("60 A", "-60 N*m", ["5 N*m", "1 N*m"], "60"):
        with pytest.raises(ValueError, match=r"lower end first|measures|the unit is empty"):
            stating(wrong)


def test_samples_at_a_stated_end_count():
    torque = np.concatenate([np.linspace(-50, 59, 400), np.full(7, 59.97), np.linspace(58, 0, 100)])
    origin = {"columns": {"torque": {"range": [-60.0, 60.0]}}}
    made = Trial("made", pl.DataFrame({"time": np.arange(507.0), "torque": torque}), origin)
    assert samples_at_rail(made, "torque") == 7
    assert stated_range(made, "torque") == (-60, 60)
    assert stated_range(made, "theta") is None


def test_a_log_with_values_beyond_the_stated_range_is_not_ingested(tmp_path):
    rows = "".join(f"{k / 100},{21 * np.sin(k / 10):.4f}\n" for k in range(400))
    (tmp_path / "log.csv").write_text("t,force\n" + rows)
    stated = (
        "format: csv\ntime: {{column: t, unit: s}}\nchannels:\n  torque: {{column: force, unit: N*m, range: {} N*m}}\n"
    )
    row = {"trial": "a", "experiment": "ingest_only", "log": "log.csv", "log_source": "cell"}
    (tmp_path / "cell.yaml").write_text(stated.format(1))
    with pytest.raises(
        InputError, match=r"trial a: torque goes from -21 to 21 N\*m, beyond the `range` of its sensor, -1 to 1"
    ):
        ingest_trial(row, tmp_path, tmp_path, tmp_path / "a.parquet")
    assert not (tmp_path / "a.parquet").exists()
    (tmp_path / "cell.yaml").write_text(stated.format(21))
    ingest_trial(row, tmp_path, tmp_path, tmp_path / "a.parquet")
