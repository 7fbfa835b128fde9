"""A row of the table of judgements, and the limits of the configuration.

Measuring needs the samples and no limit, judging needs a few numbers and no samples: a changed limit judges again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from osl_analysis.config.experiments import Experiment, judged_tables
from osl_analysis.dictionary import described_tables, own_yaml
from osl_analysis.errors import nearest
from osl_analysis.protocol.stepped_sine import SteppedSineProtocol
from osl_analysis.relations import misplaced
from osl_analysis.trial import Trial
from osl_analysis.yaml_settings import NotNegative, Settings


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


@dataclass(frozen=True)
class CheckResult:
    """What a check measured on one trial."""

    value: float | None  # in the check's unit; None where the check does not apply
    remark: str = ""  # which channel it was, or why the check does not apply


@dataclass(frozen=True)
class Cause:
    """Why a number is beyond its limit, for a reader who knows no column of ours. No text contains a semicolon."""

    name: str  # two or three words, with which every judgement on a trial or a fit begins
    says: str  # what is wrong, and what it does to the results
    remedy: str  # what to do, beginning with a verb
    explains: bool = False  # whether it makes a fit worse: the misfit of the same trial is then no cause of its own
    of_recording: bool = False
    """A fault of the recording does not come and go with the amplitude: the fit to all of a trial must show it, too."""
    otherwise: str = ""  # what to do in place of `remedy` where there are no rows of single amplitudes
    of_amplitude: str = ""  # the same where the fit to all of the trial is sound, and that to one amplitude is not
    of_frequency: str = ""  # the same in a row of one frequency


@dataclass(frozen=True)
class Judgement:
    """A row of the table: a number, and why it may be beyond its limit, which stands in the configuration."""

    name: str  # of a check under `quality`, of a column of result tables under `doubtful`
    cause: Cause
    shows: str = ""
    """What the number of a fit says, after the words of its cause; `number_said` fills in {percent} and others."""
    misfit: bool = False  # whatever else explains the misfit of the trial is its cause
    of: Sequence[str] = ("torque", "angle")  # signals whose units scale a ratio to what is known
    witness: str = ""  # column of another ratio that tells a unit from another device; its own name: none is needed
    unit: str = ""  # of a check's value and threshold
    meaning: str = ""  # what the value of a check is
    measure: Callable[[Examined], CheckResult] = lambda _: CheckResult(None)  # of a check; a column is there already
    fails: Literal["above", "below"] = "above"  # the side of its threshold on which a check fails

    def failed(self, value: float | None, limit: float) -> bool:
        """Whether a value is beyond its threshold by more than rounding; NaN fails, None (not applicable) does not."""
        if value is None:
            return False
        slack = 1e-9 * limit  # 100 Hz from stamps is 99.999 999 999 97 Hz
        return not (value >= limit - slack if self.fails == "below" else value <= limit + slack)


TABLE: dict[str, dict[str, Any]] = own_yaml(Path(__file__).with_suffix(".yaml"))
"""The words of the table: `checks` of recordings, `columns` of result tables with their `causes`, and others."""


class Rule(Settings):
    """The threshold of one check, and what happens to a trial beyond it."""

    threshold: str  # Number and unit, as in `20 N`.
    on_failure: Literal["flag", "exclude"]
    """`flag` says so in the table of quality; `exclude` keeps the trial out of every other table and figure, too."""

    @property
    def limit(self) -> float:
        """The threshold without its unit."""
        return float(self.threshold.split(maxsplit=1)[0])


class QualityRules(Settings):
    """A rule per check, under the check's name; `recording.validate_rules` compares them with the checks."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Rule] = Field(init=False)

    @property
    def by_check(self) -> dict[str, Rule]:
        return self.__pydantic_extra__


BOUNDED = {"VAF": 100, "R2": 1, "correlation": 1, "coherence": 1}  # largest values, by a part of a column's name


class Doubt(Settings):
    """Limits of one table, by column. Null: no limit."""

    above: dict[str, NotNegative | None] = Field(default_factory=dict)
    """Upper limits, by column. A fit is doubtful if the absolute value is above its limit."""
    below: dict[str, float | None] = Field(default_factory=dict)
    """Lower limits, by column. A fit is doubtful if the value is below its limit."""


class DoubtfulFits(Settings):
    """Limits by table. The tables of `judged_tables` can have limits on every numeric column."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Doubt] = Field(init=False)

    @model_validator(mode="after")
    def _tables_are_judged(self) -> Self:
        tables = {table.place.removeprefix("tables/"): table.columns for table in described_tables()}
        for name, limits in self.__pydantic_extra__.items():
            if name not in judged_tables():
                known = f"limits may stand on {', '.join(judged_tables())}"
                raise misplaced(f"unknown table; {known}{nearest(name, judged_tables())}", name)
            numbers = [column.name for column in tables[name].values() if column.unit != "text"]
            for end, column in [("above", one) for one in limits.above] + [("below", one) for one in limits.below]:
                if column not in numbers:
                    said = f"tables/{name}.csv has no number of this name; correct it{nearest(column, numbers)}"
                    raise misplaced(said, name, end, column)
                limit, most = getattr(limits, end)[column], next((n for one, n in BOUNDED.items() if one in column), 0)
                if end == "below" and limit is not None and limit > (high := limits.above.get(column) or np.inf):
                    said = f"{limit:g} is above the upper limit {high:g}, and every fit would be doubtful; correct one"
                    raise misplaced(said, name, end, column)
                if limit and most and (abs(limit) > most or (end == "below" and 0 < limit < most / 100)):
                    of = f"a {'percentage' if most == 100 else 'share'}, which is at most {most}"
                    raise misplaced(f"{limit:g} is no limit of {of}; write one as {0.9 * most:g}", name, end, column)
        return self

    def of(self, table: str) -> Doubt:
        return self.__pydantic_extra__.get(table, Doubt())
