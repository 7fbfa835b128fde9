"""The claims of the paper's text, held against numbers of the campaign: a row with number and
verdict for each.

`equivalent`, `different` and `undecided` compare a number with its target (`stats.repeats`). That a
number is beyond a limit `holds` if its whole interval is, `fails` if none of it is, and is
`undecided` otherwise. Without an interval there is no verdict."""

from collections.abc import Iterator, Mapping, Sequence
from math import pi
from typing import Annotated, Any

import numpy as np
import polars as pl
import scipy
from pydantic import Field

from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import equivalence
from osl_analysis.table import held_against_desired
from osl_analysis.yaml_settings import Positive, Settings

Claim = dict[str, Any]
CLAIM_COLUMNS = {
    **dict.fromkeys(("joint", "side", "name", "subject", "claim", "quantity"), pl.String),
    **dict.fromkeys(("value", "low", "high"), pl.Float64), **dict.fromkeys(("unit", "interval",
    "wanted"), pl.String),
    **dict.fromkeys(("target", "margin", "n"), pl.Float64), "verdict": pl.String,
}  # fmt: skip
CLAIMED = (
    "belt_summary", "transmission_summary", "actuator_summary", "impedance", "compensation",
    "frequency_response",
    "walking_summary",
)  # fmt: skip
"""The result tables that claims are held against."""
FIT, MEAN = "95 % for another motion of this kind", "95 % of the mean (Student)"
LESS = {
    "torque_error": "the torque is nearer to K_d theta + B_d omega",
    "K_error": "K is nearer to K_d",
}
LESS |= {
    "B_error": "B, without friction where this is certain, is nearer to B_d",
    "VAF": "K, B and I explain more of the torque",
}


class Claims(Settings):
    """Margins and limits of the verdicts on what the text claims."""

    K_percent: Positive | None = 5.0
    """Margin [%] within which a stiffness is the desired one, on the bench and while walking; null:
    no verdict."""
    # Margin [N*m*s/rad] within which a damping is the desired one; null: no verdict.
    B: Positive | None = None
    negligible_percent: Annotated[float, Field(gt=0, lt=100)] = 10.0
    """Share [%] below which a part of a whole is negligible."""


def limit_verdict(low: float | None, high: float | None, limit: float, wanted: str) -> str | None:
    """Whether a number with this 95 % interval is on the `wanted` side of a limit (`above`,
    `below`), as a verdict."""
    if low is None or high is None:
        return None
    if low > limit or high < limit:
        return "holds" if (low > limit) == (wanted == "above") else "fails"
    return "undecided"


Ends = tuple[float | None, float | None]


def claim_of(name: str, claim: str, quantity: str, number: float, ends: Ends, **more: Any) -> Claim:
    """A row: the claim, its quantity, a number with the ends of its interval, and `more` columns.
    Without a verdict among these, a number `wanted` on one side of its `target` has its verdict by
    that."""
    row = {
        "name": name,
        "claim": claim,
        "quantity": quantity,
        "value": number,
        "low": ends[0],
        "high": ends[1],
        **more,
    }
    return (
        row
        if "verdict" in row
        else row | {"verdict": limit_verdict(*ends, row["target"], row["wanted"])}
    )


def share_claim(
    name: str, what: str, quantity: str, share: float, parts: Sequence[Claim], **judged: Any
) -> Claim:
    """A claim on a share of a whole [1], with an interval from the means of its `parts` (rows of a
    summary)."""
    ends: Ends = None, None
    share, freedom = 100 * share, min(part["n"] for part in parts) - 1
    if freedom > 0 and all(part["se"] is not None for part in parts):
        error = np.linalg.norm([part["se"] / part["mean"] for part in parts])
        half = share * judged.pop("of", 1.0) * float(error * scipy.special.stdtrit(freedom, 0.975))
        ends = share - half, share + half
    facts = {"unit": "%", "interval": None if ends[0] is None else MEAN, "n": freedom + 1}
    return claim_of(name, what, quantity, share, ends, **facts, **judged)


