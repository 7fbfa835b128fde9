"""What the page shows of a whole campaign: counts, headline numbers, the table of trials, and what was left out."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.report.trial_page import UNKNOWN, ReportedTrial, number_cell, printed, shown
from osl_analysis.summary.text import AMPLITUDES, decimals, fixed, rounded_by, told_apart, trials_text

QUANTITIES = ["VAF", "K", "B", "I"]  # numbers of the table of trials


def trial_rows(trials: Sequence[ReportedTrial]) -> list[dict[str, Any]]:
    differing = differing_conditions(trials)
    return [trial_row(trial, differing) for trial in trials]


def differing_conditions(trials: Sequence[ReportedTrial]) -> set[str]:
    """Columns of the sheet whose entries differ between trials; the others would say the same in every row."""
    return {name for trial in trials for name in trial.row if trial.row[name] != trials[0].row.get(name)}


def trial_row(trial: ReportedTrial, differing: Collection[str]) -> dict[str, Any]:
    facts, estimates = EXPERIMENTS[trial.row["experiment"]], trial.estimates()
    return {
        "name": trial.name,
        "experiment": trial.row["experiment"],
        "condition": trial.condition(differing),
        "verdict": trial.verdict,
        "doubt": doubt_line(trial),
        "numbers": [number_cell(estimates, column) for column in ("VAF", *facts.impedance)],
    }


def doubt_line(trial: ReportedTrial) -> str:
    """Why a trial is doubtful or left out, for a cell of the table."""
    if trial.left_out:
        return trial.left_out[0]
    if not trial.doubtful:
        return ""
    rows = trial.main.filter(trial.main["doubtful"].fill_null("") != "")
    parts = ["whole trial"] * len(rows)
    if "amplitude_deg" in rows.columns:
        parts = ["all amplitudes" if deg is None else f"{deg:g} deg" for deg in rows["amplitude_deg"]]
    return "; ".join(f"{part}: {text}" for part, text in zip(parts, rows["doubtful"], strict=True))


def headline_rows(summary: Mapping[str, Any]) -> list[dict[str, str]]:
    """The headline numbers of a summary (`summary.json`) beside those that the paper's draft prints."""
    return [headline_row(number) for number in summary["numbers"].values()]


def headline_row(number: Mapping[str, Any]) -> dict[str, str]:
    digits = decimals(number["value"], *rounded_by(number))
    interval = UNKNOWN
    if number["low"] is not None:
        finer = told_apart(number["low"], number["high"], digits)
        interval = f"{fixed(number['low'], finer)} to {fixed(number['high'], finer)} ({number['interval']})"
    elif number.get("amplitudes_low") is not None:
        interval = " to ".join(fixed(number[key], digits) for key in AMPLITUDES) + " (single amplitudes)"
    return {
        "meaning": number["meaning"],
        "value": fixed(number["value"], digits),
        "unit": printed(number["unit"]),
        "interval": interval,
        "n": trials_text(number),
        "draft": UNKNOWN if number["draft"] is None else f"{number['draft']:g}",
    }


def left_out(trials: Sequence[ReportedTrial]) -> list[dict[str, Any]]:
    return [
        {"name": trial.name, "verdict": trial.verdict, "reason": reason}
        for trial in trials
        for reason in trial.left_out
    ]


def counts(trials: Sequence[ReportedTrial]) -> dict[str, int]:
    found = Counter(trial.verdict for trial in trials)
    return {verdict: found[verdict] for verdict in ("used", "doubtful", "excluded", "refused")}


def choices(trials: Sequence[ReportedTrial]) -> dict[str, list[str]]:
    experiments = dict.fromkeys(shown(trial.row["experiment"]) for trial in trials)
    return {"experiment": list(experiments), "verdict": [name for name, number in counts(trials).items() if number]}
