"""What a simulated campaign and its analysis both use: the simulator follows the campaign's configuration in it."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.config.sheet import numbered_rows
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import Weight
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings

FOLLOWED = {
    "belt": ("parameters",),
    "transmission": ("parameters", "protocol"),
    "actuator": ("parameters",),
    "impedance": ("parameters", "protocol", "gain_weight"),
    "walking": ("parameters", "gain_weight", "impedance_trajectory"),
}
"""The shared choices that the simulated trials of each experiment use; the other experiments use none."""


class SharedChoices(Settings):
    """The choices of a configuration that replace those of its simulation. Null: the simulation's own."""

    parameters: Path | None = None  # Parameter file of the device.
    gain_weight: Weight | None = None  # W with which the simulated leg's gains are selected.
    protocol: dict[str, Any] | None = None  # The stepped sine, as fields of a simulated schedule.
    impedance_trajectory: Path | None = None  # The impedance that the leg is asked to render over the gait cycle.


SYNTHETIC = "synthetic"  # Kind of a trajectory that was made for a simulated leg.


@dataclass(frozen=True)
class ImpedanceTrajectory:
    """Desired impedance at the joint over the gait cycle."""

    phase: Array  # phase of the gait cycle, from 0 to 1, shape (n,)
    K_d: Array  # desired stiffness [N*m/rad], shape (n,)
    B_d: Array  # desired damping [N*m*s/rad], shape (n,)
    theta_eq: Array | None  # equilibrium angle [rad], shape (n,); None: it is computed from the nominal ankle moment
    kind: str | None = None  # what the file says of itself in a comment `# kind: synthetic`; None: it says nothing

    def at(self, values: Array, c: Array) -> Array:
        """One of the columns at cycle phases c of any cycle, by linear interpolation."""
        return np.interp(np.mod(c, 1.0), self.phase, values)


def read_impedance_trajectory(path: Path) -> ImpedanceTrajectory:
    """Read a CSV table with columns phase, K_d [N*m/rad], B_d [N*m*s/rad] and, optionally, theta_eq_rad [rad].
    Lines that begin with `#` are comments. One of them, `# kind: synthetic`, may say what the trajectory is."""
    if not path.is_file():
        remedy = "correct its path in the configuration or the walking settings"
        raise InputError(f"{path}: no such impedance trajectory; {remedy}")
    rows = [row for _, row in numbered_rows(path)]
    names = [name.strip() for name in rows[0]] if rows else []
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"{path}: column '{twice}' stands twice; rename or remove one")
    required = ("phase", "K_d", "B_d")
    absent = [name for name in required if name not in names]
    if absent or len(rows) < 3:
        problem = f"no column '{absent[0]}'" if absent else "fewer than two rows"
        raise InputError(f"{path}: {problem}; it needs a header with {', '.join(required)} and a row per phase")
    try:
        columns = dict(zip(names, np.array(rows[1:], dtype=float).T, strict=True))
    except ValueError as error:
        raise InputError(f"{path}: not a table of numbers ({error}); write one number per column") from error
    for name, column in columns.items():
        if (wrong := column[~np.isfinite(column)]).size:
            raise InputError(f"{path}: column {name} holds {wrong[0]}; write a number in every row")
    phase = columns["phase"]
    if phase[0] != 0 or phase[-1] != 1 or not (np.diff(phase) > 0).all():
        raise InputError(f"{path}: column phase runs from {phase[0]:g} to {phase[-1]:g}; it must rise from 0 to 1")
    kind = re.search(r"^#\s*kind:\s*(\S.*?)\s*$", path.read_text(encoding="utf-8"), re.MULTILINE)
    theta_eq = columns.get("theta_eq_rad")
    return ImpedanceTrajectory(phase, columns["K_d"], columns["B_d"], theta_eq, kind[1] if kind else None)
