"""From the recordings of a powered prosthesis to its stiffness, damping and inertia.

Data flow one way: recording (`formats`, `ingest`) -> trial -> fit (`bench`, `walking`) -> table ->
figure (`figures`).

For notebooks and scripts that need no workflow (docs/notebook.md):

    import osl_analysis as osl

    trial = osl.read_recording("log.mcap", "my_bench.yaml")
    fit = osl.fit_impedance(trial)
    osl.plot_torque(fit)

The names of `__all__` are all that there is to use; the other modules may change. They stand in
`notebook`."""

# ruff: noqa: F405

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from osl_analysis.bench.impedance import DesiredImpedance
    from osl_analysis.commands.fit import Fit
    from osl_analysis.errors import (
        IdentifiabilityError,
        InputError,
        OslAnalysisError,
        UnreachableImpedanceError,
    )
    from osl_analysis.notebook import *  # noqa: F403
    from osl_analysis.trial import Trial

__all__ = [
    "DesiredImpedance", "Fit", "IdentifiabilityError", "InputError", "OslAnalysisError", "Response",
    "Trial",
    "UnreachableImpedanceError", "check", "fit_actuator", "fit_belt", "fit_impedance",
    "fit_torque_angle",
    "fit_transmission", "frequency_response", "plot_frequency_response", "plot_torque",
    "plot_torque_angle",
    "read_recording", "read_summary", "read_table", "read_trial", "simulate_trial", "to_pandas",
]  # fmt: skip

HOMES = {
    **dict.fromkeys(("Trial", "read_trial"), "trial"),
    **dict.fromkeys(("read_table", "to_pandas"), "table"),
}
"""Modules of public names that can be imported without the fits."""


def __getattr__(name: str) -> Any:
    """A public name, imported at its first use: so the command line, which imports this package,
    starts at once."""
    if name not in __all__:
        raise AttributeError(f"module 'osl_analysis' has no attribute '{name}'")
    home = "errors" if name.endswith("Error") else HOMES.get(name, "notebook")
    return getattr(import_module(f"osl_analysis.{home}"), name)


def __dir__() -> list[str]:
    """The public names, and the modules that are imported."""
    return sorted({*globals(), *__all__})