def component_claims(
    means: Mapping[str, Claim],
    asked: pl.DataFrame,
    hz: Sequence[float],
    n_T: float | None,
    limit: float,
) -> Iterator[Claim]:
    """Whether the joint's inertia is negligible beside its damping, at the lowest and the highest
    frequency [Hz], and whether belt and load friction matter, at the lowest and the highest K_d.
    `means` are the components' means over trials by quantity, `asked` the rows of `impedance.csv`
    over all amplitudes."""
    if hz and {"J_j", "B_j"} <= means.keys():
        J_j, B_j = means["J_j"], means["B_j"]
        for end, f in (("lowest", min(hz)), ("highest", max(hz))):
            share, what = (
                2 * pi * f * J_j["mean"] / B_j["mean"],
                f"the joint's inertia is negligible at {f:g} Hz",
            )
            judged = {"wanted": "below", "target": limit}
            yield share_claim(
                f"inertia_at_{end}_frequency", what, "J_j omega/B_j", share, (J_j, B_j), **judged
            )
    known, judged = (
        asked.filter(pl.col("K_d") > 0).sort("K_d").to_dicts(),
        {"wanted": "above", "target": limit},
    )
    for end, row in (("lowest", known[0]), ("highest", known[-1])) if known and n_T else ():
        at = f"at K_d = {row['K_d']:g}"
        if "K_s" in means:
            share, quantity = (
                row["K_d"] / means["K_s"]["mean"],
                "K_d/K_s, its share of the gain K_1 n_T^2",
            )
            name, what = f"belt_at_{end}_K_d", f"the belt matters {at}"
            yield share_claim(name, what, quantity, share, (means["K_s"],), **judged)
        if {"f_C", "f_G", "k_tau_n_m"} <= means.keys():
            parts = [means[name] for name in ("f_C", "f_G", "k_tau_n_m")]
            f_C, f_G, k_tau = (part["mean"] for part in parts)
            load = f_G * row["K_d"] * np.deg2rad(row["theta_rms_deg"]) / (n_T * k_tau)
            share, quantity = (
                load / (f_C + load),
                "its share of the friction at K_d times the RMS angle",
            )
            what = f"friction that grows with the load, f_G |I|, matters {at}"
            name, of = f"load_friction_at_{end}_K_d", f_C / (f_C + load)
            yield share_claim(name, what, quantity, share, parts, **judged, of=of)


def compensation_claims(compensation: pl.DataFrame) -> Iterator[Claim]:
    """What compensation improves, from `compensation.csv`."""
    rows = compensation.to_dicts()  # an empty table has no texts
    counts = {row["quantity"]: row for row in rows if row["by"] == "amplitudes"}
    for row in (one for one in rows if one["by"] == "trials"):
        name, single = row["quantity"], counts.get(row["quantity"])
        said = f" and {single['better']} of {single['pairs']} of amplitudes" if single else ""
        quantity = (
            f"mean difference; better in {row['better']} of {row['pairs']} pairs of trials{said}"
        )
        facts = {"unit": row["unit"], "interval": MEAN, "n": row["pairs"], "target": 0.0}
        facts |= {"wanted": "above" if name == "VAF" else "below"}
        ends = row["difference_low"], row["difference_high"]
        claim = f"with compensation {LESS[name]}"
        yield claim_of(f"compensation_{name}", claim, quantity, row["difference"], ends, **facts)


def rendered_claims(asked: pl.DataFrame, settings: Claims) -> Iterator[Claim]:
    """Whether each compensated trial renders K_d and B_d, and how many do; `asked` are the rows
    over all amplitudes."""
    trials = held_against_desired(asked.filter(pl.col("controller") == CONTROLLERS[0]))
    for symbol, unit in (("K", "N*m/rad"), ("B", "N*m*s/rad")):
        rows = []
        for row in trials.drop_nulls(f"{symbol}_d").to_dicts():
            target, ends = row[f"{symbol}_d"], (row[f"{symbol}_low"], row[f"{symbol}_high"])
            margin = (
                settings.B
                if symbol == "B"
                else target * settings.K_percent / 100
                if settings.K_percent
                else None
            )
            if margin is not None:
                facts = {"unit": unit, "interval": FIT, "target": target, "margin": margin, "n": 1}
                facts |= {"subject": row["trial"], "verdict": equivalence(*ends, target, margin)}
                own = symbol + " without friction" * (
                    symbol == "B" and row.get("B_viscous") is not None
                )
                rows.append(
                    claim_of(symbol, f"{own} is {symbol}_d", own, row[symbol], ends, **facts)
                )
        if rows:
            verdicts = [row["verdict"] for row in rows]
            same = verdicts.count("equivalent")
            verdict = (
                "holds"
                if same == len(rows)
                else "fails"
                if "different" in verdicts
                else "undecided"
            )
            within = f"{settings.K_percent:g} %" if symbol == "K" else f"{settings.B:g} {unit}"
            claim = f"compensated trials have {symbol} within {within} of {symbol}_d"
            facts = {
                "unit": "trials",
                "interval": "count",
                "target": float(len(rows)),
                "n": len(rows),
            }
            of = "trials whose whole interval lies within"
            yield claim_of(
                f"{symbol}_equivalent", claim, of, same, (None, None), verdict=verdict, **facts
            )
            yield from rows


