"""What a simulated campaign takes from the configuration of its analysis."""

from pathlib import Path
from typing import Any

from osl_analysis.model.compensator import Weight
from osl_analysis.yaml_settings import Settings


class SharedChoices(Settings):
    """The choices of a configuration that replace those of its simulation. Null: the simulation's
    own."""

    parameters: Path | None = None  # Parameter file of the device.
    gain_weight: Weight | None = None  # W with which the simulated leg's gains are selected.
    protocol: dict[str, Any] | None = None  # The stepped sine, as fields of a simulated schedule.
    # The impedance that the leg is asked to render over the gait cycle.
    impedance_trajectory: Path | None = None
