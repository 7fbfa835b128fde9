"""The page's table of trials."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.report.reported_trial import VERDICTS, ReportedTrial
from osl_analysis.report.shown_numbers import ShownEstimate, cell_text, shown_estimate


@dataclass(frozen=True)
class TrialRow:
    """A trial in the page's table of trials.

    Attributes
    ----------
    condition
        Those of its conditions that differ between trials.
    doubt
        Why it is left out, or doubtful.
    causes
        Of its verdict, each once.
    estimates
        VAF, stiffness, damping and inertia of the fit to all of it.
    """

    name: str
    experiment: str
    condition: str
    verdict: str
    doubt: str
    causes: Sequence[str]
    estimates: Sequence[ShownEstimate]


class LeftOutTrial(NamedTuple):
    """A reason why a trial is not used."""

    name: str
    verdict: str
    reason: str


@dataclass(frozen=True)
class TrialTable:
    """What the page shows of all trials.

    Attributes
    ----------
    rows
        The worst verdict first.
    counts
        Number of trials by verdict.
    choices
        Experiments and verdicts that the table can be filtered by.
    left_out
        Why trials are not used.
    """

    rows: Sequence[TrialRow]
    counts: Mapping[str, int]
    choices: Mapping[str, Sequence[str]]
    left_out: Sequence[LeftOutTrial]


def trial_table(trials: Sequence[ReportedTrial]) -> TrialTable:
    """The page's table of trials, and which are left out."""
    differing = set()
    for trial in trials:
        for name, value in trial.row.items():
            if value != trials[0].row.get(name):
                differing.add(name)
    counts = Counter(trial.verdict for trial in trials)
    worst_first = sorted(trials, key=lambda trial: -VERDICTS.index(trial.verdict))
    experiments = dict.fromkeys(cell_text(trial.row["experiment"]) for trial in trials)
    left_out = []
    for trial in trials:
        for reason in trial.left_out:
            left_out.append(LeftOutTrial(trial.name, trial.verdict, reason))
    return TrialTable(
        rows=[trial_row(trial, differing) for trial in worst_first],
        counts={verdict: counts[verdict] for verdict in VERDICTS},
        choices={
            "experiment": list(experiments),
            "verdict": [verdict for verdict in VERDICTS if counts[verdict]],
        },
        left_out=left_out,
    )


def trial_row(trial: ReportedTrial, differing: Collection[str]) -> TrialRow:
    """A row of the page's table of trials; of its conditions those that `differ` between trials."""
    fit_to_all = trial.main.row(-1, named=True) if len(trial.main) else {}
    estimates = []
    for column in ("VAF", *EXPERIMENTS[trial.row["experiment"]].impedance):
        estimates.append(shown_estimate(fit_to_all, column))
    # the text of the last row, which is of all of the trial, and where
    text_of: dict[str, str] = {}
    places_of: dict[str, list[str]] = {}
    for doubt in trial.doubts:
        if doubt.verdict == trial.verdict:
            text_of[doubt.cause] = doubt.text
            places_of.setdefault(doubt.cause, []).append(doubt.where)
    doubts = [f"{', '.join(places_of[cause])}: {text}" for cause, text in text_of.items()]
    return TrialRow(
        name=trial.name,
        experiment=trial.row["experiment"],
        condition=trial.condition(differing),
        verdict=trial.verdict,
        doubt=trial.left_out[0] if trial.left_out else "; ".join(doubts),
        causes=list(text_of),
        estimates=estimates,
    )
