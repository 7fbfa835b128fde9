"""The actuator's own bench in the study: one true motion, current and torque, read by noisy sensors."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.bench.actuator import EDGE_PERIODS, PARAMETERS, actuator_alone
from osl_analysis.bench.settings import ActuatorAnalysis
from osl_analysis.errors import InputError
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.signals import LowPass
from osl_analysis.simulator.bench import current_schedule, moved, recorded_actuator, turning
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.simulator.settings import SimulationSettings, stream
from osl_analysis.study.performance import regression_bound
from osl_analysis.study.recorded import at_any_phase, ideal_sensors, recorded_trial
from osl_analysis.study.trials import DEFAULT, Estimates, StudyInputs, estimates_of, torque_noise
from osl_analysis.trial import Array, Trial


@dataclass(frozen=True)
class ActuatorExperiment:
    """The actuator's bench: the motion and the actuator that every trial repeats, and the analysis.

    Attributes
    ----------
    motion
        True motion of the actuator's output.
    current
        True q-axis current [A], shape (n,).
    actuator
        Parameters that made the torque, with the friction of the settings.
    settings
        The simulated campaign.
    analysis
        Settings of the fit.
    exact
        Parameters that made the torque, by quantity.
    names
        Quantities that are estimated.
    """

    motion: JointMotion
    current: Array
    actuator: DrivetrainParameters
    settings: SimulationSettings
    analysis: ActuatorAnalysis
    exact: Mapping[str, float]
    names: tuple[str, ...] = PARAMETERS

    @property
    def theory(self) -> Mapping[str, float]:
        """The parameters that made the torque: the fitted model is exact."""
        return self.exact

    def trial(self, name: str, ideal: bool = False) -> Trial:
        """One trial as ingest would give it. The encoder's zero lies anywhere between two of its steps."""
        settings = ideal_sensors(self.settings) if ideal else at_any_phase(name, self.settings)
        zero = settings.effects.actuator_encoder.value * stream(settings.seed, name, "encoder_zero").random()
        motion = replace(self.motion, theta=self.motion.theta + zero)
        log, _ = recorded_actuator(name, motion, self.current, self.actuator, settings)
        actuator = {"theta_m": log.actuator_angle, "current": log.motor_current}
        return recorded_trial(name, log.time, actuator, log.torque_time, {"torque_m": log.output_torque})

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The estimates of the pipeline's fit."""
        fit = actuator_alone(self.trial(trial, ideal), self.analysis).fit
        yield DEFAULT, fit.interval_method, estimates_of(fit, self.names)

    def bounds(self) -> dict[str, float]:
        """Cramer-Rao bound of the torque's noise in the fitted rows. Noise in the columns would increase it
        slightly."""
        rate, omega = self.settings.dynamometer.rate_hz, self.motion.omega
        edge = int(np.ceil(EDGE_PERIODS * rate / self.analysis.cutoff_hz))
        rows = np.flatnonzero(np.abs(omega) > self.analysis.slowest)
        rows = rows[(rows >= edge) & (rows < len(omega) - edge)]
        direction, time = np.sign(omega), np.arange(len(omega)) / rate
        columns = {
            "k_tau_n_m": self.current,
            "f_C": -direction,
            "f_G": -direction * np.abs(self.current),
            "B_m": -omega,
            "J_m": -self.motion.alpha,
            "offset": np.ones_like(omega),
            "drift": time - np.mean(time),
        }
        fitted = {name: column[rows] for name, column in columns.items()}
        return regression_bound(fitted, *torque_noise(self.settings, time[rows]))


def actuator(inputs: StudyInputs) -> ActuatorExperiment:
    """The campaign's schedule, with every effect of the simulation settings.

    Raises
    ------
    InputError
        The settings have no schedule.
    """
    settings, p = inputs.simulation, inputs.p
    if settings.actuator is None:
        raise InputError(
            f"{inputs.study.simulation}: has no 'actuator' schedule, which the study needs; add one as in "
            "config/simulation/default.yaml"
        )
    rate, friction = settings.dynamometer.rate_hz, settings.effects.friction.value
    _, motion = moved(turning(settings.actuator, rate), settings)
    current, true = current_schedule(settings.actuator, rate), replace(p, f_C=friction * p.f_C, f_G=friction * p.f_G)
    exact = {"k_tau_n_m": p.k_tau * p.n_m, "f_C": true.f_C, "f_G": true.f_G, "B_m": p.B_m, "J_m": p.J_m}
    return ActuatorExperiment(motion, current, true, settings, inputs.actuator, exact)
