"""The claims of the paper's text, each compared with a number of the campaign: a row with number
and verdict for each.

`equivalent`, `different` and `undecided` compare a number with its target (`stats.repeats`). That a
number is beyond a limit `holds` if its whole interval is, `fails` if none of it is, and is
`undecided` otherwise. Without an interval there is no verdict. What is claimed over conditions is
judged by the interval of each (`verdict_over_pairs`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any, Literal

import numpy as np
import polars as pl
import scipy

from osl_analysis.judge.known_findings import known_finding
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import RANGE, equivalence
from osl_analysis.yaml_settings import Positive, Settings

WORDS_OF_CLAIM = ("joint", "side", "name", "subject", "claim", "quantity")
CLAIM_COLUMNS = {
    **dict.fromkeys(WORDS_OF_CLAIM, pl.String),
    **dict.fromkeys(("value", "low", "high"), pl.Float64),
    **dict.fromkeys(("unit", "interval", "wanted"), pl.String),
    **dict.fromkeys(("target", "margin", "n"), pl.Float64),
    "verdict": pl.String,
}
Claim = dict[str, Any]  # a row of `claims.csv`, by `CLAIM_COLUMNS`; what it has not is null
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
NEGLIGIBLE_PERCENT = 10.0  # a part of a whole below this share is negligible
BETTER = {
    "torque_error": "the torque is nearer to K_d theta + B_d omega",
    "K_error": "K is nearer to K_d",
    "B_error": "B is nearer to B_d",
    "B_viscous_error": "B without friction, where this is certain of both, is nearer to B_d",
    "VAF": "K, B and I explain more of the torque",
}
"""What compensation improves, by the quantity of `compensation.csv`."""
UNITS = {"K": "N*m/rad", "B": "N*m*s/rad", "B_viscous": "N*m*s/rad"}
Direction = Literal["above", "below"]


@dataclass(frozen=True)
class Share:
    """A claim on a share of a whole."""

    name: str
    claim: str
    quantity: str
    formula: str  # in SQL, of means over trials and of what is known without error
    wanted: Direction  # of `NEGLIGIBLE_PERCENT`


SHARES = (
    Share(
        "inertia_at_{hz:g}_Hz",
        "the joint's inertia is negligible at {hz:g} Hz",
        "J_j omega/B_j",
        "J_j * omega / B_j",
        "below",
    ),
    Share(
        "belt_at_K_d_{K_d:g}",
        "the belt matters at K_d = {K_d:g}",
        "K_d/K_s, its share of the gain K_1 n_T^2",
        "K_d / K_s",
        "above",
    ),
    Share(
        "load_friction_at_K_d_{K_d:g}",
        "friction that grows with the load, f_G |I|, matters at K_d = {K_d:g}",
        "its share of the friction at K_d times the RMS angle",
        "f_G * K_d * turn / (f_G * K_d * turn + f_C * n_T * k_tau_n_m)",
        "above",
    ),
)


class Claims(Settings):
    """Margins and limits of the verdicts on what the text claims."""

    K_percent: Positive | None = 5.0
    """Margin [%] within which a stiffness is the desired one, on the bench and while walking; null:
    no verdict."""
    B: Positive | None = None
    """Margin [N*m*s/rad] within which a damping is the desired one; null: no verdict."""


def limit_verdict(low: float | None, high: float | None, limit: float, wanted: str) -> str | None:
    """Whether a number with this 95 % interval is on the `wanted` side of a limit (`above`,
    `below`), as a verdict."""
    if low is None or high is None:
        return None
    if low > limit or high < limit:
        return "holds" if (low > limit) == (wanted == "above") else "fails"
    return "undecided"


Means = Mapping[str, Mapping[str, Any]]
"""Rows of the components' summaries by quantity: their means over trials."""


