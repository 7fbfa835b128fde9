"""The actuator's own bench in the study: one true motion, current and torque, read by noisy sensors."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.bench.actuator import EDGE_PERIODS, PARAMETERS, ActuatorSignals, actuator_columns, fit_actuator
from osl_analysis.bench.estimators import DEFAULT
from osl_analysis.bench.settings import ActuatorAnalysis
from osl_analysis.errors import InputError
from osl_analysis.model.drivetrain import actuator_torque
from osl_analysis.signals import LowPass
from osl_analysis.simulator.actuator_bench import ActuatorLog, current_schedule, recorded_actuator, turning
from osl_analysis.simulator.dynamometer import moved
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.simulator.sensors import stream
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.study.performance import regression_bound
from osl_analysis.study.trials import Estimates, StudyInputs, estimates_of, torque_noise
from osl_analysis.trial import Array

SENSORS = (
    "load_cell_noise", "load_cell_offset", "load_cell_drift", "load_cell_quantisation", "actuator_encoder",
    "current_noise", "current_quantisation",
)  # fmt: skip


@dataclass(frozen=True)
class ActuatorExperiment:
    """The actuator's bench: what every trial repeats, and how it is analysed.

    Attributes
    ----------
    motion
        True motion of the actuator's output.
    current
        True q-axis current [A], shape (n,).
    torque
        True torque [N*m] at the actuator's output, shape (n,).
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
    torque: Array
    settings: SimulationSettings
    analysis: ActuatorAnalysis
    exact: Mapping[str, float]
    names: tuple[str, ...] = PARAMETERS

    @property
    def theory(self) -> Mapping[str, float]:
        """The parameters that made the torque: the fitted model is exact."""
        return self.exact

    def log(self, trial: str, ideal: bool = False) -> ActuatorLog:
        """The log of one trial. The encoder's zero lies anywhere between two of its steps."""
        settings = self.settings
        if ideal:
            settings = settings.model_copy(update={"effects": settings.effects.without(*SENSORS)})
        zero = settings.effects.actuator_encoder.value * stream(settings.seed, trial, "encoder_zero").random()
        motion = replace(self.motion, theta=self.motion.theta + zero)
        return recorded_actuator(trial, motion, self.current, self.torque, settings)[0]

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The estimates of the pipeline's fit."""
        log, chosen = self.log(trial, ideal), self.analysis
        signals = ActuatorSignals(log.time, log.actuator_angle, log.motor_current, log.output_torque)
        columns, torque = actuator_columns(signals, low_pass, chosen.sign_width)
        fit = fit_actuator(columns, torque, self.settings.dynamometer.rate_hz, low_pass, chosen.slowest)
        yield DEFAULT, fit.interval_method, estimates_of(fit, self.names)

    def bounds(self) -> dict[str, float]:
        """Cramer-Rao bound of the torque's noise in the fitted rows. Noise in the columns would raise it a little."""
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
    torque = actuator_torque(current, motion.omega, motion.alpha, true)
    exact = {"k_tau_n_m": p.k_tau * p.n_m, "f_C": true.f_C, "f_G": true.f_G, "B_m": p.B_m, "J_m": p.J_m}
    return ActuatorExperiment(motion, current, torque, settings, inputs.actuator, exact)
