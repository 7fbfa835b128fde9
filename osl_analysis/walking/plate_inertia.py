"""The force plate's own mass: identified on a plate that moves unloaded, then removed from every wrench.

What the sensors read of the plate itself is linear in its inertial parameters. In axes that turn with the plate, with
the acceleration a of the plate's centre, angular velocity w and acceleration z, weight at rest tared away,

    F = m a' + z x mc + w x (w x mc),    M = mc x a' + I z + w x I w,    a' = R^T (a - g) + g,

m the mass, mc mass times centre of mass, I the inertia about the plate's centre.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array
from osl_analysis.walking.kinematics import GRAVITY, BodyMotion
from osl_analysis.walking.moving_plate import Wrench

PARAMETERS = ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_yy", "I_zz", "I_xy", "I_xz", "I_yz")
PLANAR = ("m", "mc_x", "mc_z", "I_yy")
"""What a platform that only turns about the mediolateral axis, and shifts across it, can show."""
EXCITED = 0.1
LEVER = 0.1
"""Weight [m] of forces beside moments: a force errs in the ankle's torque by its lever, about the ankle's height."""


@dataclass(frozen=True)
class PlateInertia:
    """Parameters of the plate (10,) in the order of `PARAMETERS` [kg, kg*m, kg*m^2], 0 where not excited.

    `standard_errors` (10,); `rms_before`, `rms_after` (6,): wrench [N, N*m] of the unloaded plate as read, and with the
    plate's own taken away, both without their means.
    """

    parameters: Array
    standard_errors: Array
    rms_before: Array
    rms_after: Array

    @property
    def identified(self) -> tuple[str, ...]:
        """The parameters that the recordings showed."""
        return tuple(name for name, se in zip(PARAMETERS, self.standard_errors, strict=True) if se > 0)

    def wrench(self, motion: BodyMotion) -> Wrench:
        """What the plate alone reads in n frames, in its own axes, about its centre, which is `motion`'s point."""
        own = regressors(motion) @ self.parameters
        return Wrench(own[:, :3], own[:, 3:])


@dataclass(frozen=True)
class PlateModel:
    """The plate's inertia, and its lag [s] behind the markers: the mean of `lags`, with its standard error.

    `lags` holds one per trial that can tell; without any the lag counts as 0, and less than two give no standard error.
    `left_out`: the model without each trial in turn, for what the choice of trials does to a torque (jackknife).
    """

    inertia: PlateInertia
    lag: float
    lag_se: float | None
    lags: Array
    left_out: "tuple[PlateModel, ...]" = ()


def cross_matrix(v: Array) -> Array:
    """Matrices (n, 3, 3) that multiply like v (n, 3) x."""
    zero = np.zeros(len(v))
    rows = [[zero, -v[:, 2], v[:, 1]], [v[:, 2], zero, -v[:, 0]], [-v[:, 1], v[:, 0], zero]]
    return np.moveaxis(np.array(rows), 2, 0)


def inertia_matrix(v: Array) -> Array:
    """Matrices (n, 3, 6) that map (I_xx, I_yy, I_zz, I_xy, I_xz, I_yz) to I v, for v (n, 3)."""
    x, y, z = v.T
    zero = np.zeros(len(v))
    rows = [[x, zero, zero, y, z, zero], [zero, y, zero, x, zero, z], [zero, zero, z, zero, x, y]]
    return np.moveaxis(np.array(rows), 2, 0)


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


def unchanged(values: Array) -> Array:
    """No low-pass."""
    return values


def identify_plate_inertia(
    recordings: Sequence[tuple[BodyMotion, Wrench]],
    smooth: Callable[[Array], Array] = unchanged,
    names: tuple[str, ...] | None = None,
) -> PlateInertia:
    """Parameters from unloaded recordings: motion of the plate with its centre as the point, wrench in its own axes.

    `smooth` is the low-pass that the wrench passed and the motion did not: it acts on the columns, which are products
    of motions. The low-pass of a product is not the product of low-passes: taken for it, at 8 Hz, the lag of the plate
    reads 0.05 ms too little. Means are taken away per recording, so that each may have its own zero.
    Moments of inertia about axes that the recordings do not excite are left out (0), and where what remains cannot be
    told apart, only the planar four are identified; `names` are identified in their place where they are given.

    Raises
    ------
    InputError, IdentifiabilityError
        No recordings, or not even the planar parameters can be told apart.
    """
    if not recordings:
        raise InputError("no recordings of the unloaded plate; add trials of experiment 'plate' to the sheet")
    columns = np.concatenate([centred(smooth(regressors(motion))) for motion, _ in recordings])
    wrench = np.concatenate([centred(np.hstack([w.force, w.moment])) for _, w in recordings])
    fit = fit_parameters(columns, wrench, names or excited_parameters([motion for motion, _ in recordings]))
    parameters = np.array([fit[name] if name in fit.names else 0.0 for name in PARAMETERS])
    errors = np.array([fit.se(name) if name in fit.names else 0.0 for name in PARAMETERS])
    return PlateInertia(parameters, errors, rms(wrench), rms(wrench - columns @ parameters))


def fit_parameters(columns: Array, wrench: Array, names: tuple[str, ...]) -> LinearFit:
    """Regress wrenches (n, 6) on the named ones of the columns (n, 6, 10); the planar ones if they look alike."""
    weight = np.array([LEVER] * 3 + [1.0] * 3)
    stacked = {
        name: (columns[:, :, PARAMETERS.index(name)] * weight).T.ravel() for name in names
    }  # component after component: residuals stay correlated in time, as the regression assumes
    try:
        return linear_fit((wrench * weight).T.ravel(), stacked)
    except IdentifiabilityError:
        if names == PLANAR:
            raise
        return fit_parameters(columns, wrench, PLANAR)


def excited_parameters(motions: Sequence[BodyMotion]) -> tuple[str, ...]:
    """The parameters that motions show: mass, its moments, and the inertias of axes that turn by more than noise.

    An axis counts from a tenth of the largest RMS angular acceleration on.
    """
    size = rms(np.concatenate([motion.alpha for motion in motions]))
    excited = {axis for axis, one in zip("xyz", size, strict=True) if one > EXCITED * size.max()}
    return tuple(name for name in PARAMETERS if not name.startswith("I_") or excited & set(name[2:]))


def centred(values: Array) -> Array:
    """Values (n, ...) without their mean over n."""
    return np.asarray(values - values.mean(axis=0))


def rms(values: Array) -> Array:
    """Root mean square over the first axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
