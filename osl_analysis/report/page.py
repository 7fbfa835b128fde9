"""The page itself: one HTML file that needs no other file and no network."""

import hashlib
import json
import math
import warnings
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import bokeh
import polars as pl
from bokeh.resources import Resources
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from osl_analysis.report import TEMPLATES
from osl_analysis.report.pack import FEWEST_PACKED, deflated_json, packed_table

MEGABYTE = 1_000_000


@dataclass(frozen=True)
class PageTrial:
    """One trial for the page: its text, and the tables that its panels draw."""

    name: str
    content: Mapping[str, Any]
    tables: Mapping[str, pl.DataFrame]


def written_page(content: Mapping[str, Any], trials: Sequence[PageTrial], largest_mb: float) -> str:
    """The HTML of the report. Its signals are thinned out until it is no larger than `largest_mb` [MB].

    `content` are the names that the template `report.html.j2` uses, besides scripts, styles and trials.
    """
    around = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    ).get_template("report.html.j2")
    bokeh_js, report_js = (
        "\n".join(Resources(mode="inline", log_level="warn", components=["bokeh", "bokeh-api"]).js_raw),
        own("report.js"),
    )

    def page(packed: Mapping[str, str], every: int) -> str:
        """The whole page with these packed trials."""
        return around.render(
            **content,
            every=every,
            bokeh_version=bokeh.__version__,
            policy=policy(bokeh_js, report_js),
            bokeh_js=Markup(bokeh_js),
            report_js=Markup(report_js),
            style=Markup(own("report.css")),
            packed={name: Markup(text) for name, text in packed.items()},
        )

    rest = len(page({}, 1).encode())
    every, packed = thinned_trials(trials, largest_mb * MEGABYTE - rest)
    return page(packed, every)


def thinned_trials(trials: Sequence[PageTrial], largest: float) -> tuple[int, dict[str, str]]:
    """k, and the trials packed with every k-th sample by name, so that together they have at most `largest` bytes.

    No table is thinned below `FEWEST_PACKED` rows. Where that is still too much, a warning says so.
    """
    longest = max((len(table) for trial in trials for table in trial.tables.values()), default=0)
    every = 1
    packed = {trial.name: packed_trial(trial, every) for trial in trials}
    while (size := sum(map(len, packed.values()))) > largest and every < longest / FEWEST_PACKED:
        every = max(math.ceil(every * min(size / max(largest, 1), 4)), every + 1)
        packed = {trial.name: packed_trial(trial, every) for trial in trials}
    if size > largest:
        warnings.warn(
            f"the report is {(size - largest) / MEGABYTE:.1f} MB larger than `report: largest_mb` asks for, with as "
            "few samples as it can draw; set a larger one, or make a campaign of fewer trials",
            stacklevel=2,
        )
    return every, packed


def packed_trial(trial: PageTrial, every: int) -> str:
    """A trial as JSON that cannot end the script element that holds it; `every` thins out its long tables."""
    thinned = {name: every_kth(table, every) for name, table in trial.tables.items()}
    kept = [round(len(trial.tables[name]) / len(table)) for name, table in thinned.items() if len(table)]
    content = {
        "content": deflated_json(trial.content),
        "every": max(kept, default=1),
        "tables": {name: packed_table(table) for name, table in thinned.items()},
    }
    return json.dumps(content, ensure_ascii=True, allow_nan=False).replace("<", "\\u003c")


def every_kth(table: pl.DataFrame, k: int) -> pl.DataFrame:
    """Every k-th row of a table, `FEWEST_PACKED` or more; of the ends of a range, `_low` and `_high`, the outermost."""
    k = min(k, len(table) // FEWEST_PACKED)
    if k <= 1:
        return table
    ends = {"_low": pl.Expr.min, "_high": pl.Expr.max}
    column = [
        next((reduced(pl.col(name)) for end, reduced in ends.items() if name.endswith(end)), pl.col(name).first())
        for name in table.columns
    ]
    grouped = table.with_row_index("k_th").group_by(pl.col("k_th") // k, maintain_order=True).agg(column)
    return grouped.drop("k_th")


def own(name: str) -> str:
    """One of this package's own files for the page."""
    return (TEMPLATES / name).read_text(encoding="utf-8")


def policy(*scripts: str) -> str:
    """Content security policy: nothing is loaded, and no script runs but these, by their hashes."""
    hashes = " ".join(f"'sha256-{b64encode(hashlib.sha256(script.encode()).digest()).decode()}'" for script in scripts)
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; font-src data:; "
        "base-uri 'none'; form-action 'none'"
    )
