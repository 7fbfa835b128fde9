"""Headline numbers of a campaign: computed from result tables as `numbers.yaml` lists them, and
written as JSON and as macros of LaTeX."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import polars as pl
import yaml

from osl_analysis.campaign.origin import sentence
from osl_analysis.report.rounding import written
from osl_analysis.schema import SCHEMA, SCHEMA_FIELD
from osl_analysis.stats.repeats import DOUBTFUL, counted, doubtful_count

PLACE = ("joint", "side")
RANGE = "lowest to highest"


@dataclass(frozen=True)
class Entry:
    """A headline number as `numbers.yaml` lists it."""

    name: str
    table: str
    value: str
    unit: str
    meaning: str
    where: str = "TRUE"
    low: str = "NULL"
    high: str = "NULL"
    by: Sequence[str] = ()
    reduce: str = "mean"
    line: str = ""
    draft: float | None = None


ENTRIES = [
    Entry(**fields)
    for fields in yaml.safe_load(
        Path(__file__).with_name("numbers.yaml").read_text(encoding="utf-8")
    )
]


@dataclass(frozen=True)
class Number:
    """A headline number with its interval, as `summary.json` has it."""

    name: str
    value: float
    low: float | None
    high: float | None
    interval: str | None  # what the interval is
    unit: str
    meaning: str
    draft: float | None
    n: int  # rows behind it
    n_doubtful: int
    n_left_out: int
    line: str  # of the summary in the terminal that shows it
    verdict: str | None = None  # on the paper's claim about it
    doubt: str | None = None

    @property
    def text(self) -> str:
        """The number, rounded by its interval, with this and its unit."""
        return f"{written(self.value, self.low, self.high)} {self.unit}"


def headline_numbers(
    tables: Mapping[str, pl.DataFrame], beside_draft: bool = True
) -> Iterator[Number]:
    """Compute the numbers of `numbers.yaml` of which the campaign has the table and the columns."""
    for entry in ENTRIES:
        table = tables.get(entry.table, pl.DataFrame())
        try:
            rows = table.filter(pl.sql_expr(entry.where)).with_columns(
                number=pl.sql_expr(entry.value).cast(pl.Float64),
                number_low=pl.sql_expr(entry.low).cast(pl.Float64),
                number_high=pl.sql_expr(entry.high).cast(pl.Float64),
            )
        except pl.exceptions.ColumnNotFoundError:
            continue
        rows = rows.filter(pl.col("number").is_finite())
        places = [name for name in PLACE if name in rows.columns and rows[name].n_unique() > 1]
        keys = [name for name in (*entry.by, *places) if name in rows.columns]
        parts = rows.partition_by(keys, maintain_order=True) if keys else [rows]
        for part in parts:
            if len(part):
                yield number_of(entry, part, keys, beside_draft)


def number_of(entry: Entry, rows: pl.DataFrame, keys: Sequence[str], beside_draft: bool) -> Number:
    """One number from its rows, which agree in the columns `keys`."""
    is_judged = DOUBTFUL in rows.columns
    used = counted(rows) if is_judged else rows
    first = used.row(0, named=True)
    values = used["number"]
    low, high, interval = values.min(), values.max(), RANGE
    if len(used) == 1:
        low, high = first["number_low"], first["number_high"]
        interval = first.get("interval_method") or first.get("interval") or "95 %"
    stated = [
        f"{key} {first[key]:g}" if isinstance(first[key], float) else str(first[key])
        for key in keys
        if first[key] not in (None, "all")
    ]
    name = entry.name.format(**first)
    subject = [text for text in stated if not name.startswith(text)]
    return Number(
        name="_".join([name, *subject]).replace(" ", "_"),
        value=float(getattr(values, entry.reduce)()),
        low=low,
        high=high,
        interval=None if low is None else interval,
        unit=entry.unit.format(**first),
        meaning=", ".join([entry.meaning.format(**first), *subject]),
        draft=entry.draft if beside_draft else None,
        n=int(first.get("n") or 1) if len(used) == 1 else len(used),
        n_doubtful=doubtful_count(rows)[0] if is_judged else int(first.get("n_doubtful") or 0),
        n_left_out=len(rows) - len(used),
        line=" ".join([entry.line, *subject]) if entry.line else "",
        verdict=first.get("verdict"),
        doubt=first.get("doubt"),
    )


def numbers_in_summary(summary: Mapping[str, Any]) -> list[Number]:
    """The numbers of a `summary.json`."""
    return [Number(name=name, **fields) for name, fields in summary["numbers"].items()]


def to_json(about: Mapping[str, str], numbers: Iterable[Number], content: Mapping[str, Any]) -> str:
    """Write a summary: what the numbers are made of, further `content`, and the numbers in full."""
    by_name = {number.name: asdict(number) for number in numbers}
    for fields in by_name.values():
        del fields["name"]
    summary = {**about, SCHEMA_FIELD: SCHEMA, **content, "numbers": by_name}
    return json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


DIGITS = ("Zero", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")


def macro_name(name: str) -> str:
    """The letters of a number's name, as LaTeX asks: `K_s` gives `KS`, `K_d 200` `KDTwoZeroZero`."""
    words = re.findall(r"[A-Za-z]+|[0-9]", name)
    return "".join(
        DIGITS[int(word)] if word.isdigit() else word[0].upper() + word[1:] for word in words
    )


def to_tex(about: Mapping[str, str], numbers: Iterable[Number]) -> str:
    r"""Write LaTeX macros such as `\oslKS` with `\oslKSLow` and `\oslKSHigh`, rounded, no units."""
    lines = [f"% {sentence(about)}", "% \\input this file and use the macros."]
    for number in numbers:
        cells = written(number.value, number.low, number.high, parts=True)
        for ending, text in zip(("", "Low", "High"), cells, strict=True):
            if text:
                macro = f"\\newcommand{{\\osl{macro_name(number.name)}{ending}}}"
                lines.append(f"{macro}{{\\ensuremath{{{text}}}}}% {number.unit}, {number.meaning}")
    return "\n".join(lines) + "\n"
