"""What a log holds, in MCAP or CSV: channels with rates and gaps, and what is damaged or odd."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import is_number_cell, unpadded
from osl_analysis.formats.csv_text import Rows, delimiter_of, name_and_unit, read_lines, split_rows
from osl_analysis.formats.mcap.channel_reader import describe_message
from osl_analysis.formats.mcap.mcap_file import McapFile, read_mcap
from osl_analysis.formats.mcap.survey import ChannelSurvey, survey_channels
from osl_analysis.formats.messages.description import FieldDescription
from osl_analysis.ingest.overview import Overview, RecordedChannel, gaps_text, rate_of
from osl_analysis.ingest.stamps import check_not_set

MOST_FIELDS = 500  # of one topic
NANOSECOND = 1e-9
STAMP = "header."  # what every message of ROS has, and no signal is in
COMMENT = "#"
CLOCKS = ("time", "t", "timestamp", "state_time", "elapsed", "clock")  # how loggers call their time
NAMES = {"\t": "tab", " ": "space"}
MOST_WORDS = 5


def inspect_mcap(path: Path) -> Overview:
    """Topics with schema, encoding, rate and gaps by log time, every field of each, and what is damaged.

    Raises
    ------
    InputError
        The file is empty, no MCAP file or two logs, or unpacks to too much.
    """
    file = read_mcap(path)
    try:
        surveys = survey_channels(file)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    remarks = list(file.damage.all_remarks())
    remarks += [remark for survey in surveys for remark in clock_remarks(survey)]
    described = [(survey, fields_of(survey, remarks)) for survey in surveys]
    channels = [channel for survey, fields in described for channel in channels_of(survey, fields)]
    stamped = any(field.path.startswith(f"{STAMP}stamp") for _, fields in described for field in fields)
    settings = {"clock": "master", "time": {"source": "header" if stamped else "log"}}
    return Overview("mcap", facts_of(file), channels, remarks, settings)


def facts_of(file: McapFile) -> dict[str, str]:
    """Size, what was read, what was lost, and whether checksums cover it."""
    damage = file.damage
    lost = damage.messages_lost()
    return {
        "bytes": str(len(file.data)),
        "chunks": str(damage.chunks),
        "messages": str(damage.messages),
        "messages lost": "the file does not tell" if lost is None else str(lost),
        "checksums": damage.crc(),
    }


def clock_remarks(survey: ChannelSurvey) -> Iterator[str]:
    """What ingest will say of a channel's log times, if they go back."""
    log_time = survey.log_time()
    table = pl.DataFrame({"stamp": log_time, "message": np.arange(log_time.size)})
    try:
        check_not_set(survey.channel.topic, table, "its log times cannot be used")
    except InputError as error:
        yield str(error)


def fields_of(survey: ChannelSurvey, remarks: list[str]) -> list[FieldDescription]:
    """The fields of a channel's first message, or else of its schema; what cannot be described is remarked."""
    reason = ""
    for message in dict.fromkeys([survey.first, None]):
        try:
            return describe_message(survey.channel, survey.schema, message)
        except (ValueError, RecursionError) as error:
            reason = reason or " ".join(str(error).split())
    remarks.append(f"topic '{survey.channel.topic}': its fields cannot be listed: {reason}")
    return []


def channels_of(survey: ChannelSurvey, fields: list[FieldDescription]) -> Iterator[RecordedChannel]:
    """A topic's numbers, one by one as a source file names them; the topic alone where there are none."""
    topic, encoding = survey.channel.topic, survey.channel.message_encoding
    kind = f"{survey.schema.name} ({encoding})" if survey.schema else encoding
    log_time = survey.log_time()
    stamps = (log_time - log_time[:1].sum()) * NANOSECOND
    rate = rate_of(stamps)
    timing = gaps_text(stamps) or ("" if survey.messages else "empty")
    numbers = [(path, field) for field in fields if not field.path.startswith(STAMP) for path in field.addresses()]
    for path, field in numbers[:MOST_FIELDS]:
        array = "" if field.length is None else f"[{field.length}]"
        address = {"topic": topic, "field": path}
        samples = 0 if field.length == 0 else survey.messages
        yield RecordedChannel(kind, address, "", samples, rate, timing, f"{field.type}{array}")
    if len(numbers) > MOST_FIELDS or not numbers:
        more = f"and {len(numbers) - MOST_FIELDS} more numbers" if numbers else ""
        yield RecordedChannel(kind, {"topic": topic}, "", survey.messages, rate, timing, more)


