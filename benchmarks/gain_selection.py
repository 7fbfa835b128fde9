"""Time of the gain selection for 10 000 pairs at once, compared with a bounded search of one pair
after the other.

    python benchmarks/gain_selection.py

One core, times of the processor; the ratio is the claim. The difference is that of B_m + B_1,
relative.
"""

import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize_scalar
from scipy.signal import butter, tf2ss

from osl_analysis.model.compensator import PAPER_WEIGHT, optimal_damping, stiffness_gain
from osl_analysis.model.drivetrain import DrivetrainParameters, joint_admittance, read_parameters
from osl_analysis.trial import Array

MANY, FEW = 10_000, 20


def lyapunov_norm(K_d: float, B_d: float, B_1: float, p: DrivetrainParameters) -> float:
    """The norm of Eq. 14 as a control engineer's script computes it: a realisation and its
    Gramian."""
    Y = joint_admittance(float(stiffness_gain(K_d, p)), B_1, p)
    b, a = butter(PAPER_WEIGHT.order, 2 * np.pi * PAPER_WEIGHT.cutoff_hz, analog=True)
    Q = [B_d, K_d]
    numerator = np.polymul(b, np.polysub(np.polymul(Y.numerator, Q), Y.denominator))
    A, B, C, _ = tf2ss(numerator, np.polymul(np.polymul(Y.denominator, Q), a))
    gramian = solve_continuous_lyapunov(A, -B @ B.T)
    squared = float((C @ gramian @ C.T)[0, 0])
    return squared**0.5 if squared > 0 else float("inf")


def bounded_search(K_d: float, B_d: float, p: DrivetrainParameters) -> float:
    """B_1 by Brent's bounded search over log(B_m + B_1)."""
    found = minimize_scalar(
        lambda u: lyapunov_norm(K_d, B_d, np.exp(u) - p.B_m, p),
        bounds=np.log([1e-4, 1e4]),
        method="bounded",
    )
    return float(np.exp(found.x) - p.B_m)


def timed(work: Callable[[], Array]) -> tuple[float, Array]:
    started = time.process_time()
    result = work()
    return time.process_time() - started, result


def main() -> None:
    warnings.simplefilter("ignore")  # the Lyapunov solver's, far from the minimum
    p = read_parameters(Path("config/parameters/default.yaml"))
    rng = np.random.default_rng(1)
    K_d, B_d = rng.uniform(20, 600, MANY), rng.uniform(0.5, 20, MANY)
    optimal_damping(K_d[:10], B_d[:10], p, PAPER_WEIGHT)
    ours, found = timed(lambda: optimal_damping(K_d, B_d, p, PAPER_WEIGHT)["B_1"])
    few = zip(K_d[:FEW], B_d[:FEW], strict=True)
    theirs, searched = timed(lambda: np.array([bounded_search(k, b, p) for k, b in few]))
    difference = np.max(np.abs((searched + p.B_m) / (found[:FEW] + p.B_m) - 1))
    print(f"10 000 pairs at once: {ours:.2f} s, {MANY / ours:,.0f} pairs per second")
    print(
        f"bounded search, Lyapunov: {FEW / theirs:,.0f} pairs per second, ratio"
        f" {theirs / FEW / ours * MANY:.0f}"
    )
    print(f"largest difference of B_m + B_1: {difference:.1e}")


if __name__ == "__main__":
    main()
