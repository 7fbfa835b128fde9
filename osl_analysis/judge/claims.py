"""What the paper's text claims, held against numbers of the campaign: a row `claim, number, verdict` for each.

`equivalent`, `different` and `undecided` are verdicts on a number and what it should be (`stats.repeats`). That a
number is beyond a limit `holds` where the whole interval is, `fails` where none of it is, and is else `undecided`.
Without an interval there is no verdict.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import pi
from typing import Annotated, Any

import numpy as np
import polars as pl
import scipy
from pydantic import Field

from osl_analysis.model.compensator import CONTROLLERS, Weight, select_gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.stats.repeats import equivalence
from osl_analysis.yaml_settings import Positive, Settings

Claim = dict[str, Any]
CLAIM_COLUMNS = {
    **dict.fromkeys(("joint", "side", "name", "subject", "claim"), pl.String),
    **dict.fromkeys(("value", "low", "high"), pl.Float64), "unit": pl.String, "interval": pl.String,
    **dict.fromkeys(("target", "margin", "n"), pl.Float64), "verdict": pl.String,
}  # fmt: skip
CLAIMED = (
    "belt_summary", "transmission_summary", "actuator_summary", "impedance", "compensation", "frequency_response",
    "response", "walking_summary",
)  # fmt: skip
"""The result tables that claims are held against."""
REAL_PART = ("damping", "damping_low", "damping_high")  # the real part of Z with its interval
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


def limit_verdict(low: float | None, high: float | None, limit: float, above: bool) -> str | None:
    """Whether a number with this 95 % interval is above a limit, or below it: `holds`, `fails` or `undecided`."""
    if low is None or high is None:
        return None
    if low > limit or high < limit:
        return "holds" if (low > limit) == above else "fails"
    return "undecided"


def claim_of(
    name: str, claim: str, number: float, ends: Sequence[float | None], unit: str, interval: str | None, **more: Any
) -> Claim:
    """A row: what is claimed, a number with the ends of its interval and what this is of, and `more` columns."""
    row = {"name": name, "claim": claim, "value": number, "low": ends[0], "high": ends[1]}
    return row | {"unit": unit, "interval": interval} | more


def share_claim(name: str, claim: str, share: float, error: tuple[float, float], limit: float, above: bool) -> Claim:
    """A claim on a share, with its relative standard `error` and the degrees of freedom of this; 0: none."""
    relative, freedom = error
    half = 100 * share * relative * float(scipy.special.stdtrit(freedom, 0.975)) if freedom > 0 else None
    low, high = (None, None) if half is None else (100 * share - half, 100 * share + half)
    judged = {"target": limit, "n": freedom + 1, "verdict": limit_verdict(low, high, limit, above)}
    return claim_of(name, claim, 100 * share, (low, high), "%", None if half is None else MEAN, **judged)


def component_claims(
    means: Mapping[str, Claim], asked: pl.DataFrame, hz: Sequence[float], p: DrivetrainParameters | None, limit: float
) -> Iterator[Claim]:
    """What the text says of the components, from their means over the trials by quantity (rows of a summary), at the
    lowest and the highest frequency [Hz]. `asked` are the rows of `impedance.csv` over all amplitudes."""

    def error(*names: str, of: float = 1.0) -> tuple[float, float]:
        parts = [means[name] for name in names]
        if any(part["se"] is None or not part["mean"] for part in parts):
            return np.inf, 0.0
        relative = float(np.linalg.norm([part["se"] / part["mean"] for part in parts]))
        return of * relative, min(part["n"] for part in parts) - 1.0

    if hz and {"J_j", "B_j"} <= means.keys():
        for end, f in zip(("lowest", "highest"), hz, strict=True):
            share = 2 * pi * f * means["J_j"]["mean"] / means["B_j"]["mean"]
            claim = f"the joint's inertia is negligible at {f:g} Hz, J_j omega/B_j"
            yield share_claim(f"inertia_at_{end}_frequency", claim, share, error("J_j", "B_j"), limit, False)
    known = asked.filter(pl.col("K_d") > 0).sort("K_d").to_dicts()
    if p is None or not known:
        return
    for end, row in (("lowest", known[0]), ("highest", known[-1])):
        where = f"matters at K_d = {row['K_d']:g}, its share"
        if "K_s" in means:
            share, claim = row["K_d"] / means["K_s"]["mean"], f"the belt {where} K_d/K_s of the gain K_1 n_T^2"
            yield share_claim(f"belt_at_{end}_K_d", claim, share, error("K_s"), limit, True)
        if {"f_C", "f_G", "k_tau_n_m"} <= means.keys():
            current = row["K_d"] * np.deg2rad(row["theta_rms_deg"]) / (p.n_T * means["k_tau_n_m"]["mean"])
            share = (load := means["f_G"]["mean"] * current) / (means["f_C"]["mean"] + load)
            claim = f"friction that grows with the load, f_G |I|, {where} of the friction at K_d times the RMS angle"
            own = error("f_C", "f_G", "k_tau_n_m", of=1 - share)
            yield share_claim(f"load_friction_at_{end}_K_d", claim, share, own, limit, True)


def compensation_claims(compensation: pl.DataFrame) -> Iterator[Claim]:
    """What compensation improves, from `compensation.csv`."""
    rows = compensation.to_dicts()  # an empty table has no texts
    counts = {row["quantity"]: row for row in rows if row["by"] == "amplitudes"}
    for row in (one for one in rows if one["by"] == "trials"):
        name, single = row["quantity"], counts.get(row["quantity"])
        said = f" and {single['better']} of {single['pairs']} of amplitudes" if single else ""
        pairs = f"in {row['better']} of {row['pairs']} pairs of trials{said}"
        claim = f"with compensation {LESS[name]}, {pairs}, mean difference"
        ends = row["difference_low"], row["difference_high"]
        judged = {"target": 0.0, "n": row["pairs"], "verdict": limit_verdict(*ends, 0.0, name == "VAF")}
        yield claim_of(f"compensation_{name}", claim, row["difference"], ends, row["unit"], MEAN, **judged)


def rendered_claims(asked: pl.DataFrame, settings: Claims) -> Iterator[Claim]:
    """Whether each compensated trial renders K_d and B_d, and how many do."""
    trials = asked.filter(pl.col("controller") == CONTROLLERS[0])
    for symbol, unit in (("K", "N*m/rad"), ("B", "N*m*s/rad")):
        rows = []
        for row in trials.drop_nulls(f"{symbol}_d").to_dicts():
            target, ends = row[f"{symbol}_d"], (row[f"{symbol}_low"], row[f"{symbol}_high"])
            margin = settings.B if symbol == "B" else target * settings.K_percent / 100 if settings.K_percent else None
            if margin is not None:
                judged = {"target": target, "margin": margin, "n": 1, "verdict": equivalence(*ends, target, margin)}
                said = claim_of(symbol, f"{symbol} is {symbol}_d", row[symbol], ends, unit, FIT, **judged)
                rows.append(said | {"subject": row["trial"]})
        if rows:
            verdicts = [row["verdict"] for row in rows]
            same = verdicts.count("equivalent")
            verdict = "holds" if same == len(rows) else "fails" if "different" in verdicts else "undecided"
            within = f"{settings.K_percent:g} %" if symbol == "K" else f"{settings.B:g} {unit}"
            claim = f"compensated trials have {symbol} within {within} of {symbol}_d, trials that do for certain"
            judged = {"n": len(rows), "verdict": verdict}
            yield claim_of(f"{symbol}_equivalent", claim, same, (None, None), "trials", "count", **judged)
            yield from rows


def passivity_claims(response: pl.DataFrame, p: DrivetrainParameters | None, weight: Weight) -> Iterator[Claim]:
    """Whether the joint takes in energy at every measured frequency, by what was measured and by the gains. `response`
    has `damping` with its interval, controller, K_d, B_d and frequency."""
    for controller in CONTROLLERS:
        rows = response.filter(pl.col("controller") == controller).drop_nulls("damping")
        if rows.is_empty():
            continue
        trial, hz, least, *ends = rows.sort("damping").select("trial", "frequency_hz", *REAL_PART).row(0)
        active, unsure = (rows["damping_high"] < 0).any(), (rows["damping_low"] < 0).any()
        judged = {"n": len(rows), "verdict": "fails" if active else "undecided" if unsure else "holds"}
        where, said, name = f"{trial} at {hz:.3g} Hz", f"the {controller} joint is passive", f"passive_{controller}"
        claim = f"{said} at all measured frequencies, least real part of Z ({where})"
        yield claim_of(name, claim, least, ends, "N*m*s/rad", "95 % of measurement noise", target=0.0, **judged)
        known = rows.drop_nulls(["K_d", "B_d"])
        if p is None or known.is_empty():
            continue
        damping = []
        for (K_d, B_d), of in known.group_by("K_d", "B_d", maintain_order=True):
            gains, w = select_gains(controller, K_d, B_d, p, weight), 2 * pi * of["frequency_hz"].unique().to_numpy()
            damping.append(float(np.min((1 / joint_admittance(gains.K_1, gains.B_1, p, p.J_j)(1j * w)).imag / w)))
        claim = f"{said} there by its gains (Eq. 9), least real part of Z"
        judged = {"n": len(known), "verdict": "holds" if min(damping) >= 0 else "fails"}
        yield claim_of(f"{name}_by_gains", claim, min(damping), (None, None), "N*m*s/rad", None, target=0.0, **judged)


def walking_claims(summary: pl.DataFrame, midstance: float | None, settings: Claims) -> Iterator[Claim]:
    """Whether the stiffness while walking is the commanded one, by group."""
    rows = summary.filter(pl.col("quantity") == "K", pl.col("estimator") == "ensemble", pl.col("mean").is_not_null())
    for row in rows.to_dicts():
        target = row["commanded"] if row["commanded"] is not None else midstance if len(rows) == 1 else None
        if target is None or settings.K_percent is None:
            continue
        margin, ends = target * settings.K_percent / 100, (row["low"], row["high"])
        judged = {"target": target, "margin": margin, "n": row["n"], "verdict": equivalence(*ends, target, margin)}
        claim = f"the ankle's stiffness while walking is {target:g} N*m/rad, within {settings.K_percent:g} %"
        judged |= {"subject": None if len(rows) == 1 else row["group"], "joint": row["joint"], "side": row["side"]}
        yield claim_of("walking_K_equivalent", claim, row["mean"], ends, "N*m/rad", row["interval_method"], **judged)


def damping_of_lines(response: pl.DataFrame) -> pl.DataFrame:
    """`damping` with its interval of the lines of `response.csv`, whose Z is torque over angle."""
    w, sd = 2 * pi * pl.col("frequency_hz"), pl.coalesce("total_sd", "noise_sd") / 2**0.5  # of one of its two parts
    damping = pl.col("Z_im") / w
    ends = {f"damping_{end}": damping + way * 1.96 * sd / w for end, way in (("low", -1), ("high", 1))}
    return response.with_columns(damping=damping, **ends)


def claims_table(
    tables: Mapping[str, pl.DataFrame],
    settings: Claims,
    frequencies_hz: Sequence[float],
    midstance: float | None,
    devices: Mapping[str, DrivetrainParameters],
    weight: Weight,
) -> pl.DataFrame:
    """`claims.csv` from those result tables that the campaign has, by name. `frequencies_hz` are the lowest and the
    highest one of the stepped sine (empty: not stated), `midstance` the stiffness [N*m/rad] that is commanded there,
    `devices` the parameters by joint."""
    bench = {name: own for name, own in tables.items() if not name.startswith("walking")}
    kept = ("trial", "controller", "K_d", "B_d", "frequency_hz", *REAL_PART)
    nothing, rows = pl.DataFrame(schema=[*kept, "amplitude_deg"]), list[Claim]()
    for joint, side in dict.fromkeys(one for own in bench.values() for one in own.select("joint", "side").iter_rows()):
        place = {"joint": joint, "side": side}
        at = [pl.col(name).eq_missing(pl.lit(value, pl.String)) for name, value in place.items()]
        here, p = {name: own.filter(at) for name, own in bench.items()}, devices.get(joint)
        summaries = [own for name, own in here.items() if name.endswith("_summary")]
        means = {row["quantity"]: row for own in summaries for row in own.to_dicts() if row["mean"] is not None}
        asked = here.get("impedance", nothing).filter(pl.col("amplitude_deg").is_null())
        found = list(component_claims(means, asked, frequencies_hz, p, settings.negligible_percent))
        found += compensation_claims(here.get("compensation", nothing))
        found += rendered_claims(asked, settings)
        lines = [damping_of_lines(here["response"])] if "response" in here else []
        lines = [one.select(kept) for one in (here.get("frequency_response", nothing), *lines)]
        found += passivity_claims(pl.concat(lines, how="vertical_relaxed"), p, weight)
        rows += [place | claim for claim in found]
    if "walking_summary" in tables:
        rows += walking_claims(tables["walking_summary"], midstance, settings)
    return pl.DataFrame(rows, schema=CLAIM_COLUMNS).sort(pl.col("subject").is_not_null(), maintain_order=True)
