# SPDX-License-Identifier: Apache-2.0
"""Write the text of a methods section, in Markdown and in LaTeX.

`templates/methods.j2` has its sentences. A sentence is printed only where its fact is recorded.

Example: `to_markdown(paragraphs(facts))`.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.judge.campaign import CampaignFinding, findings_in_summary
from osl_analysis.report.typography import (
    in_ascii_latex,
    in_markdown,
    printed,
    prose_in_latex,
    template,
    value_text,
)
from osl_analysis.report.verdicts import causes_not_checked
from osl_analysis.stats.promises import PROMISES, RANGE_PROMISE

BIBTEX = (
    Path(__file__)
    .with_name("sources.bib")
    .read_text(encoding="utf-8")
    .replace("RELEASE", version("osl-impedance"))
)
CITATION = re.compile(r"\[@(\w+)\]")
MOST_LISTED = 8  # values in a sentence; longer lists have the first and the last alone


@dataclass(frozen=True)
class MethodsFacts:
    """The facts for the template."""

    about: Mapping[str, str]  # origin of the results
    settings: Mapping[str, Any]  # of the analysis, nested
    tables: Mapping[str, pl.DataFrame]  # result tables, by name
    sheet: Sequence[Mapping[str, Any]]  # rows of the trials
    summary: Mapping[str, Any]
    rates_hz: Mapping[str, str]  # of markers and force plate
    range_promise = RANGE_PROMISE

    def listed(self, table: str, column: str) -> str:
        """The values of a column as `1, 2 and 3`; empty where there are none."""
        rows = self.tables.get(table, pl.DataFrame())
        if column not in rows.columns:
            return ""
        values = rows[column].drop_nulls().unique().sort().to_list()
        texts = list(dict.fromkeys(map(value_text, values)))
        if len(texts) > MOST_LISTED:
            return f"{texts[0]} to {texts[-1]}"
        return " and ".join(filter(None, [", ".join(texts[:-1]), *texts[-1:]]))

    @property
    def delays(self) -> Sequence[tuple[str, float]]:
        """The names of signals whose stamps were late, with their delays [s]."""
        streams = self.tables.get("timebase", pl.DataFrame(schema=["signals", "delay_s"]))
        late = streams.filter(pl.col("delay_s") != 0).select("signals", "delay_s").unique()
        return late.sort(pl.all()).rows()

    @property
    def promises(self) -> Mapping[str, str]:
        """What the intervals of the joint's fits promise, by method."""
        of_joint = [self.tables.get(name, pl.DataFrame()) for name in ("impedance", "transmission")]
        methods: set[str] = set()
        for fits in of_joint:
            if "interval_method" in fits.columns:
                methods.update(fits["interval_method"].drop_nulls())
        return {name: promise for name, promise in PROMISES.items() if name in methods}

    @property
    def findings(self) -> Sequence[CampaignFinding]:
        """The findings of the campaign."""
        return findings_in_summary(self.summary)


def unmarked(value: object) -> str:
    """A value in a sentence, without signs that the template would take for its marks."""
    return str(value).replace("$", r"\$").replace("[@", "(@").replace("¶", "")


def paragraphs(facts: MethodsFacts) -> list[str]:
    """The paragraphs, with the marks of the template for symbols and citations."""
    unchecked = "; ".join(causes_not_checked(facts.findings))
    methods = template("methods.j2", finalize=unmarked)
    text = methods.render(facts=facts, not_checked=unchecked, version=version)
    return [" ".join(part.split()) for part in text.split("¶") if part.strip()]


def to_markdown(marked: Sequence[str]) -> str:
    """The text in Markdown, with its references."""
    cited = list(dict.fromkeys(CITATION.findall(" ".join(marked))))
    texts = [
        CITATION.sub(lambda match: f"[{cited.index(match[1]) + 1}]", printed(in_markdown(text)))
        for text in marked
    ]
    references = [f"{number}. {reference(key)}" for number, key in enumerate(cited, 1)]
    return "\n\n".join(["# Methods", *texts, "## References", "\n".join(references)]) + "\n"


def reference(key: str) -> str:
    """An entry of `sources.bib` as a list of references has it."""
    entry = BIBTEX.partition(f"{{{key},")[2].partition("\n}")[0]
    fields = re.findall(r"\w+ = \{(.*)\}", entry)
    text = ". ".join(field.rstrip(".") for field in fields).replace("--", "–")
    return re.sub("[{}]", "", re.sub(r"\b10\.\d{4,5}/", r"https://doi.org/\g<0>", text))


def to_tex(marked: Sequence[str]) -> str:
    r"""The text in LaTeX, to be `\input`."""
    begin = r"% \input this file in a section of the paper, and \bibliography its methods.bib."
    return "\n\n".join([begin, *map(prose_in_latex, marked)]) + "\n"


def to_bibtex() -> str:
    """The references for BibTeX, in ASCII."""
    return in_ascii_latex(BIBTEX)
