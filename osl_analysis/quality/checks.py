"""A check of quality control: its name, what it measures, the trials to which it applies, and its rule."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from osl_analysis.experiments import EXPERIMENTS, Experiment
from osl_analysis.protocol.runs import SteppedSineProtocol
from osl_analysis.signals import longest_run
from osl_analysis.trial import Array, Trial
from osl_analysis.yaml_settings import Settings


class Rule(Settings):
    """The threshold of one check, and what happens to a trial beyond it."""

    threshold: str
    """Number and unit, as in `20 N`."""
    on_failure: Literal["flag", "exclude"]
    """`flag` says so in the table of quality; `exclude` keeps the trial out of every other table and figure, too."""

    @property
    def limit(self) -> float:
        """The threshold without its unit."""
        return float(self.threshold.split(maxsplit=1)[0])


class QualityRules(Settings):
    """A rule per check, under the check's name; `verdict.validate_rules` compares them with the table of checks."""

    model_config = ConfigDict(extra="allow")
    RENAMED: ClassVar[Mapping[str, str]] = {"unfinished": "truncated"}
    __pydantic_extra__: dict[str, Rule] = Field(init=False)

    def rule(self, check: str) -> Rule:
        return self.by_check[check]

    @property
    def by_check(self) -> dict[str, Rule]:
        return self.__pydantic_extra__


NOISY = {"current"} | {facts.torque for facts in EXPERIMENTS.values() if facts.torque}
"""Columns that a sensor's noise keeps changing."""
AT_REST = 0.02  # share of the angle's range by which a joint at rest may creep
NO_ANALOG = "no torque, current or plate"


@dataclass(frozen=True)
class CheckResult:
    """What a check measured on one trial."""

    value: float | None  # in the check's unit; None where the check does not apply
    remark: str = ""  # which channel it was, or why the check does not apply


@dataclass(frozen=True)
class Commanded:
    """The stepped sine that the configuration commands: each amplitude at every frequency."""

    amplitudes_deg: Sequence[float]
    frequencies_hz: Sequence[float]
    cycles: int | Sequence[int]  # one number for all frequencies, or one for each
    seconds_per_frequency: float | None = None  # in place of `cycles`
    excitation: str = "auto"
    """What moves the joint in impedance trials: `stepped_sine`, `any` other motion, or `auto`, what they show."""

    @property
    def protocol(self) -> SteppedSineProtocol:
        """The same with amplitudes in rad and cycles at each frequency."""
        seconds = self.seconds_per_frequency
        cycles = self.cycles if seconds is None else tuple(seconds * f for f in self.frequencies_hz)
        return SteppedSineProtocol(tuple(np.deg2rad(self.amplitudes_deg)), self.frequencies_hz, cycles)


@dataclass(frozen=True)
class Examined:
    """A trial under examination."""

    trial: Trial
    experiment: Experiment
    commanded: Commanded

    @property
    def samples(self) -> pl.DataFrame:
        return self.trial.samples

    @cached_property
    def steps(self) -> dict[str, Array]:
        """Sampling steps [s], (n - 1,) each. Channels that were sampled at the same times stand under the first."""
        time, steps, seen = self.samples["time"].to_numpy(), {}, set()
        for column in self.samples.columns:
            present = self.samples[column].is_not_null().to_numpy()
            if column == "time" or present.sum() < 3 or (pattern := present.tobytes()) in seen:
                continue
            seen.add(pattern)
            steps[column] = np.diff(time[present])
        return steps


def every_experiment(experiment: Experiment) -> bool:
    return True


@dataclass(frozen=True)
class Check:
    """One check of quality control."""

    name: str  # its key under `quality` in the configuration, and under `accept` in the sample sheet
    unit: str  # unit of its value and of its threshold
    fails: Literal["above", "below"]  # the side of the threshold on which a value fails
    meaning: str
    measure: Callable[[Examined], CheckResult]
    applies_to: Callable[[Experiment], bool] = every_experiment
    otherwise: str = ""  # remark on the trials of experiments to which it does not apply

    def result(self, examined: Examined) -> CheckResult:
        """What the check measures on a trial."""
        return self.measure(examined) if self.applies_to(examined.experiment) else not_applicable(self.otherwise)


def not_applicable(reason: str) -> CheckResult:
    return CheckResult(None, f"not applicable: {reason}")


def worst(values: Mapping[str, float], reason: str) -> CheckResult:
    """The largest of the channels' values, with its channel; `reason`: why there are no channels, if there are none."""
    if not values:
        return not_applicable(reason)
    name = max(values, key=lambda channel: values[channel])
    return CheckResult(float(values[name]), name if values[name] else "")


def channel(samples: pl.DataFrame, column: str) -> tuple[Array, Array]:
    """Time [s] and values of one column, (n,) each, where it was sampled. NaN is left out, but for hidden markers."""
    rows = samples.select("time", column).drop_nulls()
    rows = rows if column.startswith("marker_") else rows.drop_nans(column)
    return rows["time"].to_numpy(), rows[column].to_numpy()


def raw_channels(trial: Trial) -> dict[str, Mapping[str, Any]]:
    """Facts of every raw channel of the trial's plates by name, as ingest found them."""
    return {
        f"plate{plate['plate']} channel {facts['label']}": facts
        for plate in trial.provenance.get("plates", [])
        for facts in plate.get("channels", [])
    }


def own_channels(examined: Examined, raw: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[Array, Array]]:
    """The noisy channels with samples, except force and moment of plates whose raw channels are known."""
    plates = {name.partition(" ")[0] for name in raw}
    channels = noisy_channels(examined.samples)
    return {name: x for name, x in channels.items() if x[1].size and name.partition("_")[0] not in plates}


def noisy_channels(samples: pl.DataFrame) -> dict[str, tuple[Array, Array]]:
    """Time [s] and values of torque, current and plates, where they were sampled."""
    columns = [c for c in samples.columns if c in NOISY or c.startswith("plate")]
    return {column: channel(samples, column) for column in columns}


def length_of_longest(true: NDArray[np.bool_]) -> int:
    """Samples in the longest run of true ones."""
    run = longest_run(true)
    return int(run.stop - run.start)


def median_step(time: Array) -> float:
    """Median step [s]; 0 for a single sample."""
    return float(np.median(np.diff(time))) if time.size > 1 else 0.0


def duration(time: Array) -> float:
    return float(np.ptp(time)) if time.size else 0.0
