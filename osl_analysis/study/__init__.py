"""The Monte Carlo study: bias and efficiency of the estimators, and coverage of their intervals.

Here stands which experiments it has. Rules read it, so that nothing is imported that simulates.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Recording:
    """How a trial is recorded, where this differs from the simulated campaign."""

    recorder: Mapping[str, Any] = field(default_factory=dict)
    """Nodes of the recorder, as in the settings of a simulation."""
    rate_hz: float = 1000.0
    """Rate of the log [Hz]."""
    bits: int | None = None
    """Bits of the joint's encoder; None: those of the simulated campaign."""


def on(size: float, unit: str) -> Mapping[str, Any]:
    """A switch of the simulation that is on."""
    return {"enabled": True, "size": size, "unit": unit}


LATER = on(3e-4, "s")
"""How much later the node of the torque samples."""
RECORDINGS = {
    "jitter of 1 us": Recording({"node": {"jitter": on(1e-6, "s")}}),
    "jitter of 50 us": Recording({"node": {"jitter": on(50e-6, "s")}}),
    "four decimals at 300 Hz": Recording({"node": {"decimals": on(4, "decimal")}}, rate_hz=300.0),
    "four decimals at 1024 Hz": Recording({"node": {"decimals": on(4, "decimal")}}, rate_hz=1024.0),
    "missing samples": Recording({"node": {"dropped": on(1e-3, "1")}}),
    "two nodes": Recording({"node": {}, "torque_node": {"phase": LATER}}),
    "333 Hz and 1 kHz": Recording({"node": {"rate": on(333, "Hz")}, "torque_node": {"phase": LATER}}),
    "14 bits": Recording(bits=14),
    "14 bits and 50 us": Recording({"node": {"jitter": on(50e-6, "s")}}, bits=14),
    "250 Hz": Recording(rate_hz=250.0),
}
"""Recordings of the joint that is exactly Eq. 15, each an experiment of its own."""
BENCH = {
    "second order": "bench.second_order",
    **{f"second order, {name}": "recorded.second_order" for name in RECORDINGS},
    "linear drivetrain": "bench.linear_drivetrain",
    "drivetrain": "bench.drivetrain",
    "frequency response": "phasors.response_bench",
    "transmission": "bench.transmission",
    "repeated transmission": "repeats.repeated_transmission",
    "belt": "bench.belt",
    "repeated belt": "repeats.repeated_belt",
    "actuator": "actuator.actuator",
}
"""Experiments on a bench, each with the function of `study/` that turns the study's inputs into it."""
REPEATED = {"repeated transmission": 20, "repeated belt": 20}
"""Experiments on a bench whose estimate is a mean over the trials of a campaign, and how many means one job takes."""
WALKING = {"walking": ("campaigns", 10), "walking recorded": ("recorded", 5)}
"""Walking, from angle and torque on, and through markers, plate, C3D files and ingest: the field of `study` in the
configuration with the number of campaigns, and how many of them one job takes."""
