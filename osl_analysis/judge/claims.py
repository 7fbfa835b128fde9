"""The claims of the paper's text, each compared with a number of the campaign: a row with number
and verdict for each.

`equivalent`, `different` and `undecided` compare a number with its target (`stats.repeats`). That a
number is beyond a limit `holds` if its whole interval is, `fails` if none of it is, and is
`undecided` otherwise. Without an interval there is no verdict. What is claimed over conditions is
judged by the interval of each (`verdict_over_pairs`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
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
NEGLIGIBLE_PERCENT = 10.0  # a part of a whole below this share is negligible
OF_FIT = "95 % for this motion"
OF_MEAN = "95 % of the mean (Student)"
OF_NOISE = "95 % of measurement noise"
BETTER = {
    "torque_error": "the torque is nearer to K_d theta + B_d omega",
    "K_error": "K is nearer to K_d",
    "B_error": "B is nearer to B_d",
    "B_viscous_error": "B without friction, where this is certain of both, is nearer to B_d",
    "VAF": "K, B and I explain more of the torque",
}
"""What compensation improves, by the quantity of `compensation.csv`."""
Direction = Literal["above", "below"]


class Claims(Settings):
    """Margins and limits of the verdicts on what the text claims."""

    K_percent: Positive | None = 5.0
    """Margin [%] within which a stiffness is the desired one, on the bench and while walking; null:
    no verdict."""
    B: Positive | None = None
    """Margin [N*m*s/rad] within which a damping is the desired one; null: no verdict."""


@dataclass(frozen=True)
class Claim:
    """A row of `claims.csv`.

    Attributes
    ----------
    name, claim
        Its name, and what the text claims.
    quantity, unit
        What is compared.
    value, low, high
        Its number and the ends of its interval; None without one.
    interval
        What the interval is.
    wanted, target
        On which side of a limit the number is wanted, or what it should be.
    margin
        Within which it is the same as its target.
    n
        Number of trials behind it.
    verdict
        What comes of it; None without a verdict.
    subject
        The trial or group that it is of; None: the campaign.
    joint, side
        Where it was measured.
    """

    name: str
    claim: str
    quantity: str
    unit: str
    value: float
    low: float | None = None
    high: float | None = None
    interval: str | None = None
    wanted: Direction | None = None
    target: float | None = None
    margin: float | None = None
    n: float | None = None
    verdict: str | None = None
    subject: str | None = None
    joint: str | None = None
    side: str | None = None


def limit_verdict(low: float | None, high: float | None, limit: float, wanted: str) -> str | None:
    """Whether a number with this 95 % interval is on the `wanted` side of a limit (`above`,
    `below`), as a verdict."""
    if low is None or high is None:
        return None
    if low > limit or high < limit:
        return "holds" if (low > limit) == (wanted == "above") else "fails"
    return "undecided"


def share_claim(
    *,
    name: str,
    claim: str,
    quantity: str,
    share: float,
    parts: Sequence[Mapping[str, Any]],
    wanted: Direction,
    limit_percent: float,
    sensitivity: float = 1.0,
) -> Claim:
    """A claim on a share of a whole.

    Parameters
    ----------
    share
        The number [1].
    parts
        Rows of a summary, whose means make the share; its interval is from their relative errors.
    wanted, limit_percent
        On which side of the limit it is wanted.
    sensitivity
        Relative change of the share by that of its parts.
    """
    percent = 100 * share
    freedom = min(part["n"] for part in parts) - 1
    low = None
    high = None
    if freedom > 0 and all(part["se"] is not None for part in parts):
        relative_error = np.linalg.norm([part["se"] / part["mean"] for part in parts])
        relative_half_width = float(relative_error * scipy.special.stdtrit(freedom, 0.975))
        half_width = percent * sensitivity * relative_half_width
        low = percent - half_width
        high = percent + half_width
    return Claim(
        name=name,
        claim=claim,
        quantity=quantity,
        unit="%",
        value=percent,
        low=low,
        high=high,
        interval=None if low is None else OF_MEAN,
        wanted=wanted,
        target=limit_percent,
        n=freedom + 1,
        verdict=limit_verdict(low, high, limit_percent, wanted),
    )


Means = Mapping[str, Mapping[str, Any]]
"""Rows of the components' summaries by quantity: their means over trials."""


def inertia_claims(means: Means, frequencies_hz: Sequence[float]) -> Iterator[Claim]:
    """Whether the joint's inertia is negligible beside its damping, at the lowest and the highest
    frequency [Hz]."""
    if not frequencies_hz or not {"J_j", "B_j"} <= means.keys():
        return
    J_j, B_j = means["J_j"], means["B_j"]
    for hz in dict.fromkeys((min(frequencies_hz), max(frequencies_hz))):
        yield share_claim(
            name=f"inertia_at_{hz:g}_Hz",
            claim=f"the joint's inertia is negligible at {hz:g} Hz",
            quantity="J_j omega/B_j",
            share=2 * pi * hz * J_j["mean"] / B_j["mean"],
            parts=(J_j, B_j),
            wanted="below",
            limit_percent=NEGLIGIBLE_PERCENT,
        )


