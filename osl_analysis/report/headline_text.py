"""Headline numbers as text: rounded, in sentences, in tables."""

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

from osl_analysis.report.decimal_places import COUNT, RANGE, fixed
from osl_analysis.report.headline import Headline, HeadlineValue
from osl_analysis.report.typography import printed


class WrittenNumber(NamedTuple):
    """A rounded number as text."""

    value: str
    interval: str  # as `1 to 2`; empty: there is none
    single_amplitudes: str  # the range over single amplitudes; empty: there is none


def written_number(estimate: HeadlineValue) -> WrittenNumber:
    """Write a number of a summary with as many digits as its interval allows."""
    places = estimate.places
    interval = range_text(estimate.low, estimate.high, places.ends)
    single = range_text(estimate.amplitudes_low, estimate.amplitudes_high, places.value)
    return WrittenNumber(fixed(estimate.value, places.value), interval, single)


def range_text(low: float | None, high: float | None, digits: int) -> str:
    if low is None or high is None:
        return ""
    return f"{fixed(low, digits)} to {fixed(high, digits)}"


class NumberTexts(NamedTuple):
    """A number as the page prints it."""

    value: str  # without digits if 0 is in the interval
    unit: str
    ends: str  # of the interval, or of the range over single amplitudes
    kind: str  # of these ends
    trials: str  # behind it


def number_texts(estimate: HeadlineValue, unit: str) -> NumberTexts:
    """A number and its interval for a reader."""
    written = written_number(estimate)
    low, high = estimate.low, estimate.high
    value = written.value
    is_confidence_interval = estimate.interval not in (None, RANGE, COUNT)
    if is_confidence_interval and low is not None and high is not None and low <= 0 <= high:
        value = "≈ 0"
    ends = written.interval
    kind = estimate.interval or ""
    if not ends:
        ends = written.single_amplitudes
        kind = "single amplitudes" if ends else ""
    trials = trials_text(estimate).replace("DOUBTFUL", "doubtful")
    return NumberTexts(printed(value), printed(unit), printed(ends), kind, trials)


def trials_text(estimate: HeadlineValue) -> str:
    """Number of trials or fits behind a number, doubtful ones in it or left out, and why it is
    doubtful itself."""
    n = estimate.n
    n_left_out = estimate.n_left_out
    if estimate.doubt:
        return f"{n}, DOUBTFUL: {estimate.doubt}"
    if n_left_out:
        return f"{n} of {n + n_left_out}, {n_left_out} doubtful left out"
    if not estimate.n_doubtful:
        return str(n)
    return f"{n}, {estimate.n_doubtful} of them doubtful" if n > 1 else f"{n}, doubtful"


MOST_IN_SENTENCE = 3  # numbers; of more only the two extremes are written


def first_sentences(numbers: Iterable[Headline]) -> list[str]:
    """A sentence per `sentence_begin`, with each number and its subject; of many numbers, only the
    two extremes."""
    by_begin: dict[str, list[Headline]] = {}
    for number in numbers:
        if number.label.sentence_begin:
            by_begin.setdefault(number.label.sentence_begin, []).append(number)
    sentences = []
    for begins, of_sentence in by_begin.items():
        separator = ", "
        if len(of_sentence) > MOST_IN_SENTENCE:
            lowest = min(of_sentence, key=lambda number: number.estimate.value)
            highest = max(of_sentence, key=lambda number: number.estimate.value)
            of_sentence = [lowest, highest]
            separator = " to "
        parts = [number_in_sentence(number) for number in of_sentence]
        sentences.append(f"{begins} {separator.join(parts)}.")
    return sentences


def number_in_sentence(number: Headline) -> str:
    """A number with unit, and in brackets what it is of, its interval and its trials."""
    texts = number_texts(number.estimate, number.label.unit)
    ends = texts.ends
    if number.estimate.interval == RANGE:
        ends = f"{RANGE} {ends}"
    remarks = filter(None, [number.label.subject, ends, f"n = {texts.trials}"])
    return f"{texts.value}\N{NO-BREAK SPACE}{texts.unit} ({'; '.join(remarks)})"


def to_table(numbers: Collection[Headline], markdown: bool) -> str:
    """The numbers of a summary in Markdown or aligned columns: meaning, value, interval, trials,
    the draft's value."""
    rows: list[tuple[str, ...]] = [("quantity", "value", "interval", "n", "draft")]
    beside_draft = any(number.label.draft is not None for number in numbers)
    for number in numbers:
        label = number.label
        estimate = number.estimate
        written = written_number(estimate)
        interval = ""
        if written.interval:
            interval = f"{written.interval}, {estimate.interval}"
        if written.single_amplitudes:
            interval += f"; single amplitudes {written.single_amplitudes}"
        if estimate.verdict:
            interval += f"{'; ' if interval else ''}{estimate.verdict}"
        draft = "" if label.draft is None else f"{label.draft:g}"
        value = f"{written.value} {label.unit}"
        rows.append((label.meaning, value, interval, trials_text(estimate), draft))
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
