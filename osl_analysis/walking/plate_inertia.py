"""The force plate's own inertia identified on a plate that moves unloaded, then removed from every wrench.

The wrench that the plate itself causes in its sensors is linear in the plate's inertial parameters. In axes that turn
with the plate, after the zero has removed the weight at rest,

    F = m a' + z x mc + w x (w x mc),    M = mc x a' + I z + w x I w,    a' = R^T (a - g) + g,

where m is the mass, mc mass times centre of mass, I the inertia about the plate's centre, a the acceleration of that
centre, w the angular velocity and z the angular acceleration.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.stats.regression import linear_fit
from osl_analysis.trial import Array
from osl_analysis.walking.cluster import GRAVITY, BodyMotion
from osl_analysis.walking.plate import PlateWrench

PARAMETERS = ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_yy", "I_zz", "I_xy", "I_xz", "I_yz")
COMPONENTS = ("F_x", "F_y", "F_z", "M_x", "M_y", "M_z")
PLANAR = ("m", "mc_x", "mc_z", "I_yy")
"""Parameters that can be identified if the platform only turns about the mediolateral axis and shifts across it."""
EXCITED = 0.02
"""An axis counts as excited if its RMS angular acceleration is at least this fraction of the largest one. Motion along
its few directions leaves less than 0.005 of it about an axis that does not turn."""
LEVER = 0.1
"""Weight [m] of forces relative to moments: about the height of the ankle, which is a force's lever about the ankle."""
WEIGHT = np.array([LEVER] * 3 + [1.0] * 3)
"""Weights (6,) [m, 1] of forces and moments."""
LARGEST_NOISE_SHARE = 0.5
"""Largest share of noise in the columns' squares that is corrected."""


@dataclass(frozen=True)
class PlateInertia:
    """Inertial parameters of the plate.

    parameters: (10,) in the order of `PARAMETERS` [kg, kg*m, kg*m^2]; 0 where they were not excited.
    standard_errors: (10,) in the same units; 0 where they were not excited.
    rms_before: RMS wrench (6,) [N, N*m] of the unloaded plate as read, minus its mean.
    rms_after: the same after the plate's own wrench is removed.
    """

    parameters: Array
    standard_errors: Array
    rms_before: Array
    rms_after: Array

    @property
    def identified(self) -> tuple[str, ...]:
        """Names of the parameters that the recordings excited."""
        return tuple(name for name, se in zip(PARAMETERS, self.standard_errors, strict=True) if se > 0)

    def wrench(self, motion: BodyMotion) -> PlateWrench:
        """Wrench that the plate itself causes in n frames, in its own axes and about its centre, the point of
        `motion`."""
        own = regressors(motion) @ self.parameters
        return PlateWrench(own[:, :3], own[:, 3:])


def regressors(motion: BodyMotion) -> Array:
    """Columns (n, 6, 10) whose product with the parameters is force and moment [N, N*m] in the plate's axes."""
    in_plate = motion.rotation.transpose(0, 2, 1)
    a, w, z = (
        np.einsum("nij,nj->ni", in_plate, v) for v in (motion.acceleration - GRAVITY, motion.omega, motion.alpha)
    )
    a = a + GRAVITY
    W = cross_matrix(w)
    columns = np.zeros((len(a), 6, 10))
    columns[:, :3, 0] = a
    columns[:, :3, 1:4] = cross_matrix(z) + W @ W
    columns[:, 3:, 1:4] = -cross_matrix(a)
    columns[:, 3:, 4:] = inertia_matrix(z) + W @ inertia_matrix(w)
    return columns


def cross_matrix(v: Array) -> Array:
    """Matrices (n, 3, 3) whose product with a vector is the cross product of v (n, 3) with it."""
    zero = np.zeros(len(v))
    rows = [[zero, -v[:, 2], v[:, 1]], [v[:, 2], zero, -v[:, 0]], [-v[:, 1], v[:, 0], zero]]
    return np.moveaxis(np.array(rows), 2, 0)


def inertia_matrix(v: Array) -> Array:
    """Matrices (n, 3, 6) that map (I_xx, I_yy, I_zz, I_xy, I_xz, I_yz) to I v, for v (n, 3)."""
    x, y, z = v.T
    zero = np.zeros(len(v))
    rows = [[x, zero, zero, y, z, zero], [zero, y, zero, x, zero, z], [zero, zero, z, zero, x, y]]
    return np.moveaxis(np.array(rows), 2, 0)


def unfiltered(values: Array) -> Array:
    """The values unchanged: the default of `smooth`, without a low-pass."""
    return values


