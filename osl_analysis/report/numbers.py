# SPDX-License-Identifier: Apache-2.0
"""Compute the headline numbers of a campaign, and write them as JSON, LaTeX macros and sentences.

`listed_numbers.py` says from which table and rows each number comes.

Example: `next(headline_numbers({"impedance": impedance})).in_sentence`.
"""

import json
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import polars as pl

from osl_analysis.base.errors import first_of, on_one_line
from osl_analysis.base.table import SCHEMA, SCHEMA_FIELD
from osl_analysis.bench.summaries import PLACE
from osl_analysis.campaign.origin import ABOUT_MEANING, sentence
from osl_analysis.judge.joining import GROUP_DOUBTS
from osl_analysis.judge.wording import doubts_text
from osl_analysis.report.listed_numbers import BY_CONDITION, LISTED_NUMBERS, ListedNumber, column_of
from osl_analysis.report.typography import template
from osl_analysis.stats.doubts import counted, doubts_about, is_doubtful
from osl_analysis.stats.repeats import OWN_CONDITION, RANGE, summary_row
from osl_analysis.stats.rounding import decimal_places, plus_minus, to_places

CONDITION_COLUMNS = (
    *PLACE,
    "excitation",
)  # columns in which conditions may differ, beside K_d and B_d
MOST_IN_SENTENCE = 3  # numbers, or lines of conditions, that a terminal holds


@dataclass(frozen=True)
class Number:
    """A headline number with its interval, as `summary.json` has it."""

    name: str
    value: float
    low: float | None
    high: float | None
    interval: str | None  # name of the interval
    unit: str
    meaning: str
    draft: float | None
    n: int  # rows behind it
    n_doubtful: int  # further rows, which are left out
    says: str = ""  # begin of its sentence; empty for none
    symbol: str = ""  # before it in the sentence
    subject: str = ""  # its controller, condition, group, joint and side
    verdict: str | None = None  # on the estimate, or on the paper's claim about it
    doubtful: str = ""  # the doubts about the number itself; empty for none
    table: str = ""  # its result table
    trials: Sequence[str] = ()  # trials in its rows; empty where the table has none

    @property
    def places(self) -> int:
        """Decimal places, by the interval.

        A range of single values does not take digits off their mean, nor is it rounded to 100 %.
        """
        places = decimal_places(self.value, self.low, self.high, self.unit)
        if self.kind == RANGE:
            largest = max(self.value, self.high or 0.0, key=abs)
            for number in (self.value, largest):
                places = max(places, decimal_places(number, unit=self.unit))
        return places

    @property
    def texts(self) -> list[str]:
        """The number and the ends of its interval; empty ends where it has none."""
        return to_places(self.places, self.value, self.low, self.high)

    @property
    def text(self) -> str:
        """The number with its interval, without unit."""
        value, *ends = self.texts
        return f"{value} ({' to '.join(ends)})" if all(ends) else value

    @property
    def brief(self) -> str:
        """The number for a sentence: ± half of its 95 % interval, and its unit."""
        is_range = self.kind == RANGE
        ends = (None, None) if is_range else (self.low, self.high)
        return f"{plus_minus(self.places, self.value, *ends)} {self.unit}"

    @property
    def kind(self) -> str | None:
        """The name of the interval for readers; None without an interval."""
        return self.interval if self.interval in (None, RANGE) else "95 %"

    @property
    def doubts(self) -> str:
        """The doubts about the number, or the number of doubtful trials; empty for none."""
        if self.doubtful:
            return f"doubtful: {self.doubtful}"
        if not self.n_doubtful:
            return ""
        return f"{self.n_doubtful} of {self.n + self.n_doubtful} left out as doubtful"

    @property
    def in_sentence(self) -> str:
        """The number, with its subject, the range of its trials and its doubts in brackets."""
        facts = [self.subject]
        if self.kind == RANGE:
            facts.append(f"trials {' to '.join(self.texts[1:])}")
        in_brackets = "; ".join(filter(None, [*facts, self.doubts]))
        symbol = f"{self.symbol} = " if self.symbol else ""
        return f"{symbol}{self.brief}{f' ({in_brackets})' if in_brackets else ''}"


