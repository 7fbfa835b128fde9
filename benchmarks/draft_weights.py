# SPDX-License-Identifier: Apache-2.0
"""Fit the weights of `osl_analysis/draft/likelihoods.yaml` on one half of the labelled recordings
of `draft_labels.yaml`, and judge them by the other half:

python benchmarks/draft_weights.py [--write]
"""

import json
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl
import yaml
from scipy.optimize import minimize

from osl_analysis.base.trial import Array
from osl_analysis.draft import likelihood
from osl_analysis.draft.draft_source import guesses_of
from osl_analysis.draft.likelihood import Guess, decide_columns
from osl_analysis.draft.overview import inspect_recording

LABELS = Path(__file__).with_name("draft_labels.yaml")
RATE_HZ = 100.0
SAMPLES = 1500
RIDGE_ROUNDING = 0.03  # of the squares of the weights, which bounds what words in few names say
DOUBT = 0.5  # probability of its column for a channel whose name leaves a doubt
# what a channel alone does not tell from such a column
AS_COLUMN = {
    "other_angle": "theta",
    "other_torque": "torque",
    "held_theta_m": "theta_m",
    "turning_theta_m": "theta_m",
    "small_theta": "theta",
}
Labels = Mapping[str, str]  # what each channel is, by its name


def labelled() -> dict[str, Labels]:
    """What each channel of each recording is."""
    texts: Mapping[str, str] = yaml.safe_load(LABELS.read_text(encoding="utf-8"))
    return {
        name: dict(entry.rsplit(" = ", 1) for entry in text.split("; "))
        for name, text in texts.items()
    }


def signals(seed: int) -> dict[str, Array]:
    """What each kind of channel reads, in SI units: a joint of a spring, a damper and inertia that
    sines turn, and an actuator whose current is stepped."""
    noise = np.random.default_rng(seed).standard_normal((16, SAMPLES))
    time = np.arange(SAMPLES) / RATE_HZ
    turn = 2 * np.pi * time
    command = 0.06 * np.sin(0.7 * turn) + 0.03 * np.sin(2.1 * turn + seed)
    velocity = np.gradient(command, time)
    torque = 150 * command + 2 * velocity + 0.05 * np.gradient(velocity, time)
    drive = 3 * np.sin(0.4 * turn) + np.sin(1.9 * turn + 1)
    slow = np.cumsum(noise[0]) / 100
    pulses = 5.0 * (time % 1 < 0.5)
    return {
        "time": time,
        "theta": command + 3e-4 * noise[1],
        "theta_command": np.roll(command, -2),
        "other_angle": 0.2 * np.sin(1.3 * turn + 2) + 1e-4 * noise[2],
        "other_torque": 20 * np.sin(1.1 * turn + 1) + 0.05 * noise[10],
        "velocity": velocity + 3e-3 * noise[3],
        "torque": torque + 0.05 * noise[4],
        "torque_command": np.roll(torque, -2),
        "current": drive + 0.02 * noise[5],
        "current_command": drive,
        "torque_m": 1.2 * drive + 0.3 * np.tanh(np.cos(0.4 * turn)) + 0.05 * noise[6],
        "theta_m": 9 * np.sin(0.4 * turn + 0.3) + 1e-3 * noise[7],
        "small_theta": 0.08 * command + 3e-5 * noise[12],
        "turning_theta_m": 4 * np.roll(command, 3) + 1e-4 * noise[14],
        "held_theta_m": 2e-3 * drive + 1e-5 * noise[11],
        "omega_m": 40 * np.cos(0.4 * turn + 0.3) + 0.1 * noise[8],
        "speed_command": 40 * np.cos(0.4 * turn + 0.3),
        "sync": pulses,
        "trigger": np.roll(pulses, 30),
        "pressure": 20 + np.abs(slow),
        "other": slow + 0.3 * np.sin(0.2 * turn),
        "flag": 1.0 * (slow > np.median(slow)),
        "noise": noise[9],
        "still": np.zeros(SAMPLES),
    }


def write_recording(labels: Labels, path: Path, seed: int) -> None:
    """Write a table with these channels, in the units of their names."""
    reads = signals(seed)
    table: dict[str, Array] = {}
    for name, label in labels.items():
        unit = re.search(
            r"(?i)\b(mm?sec|ms|millis|deg|degrees|rpm)\b|(deg)/s", name.replace("_", " ")
        )
        factor = {"deg": 180 / np.pi, "degrees": 180 / np.pi, "rpm": 30 / np.pi}
        scale = factor.get(unit[0].lower().removesuffix("/s"), 1e3) if unit else 1.0
        table[name] = reads[label.rstrip("?~")] * scale
    pl.DataFrame(table).write_csv(path, float_precision=7)


@dataclass(frozen=True)
class LabelledLog:
    """What the channels of a log are taken for, but for its clock, and what each is."""

    name: str
    guesses: Sequence[Guess]
    labels: Sequence[str]


