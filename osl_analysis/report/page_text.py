"""Sentences of the first screen of the page: what was recorded, what is doubtful, how it was
fitted, what nobody stated."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.dictionary import own_yaml
from osl_analysis.judge.summary_findings import CampaignFinding
from osl_analysis.report.headline_statistics import include_bench_errors
from osl_analysis.report.methods import response_text
from osl_analysis.report.reported_trial import ReportedTrial
from osl_analysis.report.typography import printed
from osl_analysis.stats.repeats import DOUBTFUL, RULE_OF_MEANS, doubtful_count

WALKING_GROUPS = "walking groups"  # subject of a finding in a summary that is not on a trial
MOST_CAUSES = 3  # in a sentence
LAW = "τ = Kθ + Bθ̇ + Iθ̈"
ASSUMED_SETTINGS: dict[str, str] = own_yaml(Path(__file__).with_name("assumed_settings.yaml"))
NO_DEVICE = "Without a parameter file nothing is compared with a device's gains or belt."


def what_was_done(trials: Sequence[ReportedTrial], about: Mapping[str, str]) -> str:
    """The campaign in a sentence: numbers of trials by joint and experiment."""
    rows = [trial.row for trial in trials]
    numbers = Counter(row["experiment"] for row in rows)
    counts = []
    for experiment, n in numbers.items():
        text = f"{n} {experiment.replace('_', ' ')}"
        if experiment == "walking":
            text += crossings_text(trials, n)
        counts.append(text)

    suffixes = dict.fromkeys(
        Path(row.get(role) or "").suffix for row in rows for role in ("log", "mocap")
    )
    files = in_words([suffix[1:].upper() for suffix in suffixes if suffix])
    made_of = f"{files} files, {about['recorded']}" if files else about["recorded"]
    joints = joints_of(trials)
    of_joints = f" of the {joints}" if joints else ""
    noun = "trial" if len(trials) == 1 else "trials"
    experiment = ""
    by_experiment = f": {in_words(counts)}"
    if len(counts) == 1:
        experiment = f"{counts[0].partition(' ')[2]} "
        by_experiment = ""
    what = f"{len(trials)} {about['data']} {experiment}{noun}{of_joints}"
    return f"{what}{by_experiment} ({made_of})."


def crossings_text(trials: Sequence[ReportedTrial], n: int) -> str:
    """How many of the `n` crossings are used and perturbed; empty if all are of one kind."""
    used = [t for t in trials if t.row["experiment"] == "walking" and not t.left_out]
    n_perturbed = sum(bool(trial.row.get("perturbed")) for trial in used)
    if len(used) < n:
        return f" ({len(used)} used, {n_perturbed} of them perturbed)"
    return f" ({n_perturbed} perturbed)" if 0 < n_perturbed < n else ""


def joints_of(trials: Sequence[ReportedTrial]) -> str:
    """The joints, each once, with their sides."""
    joints = []
    for trial in trials:
        joints.append(" ".join(filter(None, [trial.row.get("side"), trial.row.get("joint")])))
    return in_words([joint for joint in dict.fromkeys(joints) if joint])


def in_words(parts: Sequence[str]) -> str:
    """Parts of a sentence as `A, B and C`."""
    return " and ".join(filter(None, [", ".join(parts[:-1]), *parts[-1:]]))


def verdicts_text(trials: Sequence[ReportedTrial], findings: Sequence[CampaignFinding]) -> str:
    """A few sentences: how many trials are doubtful or not used, and why, and what could not be
    checked. `findings` are those of a summary on trials and walking groups."""
    used = [trial for trial in trials if not trial.left_out]
    sentences = []
    for verdict in ("doubtful", "doubtful in part", "flagged"):
        sentences.append(verdict_sentence(verdict, used, len(trials)))
    if used and not any(sentences):
        sentences.append("No trial is doubtful.")
    sentences += [left_out_sentence(trials), *finding_sentences(findings)]
    return printed(" ".join(filter(None, sentences)))


def verdict_sentence(verdict: str, used: Sequence[ReportedTrial], n_trials: int) -> str:
    """How many of the used trials have a verdict, and their most frequent causes; empty for
    none."""
    causes_of_trials = [trial.causes_of(verdict) for trial in used]
    n = sum(bool(causes) for causes in causes_of_trials)
    if not n:
        return ""
    by_cause = Counter(cause for causes in causes_of_trials for cause in causes)
    causes = []
    for cause, n_of_cause in by_cause.most_common(MOST_CAUSES):
        causes.append(cause if n_of_cause == n else f"{cause} ({n_of_cause})")
    verb = "is" if n == 1 else "are"
    return f"{n} of {n_trials} trials {verb} {verdict}: {', '.join(causes)}."


def left_out_sentence(trials: Sequence[ReportedTrial]) -> str:
    """How many trials were refused, and how many excluded."""
    by_verdict = Counter(trial.verdict for trial in trials if trial.left_out)
    counts = [f"{n} {'was' if n == 1 else 'were'} {verdict}" for verdict, n in by_verdict.items()]
    return f"{in_words(counts)}." if counts else "Nothing was refused or excluded."


def finding_sentences(findings: Sequence[CampaignFinding]) -> list[str]:
    """Why the K of walking is doubtful, and what could not be checked on any trial."""
    of_groups = []
    unchecked = []
    for finding in findings:
        if finding.subject == WALKING_GROUPS and finding.verdict == "doubtful":
            of_groups.append(finding.cause)
        if finding.verdict == "not checked" and finding.cause not in unchecked:
            unchecked.append(finding.cause)
    sentences = []
    if of_groups:
        sentences.append(f"The walking K is doubtful: {', '.join(of_groups)}.")
    if len(unchecked) > MOST_CAUSES:
        n_more = len(unchecked) - MOST_CAUSES
        unchecked = [*unchecked[:MOST_CAUSES], f"{n_more} more"]
    if unchecked:
        sentences.append(f"Not checked, and in no interval: {in_words(unchecked)}.")
    return sentences


def method_text(settings: Mapping[str, Any], tables: Mapping[str, pl.DataFrame]) -> str:
    """The equation and how it is fitted, beside the first figure; empty where no impedance was
    estimated."""
    sentences = []
    if "impedance" in tables:
        cutoff = settings["dynamometer"]["cutoff_hz"]
        sentences.append(
            f"{LAW} + τ₀ is fitted to angle and torque behind a zero-phase low-pass of"
            f" {cutoff:g} Hz."
        )
    if "walking_summary" in tables:
        response = response_text(tables["walking_groups"])
        window_ms = 1e3 * settings["walking"]["window_s"]
        sentences.append(
            f"While walking {LAW} is fitted to {response}, perturbed less unperturbed, in the"
            f" {window_ms:g} ms after the onset."
        )
    if not sentences:
        return ""
    sentences.append("τ resists the motion. Brackets are intervals of 95 %.")
    if include_bench_errors(tables) is False:
        sentences.append("Errors that all trials of the bench share are not in them.")
    judged = [table for table in tables.values() if DOUBTFUL in table.columns]
    if any(doubtful_count(table)[0] for table in judged):
        sentences.append(RULE_OF_MEANS)
    return " ".join(sentences)


def assumed_text(states: pl.DataFrame) -> str:
    """The settings of `settings.csv` that are used but not stated, and whether no device is; empty
    if all are."""
    # numbers and nulls become text
    states = states.cast(dict.fromkeys(("setting", "state", "value"), pl.String))
    assumed = []
    for name, value in states.filter(state="assumed")["setting", "value"].iter_rows():
        without_words = name if value.startswith("{") else f"{name} {value}"
        text = ASSUMED_SETTINGS.get(name, without_words)
        assumed.append(text.format(value=value.removesuffix(".0")))
    sentences = []
    if assumed:
        sentences.append(f"Assumed, since nobody stated it: {in_words(assumed)}.")
    if any(states["state"].eq("none") & states["setting"].eq("parameters")):
        sentences.append(NO_DEVICE)
    return " ".join(sentences)
