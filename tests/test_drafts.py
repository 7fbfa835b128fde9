"""What a draft takes each channel for, over recordings of many laboratories."""

import sys

import numpy as np
import pytest
from conftest import ROOT

from osl_analysis.draft.draft_source import drafted_log
from osl_analysis.draft.guesses import guessed_columns
from osl_analysis.draft.likelihood import likelihoods
from osl_analysis.draft.overview import inspect_recording
from osl_analysis.draft.recorded_channel import RecordedChannel

sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script there
from draft_weights import labelled, signals, write_recording

sys.path.pop(0)

COLUMNS = {column: column for column in likelihoods()["columns"]}
COLUMNS |= {"held_theta_m": "theta_m", "small_theta": "theta"}


def test_every_channel_of_the_labelled_recordings_is_named_or_asked_as_labelled(tmp_path):
    """What a draft names is right, and it names what is clear; a spring may settle a doubt of a
    name (`?`) and of two that are alike (`~`)."""
    path = tmp_path / "log.csv"
    named, truth, wrong = {}, {}, []
    recordings = labelled()
    for seed, (name, labels) in enumerate(recordings.items()):
        write_recording(labels, path, seed)
        overview = inspect_recording(path)
        label_of = dict(zip((one.key for one in overview.channels), labels.values(), strict=True))
        log = drafted_log(overview)
        named[name] = {
            guess.channel.key: guess.column
            for guess in log.guesses
            if guess.is_sure and label_of[guess.channel.key][-1] not in "?~"
        }
        truth[name] = {key: COLUMNS[label] for key, label in label_of.items() if label in COLUMNS}
        wrong += [
            (name, guess.channel.key)
            for guess in log.guesses
            if guess.is_sure
            and guess.column != COLUMNS.get(label_of[guess.channel.key].rstrip("?~"))
        ]

    assert len(recordings) >= 120
    assert named == truth
    assert wrong == []


MEASURED = {"theta": "Winkel", "torque": "Drehmoment"}
COMMANDS = """
soll sollwert Vorgabe Führungsgröße Stellgröße command commanded cmd desired des ref reference
target setpoint goal demand feedforward ff u consigne consigna referencia deseado deseada desiderata
desiderato riferimento desejado referência gewenst gewenste streefwaarde börvärde zadany hedef
"""


@pytest.mark.parametrize("column", MEASURED)
def test_what_is_commanded_is_never_named_as_measured(column):
    """It follows the spring more closely than what is measured."""
    reads = signals(seed=1)
    commanded = reads[{"theta": "theta_command", "torque": "torque_command"}[column]]
    other = {"theta": "torque", "torque": "theta"}[column]
    units = {"theta": "rad", "torque": "N*m"}
    named = set()
    for word in COMMANDS.split():
        for name in (f"{word}_{MEASURED[column]}", f"{MEASURED[column].lower()}{word.title()}"):
            channels = [
                RecordedChannel("column", {"column": name}, units[column], numbers=commanded),
                RecordedChannel(
                    "column", {"column": MEASURED[other]}, units[other], numbers=reads[other]
                ),
            ]
            guess = guessed_columns(channels)[0]
            named |= {name} if guess.is_sure and guess.column == column else set()

    assert named == set()


def test_an_angle_that_stands_and_a_torque_of_noise_are_no_signals():
    noise = np.random.default_rng(2).standard_normal(500)
    still = RecordedChannel("column", {"column": "angle"}, "rad", numbers=np.full(500, 0.1))
    torque = RecordedChannel("column", {"column": "torque"}, "N*m", numbers=noise)

    assert all(guess.why_not for guess in guessed_columns([still, torque]))
