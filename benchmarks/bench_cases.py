"""The imperfections of `bench_imperfections.py`: the name of each row, and the fields of the simulation that differ."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

Changes = Mapping[str, Any]


@dataclass(frozen=True)
class Remedy:
    """What the user states: fields of the source file and of the configuration, and how the row is called."""

    label: str
    source: Changes = field(default_factory=dict)
    config: Changes = field(default_factory=dict)
    needed: bool = True
    """Whether nothing in the data can tell, so that the user must state it."""


@dataclass(frozen=True)
class Case:
    """One imperfection: how its row is called, and the fields of the simulation that differ."""

    label: str
    changes: Changes = field(default_factory=dict)
    remedy: Remedy | None = None


def on(size: float, unit: str, **more: Any) -> dict[str, Any]:
    """An effect that is switched on."""
    return {"enabled": True, "size": size, "unit": unit, **more}


def one(**node: Any) -> Changes:
    """One node."""
    return {"recorder": {"node": node}}


def two(torque: Changes, **node: Any) -> Changes:
    """Two nodes, the torque's 0.3 ms later."""
    return {"recorder": {"node": node, "torque_node": {"phase": on(3e-4, "s"), **torque}}}


def sensor(channel: str, **faults: Any) -> Changes:
    """Faults of one sensor."""
    return {"recorder": {"sensors": {channel: faults}}}


def at_rate(rate_hz: float, changes: Changes | None = None) -> Changes:
    """The rate of the log, and other changes."""
    return {"dynamometer": {"rate_hz": rate_hz}, **(changes or {})}


def jitter(seconds: float) -> dict[str, Any]:
    """True jitter."""
    return on(seconds, "s", distribution="normal")


def latency(seconds: float) -> dict[str, Any]:
    """Host latency, exponentially distributed."""
    return on(seconds, "s", distribution="exponential")


