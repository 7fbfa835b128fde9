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

NUMBERS = ("value", "low", "high", "target", "margin", "n")
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
BETTER = {
    "torque_error": "the torque is nearer to K_d theta + B_d omega",
    "K_error": "K is nearer to K_d",
    "B_error": "B is nearer to B_d",
    "B_viscous_error": "B without friction, where this is certain of both, is nearer to B_d",
    "VAF": "K, B and I explain more of the torque",
}
"""What compensation improves, by the quantity of `compensation.csv`."""


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
    expressions = {
        name: pl.sql_expr(entry[name])
        for name in (*NUMBERS, "subject", "joint", "side", "verdict", "where")
        if name in entry
    }
    needed = {name for each in expressions.values() for name in each.meta.root_names()}
    if not needed <= {*rows.columns}:
        return []
    rows = rows.filter(expressions.pop("where", pl.lit(value=True)))
    cells = rows.select(**expressions)
    claims: list[Claim] = []
    for row, claim in zip(rows.to_dicts(), cells.to_dicts(), strict=True):
        for name in ("name", "claim", "quantity", "unit", "interval", "wanted"):
            if name in entry:
                claim[name] = text_of(entry[name], row) or None
        if claim["low"] is None:
            claim["interval"] = None
        claims.append({"verdict": verdict_of(claim), **claim})
    return claims


def claims_of(kind: str, rows: pl.DataFrame) -> list[Claim]:
    """The claims on one kind of rows."""
    return [claim for entry in ENTRIES[kind] for claim in claims_on(rows, entry)]


def verdict_of(claim: Claim) -> str | None:
    """The verdict on a number by its 95 % interval: on the wanted side of the target or, where no
    side is wanted, within its margin."""
    low, high, target = claim["low"], claim["high"], claim["target"]
    if "wanted" not in claim:
        return equivalence(low, high, target, claim["margin"])
    if low is None or high is None:
        return None
    if low > target or high < target:
        return "holds" if (low > target) == (claim["wanted"] == "above") else "fails"
    return "undecided"


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
        error = float(np.linalg.norm((percents[1::2] - percents[2::2]) / 2 / STEP))
        trials = min(means[part]["n"] for part in parts)
        # not a number for one trial, whose scatter is not known
        half_width = error * scipy.special.stdtrit(trials - 1, 0.975)
        rows = pl.DataFrame([at_means]).with_columns(
            share=pl.lit(percents[0]), trials=trials, half_width=pl.lit(half_width).fill_nan(None)
        )
        yield from claims_on(rows, entry)


def compensation_claims(compensation: pl.DataFrame) -> Iterator[Claim]:
    """What compensation improves, from `compensation.csv`. A difference without an interval counts
    by its sign."""
    if compensation.is_empty():  # which has no texts
        return
    is_vaf = pl.col("quantity") == "VAF"
    low = pl.coalesce("difference_low", "difference")
    high = pl.coalesce("difference_high", "difference")
    n_above = (low > 0).sum()
    n_below = (high < 0).sum()
    of_trials = (
        compensation.filter(of="trial")
        .group_by("quantity")
        .agg(
            certain=pl.when(is_vaf.first()).then(n_above).otherwise(n_below),
            worse=pl.when(is_vaf.first()).then(n_below).otherwise(n_above),
            has_intervals=(low < high).any(),
        )
    )
    of_amplitudes = compensation.filter(of="amplitudes")
    rows = (
        compensation.filter(of="trials")
        .join(of_trials, on="quantity", maintain_order="left")
        .join(of_amplitudes, on="quantity", how="left", suffix="_amplitudes", maintain_order="left")
        .with_columns(
            wanted=pl.when(is_vaf).then(pl.lit("above")).otherwise(pl.lit("below")),
            better_if=pl.col("quantity").replace_strict(BETTER),
            told_certain=pl.when("has_intervals").then("certain"),
        )
    )
    yield from claims_of("pairs", rows)


def with_margins(rows: pl.DataFrame, settings: Claims) -> pl.DataFrame:
    """The rows with the margins of the settings as columns."""
    return rows.with_columns(
        K_percent=pl.lit(settings.K_percent, pl.Float64), B_margin=pl.lit(settings.B, pl.Float64)
    )


def rendered_claims(fits: pl.DataFrame, settings: Claims) -> Iterator[Claim]:
    """Whether each compensated trial renders K_d and B_d, and how many do; `fits` are the rows over
    all amplitudes. B_viscous is compared with B_d, too."""
    trials = with_margins(fits.filter(pl.col("controller") == CONTROLLERS[0]), settings)
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


def passivity_claims(response: pl.DataFrame) -> Iterator[Claim]:
    """Whether the joint takes in energy at every frequency, by the least damping of each controller
    and the lowest ends of all intervals."""
    least = (
        response.drop_nulls("damping")
        .sort("damping")
        .with_columns(
            lowest_low=pl.col("damping_low").min().over("controller"),
            lowest_high=pl.col("damping_high").min().over("controller"),
            frequencies=pl.len().over("controller"),
        )
        .unique("controller", keep="first")
        .sort("controller")
    )
    yield from claims_of("response", least)


def walking_claims(
    summary: pl.DataFrame, groups: pl.DataFrame, midstance: float | None, settings: Claims
) -> Iterator[Claim]:
    """Whether the stiffness while walking is the commanded one, by group, if nothing is at work
    that the walkway does not show. `midstance` is the commanded one [N*m/rad] of a campaign with
    one group whose sheet states none."""
    rows = summary.join(groups.select("group", "offset_share"), on="group", how="left")
    rows = rows.filter(pl.col("mean").is_not_null(), quantity="K", estimator="ensemble")
    has_one_group = len(rows) == 1
    midstance = midstance if has_one_group else None
    rows = with_margins(rows, settings).with_columns(
        pl.col("offset_share").fill_null(0.0),
        commanded=pl.coalesce("commanded", pl.lit(midstance, pl.Float64)),
        unseen=pl.lit(known_finding("walking_unseen").says),
        subject=pl.lit(None, pl.String) if has_one_group else pl.col("group"),
    )
    yield from claims_of("walking", rows)


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
    claims: list[Claim] = []
    bench = {name: table for name, table in tables.items() if not name.startswith("walking")}
    places = [place for table in bench.values() for place in table.select("joint", "side").rows()]
    for joint, side in dict.fromkeys(places):
        at_place = [
            pl.col("joint").eq_missing(pl.lit(joint, pl.String)),
            pl.col("side").eq_missing(pl.lit(side, pl.String)),
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
        yield from compensation_claims(tables["compensation"])
    if "response" in tables:
        yield from passivity_claims(tables["response"].filter(scope="all"))
