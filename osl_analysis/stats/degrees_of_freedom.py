"""Degrees of freedom of a variance that is a sum of variances."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from osl_analysis.trial import Array


def welch_satterthwaite(variances: Sequence[ArrayLike], freedoms: ArrayLike) -> Array:
    """Degrees of freedom of the sum of k independent variances (k, ...), each known with `freedoms` (k,).

    Satterthwaite, Biometrics Bulletin 2, 1946; Welch, Biometrika 34, 1947. Infinite where there is no variance at all.
    """
    found = np.asarray(variances, dtype=float)
    worth = np.tensordot(1 / np.asarray(freedoms, dtype=float), found**2, axes=1)
    total = np.sum(found, axis=0) ** 2
    return np.asarray(np.divide(total, worth, out=np.full_like(total, np.inf), where=worth > 0))
