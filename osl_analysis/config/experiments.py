# SPDX-License-Identifier: Apache-2.0
"""Read the facts of every experiment from `experiments.yaml`.

Sheet, quality control, simulator, rules and command line read this one table. Example:
`EXPERIMENTS["impedance"].torque` is the column with the measured torque.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from osl_analysis.base.files import package_yaml

# fields of `dynamometer` in the configuration that describe the expected stepped sine, and whether
# one is expected
PROTOCOL = ("amplitudes_deg", "frequencies_hz", "cycles", "excitation")


@dataclass(frozen=True)
class ResultTable:
    """A result table `tables/<name>.csv` with rows of every trial of an experiment."""

    name: str
    judged: bool = True  # its fits have limits under `doubtful.<name>` in the configuration
    derived: Sequence[str] = ()  # the tables that are computed from it alone
    doubts_of: str = ""  # the table of the same trials whose doubts its rows share; empty for none
    # False if only the files of the single trials are used and no common table is written
    published: bool = True


@dataclass(frozen=True)
class FitJob:
    """The cells of the sample sheet that the fit of one trial takes."""

    sheet: Sequence[str] = ()  # columns of the sheet
    windows: bool = False  # whether it fits the windows that the sheet states, as `windows`


@dataclass(frozen=True)
class Experiment:
    """What the pipeline knows of one kind of trial."""

    description: str  # one line for the user
    # where it is recorded; None for a trial that is ingested only
    place: Literal["bench", "walkway"] | None
    # the column with the measured motion; None if not every trial has one
    motion: str | None = None
    may_stand: bool = False  # the column of the motion may be missing, where nothing moves
    # the column with the measured torque; None if not every trial has one
    torque: str | None = None
    # other columns that every trial has, but markers and plates: a laboratory names them
    signals: Sequence[str] = ()
    optional_signals: Sequence[str] = ()  # columns that its analysis uses where a trial has them
    # columns of the sample sheet that its trials must fill
    sheet: Sequence[str] = ()
    follows: Sequence[str] = ()  # fields of `SharedChoices` that its simulated trials use
    stepped_sine: bool = False  # the motion follows the stepped-sine protocol of `dynamometer`
    any_motion: bool = False  # another motion than the stepped sine may move the joint
    bare_plate: bool = False  # every force plate is unloaded at some time
    walker: bool = False  # somebody stands or walks on the force plates
    log: str | None = None  # source file of the simulated log; None if the simulator records no log
    # source file of the simulated capture; None if the simulator records none
    mocap: str | None = None
    # result tables with rows of every trial; the fit writes them in this order
    tables: Sequence[ResultTable] = ()
    # result tables that separate rules compute from all trials together
    further_tables: Sequence[str] = ()
    judged_further: Sequence[str] = ()  # those of them whose rows have limits under `doubtful`
    fit: FitJob | None = None  # of one trial; None if separate rules do this
    # columns of its first table that are these; empty: none. They are printed with their intervals
    impedance: Sequence[str] = ("K", "B", "I")

    @property
    def needed_columns(self) -> tuple[str, ...]:
        """The columns that every trial must have."""
        motion = None if self.may_stand else self.motion
        return tuple(column for column in (motion, self.torque, *self.signals) if column)

    def uses(self, column: str) -> bool:
        """Whether the analysis uses a column; all, of what is ingested only and of a walkway."""
        if self.place != "bench":
            return True
        return column in (self.motion, self.torque, *self.signals, *self.optional_signals)


def experiment_of(facts: dict[str, Any]) -> Experiment:
    """An entry of `experiments.yaml`, without pydantic, whose import would delay the command
    line."""
    tables = [ResultTable(**table) for table in facts.get("tables", ())]
    fit = FitJob(**facts["fit"]) if "fit" in facts else None
    return Experiment(**{**facts, "tables": tables, "fit": fit})


LISTED_EXPERIMENTS = package_yaml(Path(__file__).with_suffix(".yaml"))
EXPERIMENTS = {name: experiment_of(facts) for name, facts in LISTED_EXPERIMENTS.items()}
TABLES_OF_TRIALS = {table.name: table for facts in EXPERIMENTS.values() for table in facts.tables}
"""The tables with rows of single trials, by name."""
DOUBTS_OF = {name: table.doubts_of for name, table in TABLES_OF_TRIALS.items() if table.doubts_of}
"""By table, the table of the same trials whose doubts its rows share."""
JUDGED_TABLES = (
    *(name for name, table in TABLES_OF_TRIALS.items() if table.judged),
    *(name for facts in EXPERIMENTS.values() for name in facts.judged_further),
)
"""The tables whose fits have limits under `doubtful` in the configuration."""
