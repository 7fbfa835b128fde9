"""Force plates of types 1 to 4: from their channels to force and moment on the foot (C3D manual, Kistler).

All quantities are in SI units. The moment is about the centre of the plate's surface. It is not computed from a centre
of pressure, so that it is also valid for an unloaded plate. The exception is type 1, which records only the centre of
pressure. After the rotation a clipped or dead sensor cannot be seen, so what each raw channel shows is kept.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.plateaus import run_at_extreme
from osl_analysis.signals import runs
from osl_analysis.trial import Array

CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}


@dataclass(frozen=True)
class ForcePlate:
    """One plate."""

    number: int
    type: int  # 1 to 4, as in the C3D manual
    corners: Array
    """(4, 3) [m], in the laboratory; in the quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y) of the plate's axes."""
    origin: Array  # FORCE_PLATFORM:ORIGIN, (3,) [m], in the plate's axes
    calibration: Array | None = None  # (6, 6), which turns the channels of type 4 into [N] and [N*m]

    def __post_init__(self) -> None:
        if self.type not in CHANNELS:
            raise InputError(f"plate {self.number} is of type {self.type}; types 1 to 4 are read")
        if not np.isfinite(self.axes()).all():
            raise InputError(f"plate {self.number}: its corners span no plane; correct FORCE_PLATFORM:CORNERS")
        if self.type == 3 and not self.origin[:2].all():
            raise InputError(
                f"plate {self.number} of type 3 has ORIGIN {self.origin.tolist()}; without its sensors' distances "
                "there is no moment: correct FORCE_PLATFORM:ORIGIN"
            )
        if self.type == 4 and self.calibration is None:
            raise InputError(f"plate {self.number} of type 4 has no FORCE_PLATFORM:CAL_MATRIX; export it with one")

    def axes(self) -> Array:
        """The plate's axes in the laboratory, as columns, (3, 3): x along corners 2 to 1, z normal to the surface."""
        x = self.corners[0] - self.corners[1]
        z = np.cross(x, self.corners[0] - self.corners[3])
        with np.errstate(invalid="ignore", divide="ignore"):
            x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
        return np.column_stack([x, np.cross(z, x), z])

    def wrench(self, channels: Array) -> tuple[Array, Array]:
        """Force [N] and moment [N*m] about the surface's centre, (n, 3) each, in laboratory axes, on the foot.

        `channels` (n, channels) are in [N], [N*m] and for type 1 [m]; for type 4 in the units of the calibration.
        They are in the plate's axes, whose z points down, with a negative Fz under load; in the laboratory's axes this
        is the ground reaction.
        """
        force, moment = (WRENCH[self.type])(self, channels)
        axes = self.axes()
        return force @ axes.T, moment @ axes.T


def type_1(plate: ForcePlate, channels: Array) -> tuple[Array, Array]:
    """Fx, Fy, Fz, centre of pressure x and y, free moment: M = p x F + (0, 0, T)."""
    force, pressure, free = channels[:, :3], channels[:, 3:5], channels[:, 5]
    level = np.zeros(len(channels))
    moment = np.cross(np.column_stack([pressure, level]), force) + np.column_stack([level, level, free])
    return force, moment - np.cross(surface_centre(plate), force)


def type_2(plate: ForcePlate, channels: Array) -> tuple[Array, Array]:
    """Fx, Fy, Fz, Mx, My, Mz about the plate's origin, moved to the surface's centre."""
    force = channels[:, :3]
    return force, channels[:, 3:6] - np.cross(surface_centre(plate), force)


def type_3(plate: ForcePlate, channels: Array) -> tuple[Array, Array]:
    """Kistler's four sensors: Fx12, Fx34, Fy14, Fy23, Fz1, Fz2, Fz3, Fz4.

    ORIGIN holds the sensors' distances a and b, and their depth, which files write with either sign.
    """
    a, b, depth = plate.origin[0], plate.origin[1], abs(plate.origin[2])
    x12, x34, y14, y23, z1, z2, z3, z4 = channels.T
    force = np.column_stack([x12 + x34, y14 + y23, z1 + z2 + z3 + z4])
    moment = np.column_stack(
        [
            b * (z1 + z2 - z3 - z4),
            a * (-z1 + z2 + z3 - z4),
            b * (-x12 + x34) + a * (y14 - y23),
        ]
    )
    return force, moment - np.cross((0.0, 0.0, -depth), force)


def type_4(plate: ForcePlate, channels: Array) -> tuple[Array, Array]:
    """Like type 2, after the calibration matrix."""
    assert plate.calibration is not None  # checked at construction
    return type_2(plate, channels @ plate.calibration.T)


def surface_centre(plate: ForcePlate) -> Array:
    """Vector from the plate's origin to the centre of its surface, in its axes [m].

    The origin lies under the surface and z points down, so z is negative; a file with a positive z stores the
    opposite vector.
    """
    return -plate.origin if plate.origin[2] > 0 else plate.origin


WRENCH = {1: type_1, 2: type_2, 3: type_3, 4: type_4}


LOADED = 0.2
"""Share of the range of the plate's force: where the force changes by more, every channel should change."""
LEAST_FORCE = 50.0  # range [N] of the plate's force above which the plate was used


def channel_facts(labels: Sequence[str], channels: Array, force: Array, rate: float) -> list[dict[str, Any]]:
    """Facts about each raw channel of a plate, for the trial's provenance.

    labels: names of the channels in the file.
    channels: raw samples (n, channels) in the file's units.
    force: (n, 3) [N], what the plate's channels give together.
    rate: sampling rate [Hz].

    `clipped_samples` is the length of the longest run at an extreme, `clipped_at` its value in the unit of the file.
    `stands_samples` is the length of the longest run of one value while the plate's force changes. `..._from_s` and
    `..._to_s` are the times of a run's first and last sample.
    """
    load = np.linalg.norm(force, axis=1)
    least = max(LOADED * float(np.ptp(load)), LEAST_FORCE) if load.size else LEAST_FORCE
    facts = []
    for label, values in zip(labels, channels.T, strict=True):
        clipped = run_at_extreme(values)
        repeated = [slice(run.start, run.stop + 1) for run in runs(np.diff(values) == 0)]
        standing = [run for run in repeated if np.ptp(load[run]) > least]
        longest = max(standing, key=lambda run: run.stop - run.start, default=slice(0, 0))
        at = float(values[clipped.start]) if clipped.stop > clipped.start else None
        spans = spanned("clipped", clipped, rate) | {"clipped_at": at} | spanned("stands", longest, rate)
        facts.append({"label": label, **spans})
    return facts


def spanned(name: str, run: slice, rate: float) -> dict[str, Any]:
    """A run's length in samples, and the times [s] of its first and last sample; None for an empty run."""
    found = run.stop > run.start
    return {
        f"{name}_samples": int(run.stop - run.start),
        f"{name}_from_s": run.start / rate if found else None,
        f"{name}_to_s": (run.stop - 1) / rate if found else None,
    }
