"""A motion capture recording in C3D: points and analog samples.

The data section is one table of numbers with a row per frame, which numpy reads. `ezc3d` is not used for reading: it
misplaces every frame where ANALOG:RATE and the header disagree, drops frames beyond 65535, takes the absolute value of
a negative OFFSET, returns fewer frames of a truncated file without an error, cannot read MIPS, and crashes on damaged
headers. Tests compare this reader with `ezc3d` and `c3d`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.formats.c3d_header import C3DHeader, Counts, parse_file
from osl_analysis.formats.c3d_parameters import reals
from osl_analysis.trial import Array


@dataclass(frozen=True)
class C3DRecording:
    """Content of a C3D file, in the file's units. Frame 0 and analog sample 0 are at 0 s."""

    path: Path
    """Path of the file."""
    header: C3DHeader
    """Counts and parameters."""
    points: Array
    """Positions and model outputs, (frames, points, 3); NaN where a point was not seen."""
    analogs: Array
    """Analog channels, (samples, channels), with `header.samples_per_frame` samples per frame."""

    @property
    def point_labels(self) -> list[str]:
        """Labels of the points, in the file's order."""
        return self.header.texts("POINT:LABELS")[: self.header.points]

    @property
    def analog_labels(self) -> list[str]:
        """Labels of the analog channels, in the file's order."""
        return self.header.texts("ANALOG:LABELS")[: self.header.channels]

    @property
    def model_outputs(self) -> set[str]:
        """Labels of the points that hold angles, forces, moments, powers or scalars instead of positions."""
        groups = self.header.texts("POINT:TYPE_GROUPS")[::2]
        return {label for group in groups for label in self.header.texts(f"POINT:{group.upper()}")}

    def analog_unit(self, channel: int) -> str:
        """Unit of a channel counted from 0, as the file spells it; empty where it gives none."""
        units = self.header.texts("ANALOG:UNITS")
        return units[channel] if channel < len(units) else ""

    def point_unit(self) -> str:
        """Unit of positions, as the file spells it; empty where it gives none."""
        return (self.header.texts("POINT:UNITS") or [""])[0]


def read_c3d(path: Path, counts: Counts = "refuse") -> C3DRecording:
    """Decode a C3D file. `counts` says whose counts hold where header and parameters contradict each other.

    Raises
    ------
    CountsError
        They contradict each other, and `counts` does not say.
    InputError
        The file is not C3D, damaged or truncated.
    """
    data = path.read_bytes()
    header = parse_file(path, data, counts)
    points, analogs = np.split(frames_of(data, header), [4 * header.points], axis=1)
    with np.errstate(
        invalid="ignore", over="ignore"
    ):  # a damaged sample that is not finite is refused where it is used
        return C3DRecording(
            path,
            header,
            positions(points.reshape(header.frames, header.points, 4), header),
            physical(analogs.reshape(header.frames * header.samples_per_frame, header.channels), header),
        )


def frames_of(data: bytes, header: C3DHeader) -> NDArray[Any]:
    """The data section as stored, a row per frame: x, y, z, residual per point, then analog samples."""
    content = data[header.data_start : header.data_start + header.frames * header.frame_bytes]
    integer = ">i2" if header.processor == "MIPS" else "<i2"
    numbers = np.frombuffer(content, integer) if header.integers else reals(content, header.processor)
    return numbers.reshape(header.frames, -1)


def positions(points: NDArray[Any], header: C3DHeader) -> Array:
    """Positions (frames, points, 3) in the file's unit, NaN where nothing was seen.

    A point was not seen where its residual is negative, its position is exactly the origin, or a value is not finite.
    """
    values = points[:, :, :3].astype(np.float64) * (header.scale if header.integers else 1.0)
    unseen = (points[:, :, 3] < 0) | (values == 0).all(axis=2) | ~np.isfinite(values).all(axis=2)
    values[unseen] = np.nan
    return values


def physical(analogs: NDArray[Any], header: C3DHeader) -> Array:
    """Analog values (samples, channels): (raw - OFFSET) * SCALE * GEN_SCALE; without these parameters the raw values.

    NaN where SCALE holds values for some channels only, and everywhere where GEN_SCALE is 0. ANALOG:FORMAT says whether
    16-bit samples and offsets are signed.
    """
    raw = analogs.astype(np.float64)
    offset, scale, general = (header.numbers(f"ANALOG:{name}") for name in ("OFFSET", "SCALE", "GEN_SCALE"))
    unsigned = "UNSIGNED" in [text.upper() for text in header.texts("ANALOG:FORMAT")]
    if unsigned:
        offset = offset % 65536
        raw = raw % 65536 if header.integers else raw
    count = min(header.channels, offset.size)
    raw[:, :count] -= offset[:count]
    count = min(header.channels, scale.size)
    raw[:, :count] *= scale[:count]
    raw[:, count:] *= np.nan if count else 1.0
    return raw * ((general[0] or np.nan) if general.size else 1.0)
