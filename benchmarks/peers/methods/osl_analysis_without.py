"""osl-analysis, corrected: where a fit is doubted, K, B and I with the cause in the model and their
range over all causes that explain the recording as well, as `impedance.csv` has them. Else as
`osl_analysis_fit`.

docs/bench_validation.md.
"""

from methods.osl_analysis_fit import answer, fitted

PACKAGES = ("osl-analysis",)


def estimate(t, theta, torque, person=0.0, **known):
    found, doubts = fitted(t, theta, torque, person)
    corrected = {
        f"{name}{end}": found[f"{name}_without{end}"]
        for name in "KBI"
        for end in ("", "_low", "_high")
        if doubts and found[f"{name}_without{end}"] is not None
    }
    return answer(found | corrected, doubts)
