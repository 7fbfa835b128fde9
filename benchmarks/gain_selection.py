"""Time and error of the exact gain selection, compared with a bounded search and plain gradient descent.

    python benchmarks/gain_selection.py

One run, one core, times of the processor; the ratios are the claim. The error is that of B_m + B_1, relative, against
the minimum that `certify` locates in rational arithmetic.
"""

import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize_scalar
from scipy.signal import butter, tf2ss

from osl_analysis.model.certificate import certify
from osl_analysis.model.compensator import PAPER_WEIGHT, stiffness_gain
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.gain_selection import optimal_damping
from osl_analysis.parameters import DrivetrainParameters, read_parameters
from osl_analysis.trial import Array

MANY, FEW, PROVED = 10_000, 20, 20
DESCENT_STEPS, DIFFERENCE = 200, 1e-5


def lyapunov_norm(K_d: float, B_d: float, B_1: float, p: DrivetrainParameters) -> float:
    """The norm of Eq. 14 as a control engineer's script computes it: a realisation and its Gramian."""
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
        lambda u: lyapunov_norm(K_d, B_d, np.exp(u) - p.B_m, p), bounds=np.log([1e-4, 1e4]), method="bounded"
    )
    return float(np.exp(found.x) - p.B_m)


def gradient_descent(K_d: float, B_d: float, p: DrivetrainParameters) -> float:
    """B_1 by steps down the numerical slope of the logarithm of the norm, halved where a step goes up."""
    u, rate = np.log(0.1), 0.5
    here = np.log(lyapunov_norm(K_d, B_d, np.exp(u) - p.B_m, p))
    for _ in range(DESCENT_STEPS):
        ahead = np.log(lyapunov_norm(K_d, B_d, np.exp(u + DIFFERENCE) - p.B_m, p))
        step = -rate * (ahead - here) / DIFFERENCE
        value = np.log(lyapunov_norm(K_d, B_d, np.exp(u + step) - p.B_m, p))
        if value < here:
            u, here, rate = u + step, value, rate * 1.2
        else:
            rate /= 2
        if abs(step) < 1e-10:
            break
    return float(np.exp(u) - p.B_m)


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
    pairs = list(zip(K_d[:FEW], B_d[:FEW], strict=True))
    exact = np.array([certify(k, b, p, PAPER_WEIGHT).minima[0] for k, b in pairs[:PROVED]])
    runs = {
        "exact, 10 000 at once": (MANY, lambda: optimal_damping(K_d, B_d, p, PAPER_WEIGHT).B_1),
        "bounded search, Lyapunov": (FEW, lambda: np.array([bounded_search(k, b, p) for k, b in pairs])),
        "gradient descent, Lyapunov": (FEW, lambda: np.array([gradient_descent(k, b, p) for k, b in pairs])),
    }
    reference = 0.0
    print(f"{'method':<30}{'pairs per s':>14}{'ratio':>9}{'worst error':>14}")
    for name, (count, work) in runs.items():
        seconds, found = min((timed(work) for _ in range(5 if count == MANY else 1)), key=lambda run: run[0])
        per_pair = seconds / count
        reference = reference or per_pair
        error = np.max(np.abs((found[:PROVED] + p.B_m) / (exact + p.B_m) - 1))
        print(f"{name:<30}{1 / per_pair:>14,.0f}{per_pair / reference:>9.0f}{error:>14.1e}")


if __name__ == "__main__":
    main()
