"""The validation study of walking: whole campaigns of crossings, their estimates, intervals and truth."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np

from osl_analysis.config import ValidationStudy
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.second_order import ImpedanceFit
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.repeats import Repeats, over_repeats
from osl_analysis.study.laboratory import Laboratory, calibrated
from osl_analysis.trial import Array
from osl_analysis.walking.ensemble import Bootstrap, bootstrap, common_errors, ensemble_response
from osl_analysis.walking.response import isolate_response
from osl_analysis.walking.response_fit import fit_response
from osl_analysis.walking.settings import WalkingAnalysis
from osl_analysis.walking.unperturbed import unperturbed_gait
from osl_analysis.yaml_settings import read_yaml

RESAMPLES = 300
QUANTITIES = ("K", "B", "I")
Row = dict[str, Any]
Made = TypeVar("Made")


def walking_rows(
    numbers: Iterable[int],
    study: ValidationStudy,
    settings: SimulationSettings,
    p: DrivetrainParameters,
    analysis: WalkingAnalysis,
    sources: Path | None = None,
) -> Iterator[Row]:
    """Estimates of campaigns by their numbers; through recorded files where there are `sources` to read them by.

    Raises
    ------
    InputError
        The simulation has no gait laboratory.
    """
    if settings.walking is None:
        raise InputError(f"{study.simulation}: names no 'walking' file, which the study of walking needs; add it")
    gait = read_yaml(settings.walking, WalkingSettings)
    for number in numbers:
        if sources is None:
            yield from campaign_rows(number, study, Laboratory(settings, gait, p, analysis))
            continue
        with TemporaryDirectory() as name:
            own = settings.model_copy(update={"seed": settings.seed + 1 + number})
            laboratory = calibrated(Laboratory(own, gait, p, analysis), Path(name), sources)
            yield from campaign_rows(number, study, laboratory)


def campaign_rows(number: int, study: ValidationStudy, laboratory: Laboratory) -> list[Row]:
    """Estimates of one campaign: of its first perturbation, the mean of all, and the ensemble, each with its interval.

    The truth is the same estimator's answer to the same perturbations alone, through ideal sensors: the study is of
    gait and noise. `model_error` is what that differs from the impedance that the leg rendered.
    """
    names = [f"study_{number:05d}_{i}" for i in range(2 * study.crossings)]
    analysis = laboratory.analysis
    gait = unperturbed_gait(usable(laboratory.unperturbed, names[::2]), analysis.fewest_unperturbed)
    perturbed = usable(laboratory.perturbed, names[1::2])
    responses = [isolate_response(one.crossing, gait, analysis.timing, analysis.perturbed_stance) for one in perturbed]
    fits = [fit_response(response) for response in responses]
    resampled, ensemble = bootstrap(responses, RESAMPLES), ensemble_response(responses).fit
    common, rows = common_errors(responses), []
    for quantity in QUANTITIES:
        truths = np.array([getattr(one.exact, quantity) for one in perturbed])
        rendered = np.array([one.rendered[f"{quantity}_rendered"] for one in perturbed])
        estimates = [getattr(fit, quantity) for fit in fits]
        alone = truth_of(truths[:1], rendered[:1]) | fitted("single perturbation", fits[0].fit, quantity)
        mean = over_repeats(estimates, common[quantity])
        every = truth_of(truths, rendered)
        rows += [
            {"trial": f"study_{number:05d}", "quantity": quantity, "bound": None, **row}
            for row in (alone, every | averaged(mean), every | resampled_row(ensemble, resampled, quantity))
        ]
    return rows


def truth_of(truths: Array, rendered: Array) -> Row:
    """Mean truth of perturbations (n,), and how far it lies from what the leg rendered."""
    return {"truth": float(np.mean(truths)), "model_error": float(np.mean(truths - rendered))}


def fitted(estimator: str, fit: LinearFit, quantity: str) -> Row:
    """Estimate and interval of one fit."""
    low, high = fit.interval(quantity)
    row = {"estimator": estimator, "interval_method": fit.interval_method, "value": fit[quantity]}
    return row | {"se": fit.se(quantity), "low": low, "high": high}


def averaged(mean: Repeats) -> Row:
    """The mean over perturbations, with Student's interval."""
    row = {"estimator": "mean of perturbations", "interval_method": "Student"}
    return row | {"value": mean.mean, "se": mean.se, "low": mean.low, "high": mean.high}


def resampled_row(ensemble: ImpedanceFit, resampled: Bootstrap, quantity: str) -> Row:
    """The fit to the mean response, with the bootstrap's interval."""
    low, high = resampled.interval(quantity)
    row = {"estimator": "ensemble", "interval_method": "bootstrap", "value": getattr(ensemble, quantity)}
    return row | {"se": resampled.se(quantity), "low": low, "high": high}


def usable(make: Callable[[str], Made], names: Iterable[str]) -> list[Made]:
    """What is made by name; crossings that the analysis refuses are left out, as they are of a recorded campaign.

    Raises
    ------
    InputError, IdentifiabilityError
        All are refused: why the last one was.
    """
    made, refused = [], None
    for name in names:
        try:
            made.append(make(name))
        except OslAnalysisError as error:
            refused = error
    if refused is not None and not made:
        raise refused
    return made
