"""What the paper's text claims, held against numbers of the campaign: a row for each, with number and verdict.

`equivalent`, `different` and `undecided` are verdicts on a number and what it should be (`stats.repeats`). That a
number is beyond a limit `holds` where the whole interval is, `fails` where none of it is, and is else `undecided`.
Without an interval there is no verdict.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import hypot, pi
from typing import Annotated, Any

import polars as pl
import scipy
from pydantic import Field

from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import equivalence
from osl_analysis.yaml_settings import Positive, Settings

Claim = dict[str, Any]
CLAIM_COLUMNS = {
    **dict.fromkeys(("joint", "side", "name", "subject", "claim", "quantity"), pl.String),
    **dict.fromkeys(("value", "low", "high"), pl.Float64), **dict.fromkeys(("unit", "interval", "wanted"), pl.String),
    **dict.fromkeys(("target", "margin", "n"), pl.Float64), "verdict": pl.String,
}  # fmt: skip
CLAIMED = ("transmission_summary", "impedance", "compensation", "walking_summary")
"""The result tables that claims are held against."""
FIT, MEAN = "95 % for another motion of this kind", "95 % of the mean (Student)"
LESS = {"torque_error": "the torque is nearer to K_d theta + B_d omega", "K_error": "K is nearer to K_d"}
LESS |= {"B_error": "B is nearer to B_d", "VAF": "Eq. 15 explains more of the torque"}


class Claims(Settings):
    """Margins and limits of the verdicts on what the text claims."""

    K_percent: Positive | None = 5.0
    """Margin [%] within which a stiffness is the desired one, on the bench and while walking; null: no verdict."""
    B: Positive | None = None  # Margin [N*m*s/rad] within which a damping is the desired one; null: no verdict.
    negligible_percent: Annotated[float, Field(gt=0, lt=100)] = 10.0
    """Share [%] below which a part of a whole is negligible."""


def limit_verdict(low: float | None, high: float | None, limit: float, wanted: str) -> str | None:
    """Whether a number with this 95 % interval is `above` a limit, or `below` it: `holds`, `fails` or `undecided`."""
    if low is None or high is None:
        return None
    if low > limit or high < limit:
        return "holds" if (low > limit) == (wanted == "above") else "fails"
    return "undecided"


def claim_of(name: str, claim: str, quantity: str, number: float, ends: Sequence[float | None], **more: Any) -> Claim:
    """A row: what is claimed, of which quantity, a number with the ends of its interval, and `more` columns. A number
    that is `wanted` on one side of its `target` has its verdict by this."""
    row = {"name": name, "claim": claim, "quantity": quantity, "value": number, "low": ends[0], "high": ends[1], **more}
    return row if "verdict" in row else row | {"verdict": limit_verdict(*ends, row["target"], row["wanted"])}


def inertia_claims(means: Mapping[str, Claim], hz: Sequence[float], limit: float) -> Iterator[Claim]:
    """Whether the joint's inertia is negligible beside its damping at the lowest and the highest frequency [Hz], from
    their means over the trials by quantity (rows of a summary)."""
    if not hz or not {"J_j", "B_j"} <= means.keys():
        return
    J_j, B_j = means["J_j"], means["B_j"]
    for end, f in (("lowest", min(hz)), ("highest", max(hz))):
        share, ends = 100 * 2 * pi * f * J_j["mean"] / B_j["mean"], (None, None)
        freedom = min(J_j["n"], B_j["n"]) - 1
        if J_j["se"] is not None and B_j["se"] is not None and freedom > 0:
            relative = hypot(J_j["se"] / J_j["mean"], B_j["se"] / B_j["mean"])
            half = share * relative * float(scipy.special.stdtrit(freedom, 0.975))
            ends = share - half, share + half
        claim, facts = f"the joint's inertia is negligible at {f:g} Hz", {"unit": "%", "n": freedom + 1}
        facts |= {"interval": None if ends[0] is None else MEAN, "wanted": "below", "target": limit}
        yield claim_of(f"inertia_at_{end}_frequency", claim, "J_j omega/B_j", share, ends, **facts)


def compensation_claims(compensation: pl.DataFrame) -> Iterator[Claim]:
    """What compensation improves, from `compensation.csv`."""
    rows = compensation.to_dicts()  # an empty table has no texts
    counts = {row["quantity"]: row for row in rows if row["by"] == "amplitudes"}
    for row in (one for one in rows if one["by"] == "trials"):
        name, single = row["quantity"], counts.get(row["quantity"])
        said = f" and {single['better']} of {single['pairs']} of amplitudes" if single else ""
        quantity = f"mean difference; better in {row['better']} of {row['pairs']} pairs of trials{said}"
        facts = {"unit": row["unit"], "interval": MEAN, "n": row["pairs"], "target": 0.0}
        facts |= {"wanted": "above" if name == "VAF" else "below"}
        ends = row["difference_low"], row["difference_high"]
        claim = f"with compensation {LESS[name]}"
        yield claim_of(f"compensation_{name}", claim, quantity, row["difference"], ends, **facts)


def rendered_claims(asked: pl.DataFrame, settings: Claims) -> Iterator[Claim]:
    """Whether each compensated trial renders K_d and B_d, and how many do. `asked` are the rows of `impedance.csv` over
    all amplitudes."""
    trials = asked.filter(pl.col("controller") == CONTROLLERS[0])
    for symbol, unit in (("K", "N*m/rad"), ("B", "N*m*s/rad")):
        rows = []
        for row in trials.drop_nulls(f"{symbol}_d").to_dicts():
            target, ends = row[f"{symbol}_d"], (row[f"{symbol}_low"], row[f"{symbol}_high"])
            margin = settings.B if symbol == "B" else target * settings.K_percent / 100 if settings.K_percent else None
            if margin is not None:
                facts = {"unit": unit, "interval": FIT, "target": target, "margin": margin, "n": 1}
                facts |= {"subject": row["trial"], "verdict": equivalence(*ends, target, margin)}
                rows.append(claim_of(symbol, f"{symbol} is {symbol}_d", symbol, row[symbol], ends, **facts))
        if rows:
            verdicts = [row["verdict"] for row in rows]
            same = verdicts.count("equivalent")
            verdict = "holds" if same == len(rows) else "fails" if "different" in verdicts else "undecided"
            within = f"{settings.K_percent:g} %" if symbol == "K" else f"{settings.B:g} {unit}"
            claim = f"compensated trials have {symbol} within {within} of {symbol}_d"
            facts = {"unit": "trials", "interval": "count", "target": float(len(rows)), "n": len(rows)}
            of = "trials whose whole interval lies within"
            yield claim_of(f"{symbol}_equivalent", claim, of, same, (None, None), verdict=verdict, **facts)
            yield from rows


def walking_claims(summary: pl.DataFrame, midstance: float | None, settings: Claims) -> Iterator[Claim]:
    """Whether the stiffness while walking is the commanded one, by group."""
    rows = summary.filter(pl.col("quantity") == "K", pl.col("estimator") == "ensemble", pl.col("mean").is_not_null())
    for row in rows.to_dicts():
        target = row["commanded"] if row["commanded"] is not None else midstance if len(rows) == 1 else None
        if target is None or settings.K_percent is None:
            continue
        margin, ends = target * settings.K_percent / 100, (row["low"], row["high"])
        facts = {"unit": "N*m/rad", "interval": row["interval_method"], "target": target, "margin": margin}
        facts |= {"n": row["n"], "verdict": equivalence(*ends, target, margin), "joint": row["joint"]}
        facts |= {"side": row["side"], "subject": None if len(rows) == 1 else row["group"]}
        claim = f"the ankle's stiffness while walking is {target:g} N*m/rad, within {settings.K_percent:g} %"
        yield claim_of("walking_K_equivalent", claim, "K", row["mean"], ends, **facts)


def claims_table(
    tables: Mapping[str, pl.DataFrame], settings: Claims, frequencies_hz: Sequence[float], midstance: float | None
) -> pl.DataFrame:
    """`claims.csv` from those result tables that the campaign has, by name. `frequencies_hz` are those of the stepped
    sine (empty: not stated), `midstance` the stiffness [N*m/rad] that is commanded there."""
    bench = {name: own for name, own in tables.items() if not name.startswith("walking")}
    rows = list[Claim]()
    for joint, side in dict.fromkeys(one for own in bench.values() for one in own.select("joint", "side").iter_rows()):
        place = {"joint": joint, "side": side}
        at = [pl.col(name).eq_missing(pl.lit(value, pl.String)) for name, value in place.items()]
        here = {name: own.filter(at) for name, own in bench.items()}
        found = list[Claim]()
        if "transmission_summary" in here:
            means = {row["quantity"]: row for row in here["transmission_summary"].drop_nulls("mean").to_dicts()}
            found += inertia_claims(means, frequencies_hz, settings.negligible_percent)
        if "compensation" in here:
            found += compensation_claims(here["compensation"])
        if "impedance" in here:
            found += rendered_claims(here["impedance"].filter(pl.col("amplitude_deg").is_null()), settings)
        rows += [place | claim for claim in found]
    if "walking_summary" in tables:
        rows += walking_claims(tables["walking_summary"], midstance, settings)
    return pl.DataFrame(rows, schema=CLAIM_COLUMNS).sort(pl.col("subject").is_not_null(), maintain_order=True)