def passivity_claims(response: pl.DataFrame) -> Iterator[Claim]:
    """Whether the joint takes in energy at every frequency: Re of torque over velocity, `damping`
    with its interval."""
    for controller in CONTROLLERS:
        rows = response.filter(pl.col("controller") == controller).drop_nulls("damping")
        if rows.is_empty():
            continue
        row = rows.sort("damping").row(0, named=True)
        verdict = "undecided" if (rows["damping_low"] < 0).any() else "holds"
        facts = {
            "verdict": "fails" if (rows["damping_high"] < 0).any() else verdict,
            "target": 0.0,
            "n": len(rows),
        }
        facts |= {"unit": "N*m*s/rad", "interval": "95 % of measurement noise", "wanted": "above"}
        what = f"the {controller} joint is passive at all measured frequencies"
        quantity = f"least real part of Z ({row['trial']} at {row['frequency_hz']:.3g} Hz)"
        ends = row["damping_low"], row["damping_high"]
        yield claim_of(f"passive_{controller}", what, quantity, row["damping"], ends, **facts)


def walking_claims(
    summary: pl.DataFrame, midstance: float | None, settings: Claims
) -> Iterator[Claim]:
    """Whether the stiffness while walking is the commanded one, by group."""
    rows = summary.filter(
        pl.col("quantity") == "K", pl.col("estimator") == "ensemble", pl.col("mean").is_not_null()
    )
    for row in rows.to_dicts():
        target = (
            row["commanded"]
            if row["commanded"] is not None
            else midstance
            if len(rows) == 1
            else None
        )
        if target is None or settings.K_percent is None:
            continue
        margin, ends = target * settings.K_percent / 100, (row["low"], row["high"])
        facts = {
            "unit": "N*m/rad",
            "interval": row["interval_method"],
            "target": target,
            "margin": margin,
        }
        facts |= {
            "n": row["n"],
            "verdict": equivalence(*ends, target, margin),
            "joint": row["joint"],
        }
        facts |= {"side": row["side"], "subject": None if len(rows) == 1 else row["group"]}
        claim = (
            f"the ankle's stiffness while walking is {target:g} N*m/rad, within"
            f" {settings.K_percent:g} %"
        )
        yield claim_of("walking_K_equivalent", claim, "K", row["mean"], ends, **facts)


def claims_table(
    tables: Mapping[str, pl.DataFrame],
    settings: Claims,
    frequencies_hz: Sequence[float],
    midstance: float | None,
    ratios: Mapping[str, float],
) -> pl.DataFrame:
    """`claims.csv` from the campaign's result tables by name. `frequencies_hz` are those of the
    stepped sine (empty: not stated), `midstance` the commanded stiffness [N*m/rad] there, `ratios`
    n_T by joint."""
    bench = {name: own for name, own in tables.items() if not name.startswith("walking")}
    rows = list[Claim]()
    for joint, side in dict.fromkeys(
        one for own in bench.values() for one in own.select("joint", "side").iter_rows()
    ):
        place = {"joint": joint, "side": side}
        at = [pl.col(name).eq_missing(pl.lit(value, pl.String)) for name, value in place.items()]
        here = {name: own.filter(at) for name, own in bench.items()}
        summaries = [own for name, own in here.items() if name.endswith("_summary")]
        means = {
            row["quantity"]: row for own in summaries for row in own.drop_nulls("mean").to_dicts()
        }
        asked = here.get(
            "impedance", pl.DataFrame(schema=["K_d", "controller", "amplitude_deg", "B_d"])
        )
        asked = asked.filter(pl.col("amplitude_deg").is_null())
        limit, n_T = settings.negligible_percent, ratios.get(joint)
        found = [
            *component_claims(means, asked, frequencies_hz, n_T, limit),
            *rendered_claims(asked, settings),
        ]
        if "compensation" in here:
            found += compensation_claims(here["compensation"])
        if "frequency_response" in here:
            found += passivity_claims(here["frequency_response"])
        rows += [place | claim for claim in found]
    if "walking_summary" in tables:
        rows += walking_claims(tables["walking_summary"], midstance, settings)
    return pl.DataFrame(rows, schema=CLAIM_COLUMNS).sort(
        pl.col("subject").is_not_null(), maintain_order=True
    )