PYTHON_LOOP = at_rate(
    500, one(jitter=on(1e-4, "s", distribution="exponential"), dropped=on(2e-4, "1"), burst=on(2, "sample"))
)
"""As a soft real-time loop writes: 0.1 ms of scatter, some steps of 6 ms."""
SET_APART = Remedy(
    "stated: `delay`, what the clocks differ by at the largest amplitude",
    source={"channels": {"torque": {"delay": "0.1 ms"}}},
)
EVERY_100 = on(100, "sample", scatter=3)
NAN = {"recorder": {"sensors": {name: {"failed": on(5e-3, "1")} for name in ("joint_angle", "load_cell_torque")}}}
RECORDERS = [
    Case("none"),
    *(Case(f"true jitter, {s * 1e6:g} µs", one(jitter=jitter(s))) for s in (1e-6, 20e-6, 50e-6, 300e-6)),
    *(Case(f"host latency, {s * 1e3:g} ms", one(latency=latency(s))) for s in (2e-4, 2e-3)),
    Case("stamps late by half-normal noise, 0.2 ms", one(latency=on(2e-4, "s", distribution="half_normal"))),
    Case("a Python loop at 500 Hz, 0.1 ms of scatter, steps of 6 ms", PYTHON_LOOP),
    *(
        Case(f"stamps with {d} decimals at {rate:g} Hz", at_rate(rate, one(decimals=on(d, "decimal"))))
        for d, rate in ((4, 300), (4, 1024), (3, 1024), (6, 1000))
    ),
    Case("1 sample of 141 000 missing", one(dropped=on(1e-6, "1"))),
    Case("0.1 % of the samples missing", one(dropped=on(1e-3, "1"))),
    Case("gaps of 20 ms, 0.2 % of the samples", one(dropped=on(2e-3, "1"), burst=on(20, "sample"))),
    Case("gaps of 200 ms, 0.6 % of the samples", one(dropped=on(6e-3, "1"), burst=on(200, "sample"))),
    *(
        Case(f"gaps of {ms} ms in every cycle", one(lost_every=on(200, "sample"), burst=on(ms, "sample")))
        for ms in (20, 50)
    ),
    Case("0.5 % of the angle and of the torque NaN", NAN),
    Case("1 % of the samples written twice", one(duplicated=on(0.01, "1"))),
    Case("two nodes, 0.3 ms apart", two({})),
    Case("two nodes, 20 µs of true jitter each", two({"jitter": jitter(20e-6)}, jitter=jitter(20e-6))),
    Case("two nodes, torque at 333 Hz", two({"rate": on(333, "Hz")})),
    Case("two nodes, angle at 333 Hz", two({}, rate=on(333, "Hz"))),
    Case("two nodes, torque's host latency 0.5 ms", two({"latency": latency(5e-4)})),
    Case(
        "two nodes, the same, and 1 % of the torque missing",
        two({"latency": latency(5e-4), "dropped": on(0.01, "1")}),
    ),
    *(
        Case(
            f"two nodes, the same, and one in {n} of the torque missing",
            two({"latency": latency(5e-4), "lost_every": on(n, "sample", scatter=n // 33)}),
        )
        for n in (50, 100, 300)
    ),
    Case("two nodes, 2 ms, and one in 100 missing", two({"latency": latency(2e-3), "lost_every": EVERY_100})),
    Case(
        "two nodes, torque's host latency 0.5 ms, one in 100 of the angle missing",
        two({"latency": latency(5e-4)}, lost_every=EVERY_100),
    ),
    Case("two nodes, clocks 1 ppm apart", two({"clock_drift": on(1, "ppm")}), SET_APART),
    Case("two nodes, clocks 2 ppm apart", two({"clock_drift": on(2, "ppm")})),
    Case("two nodes, clocks 50 ppm apart", two({"clock_drift": on(50, "ppm")})),
]
LITTLE_LATE = Remedy("stated: `delay` of the torque", source={"channels": {"torque": {"delay": "0.1 ms"}}})
LATE = Remedy("stated: `delay` of the torque", source={"channels": {"torque": {"delay": "2 ms"}}})
SLOW = Remedy(
    "stated: `low_pass` of the torque", source={"channels": {"torque": {"low_pass": {"cutoff": "100 Hz", "order": 1}}}}
)
STIFFNESS = {"value": "3000 N*m/rad", "standard_error": "3 N*m/rad"}
STIFFER = {"value": "8000 N*m/rad", "standard_error": "8 N*m/rad"}
STIFF_FRAME = Remedy("stated: `bench_stiffness`", config={"dynamometer": {"bench_stiffness": STIFFER}})
FRAME = Remedy("stated: `bench_stiffness`", config={"dynamometer": {"bench_stiffness": STIFFNESS}})
BITS = Remedy("stated: `bits` of the angle", source={"channels": {"theta": {"bits": 14}}}, needed=False)
SENSOR_FAULTS = [
    Case("torque 0.1 ms late", sensor("load_cell_torque", delay=on(1e-4, "s")), LITTLE_LATE),
    Case("torque 2 ms late", sensor("load_cell_torque", delay=on(2e-3, "s")), LATE),
    Case(
        "load cell behind a 100 Hz low-pass, first order",
        sensor("load_cell_torque", low_pass=on(100, "Hz", order=1)),
        SLOW,
    ),
    Case("encoder of 14 bits", {"effects": {"joint_encoder": on(14, "bit")}}, BITS),
    Case("encoder of 12 bits", {"effects": {"joint_encoder": on(12, "bit")}}),
    Case("torque with 12 bits over ± 50 N·m", sensor("load_cell_torque", clipping=on(50, "N*m"), adc=on(12, "bit"))),
    *(Case(f"log at {rate:g} Hz", at_rate(rate)) for rate in (100, 250)),
    *(
        Case(f"torque × {gain:g}", sensor("load_cell_torque", gain=on(gain, "1")))
        for gain in (4.45, 1.3558, 0.113, 0.01, -1)
    ),
    Case("angle × 57.3: degrees declared as radians", sensor("joint_angle", gain=on(57.29578, "1"))),
    Case("load cell clips at 30 N·m", sensor("load_cell_torque", clipping=on(30, "N*m"))),
    Case("encoder sticks at 5.5°", sensor("joint_angle", clipping=on(0.096, "rad"))),
    Case("hum of 0.3 N·m at 50 Hz", {"effects": {"load_cell_hum": on(0.3, "N*m", frequency_hz=50)}}),
    Case("1/f noise, 0.05 N·m in a decade", {"effects": {"load_cell_flicker": on(0.05, "N*m")}}),
    Case("the bench's frame yields, 3000 N·m/rad", {"effects": {"mount_stiffness": on(3000, "N*m/rad")}}, FRAME),
    Case("the bench's frame yields, 8000 N·m/rad", {"effects": {"mount_stiffness": on(8000, "N*m/rad")}}, STIFF_FRAME),
]
JOINTS = [
    *(Case(f"backlash of {deg:g}°", {"joint": {"backlash": on(deg * 0.01745, "rad")}}) for deg in (0.05, 0.1)),
    *(Case(f"Coulomb friction, {size:g} N·m", {"joint": {"coulomb": on(size, "N*m")}}) for size in (1, 3)),
    Case("a spring that is 8 % stiffer at 6°", {"joint": {"stiffening": on(7.3, "1/rad^2")}}),
    Case("a spring that is 20 % stiffer at 6°", {"joint": {"stiffening": on(18.2, "1/rad^2")}}),
    Case(
        "motion with 2 % of second and 5 % of third harmonic",
        {"protocol": {"second_harmonic": on(0.02, "1"), "third_harmonic": on(0.05, "1")}},
    ),
    Case("motion that decays by 1 % in a second", {"protocol": {"decay": on(0.01, "1/s")}}),
]
PROTOCOLS = [
    Case("1 s of rest between frequencies", {"protocol": {"rest_between_s": 1.0}}),
    Case("every frequency starts as a cosine", {"protocol": {"start": "cosine"}}),
    Case("ramps of 1 s at both ends of a frequency", {"protocol": {"ramp_s": 1.0}}),
    Case("10 s per frequency instead of 20 cycles", {"protocol": {"cycles": None, "seconds": 10.0}}),
    Case("10, 15, 20, 25, 30 cycles", {"protocol": {"cycles": [10, 15, 20, 25, 30]}}),
    Case("frequencies 5, 4, 3, 2, 1 Hz", {"protocol": {"frequencies_hz": [5, 4, 3, 2, 1]}}),
    Case(
        "amplitudes 6, 2, 4°; frequencies 3, 1, 5, 2, 4 Hz",
        {"protocol": {"frequencies_hz": [3, 1, 5, 2, 4], "amplitudes_deg": [6, 2, 4]}},
    ),
    *(Case(f"protocol clock {ppm / 1e4:+g} %", {"protocol": {"clock_error": on(ppm, "ppm")}}) for ppm in (-5000, 5000)),
]
COMMON = [
    Case("none"),
    Case("true jitter, 20 µs", one(jitter=jitter(20e-6))),
    Case("host latency, 0.5 ms", one(latency=latency(5e-4))),
    Case("stamps with 4 decimals at 1024 Hz", at_rate(1024, one(decimals=on(4, "decimal")))),
    Case("two nodes, 0.3 ms apart", two({})),
    Case("1 sample missing", one(dropped=on(1e-6, "1"))),
]
"""Of the recorders, for the other experiments."""
DYNAMOMETER = [
    *COMMON,
    Case("encoder of 14 bits", {"effects": {"joint_encoder": on(14, "bit")}}),
    Case("torque 2 ms late", sensor("load_cell_torque", delay=on(2e-3, "s")), LATE),
    Case("torque × −1", sensor("load_cell_torque", gain=on(-1, "1"))),
    Case("angle × 57.3: degrees declared as radians", sensor("joint_angle", gain=on(57.29578, "1"))),
]
ACTUATOR = [
    *COMMON,
    Case("true jitter, 2 µs", one(jitter=jitter(2e-6))),
    Case("a Python loop at 500 Hz, 0.1 ms of scatter, steps of 6 ms", PYTHON_LOOP),
    Case("current × −1", sensor("motor_current", gain=on(-1, "1"))),
    Case("torque clipped at 5 N·m", sensor("output_torque", clipping=on(5, "N*m"))),
    Case("angle × 57.3: degrees declared as radians", sensor("actuator_angle", gain=on(57.29578, "1"))),
]
TABLES: dict[str, tuple[str, list[Case]]] = {
    "recorders": ("impedance", RECORDERS),
    "sensors": ("impedance", SENSOR_FAULTS),
    "joints": ("impedance", JOINTS),
    "protocols": ("impedance", PROTOCOLS),
    "belt": (
        "belt",
        [*DYNAMOMETER, Case("load cell clips at 30 N·m", sensor("load_cell_torque", clipping=on(30, "N*m")))],
    ),
    "transmission": ("transmission", DYNAMOMETER),
    "actuator": ("actuator", ACTUATOR),
}
"""Tables of the page: experiment and cases."""