def inspect_csv(path: Path) -> Overview:
    """Columns with units, rate, gaps and cells that are no numbers.

    Raises
    ------
    InputError
        The file is not text, or has no rows.
    """
    lines = read_lines(path)
    comments = [text for _, text in lines if text.lstrip().startswith(COMMENT)]
    content = [(line, text) for line, text in lines if not text.lstrip().startswith(COMMENT)]
    delimiter = delimiter_of(content, "auto")
    rows = split_rows(path, content, delimiter)
    if not rows:
        raise InputError(f"{path}: holds no rows; check that it is a recording")
    headed = not all(is_number_cell(cell.replace(",", ".")) for cell in rows[0][1] if cell)
    first = unpadded(rows[0][1], 0)
    names = first if headed else [str(place + 1) for place in range(len(first))]
    body = [(line, unpadded(cells, len(names))) for line, cells in (rows[1:] if headed else rows)]
    facts = {"rows": str(len(body)), "delimiter": repr(delimiter), "header": "yes" if headed else "none"}
    facts |= {f"comment {i + 1}": text.strip() for i, text in enumerate(comments[:20])}
    settings: dict[str, object] = {"clock": "master", "delimiter": NAMES.get(delimiter, delimiter)}
    settings |= {} if headed else {"header": "none"}
    decimal_comma = delimiter != "," and any("," in cell for _, cells in body[:5] for cell in cells)
    settings |= {"decimal": ","} if decimal_comma else {}
    clock, unit = name_and_unit(clock_of(names) or "NAME_OF_TIME")
    settings["time"] = {"column": clock, "unit": unit or "UNKNOWN"}
    return Overview("csv", facts, list(column_channels(names, body)), list(odd_rows(body, len(names))), settings)


def clock_of(names: list[str]) -> str | None:
    """The column whose name is one that loggers give to time; None if there is none."""
    return next((name for name in names if name_and_unit(name)[0].strip().casefold() in CLOCKS), None)


def column_channels(names: list[str], rows: Rows) -> Iterator[RecordedChannel]:
    """Every column with its range, and the words in it that are not numbers."""
    for place, title in enumerate(names):
        name, unit = name_and_unit(title)
        cells = pl.Series([cells[place] if place < len(cells) else "" for _, cells in rows], dtype=pl.String)
        values = cells.str.replace(",", ".", literal=True).cast(pl.Float64, strict=False)
        words = Counter(cells.filter(values.is_null()).to_list()).most_common(MOST_WORDS)
        known = values.drop_nulls().to_numpy()
        note = f"from {known.min():.6g} to {known.max():.6g}" if known.size else "no numbers"
        if title == clock_of(names):
            rate = rate_of(known)
            note = f"a clock, {rate:g} per unit" if rate else "a clock that stands still"
            note += f", {gaps_text(known)}" if gaps_text(known) else ""
        note += "".join(f", {count} x '{word}'" for word, count in words)
        yield RecordedChannel("column", {"column": name}, unit, int(known.size), None, note)


def odd_rows(rows: Rows, width: int) -> Iterator[str]:
    """Remarks on rows of another length than the header."""
    for length, count in Counter(len(cells) for _, cells in rows).items():
        if length != width:
            first = next(line for line, cells in rows if len(cells) == length)
            yield f"{count} rows have {length} cells under {width} names, the first in line {first}"
