# SPDX-License-Identifier: Apache-2.0
"""Recordings on their way in: ingest and quality control of one trial in one job, the samples being
examined while they are in memory; and what files of any laboratory hold. Texts from files are
untrusted: they are escaped when they are printed."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from osl_analysis.base.errors import advise, first_of, printable, shortened
from osl_analysis.base.table import OUTCOME, write_table
from osl_analysis.base.trial import Trial, write_trial
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.draft.overview import inspect_recording
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel
from osl_analysis.ingest import raw_files
from osl_analysis.ingest.quality import Commanded, measure_quality
from osl_analysis.judge.recording_checks import measured_table
from osl_analysis.signals.grid import with_clocks

MOST_CHANNELS = 200  # that are printed of a file


def checked_trial(
    row: Mapping[str, Any],
    raw_folder: Path,
    sources_folder: Path,
    needed_columns: Sequence[str] = (),
) -> Trial:
    """The trial of one row of the sheet, from its files relative to `raw_folder`, with the
    `needed_columns`; of a bench trial with the clocks of its devices, and, if its fit takes no
    windows, what lies within those of the sheet. Warns of what was remarkable while it was read."""
    trial = raw_files.trial_from_files(row, raw_folder, sources_folder)
    raw_files.check_columns(trial, row.get("experiment"), needed_columns)
    facts = EXPERIMENTS[row.get("experiment", "ingest_only")]
    windows = row.get("windows")
    if facts.place == "bench":
        assert facts.fit is not None
        if windows and not facts.fit.windows:
            trial = trial.within(windows)
        trial = with_clocks(trial)
    # those of the log tell all
    if facts.place == "walkway" and not needed_columns:
        raw_files.check_markers(trial, row["experiment"])
    for text in trial.provenance["warnings"]:
        advise(text)
    return trial


def ingest_and_check(
    row: Mapping[str, Any],
    raw_folder: Path,
    sources_folder: Path,
    needed_columns: Sequence[str],
    commanded: Commanded,
    trial: Path,
    quality: Path,
    data: str = "",
) -> None:
    """Write the trial of one row of the sheet, and to `quality` a row for each check, without
    limits and verdicts."""
    record = checked_trial(row, raw_folder, sources_folder, needed_columns)
    write_trial(record, trial)
    measured = measure_quality(record, row["experiment"], commanded, row.get("windows") or "")
    write_table(measured_table(record.name, measured).with_columns(**OUTCOME), quality, data)


def inspect_file(path: Path) -> Overview:
    """List what a recording holds. Raises InputError, which names the file."""
    raw_files.check_file(path)
    return inspect_recording(path)


def overview_text(overview: Overview) -> str:
    """The facts on a file, a line per channel (kind, name, unit, samples, rate, note, type) of the
    first `MOST_CHANNELS`, and the remarks."""
    facts = [f"{name}: {short(fact)}" for name, fact in overview.facts.items()]
    channels = [channel_line(channel) for channel in overview.channels]
    lines = first_of(channels, MOST_CHANNELS, ", which --json lists")
    remarks = [f"! {printable(remark)}" for remark in (*overview.remarks, *overview.open)]
    parts = [f"format: {overview.format}", *facts, "", *lines, "", *remarks]
    return "\n".join(parts).rstrip()


def overview_facts(overview: Overview) -> dict[str, Any]:
    """The facts on a file for other programs, rates in Hz."""
    channels = [
        {
            "kind": channel.kind,
            **channel.address,
            "unit": channel.unit or None,
            "samples": channel.count,
            "rate_hz": channel.rate,
            "note": channel.note or None,
        }
        for channel in overview.channels
    ]
    return {
        "format": overview.format,
        "facts": overview.facts,
        "channels": channels,
        "remarks": [*overview.remarks, *overview.open],
    }


def channel_line(channel: RecordedChannel) -> str:
    """A channel in one line."""
    parts = [channel.name] if channel.kind == "marker" else channel.address.values()
    text = f"{short(channel.kind):<14} {' '.join(map(short, parts))}"
    if channel.unit:
        text += f" [{short(channel.unit)}]"
    if channel.kind != "plate":
        text += f"  {channel.count} samples"
    if channel.rate:
        text += f" at {channel.rate:.6g} Hz"
    if channel.note:
        text += f"; {printable(channel.note)}"
    return text


def short(text: str) -> str:
    """Text of a file for the terminal: printable, and not longer than a line can hold."""
    return shortened(printable(text))