def stiffness_claims(means: Means, fits: pl.DataFrame, n_T: float | None) -> Iterator[Claim]:
    """Whether belt and load friction matter, at the lowest and the highest K_d of the `fits` over
    all amplitudes."""
    known = fits.filter(pl.col("K_d") > 0).sort("K_d").to_dicts()
    if not known or not n_T:
        return
    at_ends = {f"{row['K_d']:g}": row for row in (known[0], known[-1])}
    for K_d, row in at_ends.items():
        at = f"at K_d = {K_d}"
        if "K_s" in means:
            yield share_claim(
                name=f"belt_at_K_d_{K_d}",
                claim=f"the belt matters {at}",
                quantity="K_d/K_s, its share of the gain K_1 n_T^2",
                share=row["K_d"] / means["K_s"]["mean"],
                parts=(means["K_s"],),
                wanted="above",
                limit_percent=NEGLIGIBLE_PERCENT,
            )
        if {"f_C", "f_G", "k_tau_n_m"} <= means.keys():
            parts = [means[name] for name in ("f_C", "f_G", "k_tau_n_m")]
            f_C, f_G, k_tau_n_m = (part["mean"] for part in parts)
            turn = np.deg2rad(row["theta_rms_deg"])
            of_load = f_G * row["K_d"] * turn / (n_T * k_tau_n_m)
            yield share_claim(
                name=f"load_friction_at_K_d_{K_d}",
                claim=f"friction that grows with the load, f_G |I|, matters {at}",
                quantity="its share of the friction at K_d times the RMS angle",
                share=of_load / (f_C + of_load),
                parts=parts,
                wanted="above",
                limit_percent=NEGLIGIBLE_PERCENT,
                sensitivity=f_C / (f_C + of_load),
            )


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
        wanted: Direction = "above" if name == "VAF" else "below"
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
        yield Claim(
            name=f"compensation_{name}",
            claim=f"with compensation {BETTER[name]}",
            quantity=f"mean difference; {counts}",
            unit=row["unit"],
            value=row["difference"],
            low=row["difference_low"],
            high=row["difference_high"],
            interval=RANGE,
            wanted=wanted,
            target=0.0,
            n=n,
            verdict=verdict_over_pairs(n, n_better, n_certain, n_worse),
        )


def rendered_claims(fits: pl.DataFrame, settings: Claims) -> Iterator[Claim]:
    """Whether each compensated trial renders K_d and B_d, and how many do; `fits` are the rows over
    all amplitudes."""
    trials = fits.filter(pl.col("controller") == CONTROLLERS[0])
    units = {"K": "N*m/rad", "B": "N*m*s/rad", "B_viscous": "N*m*s/rad"}
    for symbol, unit in units.items():
        of_trials = list(claims_of_trials(trials, symbol, unit, settings))
        if not of_trials:
            continue
        verdicts = [claim.verdict for claim in of_trials]
        equivalent = verdicts.count("equivalent")
        verdict = "undecided"
        if equivalent == len(of_trials):
            verdict = "holds"
        elif "different" in verdicts:
            verdict = "fails"
        within = f"{settings.K_percent:g} %" if symbol == "K" else f"{settings.B:g} {unit}"
        yield Claim(
            name=f"{symbol}_equivalent",
            claim=f"compensated trials have {symbol} within {within} of {symbol[0]}_d",
            quantity="trials whose whole interval lies within",
            unit="trials",
            value=equivalent,
            interval="count",
            target=float(len(of_trials)),
            n=len(of_trials),
            verdict=verdict,
        )
        yield from of_trials


def claims_of_trials(
    trials: pl.DataFrame, symbol: str, unit: str, settings: Claims
) -> Iterator[Claim]:
    """Whether each trial has the desired K or B; `B_viscous` is compared with B_d, too."""
    desired = f"{symbol[0]}_d"
    for row in trials.drop_nulls(desired).to_dicts():
        target = row[desired]
        margin = settings.B
        if symbol == "K":
            margin = target * settings.K_percent / 100 if settings.K_percent else None
        if margin is None or row.get(symbol) is None:
            continue
        low, high = row[f"{symbol}_low"], row[f"{symbol}_high"]
        lowest, highest = (row.get(f"{symbol}_amplitudes_{end}") for end in ("low", "high"))
        interval = OF_FIT
        if lowest is not None:
            interval = f"{OF_FIT}; single amplitudes {lowest:.4g} to {highest:.4g}"
        yield Claim(
            name=symbol,
            claim=f"{symbol} is {desired}",
            quantity=symbol,
            unit=unit,
            value=row[symbol],
            low=low,
            high=high,
            interval=interval,
            target=target,
            margin=margin,
            n=1,
            verdict=equivalence(low, high, target, margin),
            subject=row["trial"],
        )


