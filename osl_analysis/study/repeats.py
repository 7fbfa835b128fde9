"""The bench of the validation study, repeated: means over as many trials as a campaign has, with Student's interval."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.config import ValidationStudy
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.signals import LowPass
from osl_analysis.simulator.dynamometer import drivetrain_effects, scatter, simulate_belt
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.study.bench import Bench, Estimate, Estimates, belt, transmission


@dataclass(frozen=True)
class RepeatedBench:
    """`count` trials of a `nominal` bench with one estimator; `bench_of` a trial is what that trial finds.

    From trial to trial the quantities scatter by the standard deviations `scatter`, each in its unit.
    """

    nominal: Bench
    count: int
    bench_of: Callable[[str], Bench]
    scatter: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """As of one trial."""
        return self.nominal.names

    @property
    def exact(self) -> Mapping[str, float]:
        """As of one trial."""
        return self.nominal.exact

    @property
    def theory(self) -> Mapping[str, float]:
        """As of one trial."""
        return self.nominal.theory

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The mean of the trials; through ideal sensors that of the nominal bench."""
        if ideal:
            yield from (
                (name, "Student", found) for name, _, found in self.nominal.estimates(trial, low_pass, ideal=True)
            )
            return
        singles = [f"{trial}_{i}" for i in range(self.count)]
        found = [next(iter(self.bench_of(single).estimates(single, low_pass))) for single in singles]
        means = {name: over_repeats([each[name].value for _, _, each in found]) for name in self.names}
        yield found[0][0], "Student", {name: Estimate(m.mean, m.se, m.low, m.high) for name, m in means.items()}

    def bounds(self) -> dict[str, float]:
        """That of one trial and the scatter, over the root of their number."""
        single = self.nominal.bounds()
        return {n: float(np.hypot(single[n], self.scatter.get(n, 0.0)) / np.sqrt(self.count)) for n in self.names}


def repeated_belt(
    study: ValidationStudy, settings: SimulationSettings, p: DrivetrainParameters, analysis: DynamometerAnalysis
) -> RepeatedBench:
    """The campaign's belt trials, each with a belt that scatters."""
    nominal = belt(study, settings, p, analysis)

    def scattered(trial: str) -> Bench:
        stiffness = replace(p, K_s=p.K_s * scatter(trial, settings))
        return replace(nominal, response=simulate_belt(nominal.motion, drivetrain_effects(settings), stiffness))

    deviation = {"K_s": p.K_s * settings.effects.belt_scatter.value}
    return RepeatedBench(nominal, settings.experiments.belt, scattered, deviation)


def repeated_transmission(
    study: ValidationStudy, settings: SimulationSettings, p: DrivetrainParameters, analysis: DynamometerAnalysis
) -> RepeatedBench:
    """The campaign's transmission trials; nothing but noise scatters them."""
    nominal = transmission(study, settings, p, analysis)
    return RepeatedBench(nominal, settings.experiments.transmission, lambda _: nominal, {})
