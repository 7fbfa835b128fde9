"""How the simulated capture is recorded: type and faults of the plate's channels, labels, axes, what is stated."""

from typing import Literal

from pydantic import Field

from osl_analysis.simulator.effect import Positive
from osl_analysis.yaml_settings import Settings


class CaptureSettings(Settings):
    """The C3D file. The defaults are what Vicon Nexus writes."""

    plate_type: Literal[1, 2, 3, 4] = 2
    """Type of the force plate in the C3D file: 1 (force, centre of pressure, free moment), 2 (force and moment),
    3 (eight sensors of Kistler) or 4 (six voltages with a calibration matrix)."""
    sensor_span_m: tuple[Positive, Positive] = (0.21, 0.26)
    """Distance [m] of the four sensors of type 3 from the centre, along the plate's x and y."""
    dead_channels: dict[str, float] = Field(default_factory=dict)
    """Channels of the plate that stand still, by label, such as `Mx1`, with the value that they show [file's unit]."""
    moment_label: str | None = None
    """Unit that the file states for the plate's moments. Null: the true one, Nmm, in which the values always are."""
    swapped_labels: tuple[tuple[str, str], ...] = ()
    """Pairs of markers whose labels are exchanged."""
    swapped_in: tuple[str, ...] | None = None
    """Trials whose labels are exchanged. Null: all."""
    up_axis: Literal["z", "y"] = "z"
    """Axis of the file that points up. With `y`, z points to the right."""
    states_axes: bool = True
    """Whether the file states its axes (POINT:X_SCREEN and Y_SCREEN)."""
    states_body_mass: bool = False
    """Whether the file states the body mass (PROCESSING:BODYMASS)."""
