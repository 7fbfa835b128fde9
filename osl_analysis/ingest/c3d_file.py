"""A motion capture recording in C3D: points and analog samples, decoded by ezc3d behind guards."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.ingest.c3d_header import C3DHeader, read_header
from osl_analysis.ingest.isolation import isolated
from osl_analysis.trial import Array

DECODER_TIMEOUT = 120.0  # s; real files take well under one


@dataclass(frozen=True)
class C3DRecording:
    """What a C3D file holds, in the file's own units; frame 0 and analog sample 0 are at 0 s.

    `points` has shape (frames, points, 3), NaN where a point was not seen; `analogs` (samples, channels), with
    `header.samples_per_frame` samples per frame.
    """

    path: Path
    header: C3DHeader
    points: Array
    analogs: Array

    @property
    def point_labels(self) -> list[str]:
        return self.header.texts("POINT:LABELS")[: self.header.points]

    @property
    def analog_labels(self) -> list[str]:
        return self.header.texts("ANALOG:LABELS")[: self.header.channels]

    @property
    def model_outputs(self) -> set[str]:
        """Labels of points that are no positions but angles, forces, moments, powers or scalars."""
        groups = self.header.texts("POINT:TYPE_GROUPS")[::2]
        return {label for group in groups for label in self.header.texts(f"POINT:{group.upper()}")}

    def analog_unit(self, channel: int) -> str:
        """Unit of a channel counted from 0, as the file spells it; empty where it gives none."""
        units = self.header.texts("ANALOG:UNITS")
        return units[channel] if channel < len(units) else ""

    def point_unit(self) -> str:
        """Unit of positions, as the file spells it; empty where it gives none."""
        return (self.header.texts("POINT:UNITS") or [""])[0]


def read_c3d(path: Path) -> C3DRecording:
    """Decode a C3D file.

    Raises
    ------
    InputError
        No C3D file, one for another processor, damaged or truncated, or one that its own parameters contradict.
    """
    header = read_header(path)
    try:
        points, residuals, analogs = isolated(partial(decode, path), DECODER_TIMEOUT)
    except InputError as error:
        raise InputError(f"{path}: cannot be decoded: {error}; export the trial again") from error
    check_shapes(path, header, points, analogs)
    return C3DRecording(path, header, with_gaps(points, residuals), rescaled(analogs, header))


def decode(path: Path) -> list[Array]:
    """Points (frames, points, 3), residuals (frames, points) and analogs (samples, channels), as ezc3d has them."""
    import ezc3d

    data = ezc3d.c3d(str(path))["data"]
    points = data["points"][:3].transpose(2, 1, 0)
    return [points, data["meta_points"]["residuals"][0].T, data["analogs"][0].T]


def check_shapes(path: Path, header: C3DHeader, points: Array, analogs: Array) -> None:
    """Refuse what was decoded to other counts than the header's.

    ezc3d derives the samples per frame from ANALOG:RATE; where that contradicts the header it reads every frame
    from a wrong place.
    """
    expected = (header.frames, header.points), (header.frames * header.samples_per_frame, header.channels)
    if points.shape[:2] != expected[0] or (header.channels and analogs.shape != expected[1]):
        raise InputError(
            f"{path}: the header declares {expected[0]} points and {expected[1]} analog samples (rows, columns), its "
            f"parameters {points.shape[:2]} and {analogs.shape}; correct POINT:RATE and ANALOG:RATE and export again"
        )


def with_gaps(points: Array, residuals: Array) -> Array:
    """Points with NaN where nothing was seen: a negative residual, or the exact origin."""
    unseen = (residuals < 0) | (points == 0).all(axis=2)
    return np.where(unseen[:, :, None], np.nan, points)


def rescaled(analogs: Array, header: C3DHeader) -> Array:
    """Analog values (samples, channels) with the offsets that the file means: (raw - OFFSET) * SCALE * GEN_SCALE.

    ezc3d takes the absolute value of OFFSET and raw samples as signed, whatever ANALOG:FORMAT says.
    """
    offset, scale, general = (header.numbers(f"ANALOG:{name}") for name in ("OFFSET", "SCALE", "GEN_SCALE"))
    channels = min(header.channels, offset.size, scale.size)
    offset = offset[:channels]
    unit = scale[:channels] * (general[0] if general.size else 1.0)
    corrected = analogs.copy()
    part = corrected[:, :channels]
    if "UNSIGNED" in header.texts("ANALOG:FORMAT"):
        if header.integers:
            raw = part / np.where(unit == 0, 1.0, unit) + abs(offset)
            part += np.where(raw < -0.5, 65536.0, 0.0) * unit
        part += (abs(offset) - offset % 65536) * unit
    else:
        part += (abs(offset) - offset) * unit
    return corrected
