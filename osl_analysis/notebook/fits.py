"""For notebooks: the fits of single bench trials, as the jobs of a campaign make them."""

from dataclasses import replace
from pathlib import Path

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.commands.fit import FitRequest, fit_request, fit_trial
from osl_analysis.notebook.fit import Fit
from osl_analysis.notebook.inputs import OF_CONFIG, File, config_of, desired_of, device_of, trial_of
from osl_analysis.trial import Trial


def fit_impedance(
    trial: Trial | File,
    desired: DesiredImpedance | None = None,
    windows: str | None = None,
    config: File | None = None,
    parameters: File | None = OF_CONFIG,
) -> Fit:
    """K [N*m/rad], B [N*m*s/rad] and I [kg*m^2] of Eq. 15, torque = K theta + B omega + I alpha + offset.

    The rows are those of `impedance.csv`: one per amplitude of a stepped sine, and one over all of them; of any other
    motion one row.

    Parameters
    ----------
    trial
        a trial with `theta` [rad] and the resisting `torque` [N*m], or its file.
    desired
        what the leg was asked to render, `DesiredImpedance("compensated", K_d=300, B_d=5)`. With it the fit is judged
        by what the gains should give. Without it `not_checked` says what is not judged.
    windows
        what of the trial is fitted [s], as in the column `windows` of a sample sheet; default: all that moves.
    config
        a configuration file, which may state what differs from the default only; default: `config.yaml` of a campaign
        in the working folder, else the shipped one.
    parameters
        the parameter file of the device; default: the one that the configuration names; None: a device without one,
        whose stiffness is not compared with a belt.

    Raises
    ------
    InputError
        The trial lacks a signal, does not move, or follows a damaged stepped sine; or a file is not valid.
    IdentifiabilityError
        The motion cannot tell K, B and I apart.
    UnreachableImpedanceError
        The device has no gains for the desired impedance.
    """
    path = config_of(config)
    request = replace(fit_request("impedance", path, desired_of(desired)), windows=windows)
    return fitted("impedance", trial, request, device_of(parameters, path))


def fit_belt(trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG) -> Fit:
    """The belt's stiffness K_s [N*m/rad]: the slope of torque over theta - theta_m / n_T while loading (Fig. 3).

    The trial has `theta` and `theta_m` [rad] and `torque` [N*m]; the row is that of `belt.csv`. `config`, `parameters`
    and what is raised as in `fit_impedance`; a belt trial needs a parameter file, for n_T.
    """
    return fitted_alone("belt", trial, config, parameters)


def fit_transmission(trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG) -> Fit:
    """The transmission's damping B_j [N*m*s/rad] and inertia J_j [kg*m^2] (Eq. 4), of a trial without motor.

    The trial has `theta` [rad] and `torque` [N*m]; the rows are those of `transmission.csv`. `config`, `parameters`
    and what is raised as in `fit_impedance`.
    """
    return fitted_alone("transmission", trial, config, parameters)


def fit_actuator(trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG) -> Fit:
    """The actuator (Eqs. 1-2) on its own bench: k_tau n_m and f_G [N*m/A], f_C [N*m], B_m [N*m*s/rad], J_m [kg*m^2].

    The trial has `current` [A], `torque_m` [N*m], and `theta_m` [rad] or `omega_m` [rad/s]; the row is that of
    `actuator.csv`. `config`, `parameters` and what is raised as in `fit_impedance`.
    """
    return fitted_alone("actuator", trial, config, parameters)


def fit_torque_angle(trial: Trial | File, curve: str | None = None, config: File | None = None) -> Fit:
    """Torque over angle of a passive foot or a spring in slow cycles: K [N*m/rad], energies [J], hysteresis.

    The trial has `theta` [rad] and `torque` [N*m]; the row is that of `torque_angle.csv`, and `curves` has the rows of
    `torque_angle_curves.csv`. `curve` names the curve of the configuration that the device was designed for. `config`
    and what is raised as in `fit_impedance`; there may be no such curve.
    """
    path = config_of(config)
    return fitted("torque_angle", trial, replace(fit_request("torque_angle", path), curve=curve), None)


def fitted_alone(experiment: str, trial: Trial | File, config: File | None, parameters: File | None) -> Fit:
    """The fit of an experiment that uses no more than trial, configuration and parameter file."""
    path = config_of(config)
    return fitted(experiment, trial, fit_request(experiment, path), device_of(parameters, path))


def fitted(experiment: str, trial: Trial | File, request: FitRequest, parameters: Path | None) -> Fit:
    """The fit of an experiment; `parameters` is the file of the device."""
    return Fit(experiment, fit_trial(experiment, trial_of(trial), parameters, request))
