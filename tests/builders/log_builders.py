# SPDX-License-Identifier: Apache-2.0
"""Recordings in formats of several rooms, written by other libraries or letter by letter."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from nptdms import ChannelObject, RootObject, TdmsWriter

with warnings.catch_warnings(action="ignore"):  # of the library's import
    from matio import save_to_mat


def write_text(path: Path, columns: dict[str, Any], sign: str = ",", head: str = "") -> Path:
    rows = [columns, *zip(*columns.values(), strict=True)]
    path.write_text(head + "".join(sign.join(map(str, row)) + "\n" for row in rows))
    return path


def write_opensim(path: Path, columns: dict[str, Any], header: str = "grf") -> Path:
    """A table of OpenSim with a line of its header."""
    count = len(next(iter(columns.values())))
    return write_text(path, columns, "\t", f"Table\n{header}\nnRows={count}\nendheader\n")


HEAD = ["Time [s]", "Ankle angle [deg]", "Torque [Nm]"]


def written(values: Any) -> list[str]:
    return [f"{value:.9f}" for value in values]


def ankle(rows: int) -> tuple[np.ndarray, ...]:
    """Time [s], angle [deg] and torque [N*m] of a joint that swings, at 500 Hz."""
    time = np.arange(rows) / 500
    return time, 5 * np.sin(9 * time), 30 * np.sin(9 * time + 0.3)


def table_text(
    sign: str = ",",
    head: list[str] = HEAD,
    above: str = "",
    *,
    t: list[str],
    a: list[str],
    m: list[str],
    decimal: str = ".",
) -> str:
    """A table of text with columns of time, angle and torque."""
    rows = [sign.join(row).replace(".", decimal) for row in zip(t, a, m, strict=True)]
    return above + "\n".join([*[sign.join(head)] * bool(head), *rows]) + "\n"


def write_mat(path: Path, **variables: object) -> Path:
    """A file of version 5."""
    scipy.io.savemat(path, variables, do_compression=True)
    return path


def write_mat73(path: Path, **variables: object) -> Path:
    """A file of version 7.3."""
    save_to_mat(path, variables, version="v7.3")
    return path


def write_tdms(
    path: Path, channels: list[tuple[str, Any, dict[str, Any]]], segments: int = 1
) -> Path:
    """Channels of the group Bench, in as many segments."""
    with TdmsWriter(path) as writer:
        for part in range(segments):
            cut = [np.array_split(np.asarray(values), segments)[part] for _, values, _ in channels]
            named = zip(channels, cut, strict=True)
            objects = [
                ChannelObject(*f"Bench/{one[0]}".rsplit("/", 1), values, one[2])
                for one, values in named
            ]
            writer.write_segment([RootObject({"author": "lab"}), *objects])
    return path


FRAMES = 40


STEP = np.arange(FRAMES)[:, None]


HEIGHTS = np.array([1700.0, 900.0, 500.0, 50.0]) + 5 * np.sin(STEP / 5)


# (frames, markers, 3) [mm] in OpenSim's axes: x forward, y up, z to the right
WALK = np.stack([8.0 * STEP + np.arange(4), HEIGHTS, np.arange(-100.0, -96) + 0 * STEP], axis=2)


def write_trc(
    path: Path,
    positions: np.ndarray = WALK,
    start: float = 0,
    first: int = 1,
    **header: Any,
) -> Path:
    """A file as Cortex writes it; `header` replaces what its second line names."""
    frames = len(positions)
    keys = {"DataRate": 100, "CameraRate": 100, "NumFrames": frames, "NumMarkers": 4, "Units": "mm"}
    keys.update(header)
    lines = ["PathFileType\t4\t(X/Y/Z)\twalk.trc", "\t".join(keys)]
    lines.append("\t".join(map(str, keys.values())))
    lines.append(
        "\t".join(["Frame#", "Time", *(f"{label}\t\t" for label in ["HEAD", "HIP", "KNEE", "TOE"])])
    )
    lines += ["\t\tX1\tY1\tZ1", ""]
    for k, frame in enumerate(positions):
        cells = ["" if np.isnan(value) else f"{value:.5f}" for value in frame.ravel()]
        time = f"{start + k / keys['DataRate']:.3f}"
        lines.append("\t".join([str(k + first), time, *cells, ""]))
    path.write_text("\n".join(lines) + "\n")
    return path
