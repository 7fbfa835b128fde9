"""Headline numbers as text: rounded, in sentences, in tables."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from osl_analysis.report.decimal_places import COUNT, RANGE, fixed, places_of
from osl_analysis.report.typography import printed


class WrittenNumber(NamedTuple):
    """A rounded number as text."""

    value: str
    interval: str  # as `1 to 2`; empty: there is none
    single_amplitudes: str  # the range over single amplitudes; empty: there is none


def written_number(number: Mapping[str, Any]) -> WrittenNumber:
    """Write a number of a summary with as many digits as its interval allows."""
    places = places_of(number)
    interval = range_text(number["low"], number["high"], places.ends)
    single = range_text(number.get("amplitudes_low"), number.get("amplitudes_high"), places.value)
    return WrittenNumber(fixed(number["value"], places.value), interval, single)


def range_text(low: float | None, high: float | None, digits: int) -> str:
    if low is None or high is None:
        return ""
    return f"{fixed(low, digits)} to {fixed(high, digits)}"


def number_texts(number: Mapping[str, Any]) -> dict[str, str]:
    """`text`, `unit` and `ends` of a number for a reader, the `kind` of these, and the trials
    `behind` it. No digits if 0 is in the interval."""
    written = written_number(number)
    low, high = number["low"], number["high"]
    value = written.value
    is_confidence_interval = number["interval"] not in (None, RANGE, COUNT)
    if is_confidence_interval and low is not None and low <= 0 <= high:
        value = "≈ 0"
    ends = written.interval
    kind = number["interval"] or ""
    if not ends:
        ends = written.single_amplitudes
        kind = "single amplitudes" if ends else ""
    return {
        "text": printed(value),
        "ends": printed(ends),
        "kind": kind,
        "unit": printed(number["unit"]),
        "behind": trials_text(number).replace("DOUBTFUL", "doubtful"),
    }


def trials_text(number: Mapping[str, Any]) -> str:
    """Number of trials or fits behind a number, doubtful ones in it or left out, and why it is
    doubtful itself."""
    if number.get("doubt"):
        return f"{number['n']}, DOUBTFUL: {number['doubt']}"
    n = int(number.get("n") or 0)
    n_doubtful = int(number.get("n_doubtful") or 0)
    n_left_out = int(number.get("n_left_out") or 0)
    if n_left_out:
        return f"{n} of {n + n_left_out}, {n_left_out} doubtful left out"
    if not n_doubtful:
        return str(n)
    return f"{n}, {n_doubtful} of them doubtful" if n > 1 else f"{n}, doubtful"


MOST_IN_SENTENCE = 3  # numbers; of more only the two extremes are written


def first_sentences(numbers: Sequence[Mapping[str, Any]]) -> list[str]:
    """A sentence per `begins`, with each number and its `of`; of many numbers, only the two
    extremes."""
    by_begin: dict[str, list[Mapping[str, Any]]] = {}
    for number in numbers:
        if number["begins"]:
            by_begin.setdefault(number["begins"], []).append(number)
    sentences = []
    for begins, of_sentence in by_begin.items():
        separator = ", "
        if len(of_sentence) > MOST_IN_SENTENCE:
            lowest = min(of_sentence, key=lambda number: float(number["value"]))
            highest = max(of_sentence, key=lambda number: float(number["value"]))
            of_sentence = [lowest, highest]
            separator = " to "
        parts = [number_in_sentence(number) for number in of_sentence]
        sentences.append(f"{begins} {separator.join(parts)}.")
    return sentences


def number_in_sentence(number: Mapping[str, Any]) -> str:
    """A number with unit, and in brackets what it is of, its interval and its trials."""
    texts = number_texts(number)
    ends = texts["ends"]
    if number["interval"] == RANGE:
        ends = f"{RANGE} {ends}"
    remarks = filter(None, [number["of"], ends, f"n = {texts['behind']}"])
    return f"{texts['text']}\N{NO-BREAK SPACE}{texts['unit']} ({'; '.join(remarks)})"


def to_table(numbers: Mapping[str, Mapping[str, Any]], markdown: bool) -> str:
    """The numbers of a summary, as `to_json` writes them, in Markdown or aligned columns: meaning,
    value, interval, trials, the draft's value."""
    rows: list[tuple[str, ...]] = [("quantity", "value", "interval", "n", "draft")]
    beside_draft = any(number["draft"] is not None for number in numbers.values())
    for number in numbers.values():
        written = written_number(number)
        interval = ""
        if written.interval:
            interval = f"{written.interval}, {number['interval']}"
        if written.single_amplitudes:
            interval += f"; single amplitudes {written.single_amplitudes}"
        if number.get("verdict"):
            interval += f"{'; ' if interval else ''}{number['verdict']}"
        draft = "" if number["draft"] is None else f"{number['draft']:g}"
        value = f"{written.value} {number['unit']}"
        rows.append((number["meaning"], value, interval, trials_text(number), draft))
    if not beside_draft:
        rows = [row[:-1] for row in rows]
    return markdown_table(rows) if markdown else aligned(rows)


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows as a table in Markdown; the first row is the head."""
    text = ""
    for cells in (rows[0], ["---"] * len(rows[0]), *rows[1:]):
        escaped = [cell.replace("|", "\\|") for cell in cells]
        text += f"| {' | '.join(escaped)} |\n"
    return text


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows with the same number of cells as lines with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    text = ""
    for cells in rows:
        padded = [cell.ljust(width) for cell, width in zip(cells, widths, strict=True)]
        text += f"{'  '.join(padded).rstrip()}\n"
    return text
