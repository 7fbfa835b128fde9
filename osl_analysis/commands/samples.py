"""What ingest says to every recording in a folder, read with a source file that asks for all of it."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.ingest.c3d_capture import read_capture
from osl_analysis.ingest.csv_source import NexusSource
from osl_analysis.ingest.mcap_log import read_log
from osl_analysis.ingest.nexus_capture import read_nexus
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_file import C3dSource, LogChannel, McapSource, TimeSource
from osl_analysis.quality.names import CHECKS
from osl_analysis.quality.protocol import Commanded
from osl_analysis.quality.settings import QualityRules
from osl_analysis.quality.verdict import examine, fails
from osl_analysis.trial import Trial

NOWHERE = "?"  # names no topic and no field: asked for it, ingest lists what there is
CARRIER = "current"  # the canonical column that stands for any number of a log
STAMP = ("header.stamp.sec", "header.stamp.nanosec")
CSV = "not tried: what a column of a CSV file means only a source file can say"


def write_samples(folder: Path, rules: QualityRules, output: Path, made_by: str) -> None:
    """The table of `samples_table` as a Markdown page that names the command that made it."""
    table = samples_table(folder, rules)
    page = f"# What ingest says to recordings made by others\n\nMade by `{made_by}`.\n\n{table}\n"
    with atomic_path(output) as temporary:
        temporary.write_text(page, encoding="utf-8")


def samples_table(folder: Path, rules: QualityRules) -> str:
    """Markdown: a row per C3D, MCAP or CSV file below a folder, with what ingest and the quality checks say.

    Raises
    ------
    InputError
        The folder has no such files.
    """
    paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in READERS)
    if not paths:
        raise InputError(f"{folder}: no C3D, MCAP or CSV files below it; give a folder with recordings")
    rows = ["| file | ingest | quality: checks that do not pass |", "|---|---|---|"]
    for path in paths:
        said = list(READERS[path.suffix.lower()](path, rules))
        ingest, quality = (
            "<br>".join(escaped(part.replace(f"{path}: ", "")) for part in parts if part)
            for parts in zip(*said, strict=True)
        )
        rows.append(f"| {escaped(str(path.relative_to(folder)))} | {ingest} | {quality} |")
    return "\n".join(rows)


def read_c3d_sample(path: Path, rules: QualityRules) -> Iterator[tuple[str, str]]:
    """All of a capture; where that is refused, what is left without its plates."""
    try:
        yield capture_text(path, rules, C3dSource(format="c3d"))
    except InputError as error:
        yield f"refused: {error}", ""
        try:
            said, quality = capture_text(path, rules, C3dSource(format="c3d", plates=()))
        except InputError:
            return
        yield f"without plates: {said}", quality


def capture_text(path: Path, rules: QualityRules, source: C3dSource) -> tuple[str, str]:
    """What a capture holds, and which checks it does not pass."""
    return recording_text(read_capture(path, source), rules)


def recording_text(recording: Recording, rules: QualityRules) -> tuple[str, str]:
    """What a recording of motion capture holds, and which checks it does not pass."""
    columns, facts = recording.samples.columns, recording.facts
    markers = [c for c in columns if c.startswith("marker_") and c.endswith("_x")]
    frames, rate = recording.samples.select(markers[:1] or "time").drop_nulls().height, facts["frame_rate_hz"]
    plates = [f"plate {plate['plate']} of type {plate['type']}" for plate in facts["plates"]]
    fast = rate * facts["samples_per_frame"]
    hidden = [float(recording.samples[c].drop_nulls().is_nan().mean() or 0.0) for c in markers]  # type: ignore[arg-type]
    said = [f"ok: {len(markers)} markers, {frames} frames at {rate:g} Hz"]
    if any(hidden):
        said.append(f"{100 * np.mean(hidden):.1f} % hidden")
    said += [f"{', '.join(plates)} at {fast:g} Hz"] * bool(plates)
    return "; ".join([*said, *recording.warnings]), failures(recording, rules)


def read_mcap_sample(path: Path, rules: QualityRules) -> Iterator[tuple[str, str]]:
    """Every topic of a log, by the first of its fields that holds a number; topics with one answer together."""
    topics, refusal = listed(path, one_field(NOWHERE, NOWHERE), "; the file has ")
    if not topics:
        yield f"refused: {refusal}", ""
    answers: dict[str, list[str]] = {}
    remarks: dict[str, None] = {}
    for topic in topics:
        said, warnings = topic_text(path, topic)
        answers.setdefault(said, []).append(topic)
        remarks |= dict.fromkeys(warnings)
    for said, alike in answers.items():
        yield f"{', '.join(alike)}: {said}", ""
    yield "; ".join(remarks), ""


def topic_text(path: Path, topic: str) -> tuple[str, Sequence[str]]:
    """Messages, rate and fields of a topic, and ingest's warnings; or why it is refused."""
    fields, refusal = listed(path, one_field(topic, NOWHERE), "; it has ")
    refusals = [] if fields else [refusal]
    for clock in ("header", "log") if set(STAMP) <= set(fields) else ("log",):
        recording, refusal = first_number(path, topic, fields, clock)
        if recording:
            by_header = "".join(f"; not by header time: {reason}" for reason in refusals)
            return f"ok: {rate_text(recording, clock)}, {len(fields)} fields{by_header}", recording.warnings
        refusals += [refusal] * bool(refusal)
    reason = refusals[0].replace(f"topic '{topic}'", "the topic").replace(f"topic {topic}", "the topic")
    return f"refused: {reason}", ()