def labelled_logs() -> list[LabelledLog]:
    """The labelled recordings, written as tables and looked at as by a draft."""
    logs: list[LabelledLog] = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        for seed, (name, labels) in enumerate(labelled().items()):
            write_recording(labels, path, seed)
            overview = inspect_recording(path)
            addresses = [channel.address for channel in overview.channels]
            guesses = guesses_of(overview)
            places = [addresses.index(guess.channel.address) for guess in guesses]
            logs.append(LabelledLog(name, guesses, [[*labels.values()][k] for k in places]))
    return logs


def fitted_weights(logs: Sequence[LabelledLog]) -> dict[str, dict[str, float]]:
    """The weights that make the labels most likely, with small ones preferred."""
    columns = likelihood.likelihoods()["columns"]
    names = [
        "always",
        *sorted({one for log in logs for guess in log.guesses for one in guess.evidence}),
    ]
    rows: list[Array] = []
    allowed: list[Array] = []
    target: list[Array] = []
    for log in logs:
        for guess, label in zip(log.guesses, log.labels, strict=True):
            possible = likelihood.allowed_columns(guess.channel)
            known = {"always", *guess.evidence}
            rows.append(np.array([name in known for name in names], float))
            allowed.append(np.array([True, *(column in possible for column in columns)]))
            share = np.zeros(1 + len(columns))
            column = AS_COLUMN.get(label.rstrip("?~"), label.rstrip("?~"))
            if column in columns:
                share[1 + columns.index(column)] = DOUBT if "?" in label else 1.0
            share[0] = 1 - share.sum()
            target.append(share)
    X, mask, share = np.array(rows), np.array(allowed), np.array(target)

    def loss(flat: Array) -> tuple[float, Array]:
        weights = flat.reshape(X.shape[1], len(columns))
        odds = np.column_stack([np.zeros(len(X)), X @ weights])
        odds = np.where(mask, odds, -40.0)
        likely = np.exp(odds - odds.max(axis=1, keepdims=True))
        likely /= likely.sum(axis=1, keepdims=True)
        slope = X.T @ (likely - share)[:, 1:] + RIDGE_ROUNDING * weights
        return -float(
            (share * np.log(likely + 1e-300)).sum()
        ) + RIDGE_ROUNDING * flat @ flat / 2, slope.ravel()

    start = np.zeros(X.shape[1] * len(columns))
    weights = minimize(loss, start, jac=True, method="L-BFGS-B").x.reshape(X.shape[1], -1)
    return {
        name: {
            column: round(float(weight), 1)
            for column, weight in zip(columns, row, strict=True)
            if abs(weight) >= 0.05
        }
        for name, row in zip(names, weights, strict=True)
    }


def with_springs(logs: Sequence[LabelledLog]) -> list[LabelledLog]:
    """The logs, and those again in which a torque follows an angle, with that as evidence, which
    settles a doubt of a name."""
    more: list[LabelledLog] = []
    for log in logs:
        decide_columns(log.guesses)
        is_spring = ["as a spring" in guess.why for guess in log.guesses]
        if any(is_spring):
            guesses = [
                replace(guess, evidence={*guess.evidence, "spring"}) if is_one else guess
                for guess, is_one in zip(log.guesses, is_spring, strict=True)
            ]
            labels = [
                label.rstrip("?") if is_one else label
                for label, is_one in zip(log.labels, is_spring, strict=True)
            ]
            more.append(LabelledLog(log.name, guesses, labels))
    return [*logs, *more]


def judged(logs: Sequence[LabelledLog]) -> dict[str, int]:
    """How many channels are named rightly, asked, named wrongly, or missed; the last two are
    printed."""
    counts = dict.fromkeys(("right", "asked", "wrong", "missed", "left out"), 0)
    for log in logs:
        guesses = [replace(guess) for guess in log.guesses]
        decide_columns(guesses)
        for guess, label in zip(guesses, log.labels, strict=True):
            truth = label.rstrip("?~").removeprefix("held_").removeprefix("small_")
            is_column = truth in likelihood.likelihoods()["columns"]
            if guess.is_sure:
                verdict = "right" if guess.column == truth else "wrong"
            elif guess.column or label[-1] in "?~":
                verdict = "asked"
            else:
                verdict = "missed" if is_column else "left out"
            counts[verdict] += 1
            if verdict in ("wrong", "missed") or (verdict == "asked" and label[-1] not in "?~"):
                print(
                    f"{verdict}: {log.name}: {guess.channel.key} is {label}, guessed {guess.column}"
                )
    return counts


def main() -> None:
    logs = labelled_logs()
    fitted, others = logs[::2], logs[1::2]
    table = likelihood.likelihoods()
    table["weights"] = fitted_weights(fitted)
    table["weights"] = fitted_weights(with_springs(fitted))
    print(f"{len(fitted)} recordings to fit: {judged(fitted)}")
    print(f"{len(others)} recordings to judge: {judged(others)}")
    if "--write" in sys.argv:
        above = likelihood.TABLE.read_text(encoding="utf-8").partition("\nweights:\n")[0]
        lines = [f"  {name}: {json.dumps(of)}" for name, of in table["weights"].items()]
        text = "\n".join([above, "weights:", *lines, ""]).replace('"', "")
        likelihood.TABLE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
