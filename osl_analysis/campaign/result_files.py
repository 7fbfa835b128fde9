# SPDX-License-Identifier: Apache-2.0
"""List the files of a campaign's results, and what each is made from.

It also chooses the trials that figures show as examples. Paths are relative to the folder of the
campaign. Example: the rules ask for `FILES.rows("belt")`.
"""

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from osl_analysis.base.table import ARCHIVE_SUFFIX
from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.campaign.configuration import FrequencyResponseFigure
from osl_analysis.config.experiments import EXPERIMENTS, JUDGED_TABLES, TABLES_OF_TRIALS
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.figures.drawing import FIGURES
from osl_analysis.judge.claims import read_claims
from osl_analysis.judge.joining import judged_as

GROUPS = "walking_groups"  # table: a row per group of crossings
# Experiments that measure the components of the drivetrain
COMPONENT_EXPERIMENTS = ("actuator", "belt", "transmission")
SUMMARIES = [f"{component}_summary" for component in COMPONENT_EXPERIMENTS]
ON_PAPER = {
    "conditions": ["impedance"],
    "walking": ["walking_summary"],
    "components": SUMMARIES,
    "budget": ["budget", "impedance", *SUMMARIES],
}
"""Tables for a paper, and the tables of results that each is made of."""
FIGURE_SUFFIXES = ("csv", "pdf", "svg", "png")  # plotted numbers, and the figure
FOR_READERS = (
    "tables/settings.csv",
    "tables/excluded.csv",
    "tables/findings.parquet",
    "tables/findings.csv",
    "tables/quality.csv",
    "report.html",
    "summary.json",
    "numbers.tex",
    "methods.md",
    "methods.tex",
    "methods.bib",
)
"""Results of every campaign, beside its tables and figures."""


def name_pattern(names: Iterable[str]) -> str:
    """The regular expression of a wildcard that is one of these names; of none, it matches
    nothing."""
    return "|".join(map(re.escape, names)) or "(?!)"


DERIVED = {derived: table.name for table in TABLES_OF_TRIALS.values() for derived in table.derived}
"""By table that is computed from another one alone, that other one."""


