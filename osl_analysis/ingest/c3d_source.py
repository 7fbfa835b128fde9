"""The source file of a capture in C3D."""

from typing import Any, Literal

from pydantic import Field, PositiveInt, ValidationInfo, field_validator

from osl_analysis.errors import InputError
from osl_analysis.formats.c3d_file import C3DRecording
from osl_analysis.formats.c3d_header import Counts
from osl_analysis.ingest.source_fields import CaptureSource, Conversion, all_none_or_list
from osl_analysis.ingest.unit_names import ForceUnit, LengthUnit, Unit
from osl_analysis.ingest.units import si_factor
from osl_analysis.yaml_settings import Settings


class PlateUnits(Settings):
    """Units of the plates' channels where the file's ANALOG:UNITS are absent or wrong."""

    force: ForceUnit
    """Unit of the force channels."""
    moment: Unit
    """Unit of the moment channels."""
    length: LengthUnit | None = None
    """Unit of the centre of pressure of a type 1 plate; null: the file's."""

    @field_validator("force", "moment", "length")
    @classmethod
    def _known(cls, unit: str | None, info: ValidationInfo) -> str | None:
        if unit is not None:
            si_factor(unit, {"force": "N", "moment": "N*m", "length": "m"}[str(info.field_name)])
        return unit


class C3dAnalog(Conversion):
    """One analog channel of a C3D file. Without `unit`, the unit in the file's ANALOG:UNITS is used."""

    channel: str
    """Label of the channel in the file."""


class C3dSource(CaptureSource):
    """A capture in C3D."""

    format: Literal["c3d"]
    """Format of the file."""
    analogs: dict[str, C3dAnalog] = Field(default={})
    """The analog channel of each canonical column."""
    counts: Counts = "refuse"
    """Which counts of points and analog channels hold where the file's header and its parameters contradict each other:
    header, parameters, or refuse."""
    point_unit: LengthUnit | None = None
    """Unit of length, where the file's POINT:UNITS is absent or wrong."""
    plates: Literal["all"] | tuple[int, ...] = "all"
    """The force plates to read: all, none or a list counted from 1."""
    plate_units: PlateUnits | None = None
    """Units of the plates' channels, where the file's ANALOG:UNITS are absent or wrong."""
    plate_zero: Literal["none", "file"] | tuple[PositiveInt, PositiveInt] = "none"
    """Baseline to subtract from the plates' channels: none, file (the frames of FORCE_PLATFORM:ZERO) or two frames,
    counted from 1, between which the plates were unloaded."""

    @field_validator("plates", mode="before")
    @classmethod
    def _plate_choice(cls, value: Any) -> Any:
        return all_none_or_list(value)

    @field_validator("point_unit")
    @classmethod
    def _length(cls, unit: str | None) -> str | None:
        if unit is not None:
            si_factor(unit, "m")
        return unit

    def unit_of_length(self, recording: C3DRecording) -> str:
        """The source file's unit of length, or else the recording's.

        Raises
        ------
        InputError
            It is empty, unknown or not a length.
        """
        unit = self.point_unit or recording.point_unit()
        try:
            si_factor(unit, "m")
        except InputError as error:
            raise InputError(f"unit of length: {error}, as {self.place('point_unit')}") from error
        return unit
