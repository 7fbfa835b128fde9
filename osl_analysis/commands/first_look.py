"""A look at the first recordings of a new campaign: what they give, before all are analysed."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.campaign.campaign_trials import Campaign, open_campaign
from osl_analysis.campaign.configuration import Config, read_config
from osl_analysis.commands import fit as fits
from osl_analysis.commands.estimates import estimates_text
from osl_analysis.commands.fit_results import Fit
from osl_analysis.commands.trials import checked_trial
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import OslAnalysisError, unexpected
from osl_analysis.files import CAMPAIGN, write_text
from osl_analysis.judge.finding import Grade
from osl_analysis.judge.words import finding_text
from osl_analysis.signals.grid import uniform_signals
from osl_analysis.spectral.stepped_sine import Likeness, find_segments, stated_protocol
from osl_analysis.trial import Trial


@dataclass(frozen=True)
class FirstLook:
    """What the first trial of an experiment and source file gives."""

    trial: str
    experiment: str
    lines: Sequence[str]  # its estimates and findings, or why it is refused
    doubts: Sequence[str] = ()
    warnings: Sequence[str] = ()  # of its recordings, as rows that were left out
    is_refused: bool = False

    @property
    def title(self) -> str:
        """The trial, and whether it is refused or doubtful."""
        result = "doubtful" if self.doubts else "ok"
        if self.is_refused:
            result = "refused"
        return f"first trial of experiment {self.experiment}, {self.trial}: {result}"

    @property
    def text(self) -> str:
        """All of it."""
        return "\n  ".join([self.title, *self.lines, *self.warnings])


def first_look(folder: Path, is_new: bool = False) -> Iterator[FirstLook]:
    """What the first trial of each experiment and source file of a folder's campaign gives.

    Of a new campaign, the stepped sine of the first trial that has one goes into the configuration
    as a comment. Nothing else is left behind.
    """
    with chdir(folder):
        config = read_config(CAMPAIGN)
        campaign = open_campaign(config, None)
        for trial, experiment in first_trials(campaign):
            try:
                recorded = checked_trial(campaign.recording(trial), config.raw_data, config.sources)
                if is_new and EXPERIMENTS[experiment].stepped_sine:
                    with suppress(OslAnalysisError):  # the fit says why
                        is_new = not note_protocol(recorded, config)
                row = campaign.row(trial)
                fitted = fit_of_row(recorded, row, campaign.device(trial), CAMPAIGN)
            except OslAnalysisError as error:
                yield FirstLook(trial, experiment, [str(error)], is_refused=True)
            # a fault of the program in one recording must not hide the others
            except Exception as fault:
                yield FirstLook(trial, experiment, [unexpected(fault)], is_refused=True)
            else:
                text = estimates_text(fitted.table, fitted.findings)
                warnings = [f"warning: {text}" for text in recorded.provenance["warnings"]]
                yield FirstLook(trial, experiment, text.splitlines(), doubts_of(fitted), warnings)


def doubts_of(fitted: Fit) -> list[str]:
    """The doubts about each row of a fit, in words."""
    doubts = []
    for row, findings in zip(fitted.table.to_dicts(), fitted.findings, strict=False):
        for finding in findings:
            if finding.grade is Grade.DOUBTS:
                doubts.append(finding_text(finding, row))
    return doubts


def first_trials(campaign: Campaign) -> list[tuple[str, str]]:
    """The first trial of each experiment on a bench and source file, with its experiment."""
    first: dict[tuple[str, str], str] = {}
    on_bench = [name for name, facts in EXPERIMENTS.items() if facts.place == "bench"]
    for trial in campaign.trials(*on_bench):
        row = campaign.row(trial)
        first.setdefault((row["experiment"], row["log_source"] or row["mocap_source"]), trial)
    return [(trial, experiment) for (experiment, _), trial in first.items()]


def note_protocol(trial: Trial, config: Config) -> bool:
    """Write the stepped sine of a trial into the configuration, as a comment; whether it has
    one."""
    angle = uniform_signals(trial, ["theta"], config.dynamometer.gap_limits)
    known = Likeness(angle.time, angle["theta"], stated_protocol(None, None, None, None))
    if known.kind != "stepped sine":
        return False
    segments = sorted(find_segments(known), key=lambda segment: segment.frequency_hz)
    cycles = {segment.frequency_hz: segment.cycles for segment in segments}
    amplitudes = {round(np.rad2deg(segment.commanded or 0.0), 1) for segment in segments}
    protocol = {
        "amplitudes_deg": sorted(amplitudes),
        "frequencies_hz": list(cycles),
        "cycles": list(cycles.values()),
    }
    lines = [f"# dynamometer:  # as {trial.name} was recorded"]
    for name, values in protocol.items():
        lines.append(f"#   {name}: [{', '.join(f'{value:.3g}' for value in values)}]")
    text = CAMPAIGN.read_text(encoding="utf-8")
    write_text(CAMPAIGN, text.replace("# dynamometer:\n", "\n".join([*lines, ""])))
    return True


def fit_of_row(trial: Trial, row: Mapping[str, Any], device: Path | None, config: Path) -> Fit:
    """The fit of a trial in memory, by its row of a sheet, as in the workflow. `device` is its
    parameter file."""
    experiment = str(row["experiment"])
    condition: Any = {column: row.get(column) for column in fits.job_of(experiment).sheet}
    if experiment == "impedance":
        K_d, B_d = (None if row[name] is None else float(row[name]) for name in ("K_d", "B_d"))
        condition = DesiredImpedance(row["controller"], K_d, B_d)
    chosen = fits.fit_settings(experiment, config)
    return fits.fit_trial(experiment, trial, device, *chosen, condition, row.get("windows"))