def share_claims(means: Means, known: Mapping[str, float]) -> Iterator[Claim]:
    """The claims on `SHARES` that follow from means over trials and what is `known` without error.
    Their intervals are Student's, of the means' standard errors."""
    for share in SHARES:
        formula = pl.sql_expr(share.formula)
        names = set(formula.meta.root_names())
        if not names <= means.keys() | known.keys():
            continue
        parts = sorted(names & means.keys())
        at_means = {**known, **{part: means[part]["mean"] for part in parts}}
        errors = {part: means[part]["se"] for part in parts if means[part]["se"] is not None}
        moved = [
            at_means | {part: at_means[part] + step * error}
            for part, error in errors.items()
            for step in (STEP, -STEP)
        ]
        percents = 100 * pl.DataFrame([at_means, *moved]).select(formula).to_series().to_numpy()
        freedom = min(means[part]["n"] for part in parts) - 1
        low = high = None
        if freedom > 0 and len(errors) == len(parts):
            error = float(np.linalg.norm((percents[1::2] - percents[2::2]) / 2 / STEP))
            half_width = error * float(scipy.special.stdtrit(freedom, 0.975))
            low, high = percents[0] - half_width, percents[0] + half_width
        yield {
            "name": share.name.format(**known),
            "claim": share.claim.format(**known),
            "quantity": share.quantity,
            "unit": "%",
            "value": percents[0],
            "low": low,
            "high": high,
            "interval": None if low is None else "95 % of the mean (Student)",
            "wanted": share.wanted,
            "target": NEGLIGIBLE_PERCENT,
            "n": freedom + 1,
            "verdict": limit_verdict(low, high, NEGLIGIBLE_PERCENT, share.wanted),
        }


def verdict_over_pairs(n: int, n_better: int, n_certain: int, n_certainly_worse: int) -> str:
    """Whether compensation is better over n conditions: it `holds` where every pair is better and
    the intervals of most lie wholly on that side, `fails` where none is better and those of most
    lie on the other side, and is `undecided` otherwise."""
    if n_better == n and 2 * n_certain > n:
        return "holds"
    return "fails" if not n_better and 2 * n_certainly_worse > n else "undecided"


def compensation_claims(compensation: pl.DataFrame) -> Iterator[Claim]:
    """What compensation improves, from `compensation.csv`. A difference without an interval counts
    by its sign."""
    if compensation.is_empty():  # which has no texts
        return
    for row in compensation.filter(of="trials").to_dicts():
        name = row["quantity"]
        wanted = "above" if name == "VAF" else "below"
        of_quantity = compensation.filter(quantity=name)
        ends = of_quantity.filter(of="trial").select(
            low=pl.coalesce("difference_low", "difference"),
            high=pl.coalesce("difference_high", "difference"),
        )
        verdicts = [limit_verdict(low, high, 0.0, wanted) for low, high in ends.iter_rows()]
        n, n_better = row["pairs"], row["better"]
        n_certain, n_worse = verdicts.count("holds"), verdicts.count("fails")
        counts = f"better in {n_better} of {n} pairs of trials"
        if (ends["low"] < ends["high"]).any():
            counts += f" (certainly in {n_certain}, certainly worse in {n_worse})"
        for of_amplitudes in of_quantity.filter(of="amplitudes").to_dicts():
            counts += f" and {of_amplitudes['better']} of {of_amplitudes['pairs']} of amplitudes"
        yield {
            "name": f"compensation_{name}",
            "claim": f"with compensation {BETTER[name]}",
            "quantity": f"mean difference; {counts}",
            "unit": row["unit"],
            "value": row["difference"],
            "low": row["difference_low"],
            "high": row["difference_high"],
            "interval": RANGE,
            "wanted": wanted,
            "target": 0.0,
            "n": n,
            "verdict": verdict_over_pairs(n, n_better, n_certain, n_worse),
        }


def rendered_claims(fits: pl.DataFrame, settings: Claims) -> Iterator[Claim]:
    """Whether each compensated trial renders K_d and B_d, and how many do; `fits` are the rows over
    all amplitudes. B_viscous is compared with B_d, too."""
    trials = fits.filter(pl.col("controller") == CONTROLLERS[0])
    for symbol, unit in UNITS.items():
        desired = f"{symbol[0]}_d"
        margin = settings.B
        if symbol == "K":
            margin, unit = settings.K_percent, "%"
        rows = trials.drop_nulls([desired, symbol]) if symbol in trials.columns else trials.clear()
        if margin is None or rows.is_empty():
            continue
        of_trials = [claim_of_trial(row, symbol, margin) for row in rows.to_dicts()]
        verdicts = [claim["verdict"] for claim in of_trials]
        equivalent = verdicts.count("equivalent")
        verdict = "fails" if "different" in verdicts else "undecided"
        yield {
            "name": f"{symbol}_equivalent",
            "claim": f"compensated trials have {symbol} within {margin:g} {unit} of {desired}",
            "quantity": "trials whose whole interval lies within",
            "unit": "trials",
            "value": equivalent,
            "interval": "count",
            "target": float(len(of_trials)),
            "n": len(of_trials),
            "verdict": "holds" if equivalent == len(of_trials) else verdict,
        }
        yield from of_trials