def first_number(path: Path, topic: str, fields: list[str], clock: str) -> tuple[Recording | None, str]:
    """The recording of a topic's first field that is a number, or else the first refusal."""
    refusal = ""
    for field in sorted(fields, key=lambda name: name in STAMP):
        try:
            return read_log(path, one_field(topic, field, clock)), ""
        except InputError as error:
            refusal = refusal or str(error).replace(f"topic {topic}", "the topic")
    return None, refusal


def rate_text(recording: Recording, clock: str) -> str:
    """Messages, their median rate [Hz] and the longest step [s]."""
    steps = np.diff(recording.samples["time"].to_numpy())
    if not steps.size:
        return "1 message"
    rate = f"{1 / np.median(steps):.4g} Hz by {clock} time, longest step {steps.max():.4g} s"
    return f"{steps.size + 1} messages, {rate}"


def one_field(topic: str, field: str, clock: str = "log") -> McapSource:
    """A source file for one field of one topic."""
    time = TimeSource.model_validate({"source": clock})
    return McapSource(format="mcap", time=time, channels={CARRIER: LogChannel(topic=topic, field=field, unit="A")})


def listed(path: Path, source: McapSource, marker: str) -> tuple[list[str], str]:
    """What ingest lists when it refuses a topic or field that is not there, and the refusal itself."""
    try:
        read_log(path, source)
    except InputError as error:
        names = str(error).partition(marker)[2].split(", ")
        known = [re.sub(r"\[0\.\.\d+\]", "[0]", name) for name in names]
        return [name for name in known if name not in ("", "none") and not name.startswith("...")], str(error)
    return [], "nothing to list"


def read_csv_sample(path: Path, rules: QualityRules) -> Iterator[tuple[str, str]]:
    """All trajectories of a Nexus export; any other CSV file has no units of its own."""
    try:
        yield recording_text(read_nexus(path, NexusSource(format="nexus_csv")), rules)
    except InputError as error:
        yield (CSV if "no section of a Nexus export" in str(error) else f"refused: {error}"), ""


READERS = {".c3d": read_c3d_sample, ".mcap": read_mcap_sample, ".csv": read_csv_sample}


def failures(recording: Recording, rules: QualityRules) -> str:
    """The checks that a recording does not pass, with value, threshold and remark."""
    trial = Trial("sample", recording.samples, dict(recording.facts))
    said = []
    for name, found in examine(trial, "recording", Commanded((), (), 1)).items():
        limit, unit = rules.rule(name).limit, CHECKS[name].unit
        if found.value is not None and fails(name, found.value, limit):
            said.append(f"{name}: {found.value:.4g} {unit}, threshold {limit:g} ({found.remark})")
    return "; ".join(said)


def escaped(text: str) -> str:
    """Text of a stranger's file for a Markdown table: nothing in it can be markup, HTML or a line of its own."""
    printable = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    plain = printable.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_\[\]|#~$])", r"\\\1", plain)
