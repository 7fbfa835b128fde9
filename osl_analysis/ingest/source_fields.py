"""What source files of several formats have in common."""

from typing import Any, Literal

import numpy as np
from pydantic import field_validator

from osl_analysis.columns import AXES, COLUMNS, unit_of
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings

Sign = Literal[1, -1]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


class SharedAngle(Settings):
    """What aligns a log's clock where the edges of a sync channel cannot.

    A column of the log is, up to scale, sign and offset, the angle at the second of three markers.
    """

    column: str
    markers: tuple[str, str, str]


class Laboratory(Settings):
    """A motion capture laboratory.

    `markers`: all (every labelled point that is no model output), none or a list of labels. `axes` names the file's
    axes that point forward, to the left and up: `[z, x, y]` or `[x, -z, y]` where y is up. `shared` is what aligns the
    clock of a log that says `clock: shared`.
    """

    markers: Literal["all"] | tuple[str, ...] = "all"
    axes: tuple[Axis, Axis, Axis] = ("x", "y", "z")
    shared: SharedAngle | None = None

    @property
    def rotation(self) -> Array:
        """From the file's axes to ours, (3, 3): our coordinates are `rotation @ (x, y, z)`."""
        return np.array(
            [[(-1.0 if name[0] == "-" else 1.0) * (name[-1] == axis) for axis in AXES] for name in self.axes]
        )

    @field_validator("axes")
    @classmethod
    def _right_handed(cls, axes: tuple[Axis, Axis, Axis]) -> tuple[Axis, Axis, Axis]:
        if round(float(np.linalg.det(cls.model_construct(axes=axes).rotation))) != 1:
            raise ValueError("forward, left and up must be three different axes of a right-handed laboratory")
        return axes

    @field_validator("markers", mode="before")
    @classmethod
    def _marker_choice(cls, value: Any) -> Any:
        return all_none_or_list(value)


class ModelOutput(Settings):
    """One component of a model output that the laboratory's software stored as a point.

    The unit is what the software computes, not what the file says: Plug-in Gait moments are N*mm/kg whatever
    the file's units.
    """

    label: str
    component: Literal["x", "y", "z"]
    unit: str
    sign: Sign = 1


def all_none_or_list(value: Any) -> Any:
    """A choice among a file's things: `none` is the empty list."""
    if value == "none":
        return ()
    if value == "all" or isinstance(value, list | tuple):
        return value
    raise ValueError("write all, none or a list")


def check_column(column: str, unit: str | None) -> None:
    """Refuse a column that is not in the nomenclature, or a unit that cannot become the column's."""
    try:
        canonical = unit_of(column)
    except KeyError:
        names = [name for name in COLUMNS if name != "time"]
        raise ValueError(f"'{column}' is no canonical column; the columns are {', '.join(names)}") from None
    if column == "time":
        raise ValueError("time is no channel; say where it comes from under `time`")
    if unit is not None:
        try:
            si_factor(unit, canonical)
        except ValueError as error:
            raise ValueError(f"{column}: {error}") from None
