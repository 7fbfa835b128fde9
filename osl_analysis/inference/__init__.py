# SPDX-License-Identifier: Apache-2.0
"""What may be wrong with a bench recording: candidate torque models, weighed by prediction. What a
successor needs:

**Question.** Which fault or property, if any, is in this torque, how probable is it, and by how
much would it change K, B and I? `bench/budgets.py` makes rows of the budget of the answer,
`bench/friction.py` takes friction off B where it is certain. Nothing here decides a verdict.

**Equation.** A candidate model is Eq. 15 with other or further columns x, beside offset, drift and,
perhaps, dry friction, in torque and columns whose noise is white:

    torque = K x_1 + B x_2 + I x_3 + further columns + offset and drift (+ friction) + noise
    weight = prior exp(gain/temperature), the mean over a Bayesian bootstrap of 24 blocks
    gain   = log-likelihood of each block by the fit to the others, over the best sound joint's

| file, in order | does |
|---|---|
| `spectra` | angle and torque in the band of the motion, at two rates |
| `whitening` | the noise becomes white by what a model richer than any candidate model leaves |
| `candidate_models` | the candidate models as one table, and how each is fitted |
| `rounding_errors` | what rounding of the angle alone would do |
| `weighing` | predictions and priors give weights |
| `actuator` | a leg's actuator without its friction |

**Evidence for each choice** (`benchmarks/causes.py`, its table in docs/bench_validation.md; "before
1.0" was measured once, before the first release, on 239 planted, 159 sound and 18 human-like
recordings that are not in the repository; "a choice" was not varied):

* *Prediction, not fit*: of 219 sound recordings of 15 kinds none is accused of a fault.
* *Families and priors* (`PRIOR_SOUND`): before 1.0, 0.9, 0.98 and 0.995 accuse 1, 1 and 0 of 159
  sound files, and 22, 25 and 26 faults stay silent. `benchmarks/weights.py` fits them on one half.
* *A mechanism misses a fifth of its own torque* (`INEXACTNESS`): before 1.0, with 0 and 0.2, 69 and
  85 % of I's ranges hold under a fault; 0.4 names a quarter.
* *Rounding lowers the gain* by drawn zeros and sizes: of 384 frictionless slow sines of 12 and 14
  bits 19 have friction without other sizes, 10 with them.
* *One screen by all columns at once*: where they gain less than chance, no candidate model is
  tried. A sound fit takes 0.22 s for 0.55 s, and K moves by 1.6e-5.
* *Leverage in the noise's spectrum*: without it 34 columns leave a quarter less noise near the
  motion than far from it in 15 s; with it the ratio is 0.9 to 1.2 (`tests/inference`).
* *Friction of a leg by its sliding actuator*: B of 16 uncompensated legs is off by 0.012 to 0.037
  N*m*s/rad (RMS) above 0.05 to 0.2 SD of the speed.

**Tried and dropped.** Residuals named by their shape, a threshold each (122 rules that did not know
the interval). Rounding as random effects (a dozen draws are fitted away). Jerk and snap as a screen
of paths, a least gain before a search, the scatter of scores in the covariance, a second noise for
faults: without them 22 planted faults of 45 are named for 23 (clipping, backlash, hardening, moving
average, steps of K; `causes.py --quick`), and two of backlash fewer are called unexplained.

**Not solved.** A reflex reads as a late torque. A low-pass behind steps, a gain of all torques and
gravity that turns with the joint leave nothing that a candidate model could predict: only a
calibration tells. Friction at one speed is damping.
"""

from osl_analysis.inference.actuator import FrictionlessActuator, frictionless_actuator
from osl_analysis.inference.candidate_models import Family
from osl_analysis.inference.model_names import ModelName
from osl_analysis.inference.spectra import BenchSignals
from osl_analysis.inference.weighing import ImpedanceInference, infer_impedance

__all__ = [
    "BenchSignals",
    "Family",
    "FrictionlessActuator",
    "ImpedanceInference",
    "ModelName",
    "frictionless_actuator",
    "infer_impedance",
]
