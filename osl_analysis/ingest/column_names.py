"""What the name of a column in a log tells about it: whether it is the clock, its likely unit, a pattern for it."""

import re
from collections.abc import Sequence

from osl_analysis.formats.csv_table import places_of
from osl_analysis.formats.csv_text import name_and_unit

CLOCKS = (
    "time", "t", "timestamp", "stamp", "state_time", "loop_time", "pi_time", "sys_time", "ros_time", "elapsed",
    "elapsed_time", "clock", "seconds", "time_since_start",
)  # fmt: skip
"""How loggers call their time, without a unit behind it."""
ENDINGS = {
    "deg": "deg", "rad": "rad", "rev": "rev", "rpm": "rpm", "deg_s": "deg/s", "deg_per_s": "deg/s", "rad_s": "rad/s",
    "rad_per_s": "rad/s", "Nm": "Nm", "N": "N", "A": "A", "mA": "mA", "V": "V", "mV": "mV", "s": "s", "sec": "s",
    "ms": "ms", "us": "us", "ns": "ns", "Hz": "Hz", "mm": "mm",
}  # fmt: skip
"""Unit that a name may end with, as in `torque_Nm`. `_m` is none: `theta_m` is the motor's angle."""
ADDRESS = re.compile(r"<[^<>]* object at 0x[0-9a-fA-F]+>")
"""How Python prints an object without a name; the number changes from run to run."""


def likely_unit(name: str) -> str:
    """The unit that the end of a column's name tells, as `deg` in `ankle_deg`; empty if it tells none."""
    endings = sorted((end for end in ENDINGS if name.endswith(f"_{end}")), key=len)
    return ENDINGS[endings[-1]] if endings else ""


def is_clock(title: str) -> bool:
    """Whether a column is called like a clock: `time`, `t_s`, `loop_time [ms]`."""
    name = name_and_unit(title)[0].strip()
    plain = re.sub(r"_(s|sec|ms|us|ns)$", "", name)
    return name.casefold() in CLOCKS or plain.casefold() in CLOCKS


def clocks_among(paths: Sequence[str]) -> list[str]:
    """Those of several dotted paths whose last name is that of a clock, each once, the shortest way first."""
    shortest_first = sorted(dict.fromkeys(paths), key=lambda path: path.count("."))
    return [path for path in shortest_first if is_clock(path.rpartition(".")[2])]


def lasting_name(name: str, names: Sequence[str]) -> str:
    """A name for a source file that also fits the next recording of the same logger.

    A pattern in place of an object's address in memory, where only this column of the file fits it; else the name.
    """
    pattern = ADDRESS.sub("*", name)
    return pattern if pattern != name and len(places_of(pattern, names)) == 1 else name
