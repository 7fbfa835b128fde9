"""What a simulated campaign and its analysis both use: the simulator follows the campaign's configuration in it."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from osl_analysis.model.gain_selection import FASTEST_HZ, HIGHEST_ORDER, SLOWEST_HZ, Weight
from osl_analysis.yaml_settings import Positive, Settings

FOLLOWED = {
    "belt": ("parameters",),
    "transmission": ("parameters", "protocol"),
    "actuator": ("parameters",),
    "impedance": ("parameters", "protocol", "gain_weight"),
    "walking": ("parameters", "gain_weight", "impedance_trajectory"),
}
"""The shared choices that the simulated trials of each experiment use; the other experiments use none."""


class WeightSettings(Settings):
    """W of Eq. 14, the Butterworth low-pass with which the laboratory selected its gains."""

    cutoff_hz: Annotated[float, Field(ge=SLOWEST_HZ, le=FASTEST_HZ)]
    """Cut-off [Hz]."""
    order: Annotated[int, Field(ge=1, le=HIGHEST_ORDER)]
    """Order."""

    @property
    def weight(self) -> Weight:
        """The weight W of these settings."""
        return Weight(self.cutoff_hz, self.order)


PAPER = WeightSettings(cutoff_hz=1.0, order=3)
"""W of the paper."""


class FollowedProtocol(Settings):
    """The stepped sine that `dynamometer` expects. Rests, ramps and imperfections are the simulation's own."""

    amplitudes_deg: tuple[Positive, ...]
    """Amplitudes [deg]."""
    frequencies_hz: tuple[Positive, ...]
    """Frequencies [Hz]."""
    cycles: int | tuple[int, ...]
    """Cycles at each frequency."""
    seconds_per_frequency: Positive | None = None
    """Duration [s] of each frequency in place of `cycles`."""

    def schedule(self) -> dict[str, Any]:
        """The fields of a simulated schedule that say the same."""
        seconds = self.seconds_per_frequency
        return {
            "amplitudes_deg": self.amplitudes_deg,
            "frequencies_hz": self.frequencies_hz,
            "cycles": self.cycles if seconds is None else None,
            "seconds": seconds,
        }


class SharedChoices(Settings):
    """The choices of a configuration that replace those of its simulation. Null: the simulation's own."""

    parameters: Path | None = None
    """Parameter file of the device."""
    gain_weight: WeightSettings | None = None
    """W with which the simulated leg's gains are selected."""
    protocol: FollowedProtocol | None = None
    """The stepped sine."""
    impedance_trajectory: Path | None = None
    """The impedance that the leg is asked to render over the gait cycle."""
