"""osl-analysis as its doubt says: where the first doubt has K, B and I without its cause, these,
with their range.

docs/bench_validation.md. The range is over all causes that explain the recording as well. Else as
`osl_analysis_fit`.
"""

from methods.osl_analysis_fit import answer, fitted


def estimate(t, theta, torque, person=0.0, **known):
    found, doubts = fitted(t, theta, torque, person)
    return answer(found | doubts[0].without if doubts else found, doubts)
