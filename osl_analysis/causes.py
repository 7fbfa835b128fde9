"""Likely causes of numbers that cannot be right, in words, with the remedy: for refusals and for doubtful fits."""

import math
from collections.abc import Callable

FACTORS: dict[str, float] = {
    "between peak and RMS current": math.sqrt(2),
    "between lbf*ft and N*m": 1.3558,
    "between lbf and N": 4.4482,
    "between lbf*in and N*m": 8.8507,
    "between kgf*m and N*m": 9.8067,
    "between degrees and radians": 180 / math.pi,
    "between N*cm and N*m": 100.0,
    "between N*mm and N*m, or mA and A": 1000.0,
}
"""Factors between units that are often taken for one another."""
NEAR = 0.08
"""Largest relative distance of a ratio from a factor, or from its inverse, that names the factor as the cause."""


def wrong_scale(ratio: float) -> str:
    """What may make a number `ratio` times too large: the factor between two units, or else where to look."""
    size = max(abs(ratio), 1 / abs(ratio)) if ratio else math.inf
    name = min(FACTORS, key=lambda known: abs(math.log(size / FACTORS[known])) if math.isfinite(size) else math.inf)
    if math.isfinite(size) and abs(size / FACTORS[name] - 1) < NEAR:
        return f"{FACTORS[name]:.3g} is the factor {name}: correct the `unit` or the `scale` in the source file"
    return "check unit and scale of the channels in the source file"


def too_far(symbol: str, reference: str) -> Callable[[float], str]:
    """The words for an estimate of `symbol` that is far from its `reference`, by their ratio."""
    return lambda ratio: f"{symbol} is {ratio:.3g} times {reference}, {wrong_scale(ratio)}"


FROM_FILE = "that of the parameter file"
LATE = (
    "the torque is late, or the angle is where it is negative: state `delay` or `low_pass` of the channel in the "
    "source file, as in `delay: 2 ms` or `low_pass: {cutoff: 100 Hz, order: 1}`"
)


def changing(symbol: str, rising: str, falling: str) -> Callable[[float], str]:
    """The words for an estimate that changes with the amplitude, by its relative change."""

    def words(change: float) -> str:
        way, cause = ("rises", rising) if change > 0 else ("falls", falling)
        return (
            f"{symbol} {way} by {100 * abs(change):.0f} % from the smallest to the largest amplitude: {cause}, use the "
            "rows of single amplitudes"
        )

    return words


REMEDIES: dict[str, str | Callable[[float], str]] = {
    "K_ratio": too_far("K", "what K_d and the controller should give"),
    "K_over_K_s": too_far("K", "the belt's K_s"),
    "K_s_ratio": too_far("K_s", FROM_FILE),
    "B_j_ratio": too_far("B_j", FROM_FILE),
    "J_j_ratio": too_far("J_j", FROM_FILE),
    "k_tau_n_m_ratio": too_far("k_tau n_m", FROM_FILE),
    "J_m_ratio": too_far("J_m", FROM_FILE),
    "f_C_ratio": too_far("f_C", FROM_FILE),
    "f_G_ratio": too_far("f_G", FROM_FILE),
    "B_m_ratio": too_far("B_m", FROM_FILE),
    "saturated_samples": "a torque, angle or current is clipped, it stands at an end of its sensor's range, see the "
    "quality check `saturation`: use a sensor of larger range",
    "lag_share": LATE,
    "certain_lag_damping": LATE,
    "K_change": changing("K", "a spring that stiffens, or backlash", "friction, or a spring that softens"),
    "B_change": changing("B", "damping that grows with the velocity", "friction"),
    "coulomb_share": "this share of B is Coulomb friction and not damping",
    "stiffening": "the spring stiffens by this share up to the largest amplitude, or softens if it is negative",
    "backlash_share": "this share of K is lost to backlash, the play between joint and bench",
}
"""By column of a result table: what a number beyond its limit means, and what to do; as words, or as a function of the
number. No text contains a semicolon, which separates the reasons."""


def remedy(column: str, value: float) -> str:
    """What a number beyond its limit means, in brackets after a blank; empty where the column says it all."""
    words = REMEDIES.get(column, "")
    text = words if isinstance(words, str) else words(value)
    return f" ({text})" if text else ""
