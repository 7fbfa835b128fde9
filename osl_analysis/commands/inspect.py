"""What files of any laboratory hold: one file as lines for a terminal, all recordings of a folder as a table.

Texts from files are untrusted. They are escaped when they are printed.
"""

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from osl_analysis.errors import InputError, printable
from osl_analysis.files import atomic_path
from osl_analysis.ingest.known_formats import FORMATS, NOT_READ, SUFFIXES, recognise
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.raw_files import check_file
from osl_analysis.ingest.recording import Recording
from osl_analysis.quality.checks import Commanded
from osl_analysis.quality.settings import QualityRules
from osl_analysis.quality.verdict import CHECKS, examine, fails, validate_rules
from osl_analysis.trial import Trial

LONGEST = 60  # characters of a name that are printed
LISTED = (*NOT_READ, *SUFFIXES)
"""Endings of the files that `samples` lists."""


def inspect_file(path: Path) -> Overview:
    """What a file holds.

    Raises
    ------
    InputError
        The file is missing, empty, damaged beyond reading, or of no format that is read.
    """
    check_file(path)
    return FORMATS[recognise(path)].inspect(path)


def overview_text(overview: Overview) -> str:
    """The overview as lines for a terminal."""
    lines = [f"format: {overview.format}", *(f"{name}: {shortened(fact)}" for name, fact in overview.facts.items()), ""]
    lines += [channel_text(channel) for channel in overview.channels]
    lines += ["", *(f"! {printable(remark)}" for remark in (*overview.remarks, *overview.open))]
    return "\n".join(lines).rstrip()


def channel_text(channel: RecordedChannel) -> str:
    """One channel on one line: kind, name, unit, samples, rate, note, type."""
    name = " ".join(shortened(part) for part in channel.address.values())
    rate = f" at {channel.rate:.6g} Hz" if channel.rate else ""
    unit = f" [{shortened(channel.unit)}]" if channel.unit else ""
    notes = "".join(f"; {printable(note)}" for note in (channel.note, channel.type) if note)
    return f"{shortened(channel.kind):<14} {name}{unit}  {channel.count} samples{rate}{notes}"


def shortened(text: str) -> str:
    """Text of a file for the terminal: printable, and not longer than a line can hold."""
    safe = printable(text)
    return safe if len(safe) <= LONGEST else f"{safe[:LONGEST]}..."


def write_samples(folder: Path, rules: QualityRules, output: Path, made_by: str) -> None:
    """The table of `samples_table` as a Markdown page that names the command that made it."""
    table = samples_table(folder, rules)
    page = f"# What recordings made by others hold\n\nMade by `{made_by}`.\n\n{table}\n"
    with atomic_path(output) as temporary:
        temporary.write_text(page, encoding="utf-8")


def samples_table(folder: Path, rules: QualityRules) -> str:
    """Markdown: a row per recording below a folder, with what it holds and what ingest and the quality checks say.

    Raises
    ------
    InputError
        The folder has no recordings.
    """
    validate_rules(rules)
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in LISTED)
    if not paths:
        raise InputError(f"{folder}: no recordings below it ({', '.join(LISTED)}); name another folder")
    rows = ["| file | format | holds | ingest and quality |", "|---|---|---|---|"]
    for path in paths:
        cells = [cell.replace(f"{path}: ", "") for cell in (str(path.relative_to(folder)), *row_of(path, rules))]
        rows.append(f"| {' | '.join('<br>'.join(escaped(line) for line in cell.splitlines()) for cell in cells)} |")
    return "\n".join(rows)


def row_of(path: Path, rules: QualityRules) -> tuple[str, str, str]:
    """A file's format, what it holds, and what is said to it."""
    try:
        overview = inspect_file(path)
    except InputError as error:
        return "", "", f"refused: {error}"
    has_topics = any("topic" in channel.address for channel in overview.channels)
    holds = topic_lines(overview) if has_topics else kind_lines(overview)
    judged = capture_says(path, overview.format, rules) if FORMATS[overview.format].is_capture else ()
    return overview.format, "\n".join(holds), "\n".join([*overview.remarks, *overview.open, *judged])


def topic_lines(overview: Overview) -> Iterator[str]:
    """The topics of a log; those of the same timing and size on one line."""
    numbers = Counter(channel.address["topic"] for channel in overview.channels if "field" in channel.address)
    alike: dict[str, dict[str, None]] = {}
    for channel in overview.channels:
        topic, rate = channel.address["topic"], f" at {channel.rate:.4g} Hz" if channel.rate else ""
        size = f"{channel.count} messages{rate}, numbers in each: {numbers[topic]}"
        alike.setdefault("; ".join(filter(None, [size, channel.note])), {})[topic] = None
    yield from (f"{', '.join(topics)}: {size}" for size, topics in alike.items())


def kind_lines(overview: Overview) -> Iterator[str]:
    """How many channels a file has of each kind and rate, and how much of them is missing."""
    yield from (f"{name}: {overview.facts[name]}" for name in ("frames", "rows") if name in overview.facts)
    for kind, rate in dict.fromkeys((channel.kind, channel.rate) for channel in overview.channels):
        alike = [channel for channel in overview.channels if (channel.kind, channel.rate) == (kind, rate)]
        missing = sum(channel.missing for channel in alike) / len(alike)
        count = f"{len(alike)} x {kind}{f' at {rate:g} Hz' if rate else ''}"
        notes = [f"{missing:.1%} missing"] * bool(missing) + [c.note for c in alike if kind == "plate"]
        yield "; ".join([count, *notes])


def capture_says(path: Path, name: str, rules: QualityRules) -> Iterator[str]:
    """What ingest and the quality checks say to all of a capture; where it is refused, to all but its plates."""
    plates = FORMATS[name].source.model_fields.get("plates")
    for options in [{}, {"plates": "none"}] if plates and plates.default == "all" else [{}]:
        source = FORMATS[name].source.model_validate({"format": name, **options})
        try:
            recording = FORMATS[name].read(path, source)
        except InputError as error:
            yield from [] if options else [f"refused: {error}"]
            continue
        yield "ok without plates" if options else "ok"
        yield from [*recording.warnings, *failures(recording, rules)]
        return


def failures(recording: Recording, rules: QualityRules) -> Iterator[str]:
    """The checks that a recording does not pass, with value, threshold and remark."""
    trial = Trial("sample", recording.samples, dict(recording.facts))
    for name, finding in examine(trial, "ingest_only", Commanded((), (), 1)).items():
        limit, unit = rules.rule(name).limit, CHECKS[name].unit
        if finding.value is not None and fails(name, finding.value, limit):
            yield f"{name}: {finding.value:.4g} {unit}, threshold {limit:g} ({finding.remark})"


def escaped(text: str) -> str:
    """Text of a stranger's file for a Markdown table: nothing in it can be markup, HTML or a line of its own."""
    printable = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    plain = printable.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_\[\]|#~$])", r"\\\1", plain)
