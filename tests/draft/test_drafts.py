# SPDX-License-Identifier: Apache-2.0
"""What a draft takes each channel for, over recordings of many laboratories."""

import sys
from datetime import datetime, timedelta

import numpy as np
import pytest
import yaml
from conftest import ROOT, white_noise
from scipy.io import savemat

from osl_analysis.draft.draft_campaign import draft_campaign
from osl_analysis.draft.draft_source import draft_source, entries_of, guesses_of
from osl_analysis.draft.likelihood import guessed_columns, likelihoods
from osl_analysis.draft.overview import inspect_recording
from osl_analysis.draft.recorded_channel import RecordedChannel
from osl_analysis.ingest.raw_files import read_converted, read_source

sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script there
from draft_weights import labelled, signals, write_recording

sys.path.pop(0)

COLUMNS = {column: column for column in likelihoods()["columns"]}
COLUMNS |= {"held_theta_m": "theta_m", "turning_theta_m": "theta_m", "small_theta": "theta"}


def test_every_channel_of_labelled_recordings_is_named_or_asked_so(tmp_path):
    """What a draft names is right, and it names what is clear; a spring may settle a doubt of a
    name (`?`) and of two that are alike (`~`)."""
    path = tmp_path / "log.csv"
    wrong = []
    for seed, (name, labels) in enumerate(labelled().items()):
        write_recording(labels, path, seed)
        overview = inspect_recording(path)
        named = {guess.channel.key: guess.column for guess in guesses_of(overview) if guess.is_sure}
        for channel, label in zip(overview.channels, labels.values(), strict=True):
            truth = COLUMNS.get(label.rstrip("?~"))
            may_be_asked = label[-1] in "?~" and channel.key not in named
            if named.get(channel.key) != truth and not may_be_asked:
                wrong.append((name, label, channel.key))

    assert not wrong


READS = signals(seed=1)
MEASURED = {"theta": "Winkel", "torque": "Drehmoment"}
COMMANDS = """
soll sollwert Vorgabe Führungsgröße Stellgröße command commanded cmd desired des ref reference
target setpoint goal demand feedforward ff u consigne consigna referencia deseado deseada desiderata
desiderato riferimento desejado referência gewenst gewenste streefwaarde börvärde zadany hedef
"""


@pytest.mark.parametrize("column", MEASURED)
def test_what_is_commanded_is_never_named_as_measured(column):
    """It follows the spring more closely than what is measured."""
    commanded = READS[{"theta": "theta_command", "torque": "torque_command"}[column]]
    other = {"theta": "torque", "torque": "theta"}[column]
    units = {"theta": "rad", "torque": "N*m"}
    named = set()
    for word in COMMANDS.split():
        for name in (f"{word}_{MEASURED[column]}", f"{MEASURED[column].lower()}{word.title()}"):
            channels = [
                RecordedChannel("column", {"column": name}, units[column], numbers=commanded),
                RecordedChannel(
                    "column", {"column": MEASURED[other]}, units[other], numbers=READS[other]
                ),
            ]
            guess = guessed_columns(channels)[0]
            named |= {name} if guess.is_sure and guess.column == column else set()

    assert named == set()


@pytest.mark.parametrize("computed", ["effort", "torque_from_current", "estimated_torque"])
def test_a_measured_torque_goes_before_one_that_is_called_computed(computed):
    """Whichever follows the angle more closely."""
    channels = [
        RecordedChannel("column", {"column": "joint_angle"}, "rad", numbers=READS["theta"]),
        RecordedChannel("column", {"column": computed}, "N*m", numbers=READS["torque"]),
        RecordedChannel(
            "column", {"column": "wrench.torque.z"}, "N*m", numbers=1.1 * READS["torque"]
        ),
    ]

    guesses = guessed_columns(channels)

    assert [guess.is_sure and guess.column for guess in guesses][1:] == [False, "torque"]


def test_an_angle_that_stands_and_a_torque_of_noise_are_no_signals():
    noise = white_noise(500, 2)
    still = RecordedChannel("column", {"column": "angle"}, "rad", numbers=np.full(500, 0.1))
    torque = RecordedChannel("column", {"column": "torque"}, "N*m", numbers=noise)

    guesses = guessed_columns([still, torque])

    assert all(guess.why_not for guess in guesses)
    # a draft names them all where nothing else is there
    assert not any(entry.is_comment for entry in entries_of(guesses))


def test_a_torque_whose_reading_tells_a_third_of_the_next_is_a_signal():
    noise = white_noise(501, 2)
    numbers = noise[1:] + noise[:-1] / 3  # a correlation of 0.3

    (torque,) = guessed_columns(
        [RecordedChannel("column", {"column": "torque"}, "N*m", numbers=numbers)]
    )

    assert not torque.why_not


@pytest.mark.parametrize(
    ("torque", "sign"),
    [
        (READS["torque"], 1),
        (-READS["torque"], -1),
        (-READS["velocity"], 0),
        (0.05 * READS["velocity"] - READS["theta"], 0),
        (READS["theta"] - 0.05 * READS["velocity"], 0),
    ],
)
def test_a_torque_has_the_sign_by_which_a_joint_resists(torque, sign):
    """That of an inertia falls as the angle rises, and its losses go with the speed."""
    theta = RecordedChannel("column", {"column": "theta"}, "rad", numbers=READS["theta"])
    load = RecordedChannel("column", {"column": "torque"}, "N*m", numbers=torque)

    guesses = guessed_columns([theta, load])

    assert [guess.is_sure for guess in guesses] == [True, True]
    assert guesses[1].sign == sign


def test_channels_that_begin_apart_are_compared_at_their_own_instants():
    time = READS["time"]
    channels = [
        RecordedChannel("channel", {"channel": name}, unit, numbers=values, times=times)
        for name, unit, values, times in (
            ("x", "rad", READS["theta"], time),
            ("y", "Nm", READS["torque"][40:], time[40:]),
        )
    ]

    guesses = guessed_columns(channels)

    assert [(guess.column, guess.is_sure) for guess in guesses] == [
        ("theta", True),
        ("torque", True),
    ]


def test_a_clock_in_another_part_of_a_file_goes_before_a_rate_in_its_text(tmp_path):
    """The rate is that of the device, four times that of the rows."""
    time = np.arange(READS["theta"].size) / 250
    signals_of_joint = {"angle_deg": np.degrees(READS["theta"]), "torque_Nm": READS["torque"]}
    savemat(tmp_path / "a.mat", {"trial": {"fs": 1000.0, "t": time, "ankle": signals_of_joint}})

    drafted = yaml.safe_load(draft_source(inspect_recording(tmp_path / "a.mat"), "a.mat"))

    assert drafted["time"] == {"variable": "trial.t", "unit": "s"}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(drafted))
    samples = read_converted(tmp_path / "a.mat", read_source(tmp_path / "a.yaml")).samples
    np.testing.assert_allclose(samples["time"], time - time[0])


def test_times_of_day_tell_how_often_an_angle_turns(tmp_path):
    rows = ["time,angle_rad,torque_Nm"]
    start = datetime(2026, 3, 2, 9, 30)
    for number, (theta, torque) in enumerate(zip(READS["theta"], READS["torque"], strict=True)):
        stamp = start + timedelta(milliseconds=10 * number)
        rows.append(f"{stamp.isoformat(timespec='milliseconds')},{theta:.7f},{torque:.7f}")
    (tmp_path / "a.csv").write_text("\n".join(rows))

    (trial,) = draft_campaign(tmp_path).trials

    assert trial.cells["experiment"] == "impedance"
