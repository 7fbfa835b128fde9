"""Repeated bench trials in the study: the mean over the trials of one campaign, with Student's interval."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.signals import LowPass
from osl_analysis.simulator.bench import drivetrain_effects, scatter, simulate_belt
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.study.bench import StudyBench, belt, transmission
from osl_analysis.study.trials import Estimate, Estimates, StudyInputs


@dataclass(frozen=True)
class RepeatedBench:
    """A bench with one estimator, of which the mean over several trials is estimated.

    Attributes
    ----------
    nominal
        The bench without scatter from trial to trial.
    count
        Number of trials in a mean.
    bench_of
        Function that returns the bench of the trial with this name.
    scatter
        Standard deviation from trial to trial, by quantity, in the unit of the quantity.
    """

    nominal: StudyBench
    count: int
    bench_of: Callable[[str], StudyBench]
    scatter: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities of one trial."""
        return self.nominal.names

    @property
    def exact(self) -> Mapping[str, float]:
        """The parameters that made one trial."""
        return self.nominal.exact

    @property
    def theory(self) -> Mapping[str, float]:
        """Prediction of linear theory for one trial."""
        return self.nominal.theory

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The mean over the trials. Through ideal sensors it is the estimate of the nominal bench."""
        if ideal:
            for name, _, estimates in self.nominal.estimates(trial, low_pass, ideal=True):
                yield name, "Student", estimates
            return
        singles = [f"{trial}_{i}" for i in range(self.count)]
        each = [next(iter(self.bench_of(single).estimates(single, low_pass))) for single in singles]
        means = {name: over_repeats([estimates[name].value for _, _, estimates in each]) for name in self.names}
        yield each[0][0], "Student", {name: Estimate(m.mean, m.se, m.low, m.high) for name, m in means.items()}

    def bounds(self) -> dict[str, float]:
        """The bound of one trial and the scatter, over the root of the number of trials."""
        single = self.nominal.bounds()
        return {n: float(np.hypot(single[n], self.scatter.get(n, 0.0)) / np.sqrt(self.count)) for n in self.names}


def repeated_belt(inputs: StudyInputs) -> RepeatedBench:
    """The campaign's belt trials. K_s scatters from trial to trial."""
    nominal, settings, p = belt(inputs), inputs.simulation, inputs.p

    def scattered(trial: str) -> StudyBench:
        """The bench with the belt of one trial."""
        own = replace(p, K_s=p.K_s * scatter(trial, settings))
        return replace(nominal, response=simulate_belt(nominal.motion, drivetrain_effects(settings), own))

    deviation = {"K_s": p.K_s * settings.effects.belt_scatter.value}
    return RepeatedBench(nominal, settings.experiments.belt, scattered, deviation)


def repeated_transmission(inputs: StudyInputs) -> RepeatedBench:
    """The campaign's transmission trials. They differ in their noise alone."""
    nominal = transmission(inputs)
    return RepeatedBench(nominal, inputs.simulation.experiments.transmission, lambda _: nominal, {})