def headline_numbers(
    tables: Mapping[str, pl.DataFrame], beside_draft: bool = True
) -> Iterator[Number]:
    """Compute the listed numbers whose table and columns the campaign has.

    A number whose rows are all doubtful is left out.

    Parameters
    ----------
    tables : Mapping of str to polars.DataFrame
        Result tables by name, with the findings on their rows (`judge.joining.read_joined`).
    beside_draft : bool
        Whether the values of the paper's draft stand beside them.
    """
    for entry in LISTED_NUMBERS:
        origin = tables.get(entry.origin or entry.table.removesuffix("_summary"), pl.DataFrame())
        estimate = entry.name.rpartition("_")[2]  # ends the names of numbers over trials
        trials = trials_in(counted(origin, [estimate]))
        for part, keys in parts(entry, tables.get(entry.table, pl.DataFrame())):
            if not part["left_out"].all():
                yield number_of(entry, part, keys, beside_draft, trials)


def parts(entry: ListedNumber, table: pl.DataFrame) -> list[tuple[pl.DataFrame, list[str]]]:
    """The rows of each number of an entry, and the columns in which they agree.

    The rows have `number`, `number_low` and `number_high`. There are none where the table is empty,
    whose columns have no types, or lacks a column of the entry.
    """
    if table.is_empty():
        return []
    try:
        rows = table.with_columns(left_out=is_doubtful(table, entry.columns))
        rows = rows.filter(entry.rows(rows))
        value = column_of(rows, entry.value)
        ends = [column_of(rows, end) for end in entry.ends or ()]
    except pl.exceptions.ColumnNotFoundError:
        return []
    low, high = ends or [value.clear(len(value))] * 2  # without an interval they are null
    rows = rows.with_columns(number=value, number_low=low, number_high=high)
    if isinstance(entry.value, str):  # a mean has the errors that its trials share
        rows = rows.rename({f"{entry.value}_se_bench": "number_se_bench"}, strict=False)
    rows = rows.filter(pl.col("number").is_finite())
    kinds = CONDITION_COLUMNS if "K_d" in entry.by else PLACE
    several = [name for name in kinds if name in rows.columns and rows[name].n_unique() > 1]
    keys = [name for name in (*entry.by, *several) if name in rows.columns]
    if "K_d" in keys:
        keys.append("own_condition")
        rows = rows.with_columns(OWN_CONDITION)
    by_keys = rows.partition_by(keys) if keys else [rows]
    return [(part, keys) for part in by_keys if len(part)]


def number_of(
    entry: ListedNumber,
    rows: pl.DataFrame,
    keys: Sequence[str],
    beside_draft: bool,
    trials: Sequence[str],
) -> Number:
    """One number from its rows, which agree in the columns `keys`. `trials` are its trials where
    the rows name none."""
    used = rows.remove(pl.col("left_out"))
    first = used.row(0, named=True)
    values = used["number"]
    value = float(getattr(values, entry.reduce)())
    mean = summary_row(used, "number")
    low, high = mean["low"], mean["high"]
    interval = entry.interval or mean["interval_method"] or first.get("interval") or "95 %"
    if entry.reduce == "sum":
        low = high = None
    elif entry.ends is None and len(used) > 1:
        low, high, interval = values.min(), values.max(), RANGE
    cells = {key: first[key] for key in keys if first[key] not in (None, "", "all")}
    condition_texts = [
        f"{key} {cell:g}" if isinstance(cell, float) else str(cell) for key, cell in cells.items()
    ]
    n = len(used)
    n_doubtful = len(rows) - n or int(first.get("n_doubtful") or 0)
    if n == 1:  # a row of a summary stands for several trials or pairs
        n = int(first.get("n") or first.get("pairs") or 1)
    name, unit, meaning, says = (
        text.format(**{"n": n, **first})
        for text in (entry.name, entry.unit, entry.meaning, entry.says)
    )
    subject = [text for text in condition_texts if not name.startswith(text)]
    return Number(
        name="_".join([name, *subject]).replace(" ", "_"),
        value=value,
        low=low,
        high=high,
        interval=None if low is None else interval,
        unit=unit,
        meaning=", ".join([meaning, *subject]),
        draft=entry.draft if beside_draft else None,
        n=n,
        n_doubtful=n_doubtful,
        says=says,
        symbol=entry.symbol,
        subject=", ".join(subject),
        verdict=first.get("verdict"),
        doubtful=doubts_text(doubts_about(first.get(GROUP_DOUBTS), [first.get("quantity", "")])),
        table=entry.table,
        trials=trials_in(used) or trials,
    )


