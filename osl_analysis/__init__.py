# SPDX-License-Identifier: Apache-2.0
"""From the recordings of a powered prosthesis to its stiffness, damping and inertia.

Data flow one way: recording (`formats`, `ingest`) -> trial -> fit (`bench`, `walking`) -> table ->
figure (`figures`).

For notebooks and scripts that need no workflow (docs/notebook.md):

    import osl_analysis as osl

    trial = osl.read_recording("log.mcap", "my_bench.yaml")
    fit = osl.fit(trial)
    osl.plot_torque(fit)

The names of `__all__` are all that there is to use; the other modules may change.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from osl_analysis.base.errors import (
        IdentifiabilityError,
        InputError,
        OslAnalysisError,
        UnreachableImpedanceError,
    )
    from osl_analysis.base.result_table import read_table
    from osl_analysis.base.table import to_pandas
    from osl_analysis.base.trial import Trial, read_trial
    from osl_analysis.bench.evidence import DesiredImpedance
    from osl_analysis.commands.fit_results import Fit
    from osl_analysis.judge.findings import Finding
    from osl_analysis.notebook import (
        FrequencyResponse,
        check,
        fit,
        frequency_response,
        plot_figure,
        plot_frequency_response,
        plot_torque,
        plot_torque_angle,
        read_recording,
        read_summary,
        simulate_trial,
    )

__all__ = [
    "DesiredImpedance", "Finding", "Fit", "FrequencyResponse", "IdentifiabilityError", "InputError",
    "OslAnalysisError", "Trial", "UnreachableImpedanceError", "check", "fit", "frequency_response",
    "plot_figure", "plot_frequency_response", "plot_torque", "plot_torque_angle", "read_recording",
    "read_summary", "read_table", "read_trial", "simulate_trial", "to_pandas",
]  # fmt: skip

MODULES = {
    "DesiredImpedance": "bench.evidence",
    "Finding": "judge.findings",
    "Fit": "commands.fit_results",
    **dict.fromkeys(
        (
            "IdentifiabilityError", "InputError", "OslAnalysisError", "UnreachableImpedanceError",
        ),
        "base.errors",
    ),
    **dict.fromkeys(
        (
            "FrequencyResponse", "check", "fit", "frequency_response", "plot_figure",
            "plot_frequency_response", "plot_torque", "plot_torque_angle", "read_recording",
            "read_summary", "simulate_trial",
        ),
        "notebook",
    ),
    "read_table": "base.result_table",
    "to_pandas": "base.table",
    **dict.fromkeys(("Trial", "read_trial"), "base.trial"),
}  # fmt: skip
"""Module of each public name."""

if not TYPE_CHECKING:  # so that a type checker knows the names, and no others

    def __getattr__(name):
        """A public name, imported at its first use: so the command line, which imports this
        package, starts at once."""
        if name not in MODULES:
            raise AttributeError(f"module 'osl_analysis' has no attribute '{name}'")
        public = getattr(import_module(f"osl_analysis.{MODULES[name]}"), name)
        globals()[name] = public  # which is found there from now on
        return public


def __dir__() -> list[str]:
    """The public names, and the modules that are imported."""
    return sorted({*globals(), *__all__})
