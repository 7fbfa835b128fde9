# SPDX-License-Identifier: Apache-2.0
"""One inference for a bench recording: rival torque models, weighed by prediction.

It says what may be wrong with the recording of a whole trial of a joint, and whether friction is
certain; `bench/friction.py` calls it.

Read `infer.py` first; it names the other modules in their order. Equations stand where they are
computed, and every number that decides in `constants.py`.
"""

from osl_analysis.inference.actuator import FrictionlessActuator, frictionless_actuator
from osl_analysis.inference.infer import ImpedanceInference, infer_impedance
from osl_analysis.inference.spectra import BenchSignals

__all__ = [
    "BenchSignals",
    "FrictionlessActuator",
    "ImpedanceInference",
    "frictionless_actuator",
    "infer_impedance",
]
