"""The validation study of walking: whole campaigns of crossings, from angle and torque on."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from osl_analysis.config import ValidationStudy
from osl_analysis.errors import InputError
from osl_analysis.fits.repeats import over_repeats
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator.crossing import draw_step, simulate_crossing
from osl_analysis.simulator.draws import stream
from osl_analysis.simulator.dynamometer import drivetrain_effects
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.walking import motion_grid
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.simulator.walking_truth import rendered_impedance
from osl_analysis.trial import Array
from osl_analysis.validation import read_yaml
from osl_analysis.walking.crossing import Crossing, Quality
from osl_analysis.walking.ensemble import bootstrap, ensemble_response, variance_of_normal_gait
from osl_analysis.walking.events import Stance
from osl_analysis.walking.perturbation import Timing, fit_response, isolate, normal_gait
from osl_analysis.walking.settings import WalkingAnalysis

LEVER_M = 0.1
"""Between the middle of a cluster and its markers, and from the plate to the ankle: turns noise into angle, moment."""
RESAMPLES = 300
UNCHECKED = Quality(residuals={}, zero=None, placement=(0.0, 0.0), encoder=None)
"""Of a crossing that no markers and no plate recorded."""
QUANTITIES = ("K", "B", "I")
Row = dict[str, Any]


@dataclass(frozen=True)
class Laboratory:
    """What makes a crossing, and how it is analysed."""

    settings: SimulationSettings
    gait: WalkingSettings
    p: DrivetrainParameters
    analysis: WalkingAnalysis

    def crossing(self, name: str, perturbed: bool) -> tuple[Crossing, dict[str, float]]:
        """Filtered angle and torque of one crossing, and the impedance that the leg rendered in it."""
        time = motion_grid(self.gait)
        step = draw_step(name, self.settings.seed, time, self.gait)
        effects = drivetrain_effects(self.settings)
        calm = simulate_crossing(time, step, False, True, self.gait, effects, self.p)
        walked = simulate_crossing(time, step, True, True, self.gait, effects, self.p) if perturbed else calm
        stance = Stance(step.heel_strike, step.toe_off)
        every = self.gait.rates.motion_hz // self.gait.rates.points_hz
        theta, torque = self.measured(name, walked.motion.theta[::every], walked.torque[::every])
        platform = walked.motion.platform
        seen = Crossing(
            name, time[::every], theta, torque, platform.angle[::every], stance, platform.onset, 0.0, UNCHECKED
        )
        return seen, rendered_impedance(walked, calm)

    def measured(self, name: str, theta: Array, torque: Array) -> tuple[Array, Array]:
        """Angle [rad] and torque [N*m] with the noise of markers and plate, through the analysis' filter."""
        effects, seed = self.gait.effects, self.settings.seed
        angle_noise = 1e-3 * effects.marker_noise.value / LEVER_M
        torque_noise = float(np.hypot(effects.moment_noise.value, LEVER_M * effects.force_noise.value))
        noisy = (
            signal + size * stream(seed, name, effect).standard_normal(len(signal))
            for signal, size, effect in ((theta, angle_noise, "angle_noise"), (torque, torque_noise, "torque_noise"))
        )
        first, second = (self.analysis.low_pass(signal, float(self.gait.rates.points_hz)) for signal in noisy)
        return first, second


def walking_rows(
    number: int,
    study: ValidationStudy,
    settings: SimulationSettings,
    p: DrivetrainParameters,
    analysis: WalkingAnalysis,
) -> list[Row]:
    """Estimates of one campaign: mean of its perturbations with Student's interval, and ensemble with bootstrap.

    The truth is the mean impedance that the leg rendered in the campaign's own perturbations, which the simulator
    knows from the same crossings without them.

    Raises
    ------
    InputError
        The simulation has no gait laboratory.
    """
    if settings.walking is None:
        raise InputError(f"{study.simulation}: names no 'walking' file, which the study of walking needs; add it")
    laboratory = Laboratory(settings, read_yaml(settings.walking, WalkingSettings), p, analysis)
    names = [f"study_{number:05d}_{i}" for i in range(2 * study.crossings)]
    normal = normal_gait([laboratory.crossing(name, False)[0] for name in names[::2]], analysis.fewest_unperturbed)
    perturbed = [laboratory.crossing(name, True) for name in names[1::2]]
    timing = Timing(analysis.window_s, analysis.baseline_s, analysis.guard_s)
    responses = [isolate(crossing, normal, timing, crossing.stance.duration) for crossing, _ in perturbed]
    fits = [fit_response(response) for response in responses]
    ensemble, resampled = ensemble_response(responses).fit, bootstrap(responses, RESAMPLES)
    rows, common = [], variance_of_normal_gait(responses)
    for quantity in QUANTITIES:
        truth = float(np.mean([rendered[f"{quantity}_rendered"] for _, rendered in perturbed]))
        row = {"trial": f"study_{number:05d}", "quantity": quantity, "truth": truth, "bound": None, "model_error": None}
        mean = over_repeats([getattr(fit, quantity) for fit in fits], common[quantity], study.crossings)
        drawn = getattr(resampled, quantity)
        low, high = np.percentile(drawn, [2.5, 97.5])
        student = {"estimator": "mean of perturbations", "interval_method": "Student", "value": mean.mean}
        rows.append(row | student | {"se": mean.se, "low": mean.low, "high": mean.high})
        together = {"estimator": "ensemble", "interval_method": "bootstrap", "value": getattr(ensemble, quantity)}
        rows.append(row | together | {"se": float(np.std(drawn, ddof=1)), "low": float(low), "high": float(high)})
    return rows