def claim_of_trial(row: Mapping[str, Any], symbol: str, margin: float) -> Claim:
    """Whether a trial has the desired K, to a margin in percent, or the desired damping."""
    target = row[f"{symbol[0]}_d"]
    if symbol == "K":
        margin = target * margin / 100
    interval = "95 % for this motion"
    lowest, highest = (row.get(f"{symbol}_amplitudes_{end}") for end in ("low", "high"))
    if lowest is not None:
        interval = f"{interval}; single amplitudes {lowest:.4g} to {highest:.4g}"
    low, high = row[f"{symbol}_low"], row[f"{symbol}_high"]
    return {
        "name": symbol,
        "claim": f"{symbol} is {symbol[0]}_d",
        "quantity": symbol,
        "unit": UNITS[symbol],
        "value": row[symbol],
        "low": low,
        "high": high,
        "interval": interval,
        "target": target,
        "margin": margin,
        "n": 1,
        "verdict": equivalence(low, high, target, margin),
        "subject": row["trial"],
    }


def passivity_claims(response: pl.DataFrame) -> Iterator[Claim]:
    """Whether the joint takes in energy at every frequency: Re of torque over velocity, `damping`
    with its interval."""
    for controller in CONTROLLERS:
        rows = response.filter(pl.col("controller") == controller).drop_nulls("damping")
        if rows.is_empty():
            continue
        least = rows.sort("damping").row(0, named=True)
        where = f"{least['trial']} at {least['frequency_hz']:.3g} Hz"
        lowest, highest = rows.select(pl.col("damping_low", "damping_high").min()).row(0)
        yield {
            "name": f"passive_{controller}",
            "claim": f"the {controller} joint is passive at all measured frequencies",
            "quantity": f"least real part of Z ({where})",
            "unit": "N*m*s/rad",
            "value": least["damping"],
            "low": least["damping_low"],
            "high": least["damping_high"],
            "interval": "95 % of measurement noise",
            "wanted": "above",
            "target": 0.0,
            "n": len(rows),
            "verdict": limit_verdict(lowest, highest, 0.0, "above"),
        }


def walking_claims(
    summary: pl.DataFrame, groups: pl.DataFrame, midstance: float | None, settings: Claims
) -> Iterator[Claim]:
    """Whether the stiffness while walking is the commanded one, by group, if nothing is at work
    that the walkway does not show. The interval holds what an offset of the fit would change.
    `midstance` is the commanded one [N*m/rad] of a campaign with one group whose sheet states
    none."""
    rows = summary.join(groups.select("group", "offset_share"), on="group", how="left")
    rows = rows.filter(pl.col("mean").is_not_null(), quantity="K", estimator="ensemble")
    has_one_group = len(rows) == 1
    percent = settings.K_percent
    for row in rows.to_dicts():
        target = row["commanded"]
        if target is None and has_one_group:
            target = midstance
        if target is None or percent is None:
            continue
        margin = target * percent / 100
        by_offset = -row["mean"] * (row["offset_share"] or 0.0)
        low = row["low"] + min(by_offset, 0.0)
        high = row["high"] + max(by_offset, 0.0)
        yield {
            "name": "walking_K_equivalent",
            "claim": (
                f"the ankle's stiffness while walking is {target:g} N*m/rad, within {percent:g} %,"
                f" if none of these is at work: {known_finding('walking_unseen').says}"
            ),
            "quantity": "K",
            "unit": "N*m/rad",
            "value": row["mean"],
            "low": low,
            "high": high,
            "interval": f"{row['interval_method']}, and an offset of the fit",
            "target": target,
            "margin": margin,
            "n": row["n"],
            "verdict": equivalence(low, high, target, margin),
            "subject": None if has_one_group else row["group"],
            "joint": row["joint"],
            "side": row["side"],
        }


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