def trials_in(table: pl.DataFrame) -> Sequence[str]:
    """The trials of a table's rows; none where it does not name them."""
    return list(dict.fromkeys(table["trial"])) if "trial" in table.columns else ()


def headline_sentences(numbers: Iterable[Number], by_condition: bool = True) -> Iterator[str]:
    """The sentences at the end of a run, each on numbers of one kind.

    K and B of the first conditions come first if `by_condition`; else the answer has them.
    """
    texts_of: dict[str, list[str]] = {}
    texts_of_condition: dict[str, list[str]] = {}
    for number in numbers:
        if number.says == BY_CONDITION:
            condition = f"{number.subject}, {number.doubts}".removesuffix(", ")
            text = f"{number.symbol} = {number.brief}"
            texts_of_condition.setdefault(condition, []).append(text)
        elif number.says:
            texts_of.setdefault(number.says, []).append(number.in_sentence)
    if by_condition:
        conditions = [f"{name}: {', '.join(texts)}" for name, texts in texts_of_condition.items()]
        yield from first_of(conditions, MOST_IN_SENTENCE)
    for begin, texts in texts_of.items():
        yield f"{begin} {', '.join(first_of(texts, MOST_IN_SENTENCE))}."


def numbers_in_summary(summary: Mapping[str, Any]) -> list[Number]:
    """The numbers of a `summary.json`."""
    return [Number(name=name, **fields) for name, fields in summary["numbers"].items()]


def to_json(about: Mapping[str, str], numbers: Iterable[Number], content: Mapping[str, Any]) -> str:
    """Write a summary: the origin of the numbers, further `content`, and the numbers in full."""
    by_name = {number.name: asdict(number) for number in numbers}
    for fields in by_name.values():
        del fields["name"]
    summary = {**about, SCHEMA_FIELD: SCHEMA, **content, "numbers": by_name}
    return json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _letters_of_sign(sign: str) -> str:
    """A digit or sign in letters and blanks: `2` gives `Two`, `-` gives `Hyphen Minus`."""
    spelled = unicodedata.name(sign).title().removeprefix("Digit ")
    return re.sub("[^A-Za-z]", " ", spelled)


def macro_name(name: str) -> str:
    """The letters of a number's name, as LaTeX asks: `B_d 2.5` gives `BDTwoPointFive`. Digits and
    signs are spelled: `PD+` gives `PDPlusSign`."""
    words = name.replace(".", " point ").replace("_", " ")
    spelled = re.sub(
        r"[^A-Za-z ]",
        lambda sign: f" {_letters_of_sign(sign[0])} ",
        words,
    )
    return "".join(word[0].upper() + word[1:] for word in spelled.split())


def macros_tex(about: Mapping[str, str], numbers: Iterable[Number], remarks: Iterable[str]) -> str:
    r"""Write LaTeX macros such as `\oslKS` with `\oslKSLow` and `\oslKSHigh`, rounded, without
    units, below comments with `remarks`."""
    return template("numbers.tex.j2", finalize=on_one_line, keep_trailing_newline=True).render(
        about=about,
        made_of=sentence(about),
        meanings=ABOUT_MEANING,
        numbers=numbers,
        remarks=remarks,
        macro_name=macro_name,
    )
