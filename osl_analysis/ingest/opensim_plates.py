"""Force plates in a table of OpenSim: force, point of application and free moment, to force and moment at the plate.

OpenSim's files of ground reactions have, per plate, the force on the foot, the point at which it acts, and the moment
about this point. Columns differ by their last letter: `ground_force_vx`, `ground_force_vy`, `ground_force_vz`.
"""

import json
import re
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np

from osl_analysis.columns import AXES, plate_columns, unit_of
from osl_analysis.errors import printable
from osl_analysis.formats.opensim_table import OpenSimTable
from osl_analysis.ingest.capture import PlateLoad, geometry
from osl_analysis.ingest.draft_places import UNKNOWN
from osl_analysis.ingest.raw_channels import channel_facts
from osl_analysis.ingest.recording import check_finite
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings

Point = tuple[float, float, float]


class OpenSimPlate(Settings):
    """One plate. The file states neither units, which are N, m and N*m in OpenSim, nor where the plate lies."""

    force: str
    """Beginning of the names of the force's columns [N]: `R_ground_force_v`."""
    point: str
    """Beginning of the names of the columns of the point of application [m]: `R_ground_force_p`."""
    moment: str
    """Beginning of the names of the columns of the moment about this point [N*m]: `R_ground_torque_`."""
    corners: tuple[Point, Point, Point, Point]
    """Corners of the surface in the file's axes [m]."""
    sign: Literal[1, -1] = 1
    """-1 if the file has the force on the plate instead of the force on the foot."""


def plate_load(table: OpenSimTable, number: int, plate: OpenSimPlate, time: Array) -> PlateLoad:
    """Force and moment about the centre of the plate, on the foot, in the file's axes.

    time: (rows,) [s], for messages and the rate.

    Raises
    ------
    InputError
        A column is missing, or holds something else than finite numbers.
    """
    names = [f"{begin}{axis}" for begin in (plate.force, plate.point, plate.moment) for axis in AXES]
    columns = np.column_stack([table.column(name) for name in names])
    for name, values in zip(names, columns.T, strict=True):
        check_finite(f"{table.path}: column '{name}'", values, time)
    force, point, moment = plate.sign * columns[:, :3], columns[:, 3:6], plate.sign * columns[:, 6:]
    centre = np.mean(plate.corners, axis=0)
    about = moment + np.cross(point - centre, force)
    origin = plate.model_dump(include={"force", "point", "moment", "sign"})
    rate = float(1 / np.median(np.diff(time))) if time.size > 1 else 1.0
    raw = channel_facts([*names[:3], *names[6:]], columns[:, [0, 1, 2, 6, 7, 8]], force, rate)
    return PlateLoad(number, 2, np.array(plate.corners), force, about, origin, raw)


def plate_signals(loads: list[PlateLoad], rotation: Array) -> tuple[dict[str, Array], dict[str, Any], list[Any]]:
    """Columns in our axes, their origins, and the plates' geometry for the trial's provenance.

    rotation: from the file's axes to ours, (3, 3).
    """
    columns: dict[str, Array] = {}
    origins: dict[str, Any] = {}
    for load in loads:
        for quantity, values in (("force", load.force), ("moment", load.moment)):
            for column, turned in zip(plate_columns(load.number, quantity), (values @ rotation.T).T, strict=True):
                columns[column] = turned
                origins[column] = {"plate": load.number, **load.origin, "si_unit": unit_of(column)}
    return columns, origins, [geometry(load, rotation) for load in loads]


def plates_text(names: Sequence[str]) -> str:
    """The plates that the names of columns tell, as a source file has them but for their corners; empty if none."""
    plates = [
        f"{number}: {{{', '.join(f'{key}: {json.dumps(begin)}' for key, begin in found.items())}, corners: {UNKNOWN}}}"
        for number, found in enumerate(named_plates(names), start=1)
    ]
    text = f"these columns are force plates, if you state their corners: plates: {{{', '.join(plates)}}}"
    return printable(text) if plates else ""


def named_plates(names: Sequence[str]) -> Iterator[dict[str, str]]:
    """Beginnings of the names of force, point and moment of each plate: `ground_force_v`, `ground_force_p` ..."""
    triples = {name[:-1] for name in names if name[-1:] == "x" and {f"{name[:-1]}y", f"{name[:-1]}z"} <= {*names}}
    for name in names:
        force = name[:-1]
        if name.endswith("vx") and force in triples and f"{force[:-1]}p" in triples:
            stem = force[:-1]  # `R_ground_force_`: its moment is `R_ground_torque_` or `R_ground_moment_`
            moments = [re.sub("force", word, stem) for word in ("torque", "moment")]
            moment = next((one for one in moments if one != stem and one in triples), None)
            if moment is not None:
                yield {"force": force, "point": f"{stem}p", "moment": moment}
