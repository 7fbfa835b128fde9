"""Walking in the study: whole campaigns of crossings with their estimates, intervals and truth."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import numpy as np

from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.second_order import ImpedanceFit
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.repeats import Repeats, over_repeats
from osl_analysis.study.laboratory import StudyLaboratory, calibrated
from osl_analysis.study.trials import StudyInputs, StudyRow
from osl_analysis.trial import Array
from osl_analysis.walking.ensemble import Bootstrap, bootstrap, common_errors, ensemble_response
from osl_analysis.walking.gait import unperturbed_gait
from osl_analysis.walking.response import fit_response, isolate_response

RESAMPLES = 300
"""Resamples of the bootstrap in one campaign."""
QUANTITIES = ("K", "B", "I")
Made = TypeVar("Made")


def walking_rows(inputs: StudyInputs, numbers: Iterable[int], recorded: bool) -> Iterator[StudyRow]:
    """Estimates of campaigns, by their numbers. The signals of `recorded` campaigns go through files and ingest.

    Raises
    ------
    InputError
        The simulation has no gait laboratory.
    """
    if inputs.gait is None:
        raise InputError(
            f"{inputs.study.simulation}: names no 'walking' file, which the study of walking needs; add it as in "
            "config/simulation/default.yaml"
        )
    laboratory, crossings = (
        StudyLaboratory(inputs.simulation, inputs.gait, inputs.p, inputs.walking),
        inputs.study.crossings,
    )
    for number in numbers:
        if not recorded:
            yield from campaign_rows(number, crossings, laboratory)
            continue
        own = inputs.simulation.model_copy(update={"seed": inputs.simulation.seed + 1 + number})
        with TemporaryDirectory() as folder:
            session = calibrated(replace(laboratory, settings=own), Path(folder), inputs.sources)
            yield from campaign_rows(number, crossings, session)


def campaign_rows(number: int, crossings: int, laboratory: StudyLaboratory) -> list[StudyRow]:
    """Estimates of one campaign with as many perturbed as unperturbed `crossings`.

    The estimates are those of the first perturbation, of the mean of all, and of the ensemble, each with its interval.
    The study is about gait and noise. The truth is the estimate of the same estimator for the same perturbations
    without gait, with ideal sensors. `model_error` is the truth minus the impedance that the leg rendered.
    """
    names = [f"study_{number:05d}_{i}" for i in range(2 * crossings)]
    analysis, laboratory = laboratory.analysis, laboratory.sharing(names[1::2])
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
        alone = truth_of(truths[:1], rendered[:1]) | fit_row("single perturbation", fits[0].fit, quantity)
        mean = over_repeats(estimates, common[quantity])
        every = truth_of(truths, rendered)
        rows += [
            {"trial": f"study_{number:05d}", "quantity": quantity, "bound": None, **row}
            for row in (alone, every | mean_row(mean), every | bootstrap_row(ensemble, resampled, quantity))
        ]
    return rows


def truth_of(truths: Array, rendered: Array) -> StudyRow:
    """Mean truth of perturbations, shape (n,), and its mean difference from what the leg rendered."""
    mean = float(np.mean(truths))
    return {"truth": mean, "model_truth": mean, "model_error": float(np.mean(truths - rendered))}


def fit_row(estimator: str, fit: LinearFit, quantity: str) -> StudyRow:
    """Estimate and interval of one fit."""
    low, high = fit.interval(quantity)
    row = {"estimator": estimator, "interval_method": fit.interval_method, "value": fit[quantity]}
    return row | {"se": fit.se(quantity), "low": low, "high": high}


def mean_row(mean: Repeats) -> StudyRow:
    """The mean over perturbations, with Student's interval."""
    row = {"estimator": "mean of perturbations", "interval_method": "Student"}
    return row | {"value": mean.mean, "se": mean.se, "low": mean.low, "high": mean.high}


def bootstrap_row(ensemble: ImpedanceFit, resampled: Bootstrap, quantity: str) -> StudyRow:
    """The fit to the mean response, with the bootstrap's interval."""
    low, high = resampled.interval(quantity)
    row = {"estimator": "ensemble", "interval_method": "bootstrap", "value": getattr(ensemble, quantity)}
    return row | {"se": resampled.se(quantity), "low": low, "high": high}


def usable(make: Callable[[str], Made], names: Iterable[str]) -> list[Made]:
    """Result of `make` for each name. Crossings that the analysis refuses are excluded, as in a recorded campaign.

    Raises
    ------
    InputError, IdentifiabilityError
        All are refused. The error is that of the last one.
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
