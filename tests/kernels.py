"""Kernels of OpenBLAS differ by processor in rounding: an exact fit leaves 1e-16 with one and may
leave 0 with another. `make test-kernels` runs the tests of `NUMERICAL` with those of two other
processors, which run on any recent x86."""

import ctypes
import re
from pathlib import Path

import numpy as np
import scipy.linalg

NUMERICAL = (
    "test_bench_[abdeimnprst]*", "test_degenerate", "test_drivetrain", "test_kernels",
    "test_signals", "test_spectral*", "test_stats_re*",
    "test_walking_bodies", "test_walking_response",
    "test_walking_plate*", "test_walking_response",
)  # fmt: skip
"""Modules of tests, as patterns, whose results are floating-point numbers of fits. They have the
marker `numerics`.

Long simulations of coverage are not among them: two more runs take three minutes at most."""
NAMES = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename", "openblas_get_corename")


def loaded_kernels() -> dict[str, str]:
    """The kernel that each OpenBLAS in this process has taken, by library; empty where another
    library is used."""
    # both libraries are loaded now
    product = scipy.linalg.blas.dgemm(1.0, np.eye(2), np.eye(2)) @ np.eye(2)
    assert product.shape == (2, 2)
    maps = Path("/proc/self/maps")
    found = re.findall(r"/\S*openblas\S*", maps.read_text()) if maps.is_file() else []
    return {Path(path).name: kernel for path in dict.fromkeys(found) if (kernel := kernel_of(path))}


def kernel_of(path: str) -> str | None:
    """What one library says that it has taken; None if it does not say."""
    library = ctypes.CDLL(path)
    for name in NAMES:
        if hasattr(library, name):
            asked = getattr(library, name)
            asked.restype = ctypes.c_char_p
            return str(asked().decode())
    return None


if __name__ == "__main__":
    print(
        "kernels:",
        loaded_kernels() or "not OpenBLAS, or it does not say; OPENBLAS_CORETYPE does nothing here",
    )