def passivity_claims(response: pl.DataFrame) -> Iterator[Claim]:
    """Whether the joint takes in energy at every frequency: Re of torque over velocity, `damping`
    with its interval."""
    for controller in CONTROLLERS:
        rows = response.filter(pl.col("controller") == controller).drop_nulls("damping")
        if rows.is_empty():
            continue
        verdict = "holds"
        if (rows["damping_high"] < 0).any():
            verdict = "fails"
        elif (rows["damping_low"] < 0).any():
            verdict = "undecided"
        least = rows.sort("damping").row(0, named=True)
        where = f"{least['trial']} at {least['frequency_hz']:.3g} Hz"
        yield Claim(
            name=f"passive_{controller}",
            claim=f"the {controller} joint is passive at all measured frequencies",
            quantity=f"least real part of Z ({where})",
            unit="N*m*s/rad",
            value=least["damping"],
            low=least["damping_low"],
            high=least["damping_high"],
            interval=OF_NOISE,
            wanted="above",
            target=0.0,
            n=len(rows),
            verdict=verdict,
        )


def walking_claims(
    summary: pl.DataFrame, groups: pl.DataFrame, midstance: float | None, settings: Claims
) -> Iterator[Claim]:
    """Whether the stiffness while walking is the commanded one, by group, if nothing is at work
    that the walkway does not show. The interval holds what an offset of the fit would change.
    `midstance` is the commanded one [N*m/rad] of a campaign with one group whose sheet states
    none."""
    offset_shares = dict(groups.select("group", "offset_share").iter_rows())
    unseen = known_finding("walking_unseen").says
    is_ensemble = pl.col("estimator") == "ensemble"
    rows = summary.filter(
        pl.col("quantity") == "K", is_ensemble, pl.col("mean").is_not_null()
    ).to_dicts()
    has_one_group = len(rows) == 1
    for row in rows:
        target = row["commanded"]
        if target is None and has_one_group:
            target = midstance
        if target is None or settings.K_percent is None:
            continue
        margin = target * settings.K_percent / 100
        by_offset = -row["mean"] * (offset_shares.get(row["group"]) or 0.0)
        low = row["low"] + min(by_offset, 0.0)
        high = row["high"] + max(by_offset, 0.0)
        yield Claim(
            name="walking_K_equivalent",
            claim=(
                f"the ankle's stiffness while walking is {target:g} N*m/rad, within"
                f" {settings.K_percent:g} %, if none of these is at work: {unseen}"
            ),
            quantity="K",
            unit="N*m/rad",
            value=row["mean"],
            low=low,
            high=high,
            interval=f"{row['interval_method']}, and an offset of the fit",
            target=target,
            margin=margin,
            n=row["n"],
            verdict=equivalence(low, high, target, margin),
            subject=None if has_one_group else row["group"],
            joint=row["joint"],
            side=row["side"],
        )


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
    bench = {name: table for name, table in tables.items() if not name.startswith("walking")}
    claims: list[Claim] = []
    places = [place for table in bench.values() for place in table.select("joint", "side").rows()]
    for joint, side in dict.fromkeys(places):
        at_place = [
            pl.col(name).eq_missing(pl.lit(value, pl.String))
            for name, value in (("joint", joint), ("side", side))
        ]
        of_place = {name: table.filter(at_place) for name, table in bench.items()}
        for claim in claims_of_place(of_place, settings, frequencies_hz, ratios.get(joint)):
            claims.append(replace(claim, joint=joint, side=side))
    if "walking_summary" in tables:
        groups = tables["walking_groups"]
        claims += walking_claims(tables["walking_summary"], groups, midstance, settings)
    table = pl.DataFrame([asdict(claim) for claim in claims], schema=CLAIM_COLUMNS)
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
    no_fits = pl.DataFrame(schema=["K_d", "controller", "amplitude_deg", "B_d"])
    fits = tables.get("impedance", no_fits).filter(pl.col("amplitude_deg").is_null())
    yield from inertia_claims(means, frequencies_hz)
    yield from stiffness_claims(means, fits, n_T)
    yield from rendered_claims(fits, settings)
    if "compensation" in tables:
        yield from compensation_claims(tables["compensation"])
    if "response" in tables:
        yield from passivity_claims(tables["response"].filter(scope="all"))
