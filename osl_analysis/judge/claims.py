"""The claims of the paper's text (`claims.yaml`), each compared with a number of the campaign: a
row with number and verdict for each.

`equivalent`, `different` and `undecided` compare a number with its target (`stats.repeats`). That a
number is beyond a limit `holds` if its whole interval is, `fails` if none of it is, and is
`undecided` otherwise. Without an interval there is no verdict. What is claimed over conditions
rests on the interval of each: it `holds` where every pair is better and the intervals of most lie
wholly on that side, and `fails` where none is better and those of most lie on the other side.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import pi
from pathlib import Path
from string import Formatter
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.files import own_yaml
from osl_analysis.judge.known_findings import known_finding
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import equivalence
from osl_analysis.yaml_settings import Positive, Settings

EXPRESSIONS = ("value", "low", "high", "target", "margin", "n", "subject", "joint", "side")
CLAIM_COLUMNS = {
    **dict.fromkeys(("joint", "side", "name", "subject", "claim", "quantity"), pl.String),
    **dict.fromkeys(("value", "low", "high"), pl.Float64),
    **dict.fromkeys(("unit", "interval", "wanted"), pl.String),
    **dict.fromkeys(("target", "margin", "n"), pl.Float64),
    "verdict": pl.String,
}
Claim = dict[str, Any]  # a row of `claims.csv`, by `CLAIM_COLUMNS`; what it has not is null
Entry = Mapping[str, Any]
ENTRIES: Mapping[str, Sequence[Entry]] = own_yaml(Path(__file__).with_name("claims.yaml"))
"""The claims, by the rows on which they are made."""
CLAIMED = (
    "belt_summary",
    "transmission_summary",
    "actuator_summary",
    "impedance",
    "compensation",
    "response",
    "walking_summary",
    "walking_groups",
)
"""The result tables with whose numbers claims are compared."""
STEP = 1e-4  # of a standard error, over which a derivative by a mean is taken


class Claims(Settings):
    """Margins and limits of the verdicts on what the text claims."""

    K_percent: Positive | None = 5.0
    """Margin [%] within which a stiffness is the desired one, on the bench and while walking; null:
    no verdict."""
    B: Positive | None = None
    """Margin [N*m*s/rad] within which a damping is the desired one; null: no verdict."""


def text_of(parts: str | Sequence[str], row: Mapping[str, Any]) -> str:
    """The parts of a text of which the row knows all numbers."""
    text = ""
    for part in [parts] if isinstance(parts, str) else parts:
        names = [name for _, name, _, _ in Formatter().parse(part) if name]
        if all(row.get(name) is not None for name in names):
            text += part.format(**row)
    return text


def claims_on(rows: pl.DataFrame, entry: Entry) -> list[Claim]:
    """The claim of an entry on each row that has its columns and meets its condition."""
    steps = [
        *entry.get("columns", ()),
        {"where": "TRUE"}
        | {name: entry[name] for name in ("where", *EXPRESSIONS) if name in entry},
        {name: entry[name] for name in ("verdict",) if name in entry},
    ]
    for step in steps:
        expressions = {name: pl.sql_expr(text) for name, text in step.items()}
        needed = {name for each in expressions.values() for name in each.meta.root_names()}
        if rows.is_empty() or not needed <= {*rows.columns}:
            return []
        rows = rows.with_columns(**expressions)
    claims = []
    for row in rows.filter("where").to_dicts():
        claim = {name: row[name] for name in (*EXPRESSIONS, "verdict") if name in entry}
        for name in ("name", "claim", "quantity", "unit", "interval", "wanted"):
            if name in entry:
                claim[name] = text_of(entry[name], row) or None
        if claim["low"] is None:
            claim["interval"] = None
        if "verdict" not in entry:
            ends = claim["low"], claim["high"]
            claim["verdict"] = equivalence(*ends, claim["target"], claim["margin"])
        claims.append(claim)
    return claims


def claims_of(kind: str, rows: pl.DataFrame) -> list[Claim]:
    """The claims on one kind of rows."""
    return [claim for entry in ENTRIES[kind] for claim in claims_on(rows, entry)]


def share_claims(
    means: Mapping[str, Mapping[str, Any]], known: Mapping[str, float]
) -> Iterator[Claim]:
    """The claims on shares that follow from the rows of the components' summaries by quantity, and
    from what is `known` without error. Their intervals are Student's, of the standard errors of the
    means."""
    for entry in ENTRIES["shares"]:
        formula = pl.sql_expr(entry["formula"])
        names = set(formula.meta.root_names())
        if not names <= means.keys() | known.keys():
            continue
        parts = sorted(names & means.keys())
        at_means = {**known, **{part: means[part]["mean"] for part in parts}}
        moved = [
            at_means | {part: at_means[part] + step * (means[part]["se"] or 0.0)}
            for part in parts
            for step in (STEP, -STEP)
        ]
        percents = pl.DataFrame([at_means, *moved]).select(formula).to_series().to_numpy()
        error = np.linalg.norm((percents[1::2] - percents[2::2]) / 2 / STEP)
        trials = min(means[part]["n"] for part in parts)
        # not a number for one trial, whose scatter is not known
        half_width = error * scipy.special.stdtrit(trials - 1, 0.975)
        rows = pl.DataFrame([at_means]).with_columns(
            share=pl.lit(percents[0]), trials=trials, half_width=pl.lit(half_width).fill_nan(None)
        )
        yield from claims_on(rows, entry)


def with_margins(rows: pl.DataFrame, settings: Claims) -> pl.DataFrame:
    """The rows with the margins of the settings as columns."""
    return rows.with_columns(
        K_percent=pl.lit(settings.K_percent, pl.Float64), B_margin=pl.lit(settings.B, pl.Float64)
    )


def rendered_claims(fits: pl.DataFrame, settings: Claims) -> Iterator[Claim]:
    """Whether each compensated trial renders K_d and B_d, and how many do; `fits` are the rows over
    all amplitudes. B_viscous is compared with B_d, too."""
    trials = with_margins(fits.filter(controller=CONTROLLERS[0]), settings)
    for entry in ENTRIES["trials"]:
        of_trials = claims_on(trials, entry)
        if not of_trials:
            continue
        verdicts = [claim["verdict"] for claim in of_trials]
        equivalent = verdicts.count("equivalent")
        verdict = "fails" if "different" in verdicts else "undecided"
        yield {
            "name": f"{entry['name']}_equivalent",
            "claim": text_of(entry["all"], trials.row(0, named=True)),
            "quantity": "trials whose whole interval lies within",
            "unit": "trials",
            "value": equivalent,
            "interval": "count",
            "target": float(len(of_trials)),
            "n": len(of_trials),
            "verdict": "holds" if equivalent == len(of_trials) else verdict,
        }
        yield from of_trials


def walking_claims(
    summary: pl.DataFrame, groups: pl.DataFrame, midstance: float | None, settings: Claims
) -> list[Claim]:
    """Whether the stiffness while walking is the commanded one, by group, if nothing is at work
    that nothing on the walkway shows. `midstance` is the commanded one [N*m/rad] of a campaign with
    one group whose sheet states none."""
    rows = summary.join(groups.select("group", "offset_share"), on="group", how="left")
    rows = rows.drop_nulls("mean").filter(quantity="K", estimator="ensemble")
    rows = with_margins(rows, settings).with_columns(
        midstance=pl.lit(midstance, pl.Float64), unseen=pl.lit(known_finding("walking_unseen").says)
    )
    return claims_of("walking", rows)


def claims_table(
    tables: Mapping[str, pl.DataFrame],
    settings: Claims,
    frequencies_hz: Sequence[float],
    midstance: float | None,
    ratios: Mapping[str, float],
) -> pl.DataFrame:
    """Compare the claims of the paper's text with the numbers of a campaign.

    Parameters
    ----------
    tables
        The campaign's result tables, by name.
    settings
        Margins and limits.
    frequencies_hz
        Those of the stepped sine; empty: not stated.
    midstance
        The stiffness that is commanded there [N*m/rad].
    ratios
        n_T by joint.

    Returns
    -------
    polars.DataFrame
        `claims.csv`: claims on the campaign first, then those on single trials and groups.
    """
    claims = []
    bench = {name: table for name, table in tables.items() if not name.startswith("walking")}
    places = [place for table in bench.values() for place in table.select("joint", "side").rows()]
    for joint, side in dict.fromkeys(places):
        at_place = [
            pl.col("joint").eq_missing(joint),
            pl.col("side").eq_missing(side),
        ]
        of_place = {name: table.filter(at_place) for name, table in bench.items()}
        for claim in claims_of_place(of_place, settings, frequencies_hz, ratios.get(joint)):
            claims.append({**claim, "joint": joint, "side": side})
    if "walking_summary" in tables:
        groups = tables["walking_groups"]
        claims += walking_claims(tables["walking_summary"], groups, midstance, settings)
    table = pl.DataFrame(claims, schema=CLAIM_COLUMNS)
    return table.sort(pl.col("subject").is_not_null(), maintain_order=True)


def claims_of_place(
    tables: Mapping[str, pl.DataFrame],
    settings: Claims,
    frequencies_hz: Sequence[float],
    n_T: float | None,
) -> Iterator[Claim]:
    """The claims on one joint and side of the bench."""
    means: dict[str, Mapping[str, Any]] = {}
    for name, table in tables.items():
        if name.endswith("_summary"):
            for row in table.drop_nulls("mean").to_dicts():
                means[row["quantity"]] = row
    if frequencies_hz:
        for hz in dict.fromkeys((min(frequencies_hz), max(frequencies_hz))):
            yield from share_claims(means, {"hz": hz, "omega": 2 * pi * hz})
    if "impedance" in tables:
        fits = tables["impedance"].filter(pl.col("amplitude_deg").is_null())
        known = fits.filter(pl.col("K_d") > 0).sort("K_d")
        ends = {row["K_d"]: row for row in (*known.head(1).to_dicts(), *known.tail(1).to_dicts())}
        for K_d, row in ends.items():
            turn = np.deg2rad(row["theta_rms_deg"])
            if n_T:
                yield from share_claims(means, {"K_d": K_d, "turn": turn, "n_T": n_T})
        yield from rendered_claims(fits, settings)
    if "compensation" in tables:
        yield from claims_of("pairs", tables["compensation"])
    if "response" in tables:
        yield from claims_of("response", tables["response"].filter(scope="all").sort("controller"))
