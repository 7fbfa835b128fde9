"""The files of a campaign's results: which it has, and which of them each is made from.

The rules ask for them, as `FILES.rows("belt")`. Paths are relative to the folder of the campaign.
"""

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.campaign.figure_examples import matching, response_example
from osl_analysis.config.experiments import EXPERIMENTS, ResultTable
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.figures import FIGURES
from osl_analysis.judge.claims import CLAIMED

# Experiments that measure the components of the drivetrain
COMPONENTS = ("actuator", "belt", "transmission")
ON_PAPER = {"impedance": "conditions", "walking_summary": "walking"}
"""Tables for a paper, by the table of results that each is made of."""
FIGURE_SUFFIXES = ("csv", "pdf", "svg", "png")  # plotted numbers, and the figure
# Suffix of files with the rows of one trial; those of an experiment's first table are CSV, and
# those of all others of its tables stand in one archive
ARCHIVE_SUFFIX = "zip"


def experiment_tables() -> list[tuple[str, ResultTable]]:
    """The tables with rows of single trials, with their experiments."""
    return [(name, table) for name, facts in EXPERIMENTS.items() for table in facts.tables]


def name_pattern(names: Iterable[str]) -> str:
    """The regular expression of a wildcard that is one of these names; of none, it matches
    nothing."""
    return "|".join(map(re.escape, names)) or "(?!)"


@dataclass(frozen=True)
class DerivedTable:
    """A table that is computed from another one alone."""

    source: str  # name of the other one
    command: str  # `module.function` of `commands` that computes it


DERIVED = {
    derived: DerivedTable(table.name, command)
    for _, table in experiment_tables()
    for derived, command in table.derived.items()
}


@dataclass(frozen=True)
class ResultFiles:
    """The files of a campaign's results."""

    campaign: Campaign

    @property
    def results(self) -> Path:
        """The folder of the results."""
        return self.campaign.config.results

    # ---- Results of single trials

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
        """The files with the rows of single trials behind a table; of these trials, or of all."""
        files = []
        for experiment, other in experiment_tables():
            if other.name != table:
                continue
            first = EXPERIMENTS[experiment].tables[0].name
            suffix = "csv" if table == first else ARCHIVE_SUFFIX
            of_experiment = self.campaign.trials(experiment)
            if table == "walking":  # of the perturbed crossings alone
                of_experiment = self.campaign.crossings(perturbed=True)
            for trial in of_experiment:
                if trials is None or trial in trials:
                    files.append(f"{self.results}/fits/{first}/{trial}.{suffix}")
        return files

    @cached_property
    def of_single_trials(self) -> list[str]:
        """All results of single trials."""
        walked = self.campaign.trials("walking")
        files = [f"{self.results}/trials/{trial}.parquet" for trial in self.campaign.trials()]
        files += [*self.crossings(walked), *self.calibrations(walked)]
        for table in self.gathered_tables:
            files += self.rows(table)
        return list(dict.fromkeys(files))

    # ---- Tables

    @cached_property
    def gathered_tables(self) -> list[str]:
        """The names of the tables that are gathered from the rows of single trials."""
        names = dict.fromkeys(table.name for _, table in experiment_tables())
        return [name for name in names if self.rows(name)]

    @cached_property
    def table_names(self) -> list[str]:
        """The names of the tables of results that the campaign has."""
        published = dict.fromkeys(table.name for _, table in experiment_tables() if table.published)
        names = [name for name in published if self.rows(name)]
        names += [name for name, derived in DERIVED.items() if derived.source in names]
        for experiment, facts in EXPERIMENTS.items():
            if self.campaign.trials(experiment):
                names += facts.further_tables
        if self.campaign.config.impedance_trajectory:
            names.append("gains")
        if any(name in names for name in CLAIMED):
            names.append("claims")
        return names

    @cached_property
    def all_tables(self) -> list[str]:
        """All tables of results."""
        return self.tables(*self.table_names)

    def tables(self, *names: str) -> list[str]:
        """Those of these tables that the campaign has."""
        present = [name for name in self.table_names if name in names]
        return [f"{self.results}/tables/{name}.csv" for name in present]

    @cached_property
    def tables_for_paper(self) -> list[str]:
        """The tables for a paper, in LaTeX and in Markdown."""
        names = [name for table, name in ON_PAPER.items() if table in self.table_names]
        if self.component_summaries:
            names.append("components")
        of_latex = [f"{self.results}/tables/latex/{name}.tex" for name in names]
        return of_latex + [f"{self.results}/tables/markdown/{name}.md" for name in names]

    @cached_property
    def component_summaries(self) -> list[str]:
        """The tables of the measured components, over trials."""
        return self.tables(*(f"{component}_summary" for component in COMPONENTS))

    @cached_property
    def fits_for_findings(self) -> list[str]:
        """The fits of single trials that have columns for findings alone."""
        files = []
        for name, described in described_tables_by_name().items():
            if described.of_fits:
                files += self.rows(name)
        return files

    @property
    def trials_for_findings(self) -> list[str]:
        """The trials of these fits."""
        return [Path(file).stem for file in self.fits_for_findings]

    def places_in(self, table: str) -> dict[str, dict[str, str]]:
        """Joint and side of the trials that have rows in a table."""
        trials = {Path(file).stem for file in self.rows(table)}
        return {trial: place for trial, place in self.campaign.places.items() if trial in trials}

    # ---- Figures

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
        return [*files, f"{self.results}/figures/captions.md"] if files else []

    def tables_beside(self, figure: str) -> list[str]:
        """The tables that a figure shows beside its first one: none, one or two."""
        return [f"{self.results}/tables/{table}.csv" for table in FIGURES[figure].beside]

    def results_in_figure(self, figure: str) -> list[str]:
        """The results of single trials that a figure shows; the refused ones are named below it."""
        if figure == "fig4":
            return []  # one trial, without which it is not drawn
        if figure == "fig7":
            example = response_example(self.campaign)
            condition = {} if example is None else example.model_dump()
            return self.rows("response", matching(self.campaign, condition))
        table = FIGURES[figure].table
        if table in EXPERIMENTS["walking"].further_tables:
            return self.crossings(self.campaign.trials("walking")) + self.rows("walking")
        if table in DERIVED:
            return self.rows(DERIVED[table].source)
        return self.rows(table)
