"""The result of one group of crossings: its ensemble, the errors of it, and the comparison of both directions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.second_order import ImpedanceFit
from osl_analysis.signals import differentiate
from osl_analysis.stats.repeats import CommonError
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import (
    Bootstrap,
    Draws,
    EnsembleResponse,
    bootstrap,
    common_errors,
    ensemble_response,
    signs_of,
)
from osl_analysis.walking.prediction import Prediction, cross_validated
from osl_analysis.walking.response import PerturbationResponse, isolate_response
from osl_analysis.walking.response_fit import fit_without_offset
from osl_analysis.walking.settings import EnsembleSettings
from osl_analysis.walking.unperturbed import UnperturbedGait


@dataclass(frozen=True)
class Symmetry:
    """Both directions of one group, each fitted alone.

    up, down: fits to the mean responses.
    up_draws, down_draws: the same of the resampled responses.
    difference: up minus down, of the resampled responses.
    counts: number of perturbations up, and down.
    """

    up: ImpedanceFit
    down: ImpedanceFit
    up_draws: Bootstrap
    down_draws: Bootstrap
    difference: Bootstrap
    counts: tuple[int, int]


Result = tuple[EnsembleResponse, Bootstrap]


@dataclass(frozen=True)
class Headline:
    """Result of one group.

    responses: the isolated responses, each with the sign of its direction.
    common: errors that all single fits share, by quantity.
    symmetry: comparison of the directions; None if there is one only.
    baseline: `mean` or `predicted`: which of both the settings name.
    prediction: how the behaviour before the onset predicts the unperturbed course.
    mean_gait, predicted_gait: the ensemble and its bootstrap with either baseline.
    """

    responses: Sequence[PerturbationResponse]
    common: Mapping[str, Sequence[CommonError]]
    symmetry: Symmetry | None
    baseline: str
    prediction: Prediction
    mean_gait: Result
    predicted_gait: Result

    @property
    def ensemble(self) -> EnsembleResponse:
        """The fit to the mean response, or to half the difference of two directions, with the baseline asked for."""
        return self.asked[0]

    @property
    def resampled(self) -> Bootstrap:
        """The bootstrap of `ensemble`."""
        return self.asked[1]

    @property
    def asked(self) -> Result:
        """The result with the baseline that the settings name."""
        return self.predicted_gait if self.baseline == "predicted" else self.mean_gait


def group_headline(perturbed: Sequence[Crossing], gait: UnperturbedGait, settings: EnsembleSettings) -> Headline:
    """The result of the perturbed crossings of one group, whose mean unperturbed gait is `gait`.

    Raises
    ------
    InputError, IdentifiabilityError
        As `isolate_response`, `ensemble_response` and `fit_without_offset`: for example fewer than two crossings, or
        only one that turns up among others that turn down.
    """
    responses = [isolate_response(c, gait, settings.timing, settings.perturbed_stance) for c in perturbed]
    samples = settings.bootstrap_samples
    mean_gait = ensemble_response(responses), bootstrap(responses, samples)
    prediction = cross_validated(responses, mean_gait[0].fit)
    names = prediction.predictors
    predicted_gait = (ensemble_response(responses, names), bootstrap(responses, samples, names)) if names else mean_gait
    return Headline(
        responses,
        common_errors(responses),
        compare_directions(responses, samples),
        settings.baseline,
        prediction,
        mean_gait,
        predicted_gait,
    )


def compare_directions(responses: Sequence[PerturbationResponse], samples: int) -> Symmetry | None:
    """Fits to the mean responses up and down, and their difference; None if the platform always turned one way.

    Both are resampled together: the mean unperturbed gait errs the same way in both, and its error does not cancel in
    the difference.
    """
    signs = signs_of(responses)
    if len(np.unique(signs)) < 2:
        return None
    draws = Draws.of(responses, samples)
    fits: list[ImpedanceFit] = []
    resampled: list[Bootstrap] = []
    for sign in (1, -1):
        some = signs == sign
        chosen = [r for r, one in zip(responses, some, strict=True) if one]
        motion = differentiate(chosen[0].time, np.mean([r.motion.theta for r in chosen], axis=0))
        torque, rows = np.mean([r.torque for r in chosen], axis=0), chosen[0].window
        fits.append(fit_without_offset(motion[rows], torque[rows]))
        resampled.append(draws.refitted(draws.perturbed * some, float(len(chosen) - 1)))
    up, down = resampled
    K, B, I, VAF = (getattr(up, name) - getattr(down, name) for name in ("K", "B", "I", "VAF"))
    difference = Bootstrap(K, B, I, VAF, min(up.degrees_of_freedom, down.degrees_of_freedom))
    return Symmetry(fits[0], fits[1], up, down, difference, (int(np.sum(signs > 0)), int(np.sum(signs < 0))))