@dataclass(frozen=True)
class ResultFiles:
    """The files of a campaign's results."""

    campaign: Campaign

    @property
    def results(self) -> Path:
        """The folder of the results."""
        return self.campaign.config.results

    # Results of single trials

    def checks(self, trials: Iterable[str]) -> list[str]:
        """What quality control measured on these trials."""
        return [f"{self.results}/quality/{trial}.csv" for trial in trials]

    def crossings(self, trials: Iterable[str]) -> list[str]:
        """Angle and torque of these crossings."""
        return [f"{self.results}/crossings/{trial}.parquet" for trial in trials]

    def calibrations(self, trials: Iterable[str]) -> list[str]:
        """The calibrations of the markers that these trials use."""
        statics = dict.fromkeys(self.campaign.static_of[trial] for trial in trials)
        return [f"{self.results}/fits/calibration/{static}.json" for static in statics]

    def rows(self, table: str, trials: Collection[str] | None = None) -> list[str]:
        """The files with the rows of single trials behind a table, of these trials, or of all; of
        groups of crossings the file with those of all groups.

        Those of an experiment's first table are CSV; all others stand in one archive."""
        if table == GROUPS:
            has_groups = bool(self.campaign.trials("walking"))
            return [f"{self.results}/fits/{GROUPS}.csv"] if has_groups else []
        files = []
        for trial, row in self.campaign.rows.items():
            names = [table_facts.name for table_facts in EXPERIMENTS[row["experiment"]].tables]
            is_unperturbed = table == "walking" and not row["perturbed"]
            if table in names and not is_unperturbed and (trials is None or trial in trials):
                suffix = ".csv" if table == names[0] else ARCHIVE_SUFFIX
                files.append(f"{self.results}/fits/{names[0]}/{trial}{suffix}")
        return files

    @cached_property
    def files_of_single_trials(self) -> list[str]:
        """All results of single trials."""
        walked = self.campaign.trials("walking")
        files = [f"{self.results}/trials/{trial}.parquet" for trial in self.campaign.trials()]
        files += [*self.crossings(walked), *self.calibrations(walked)]
        for table in self.gathered_tables:
            files += self.rows(table)
        return list(dict.fromkeys(files))

    # Tables

    @cached_property
    def gathered_tables(self) -> list[str]:
        """The names of the tables that are gathered from the rows of single trials."""
        return [name for name in TABLES_OF_TRIALS if self.rows(name)]

    @cached_property
    def table_names(self) -> list[str]:
        """The names of the tables of results that the campaign has."""
        names = [name for name in self.gathered_tables if TABLES_OF_TRIALS[name].published]
        names += [name for name, source in DERIVED.items() if source in names]
        for experiment, facts in EXPERIMENTS.items():
            if self.campaign.trials(experiment):
                names += facts.further_tables
        if self.campaign.config.impedance_trajectory:
            names.append("gains")
        if any(table in names for table in self.claimed_tables):
            names.append("claims")
        return names

    @cached_property
    def claimed_tables(self) -> list[str]:
        """The tables with whose numbers claims are compared."""
        file = self.campaign.config.claims
        return [claim.table for claim in read_claims(file).values()] if file else []

    @cached_property
    def all_tables(self) -> list[str]:
        """All tables of results."""
        return self.tables(*self.table_names)

    def tables(self, *names: str) -> list[str]:
        """Those of these tables that the campaign has."""
        present = [name for name in self.table_names if name in names]
        return [f"{self.results}/tables/{name}.csv" for name in present]

    @cached_property
    def for_paper(self) -> dict[str, list[str]]:
        """By the name of a table for a paper, the tables of results that it is made of."""
        made_of = {name: self.tables(*tables) for name, tables in ON_PAPER.items()}
        return {name: tables for name, tables in made_of.items() if tables}

    # Findings

    @cached_property
    def judged_tables(self) -> list[str]:
        """The tables whose rows are judged, and that the campaign has."""
        return [name for name in self.table_names if name in JUDGED_TABLES]

    def findings(self, *tables: str) -> list[str]:
        """The findings about the rows of some tables, also of those that share another one's.

        Their names begin as no trial's does: a job takes the files of a refused trial out of all
        its inputs by their names, and a trial may be called `belt`."""
        judged = {judged_as(table) for table in tables}
        names = [name for name in self.judged_tables if name in judged]
        return [f"{self.results}/findings/_{name}.parquet" for name in names]

    def budgets(self, table: str) -> list[str]:
        """The files with the budgets of the estimates of a judged table, if its fits have any."""
        if table == GROUPS:
            return self.tables("walking_budget")
        for facts in EXPERIMENTS.values():
            names = [result.name for result in facts.tables]
            if table in names and "budget" in names:
                return self.rows("budget", self.places_in(table))
        return []

    @cached_property
    def fits_for_findings(self) -> list[str]:
        """The fits of single trials that have columns for findings alone."""
        files = []
        for name, described in described_tables_by_name().items():
            if described.of_fits and name != GROUPS:
                files += self.rows(name)
        return files

    def places_in(self, table: str) -> dict[str, dict[str, str]]:
        """Joint and side of the trials that have rows in a table."""
        trials = [Path(file).stem for file in self.rows(table)]
        places = self.campaign.places
        return {trial: places[trial] for trial in trials if trial in places}

    # Figures

    @cached_property
    def figure_names(self) -> list[str]:
        """The figures whose table the campaign has."""
        return [name for name, figure in FIGURES.items() if figure.table in self.table_names]

    @cached_property
    def figures(self) -> list[str]:
        """All figures, with the numbers that they plot, and their captions."""
        files = [
            f"{self.results}/figures/{figure}.{suffix}"
            for figure in self.figure_names
            for suffix in FIGURE_SUFFIXES
        ]
        if not files:
            return []
        captions = [f"{self.results}/figures/captions.{suffix}" for suffix in ("md", "tex")]
        return [*files, *captions]

    @cached_property
    def published(self) -> list[str]:
        """All results that are for readers, and not of single trials."""
        names = [*FOR_READERS]
        if self.campaign.trials("walking"):
            names.append("tables/walking_responses.csv")
        for name in self.for_paper:
            names += [f"tables/latex/{name}.tex", f"tables/markdown/{name}.md"]
        return [*self.all_tables, *self.figures, *(f"{self.results}/{name}" for name in names)]

    def results_in_figure(self, figure: str) -> list[str]:
        """The results of single trials that a figure shows; the refused ones are named below it."""
        if figure == "fig4":
            return []  # one trial, without which it is not drawn
        if figure == "fig7":
            return self.rows("response", matching(self.campaign, response_example(self.campaign)))
        table = FIGURES[figure].table
        if table in EXPERIMENTS["walking"].further_tables:
            return self.crossings(self.campaign.trials("walking")) + self.rows("walking")
        if table in DERIVED:
            return self.rows(DERIVED[table])
        return self.rows(table)


# The trials that figures show as examples


@dataclass(frozen=True)
class TimeSeriesExample:
    """The trials of which Fig. 4 shows the first one that is not doubtful."""

    trials: Sequence[str]
    chosen: str  # why these, if the configuration does not name one


def time_series_example(campaign: Campaign) -> TimeSeriesExample | None:
    """Choose the trials that Fig. 4 may show: the one that the configuration names, else all.

    Returns
    -------
    TimeSeriesExample or None
        None without impedance trials.
    """
    trials = campaign.trials("impedance")
    if not trials:
        return None
    example = campaign.config.figures.time_series
    named = matching(campaign, example)
    if named and example:
        return TimeSeriesExample(named[:1], "")
    chosen = "the first impedance trial of the sheet that is not doubtful"
    if not named:
        chosen += "; the example of the configuration is not in it"
    return TimeSeriesExample(trials, chosen)


def response_example(campaign: Campaign) -> FrequencyResponseFigure | None:
    """The desired impedance of Fig. 7, if the campaign has it; None: the one with the most
    trials."""
    example = campaign.config.figures.frequency_response
    return example if matching(campaign, example) else None


def matching(campaign: Campaign, example: FrequencyResponseFigure | None) -> list[str]:
    """Find the impedance trials with the cells of the sheet that are stated, of which None matches
    an empty cell; all where nothing is stated."""
    cells = example.model_dump() if example else {}
    return [
        trial
        for trial in campaign.trials("impedance")
        if all(campaign.rows[trial][column] == value for column, value in cells.items())
    ]