def identify_plate_inertia(
    recordings: Sequence[tuple[BodyMotion, PlateWrench]],
    smooth: Callable[[Array], Array] = unfiltered,
    names: tuple[str, ...] | None = None,
    noise: Array | None = None,
    known: Array | None = None,
) -> PlateInertia:
    """Parameters from unloaded recordings: motion of the plate's centre, and wrench in the plate's axes.

    `smooth` is the low-pass that the wrench passed and the motion did not. It is applied to the columns, which are
    products of motions, because the low-pass of a product is not the product of low-passes. With filtered motions
    instead, a filter of 8 Hz would make the plate's lag 0.05 ms too small. The mean of each recording is removed,
    because each has its own zero. Moments of inertia about axes that are not excited are 0. If the remaining parameters
    cannot be told apart, or some are seen with more noise than motion, only the four planar ones are identified.
    `names` are those that may be identified, all if None or empty (as an exact fit, without errors, names).
    The others are as in `known` (10,), 0 if None.

    `noise` (10, 10) is the sum of squares that marker noise alone causes in the columns. It is
    subtracted from theirs, because least squares with noise in its columns makes every estimate too small.

    Raises
    ------
    InputError, IdentifiabilityError
        No recordings, or not even the planar parameters can be told apart.
    """
    if not recordings:
        raise InputError("no recordings of the unloaded plate; add trials of experiment 'plate' to the sheet")
    columns = np.concatenate([centred(smooth(regressors(motion))) for motion, _ in recordings])
    wrench = np.concatenate([centred(w.components()) for _, w in recordings])
    excited = excited_parameters([motion for motion, _ in recordings])
    wanted = tuple(name for name in excited if not names or name in names)
    held = np.zeros(len(PARAMETERS)) if known is None else known
    parameters, errors = fit_parameters(columns, wrench, wanted, noise, held)
    return PlateInertia(parameters, errors, rms(wrench), rms(wrench - columns @ parameters))


def fit_parameters(
    columns: Array, wrench: Array, names: tuple[str, ...], noise: Array | None, held: Array
) -> tuple[Array, Array]:
    """Parameters and standard errors (10,) from wrenches (n, 6) and the named ones of the columns (n, 6, 10).

    The others are `held` (10,), with errors of 0. If the named ones look alike, or are noise, use only the planar ones.
    """
    chosen = [PARAMETERS.index(name) for name in names]
    parameters, errors = held.copy(), np.zeros(len(PARAMETERS))
    parameters[chosen] = 0.0
    left = wrench - columns @ parameters
    try:
        fit = linear_fit((left * WEIGHT).T.ravel(), dict(zip(names, stacked_columns(columns, names).T, strict=True)))
        correction = np.eye(len(chosen)) if noise is None else noise_correction(columns, noise, names)
    except IdentifiabilityError:
        if names == PLANAR:
            raise
        return fit_parameters(columns, wrench, PLANAR, noise, held)
    parameters[chosen] = correction @ fit.estimates
    errors[chosen] = np.sqrt(np.diag(correction @ fit.covariance @ correction.T))
    return parameters, errors


def noise_squares(motion: BodyMotion, resting: Sequence[slice]) -> Array:
    """Mean weighted square (10, 10), per frame, that marker noise causes in the columns before `smooth`.

    `motion` is that of a platform as measured. It shows nothing but noise in the runs of frames in which it is
    `resting`. After `smooth`, which is far slower, the columns of such frames would hold the motions beside them too.
    """
    columns = regressors(motion)
    still = [stacked_columns(centred(columns[run]), PARAMETERS) for run in resting]
    count = sum(run.stop - run.start for run in resting)
    return np.asarray(sum((one.T @ one for one in still), np.zeros((10, 10))) / max(count, 1))


def noise_correction(columns: Array, noise: Array, names: Sequence[str]) -> Array:
    """The matrix (p, p) that turns least-squares estimates into those without the bias from noise in the columns.

    With the columns' squares G, of which N are noise, it is (G - N)^-1 G (Fuller, Measurement Error Models, 1987, 1.4).

    Raises
    ------
    IdentifiabilityError
        Some combination of the parameters is seen with more noise than motion.
    """
    chosen = [PARAMETERS.index(name) for name in names]
    stacked, own = stacked_columns(columns, names), noise[np.ix_(chosen, chosen)]
    squares = stacked.T @ stacked
    share = np.linalg.eigvals(np.linalg.solve(squares, own)).real.max()
    if share > LARGEST_NOISE_SHARE:
        raise IdentifiabilityError(
            f"marker noise is {share:.0%} of what moves the unloaded plate in one of its directions, expected "
            f"{LARGEST_NOISE_SHARE:.0%} or less; record larger or faster motions of the unloaded plate"
        )
    return np.asarray(np.linalg.solve(squares - own, squares))


def stacked_columns(columns: Array, names: Sequence[str]) -> Array:
    """Weighted columns (6 n, p) of the named parameters out of (n, 6, 10).

    Component after component: residuals stay correlated in time, as the regression assumes.
    """
    chosen = columns[:, :, [PARAMETERS.index(name) for name in names]] * WEIGHT[:, None]
    return np.asarray(chosen.transpose(1, 0, 2).reshape(-1, len(names)))


def excited_parameters(motions: Sequence[BodyMotion]) -> tuple[str, ...]:
    """Parameters that motions excite: mass, its moments, and the inertias of axes that turn by more than noise.

    An axis counts if its RMS angular acceleration is above a fiftieth of the largest.
    """
    size = rms(np.concatenate([motion.alpha for motion in motions]))
    excited = {axis for axis, one in zip("xyz", size, strict=True) if one > EXCITED * size.max()}
    return tuple(name for name in PARAMETERS if not name.startswith("I_") or excited & set(name[2:]))


def centred(values: Array) -> Array:
    """Values (n, ...) minus their mean over n."""
    return np.asarray(values - values.mean(axis=0))


def rms(values: Array) -> Array:
    """Root mean square over the first axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
