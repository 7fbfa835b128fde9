"""Two campaigns, A and B, side by side: devices, controllers or days, quantity by quantity, with a
verdict."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.judge.finding import ESTIMATES
from osl_analysis.measured import rms
from osl_analysis.stats import repeats

Between = Callable[[repeats.Sample, repeats.Sample], repeats.Difference]
COMPARED_QUANTITIES = {
    "impedance": ("K", "B", "B_viscous", "I", "VAF", "torque_error"), "belt": ("K_s",),
    "transmission": ("B_j", "J_j"),
    "actuator": ("k_tau_n_m", "f_C", "f_G", "B_m", "J_m"), "walking_summary": ("K", "B", "I"),
}  # fmt: skip
"""The compared quantities, by table."""
SAME_PLACE = ("joint", "side", "group", "controller")
DIFFERENCE = ("difference", "difference_low", "difference_high")  # B - A
RATIO = ("relative_percent", "relative_percent_low", "relative_percent_high")  # B over A, less 1
SAME_CONDITION = ("K_d", "B_d", "excitation", "amplitudes", "named")  # of a rendered impedance
COMPARISON_COLUMNS = {
    **dict.fromkeys(("experiment", "quantity", *SAME_PLACE, "condition"), pl.String),
    **dict.fromkeys(("n_A", "n_B"), pl.Int64),
    **dict.fromkeys(("mean_A", "mean_B", *DIFFERENCE, *RATIO, "margin_percent"), pl.Float64),
    **dict.fromkeys(("verdict", "method"), pl.String),
    **dict.fromkeys(("n_doubtful_A", "n_doubtful_B", "n_left_out_A", "n_left_out_B"), pl.Int64),
    "remark": pl.String,
}  # fmt: skip


def compared(
    a: Mapping[str, pl.DataFrame], b: Mapping[str, pl.DataFrame], margin: float | None = None
) -> pl.DataFrame:
    """A row per quantity of A or B, as in `comparison.csv`, from their result tables by name; for
    an impedance also one per condition, if both have several.

    Positive quantities are compared as ratios, by differences of logarithms: K goes from 100 to 400
    N*m/rad, and a ratio weights every desired impedance equally and needs no K_d. I and VAF have no
    ratio. `margin` applies to all ratios, as 0.05; None: not stated, and nothing is equivalent."""
    rows, (a, b) = [], with_names_shared(*with_common_sizes(a, b))
    for table, quantities in COMPARED_QUANTITIES.items():
        parts = [by_place(one[table], table) if table in one else {} for one in (a, b)]
        for key in dict.fromkeys(key for part in parts for key in part):
            for quantity in quantities:
                named = {"experiment": table.removesuffix("_summary"), "quantity": quantity}
                named |= dict(zip(SAME_PLACE, key, strict=True))
                own = [part.get(key) for part in parts]
                rows.append(named | row_of(own, quantity, margin))
                rows += [named | row for row in rows_of_conditions(own, quantity, margin)]
    return pl.DataFrame(rows, schema=COMPARISON_COLUMNS).filter(pl.max_horizontal("n_A", "n_B") > 0)


def with_common_sizes(*campaigns: Mapping[str, pl.DataFrame]) -> list[Mapping[str, pl.DataFrame]]:
    """The tables of campaigns, impedance trials with their measured `amplitudes`: commanded ones
    may not be stated."""
    own = [
        one["impedance"].with_columns(campaign=pl.lit(k))
        for k, one in enumerate(campaigns)
        if "impedance" in one
    ]
    if not own:
        return [*campaigns]
    pooled = pl.concat(own, how="diagonal_relaxed").with_columns(
        pl.col("amplitude_deg").cast(pl.Float64)
    )
    pooled = pooled.with_columns(size=repeats.alike_sizes(pooled["amplitude_deg"]))
    each = pl.col("size").drop_nulls().unique().sort().cast(pl.String).str.join(" ")
    pooled = pooled.with_columns(amplitudes=each.over("campaign", "trial"))
    of = {
        k: {"impedance": pooled.filter(campaign=k)}
        for k, one in enumerate(campaigns)
        if "impedance" in one
    }
    return [{**one, **of.get(k, {})} for k, one in enumerate(campaigns)]


def with_names_shared(*campaigns: Mapping[str, pl.DataFrame]) -> list[Mapping[str, pl.DataFrame]]:
    """The tables of campaigns. Impedance trials without a stated K_d are paired by name (`named`)
    if each campaign has half of the names or more; else `named` is null, and they are paired by
    measured values."""
    tables = [one.get("impedance", pl.DataFrame()) for one in campaigns]
    if not all({"trial", "K_d"} <= {*table.columns} for table in tables):
        return [*campaigns]
    names = [{*table.filter(pl.col("K_d").is_null())["trial"]} for table in tables]
    known = pl.col("K_d").is_null() & (2 * len(set.intersection(*names)) >= len(set.union(*names)))
    name = pl.when(known).then(pl.col("trial").cast(pl.String)).alias("named")
    return [
        {**one, "impedance": table.with_columns(name)}
        for one, table in zip(campaigns, tables, strict=True)
    ]


def by_place(table: pl.DataFrame, name: str) -> dict[tuple[Any, ...], pl.DataFrame]:
    """The fits to whole trials, or the ensembles of groups, of each joint, side, group and
    controller, with the columns `SAME_CONDITION`: the amplitudes among them, because friction makes
    a rendered impedance depend on them."""
    kinds = dict.fromkeys((*SAME_PLACE, *SAME_CONDITION), pl.String) | dict.fromkeys(
        ("K_d", "B_d"), pl.Float64
    )
    rows = table.with_columns(
        pl.lit(None, kind).alias(k) for k, kind in kinds.items() if k not in table.columns
    )
    if name == "walking_summary":
        rows = rows.filter(estimator="ensemble")  # that of the headline numbers
        rows = rows.with_columns(pl.col("doubt").cast(pl.String).alias(repeats.DOUBTFUL))
    if "amplitude_deg" in rows.columns:
        rows = rows.filter(pl.col("amplitude_deg").is_null())
    return rows.partition_by(SAME_PLACE, as_dict=True, maintain_order=True)


def estimates(rows: pl.DataFrame | None, quantity: str) -> tuple[dict[str, Any], repeats.Sample]:
    """Counts of one campaign, and its fits that count in a mean (`repeats.counted`) by condition.
    An ensemble is one condition, the command, with estimate, low and high."""
    if rows is None:
        return {"n": 0}, {}
    if "estimator" in rows.columns:
        rows = rows.filter(quantity=quantity).drop_nulls(["mean", "low", "high"])
        ensemble = {
            one[0]: one[1:] for one in rows.select("commanded", "mean", "low", "high").iter_rows()
        }
        return {"n": rows["n"].sum(), "n_doubtful": repeats.doubtful_count(rows)[0]}, ensemble
    used = repeats.counted(rows)
    finite, doubts = (
        used.filter(pl.col(quantity).is_finite()),
        {"n_doubtful": repeats.doubtful_count(rows)[0]},
    )
    sample = {
        key: one[quantity].to_list()
        for key, one in finite.group_by(SAME_CONDITION, maintain_order=True)
    }
    return {"n": len(finite), **doubts, "n_left_out": len(rows) - len(used)}, sample


def with_own_ends(
    rows: pl.DataFrame | None, quantity: str, sample: repeats.Sample
) -> repeats.Sample:
    """A sample of one trial with the ends of its own interval, like an ensemble's; empty if it has
    none."""
    ends = [f"{quantity}{end}" for end in ("", "_low", "_high")]
    if rows is None or not {*ends} <= {*rows.columns} or [len(of) for of in sample.values()] != [1]:
        return {}
    ((key, (value,)),) = sample.items()
    known = (
        rows.filter(pl.col(quantity) == value, *(pl.col(end).is_finite() for end in ends))
        .select(ends)
        .rows()
    )
    return {key: known[0]} if known else {}


def rows_of_conditions(
    parts: Sequence[pl.DataFrame | None], quantity: str, margin: float | None
) -> Iterator[dict[str, Any]]:
    """A row for each of several conditions that both have, stated or by name: the mean hides a
    change of one."""
    by = [
        {} if one is None else one.partition_by(SAME_CONDITION, as_dict=True, maintain_order=True)
        for one in parts
    ]
    shared = [key for key in by[0] if key in by[1] and (key[0], key[-1]) != (None, None)]
    if len(shared) < 2 or quantity not in (*ESTIMATES, "B_viscous"):
        return
    differing = [k for k in range(len(SAME_CONDITION)) if len({key[k] for key in shared}) > 1]
    for key in shared:
        said = [
            f"{SAME_CONDITION[k]} {key[k]:g}" if k < 2 else key[k]
            for k in differing
            if key[k] is not None
        ]
        row = row_of([one[key] for one in by], quantity, margin)
        if row.get("difference") is not None:
            yield {"condition": ", ".join(said), **row}


def row_of(
    parts: Sequence[pl.DataFrame | None], quantity: str, margin: float | None
) -> dict[str, Any]:
    """The numbers of a row. If one campaign has none, there is no difference, and the remark says
    so."""
    (of_a, a), (of_b, b) = (estimates(part, quantity) for part in parts)
    row: dict[str, Any] = {
        f"{name}_{one}": v for one, of in (("A", of_a), ("B", of_b)) for name, v in of.items()
    }
    of_ensembles = any(part is not None and "estimator" in part.columns for part in parts)
    shared = {*a} & {*b}
    ends = [with_own_ends(part, quantity, one) for part, one in zip(parts, (a, b), strict=True)]
    by_ends = all(ends) and bool(shared)  # one trial each, without scatter
    if by_ends:
        a, b = ends
    for name, sample in (("A", a), ("B", b)):
        row[f"mean_{name}"] = mean_of(sample, shared, of_ensembles or by_ends)
    if not (a and b):
        return row | {"remark": f"only in {'A' if a else 'B'}"}
    between, remarks = (
        repeats.of_intervals if of_ensembles or by_ends else repeats.difference,
        list[str](),
    )
    benches = [] if by_ends else parts  # a trial's interval includes its bench's errors
    if is_pooled(a, b):
        remarks.append(
            "trials without K_d count as repeats of one condition; state K_d, or name like trials"
            " alike"
        )
    if shared and {*a} != {*b}:
        remarks.append(f"{len(shared)} of {len({*a, *b})} conditions are shared")
    apart = repeats.with_bench(between(a, b), bench_error(benches, quantity))
    row |= dict(zip((*DIFFERENCE, "method"), apart, strict=True))
    if of_ensembles and None not in (commanded := (*a, *b)) and len(set(commanded)) > 1:
        remarks.append("commanded {:g} in A and {:g} in B".format(*commanded))
    # the rendered inertia may be zero or negative, and a VAF is a percentage
    if quantity not in ("I", "VAF"):
        if min(chain.from_iterable((*a.values(), *b.values()))) > 0:
            bench = bench_error(benches, quantity, as_share=True)
            row |= ratio_of(
                a, b, lambda *logarithms: repeats.with_bench(between(*logarithms), bench), margin
            )
        else:
            remarks.append("no ratio: an estimate, or an end of its interval, is not above 0")
    return row | {"remark": "; ".join(remarks) or None}


def bench_error(
    parts: Sequence[pl.DataFrame | None], quantity: str, as_share: bool = False
) -> float:
    """Standard error, or relative standard error, of the difference between two campaigns due to
    the stated errors of their benches, which all trials of a campaign share; 0 if none are
    stated."""
    known, errors = f"{quantity.removesuffix('_viscous')}_se_bench", list[float]()
    for part in parts:
        if (
            part is not None
            and known in part.columns
            and len(used := part.drop_nulls([quantity, known]))
        ):
            errors.append(
                rms(used[known].to_numpy() / (used[quantity].to_numpy() if as_share else 1.0))
            )
    return math.hypot(*errors)


def mean_of(sample: repeats.Sample, shared: Collection[Any], of_ensembles: bool) -> float | None:
    """Mean of the fits of the shared condition, or of all if none is shared; None for several
    conditions. An ensemble has its estimate, which precedes the ends of its interval."""
    own = [
        values[:1] if of_ensembles else values
        for key, values in sample.items()
        if key in shared or not shared
    ]
    return float(np.mean(own[0])) if len(own) == 1 else None


def is_pooled(*samples: repeats.Sample) -> bool:
    """Whether impedance trials count as repeats although neither a stated K_d nor their names say
    so."""
    keys = [
        key
        for sample in samples
        for key, of in sample.items()
        if isinstance(key, tuple) and len(of) > 1
    ]
    return any(
        K_d is named is None and amplitudes is not None for K_d, *_, amplitudes, named in keys
    )


def ratio_of(
    a: repeats.Sample, b: repeats.Sample, between: Between, margin: float | None
) -> dict[str, Any]:
    """B over A less 1 [percent] with its interval, by the differences of logarithms, and the
    verdict on it."""
    ratio = between(
        *(
            {name: [math.log(v) for v in values] for name, values in sample.items()}
            for sample in (a, b)
        )
    )
    ends = [None if end is None else 100 * math.expm1(end) for end in ratio[:3]]
    percent = None if margin is None else 100 * margin
    row = dict(zip(RATIO, ends, strict=True)) | {"margin_percent": percent, "method": ratio.method}
    return row | {"verdict": repeats.equivalence(ends[1], ends[2], 0.0, percent or 0.0)}


def label_of(row: Mapping[str, Any]) -> str:
    """What a row is about, as `impedance K, compensated`."""
    quantity = "B without friction" if row["quantity"] == "B_viscous" else row["quantity"]
    parts = (
        f"{row['experiment']} {quantity}",
        row["controller"],
        row["group"],
        row["joint"],
        row["side"],
    )
    said = ", ".join(part for part in parts if part not in (None, "all", "ankle"))
    return f"{said} ({row['condition']})" if row["condition"] else said


def verdicts_said(table: pl.DataFrame) -> str:
    """The verdicts in a sentence, each with its quantities, and how many quantities have none."""
    rows, said = table.to_dicts(), list[str]()
    whole = table.filter(pl.col("condition").is_null())
    alone = whole["method"].null_count()
    for verdict in ("equivalent", "different", "undecided"):
        own = [row for row in rows if row["verdict"] == verdict]
        of = {
            row["margin_percent"]: f" (±{row['margin_percent']:g} %)"
            for row in own
            if row["margin_percent"]
        }
        named = [label_of(row) + of.get(row["margin_percent"], "") for row in own]
        said += [f"{verdict}: {', '.join(named)}"] if named else []
    none = f"without a verdict: {whole['verdict'].null_count()} of {len(whole)} quantities"
    doubtful = table.select("n_doubtful_A", "n_doubtful_B").sum().row(0)
    rule = f" {repeats.RULE_OF_MEANS}" if any(doubtful) else ""
    return f"{'; '.join([*said, none])}, {alone} of them in one campaign alone.{rule}"
