"""Two campaigns, A and B, side by side: devices, controllers or days, quantity by quantity, with a
verdict.

Trials of one condition (`Condition`) are compared with each other. Positive quantities are compared
as ratios, by differences of logarithms: K goes from 100 to 400 N*m/rad, and a ratio weights every
desired impedance equally and needs no K_d.
"""

import math
from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from osl_analysis.judge.finding import ESTIMATES
from osl_analysis.measured import rms
from osl_analysis.stats import repeats

COMPARED_QUANTITIES = {
    "impedance": ("K", "B", "B_viscous", "I", "VAF", "torque_error"),
    "belt": ("K_s",),
    "transmission": ("B_j", "J_j"),
    "actuator": ("k_tau_n_m", "f_C", "f_G", "B_m", "J_m"),
    "walking_summary": ("K", "B", "I"),
}
"""The compared quantities, by table."""
WITHOUT_RATIO = ("I", "VAF")
"""The rendered inertia may be zero or negative, and a VAF is a percentage."""
SAME_PLACE = ("joint", "side", "group", "controller")
DIFFERENCE = ("difference", "difference_low", "difference_high")  # B - A
RATIO = ("relative_percent", "relative_percent_low", "relative_percent_high")  # B over A, less 1
COMPARISON_COLUMNS = {
    **dict.fromkeys(("experiment", "quantity", *SAME_PLACE, "condition"), pl.String),
    **dict.fromkeys(("n_A", "n_B"), pl.Int64),
    **dict.fromkeys(("mean_A", "mean_B", *DIFFERENCE, *RATIO, "margin_percent"), pl.Float64),
    **dict.fromkeys(("verdict", "method"), pl.String),
    **dict.fromkeys(("n_doubtful_A", "n_doubtful_B", "n_left_out_A", "n_left_out_B"), pl.Int64),
    "remark": pl.String,
}
Tables = Mapping[str, pl.DataFrame]
"""Result tables of one campaign, by name."""
Rows = pl.DataFrame | None
"""Rows of one campaign's table at one place; None: it has none."""


class Condition(NamedTuple):
    """In what trials agree that are compared; None where a trial does not have it."""

    K_d: float | None
    B_d: float | None
    excitation: str | None
    amplitudes: str | None
    """Measured amplitudes [deg]: friction makes a rendered impedance depend on them."""
    named: str | None
    """The trial's name, where trials without a stated K_d are paired by it."""

    @property
    def is_known(self) -> bool:
        """Whether the sheet or the trial's name says what was rendered."""
        return self.K_d is not None or self.named is not None


SAME_CONDITION = Condition._fields


@dataclass(frozen=True)
class Estimates:
    """What one campaign has of a quantity at one place.

    Attributes
    ----------
    n
        Number of trials or crossings.
    sample
        Their estimates by condition: by `Condition` those of trials; by the commanded impedance
        that of an ensemble.
    has_ends
        Whether each condition has one estimate, followed by the ends of its 95 % interval.
    n_doubtful, n_left_out
        Number of doubtful fits, and of those that are not in `sample`; None: not told.
    """

    n: int = 0
    sample: repeats.Sample = field(default_factory=dict)
    has_ends: bool = False
    n_doubtful: int | None = None
    n_left_out: int | None = None


@dataclass(frozen=True)
class Comparison:
    """A row of `comparison.csv`. Fields that end in `_A` or `_B` are of one campaign.

    Attributes
    ----------
    mean
        Mean estimate; None where there are several conditions.
    difference
        B - A with the ends of its 95 % interval; None without a condition in common.
    relative_percent
        B over A, less 1, with the ends of its interval; None for a quantity without a ratio.
    margin_percent
        Within which a ratio is equivalent; None: not stated.
    method
        Source of the interval, or why there is none; of the ratio, if there is one.
    """

    n_A: int
    n_B: int
    mean_A: float | None = None
    mean_B: float | None = None
    difference: float | None = None
    difference_low: float | None = None
    difference_high: float | None = None
    relative_percent: float | None = None
    relative_percent_low: float | None = None
    relative_percent_high: float | None = None
    margin_percent: float | None = None
    verdict: str | None = None
    method: str | None = None
    n_doubtful_A: int | None = None
    n_doubtful_B: int | None = None
    n_left_out_A: int | None = None
    n_left_out_B: int | None = None
    remark: str | None = None
    condition: str | None = None  # one of several; None: all


@dataclass(frozen=True)
class Ratio:
    """B over A, less 1 [percent], with the ends of its 95 % interval and the verdict on it, as the
    fields of `Comparison`."""

    relative_percent: float | None
    relative_percent_low: float | None
    relative_percent_high: float | None
    margin_percent: float | None
    method: str
    verdict: str | None


def comparison_table(a: Tables, b: Tables, margin: float | None = None) -> pl.DataFrame:
    """Compare two campaigns.

    Parameters
    ----------
    a, b
        Their result tables, by name.
    margin
        Within which a ratio is equivalent [1], as 0.05; None: not stated, and nothing is
        equivalent.

    Returns
    -------
    polars.DataFrame
        `comparison.csv`: a row per quantity that A or B has; for K, B and I also one per
        condition, if both campaigns have several.
    """
    a, b = with_common_sizes([a, b])
    a, b = with_shared_names([a, b])
    rows: list[dict[str, Any]] = []
    for table, quantities in COMPARED_QUANTITIES.items():
        places_a = by_place(a[table], table) if table in a else {}
        places_b = by_place(b[table], table) if table in b else {}
        for place in dict.fromkeys([*places_a, *places_b]):
            rows_a, rows_b = places_a.get(place), places_b.get(place)
            for quantity in quantities:
                label = {"experiment": table.removesuffix("_summary"), "quantity": quantity}
                label.update(zip(SAME_PLACE, place, strict=True))
                comparison = compare_quantity(rows_a, rows_b, quantity, margin)
                rows.append({**label, **asdict(comparison)})
                for of_condition in compare_conditions(rows_a, rows_b, quantity, margin):
                    rows.append({**label, **asdict(of_condition)})
    compared = pl.DataFrame(rows, schema=COMPARISON_COLUMNS)
    return compared.filter(pl.max_horizontal("n_A", "n_B") > 0)


def with_common_sizes(campaigns: Sequence[Tables]) -> list[Tables]:
    """Give the impedance trials of all campaigns their measured `amplitudes`, as commanded ones may
    not be stated."""
    has_impedance = [number for number, tables in enumerate(campaigns) if "impedance" in tables]
    if not has_impedance:
        return list(campaigns)
    # sizes are alike across campaigns, so that one label serves both
    labelled = []
    for number in has_impedance:
        labelled.append(campaigns[number]["impedance"].with_columns(campaign=pl.lit(number)))
    pooled = pl.concat(labelled, how="diagonal_relaxed")
    pooled = pooled.with_columns(pl.col("amplitude_deg").cast(pl.Float64))
    pooled = pooled.with_columns(size=repeats.alike_sizes(pooled["amplitude_deg"]))
    sizes = pl.col("size").drop_nulls().unique().sort()
    amplitudes = sizes.cast(pl.String).str.join(" ").over("campaign", "trial")
    pooled = pooled.with_columns(amplitudes=amplitudes)

    with_sizes = list(campaigns)
    for number in has_impedance:
        impedance = pooled.filter(campaign=number)
        with_sizes[number] = {**campaigns[number], "impedance": impedance}
    return with_sizes


def with_shared_names(campaigns: Sequence[Tables]) -> list[Tables]:
    """Give impedance trials without a stated K_d the column `named`: their name, by which they are
    paired if the campaigns share half of the names or more; else null, and they are paired by
    measured values."""
    names: list[set[str]] = []
    for tables in campaigns:
        impedance = tables.get("impedance", pl.DataFrame())
        if not {"trial", "K_d"} <= set(impedance.columns):
            return list(campaigns)
        names.append(set(impedance.filter(pl.col("K_d").is_null())["trial"]))
    shared = set.intersection(*names)
    all_names = set.union(*names)
    are_paired = pl.col("K_d").is_null() & (2 * len(shared) >= len(all_names))
    named = pl.when(are_paired).then(pl.col("trial").cast(pl.String)).alias("named")
    return [
        {**tables, "impedance": tables["impedance"].with_columns(named)} for tables in campaigns
    ]


def by_place(table: pl.DataFrame, name: str) -> dict[tuple[Any, ...], pl.DataFrame]:
    """The fits to whole trials, or the ensembles of groups, by the values of `SAME_PLACE`, with the
    columns of a `Condition`."""
    rows = table
    for column in (*SAME_PLACE, *SAME_CONDITION):
        if column not in table.columns:
            dtype = pl.Float64 if column in ("K_d", "B_d") else pl.String
            rows = rows.with_columns(pl.lit(None, dtype).alias(column))
    if name == "walking_summary":
        rows = rows.filter(estimator="ensemble")  # that of the headline numbers
        rows = rows.with_columns(pl.col("doubt").cast(pl.String).alias(repeats.DOUBTFUL))
    if "amplitude_deg" in rows.columns:
        rows = rows.filter(pl.col("amplitude_deg").is_null())
    return rows.partition_by(SAME_PLACE, as_dict=True, maintain_order=True)


def is_ensemble(rows: Rows) -> bool:
    """Whether rows are of a summary of groups, not of trials."""
    return rows is not None and "estimator" in rows.columns


def estimates(rows: Rows, quantity: str) -> Estimates:
    """What one campaign has of a quantity: the fits that count in a mean (`repeats.counted`), or
    the ensembles with their intervals."""
    if rows is None:
        return Estimates()
    sample: dict[Hashable, list[float]] = {}
    if is_ensemble(rows):
        rows = rows.filter(quantity=quantity).drop_nulls(["mean", "low", "high"])
        for commanded, mean, low, high in rows.select("commanded", "mean", "low", "high").rows():
            sample[commanded] = [mean, low, high]
        n_doubtful, _ = repeats.doubtful_count(rows)
        return Estimates(int(rows["n"].sum()), sample, has_ends=True, n_doubtful=n_doubtful)
    used = repeats.counted(rows)
    finite = used.filter(pl.col(quantity).is_finite())
    for key, of_condition in finite.group_by(SAME_CONDITION, maintain_order=True):
        sample[Condition._make(key)] = of_condition[quantity].to_list()
    n_doubtful, _ = repeats.doubtful_count(rows)
    return Estimates(len(finite), sample, n_doubtful=n_doubtful, n_left_out=len(rows) - len(used))


def with_interval_of_trial(rows: Rows, quantity: str, of_campaign: Estimates) -> Estimates | None:
    """The only trial of a campaign with the ends of its own interval; None if there are several
    trials, or it has no interval."""
    columns = [quantity, f"{quantity}_low", f"{quantity}_high"]
    conditions = list(of_campaign.sample.items())
    if rows is None or not set(columns) <= set(rows.columns) or len(conditions) != 1:
        return None
    condition, values = conditions[0]
    if len(values) != 1:
        return None
    at_value = rows.filter(pl.col(quantity) == values[0])
    at_value = at_value.filter(pl.all_horizontal(pl.col(columns).is_finite()))
    if at_value.is_empty():
        return None
    return replace(of_campaign, sample={condition: at_value.select(columns).row(0)}, has_ends=True)


def compare_conditions(
    rows_a: Rows, rows_b: Rows, quantity: str, margin: float | None
) -> Iterator[Comparison]:
    """Compare each of several conditions that both have, stated or by name: a mean hides a change
    of one."""
    if rows_a is None or rows_b is None or quantity not in (*ESTIMATES, "B_viscous"):
        return
    by_condition_a = rows_a.partition_by(SAME_CONDITION, as_dict=True, maintain_order=True)
    by_condition_b = rows_b.partition_by(SAME_CONDITION, as_dict=True, maintain_order=True)
    shared = []
    for condition in map(Condition._make, by_condition_a):
        if condition in by_condition_b and condition.is_known:
            shared.append(condition)
    if len(shared) < 2:
        return
    differing = []
    for name in SAME_CONDITION:
        if len({getattr(condition, name) for condition in shared}) > 1:
            differing.append(name)
    for condition in shared:
        comparison = compare_quantity(
            by_condition_a[condition], by_condition_b[condition], quantity, margin
        )
        if comparison.difference is not None:
            yield replace(comparison, condition=condition_text(condition, differing))


def condition_text(condition: Condition, names: Sequence[str]) -> str:
    """These fields of a condition, as `K_d 300, B_d 5`."""
    texts = []
    for name in names:
        value = getattr(condition, name)
        if value is None:
            continue
        texts.append(f"{name} {value:g}" if name in ("K_d", "B_d") else value)
    return ", ".join(texts)


def compare_quantity(rows_a: Rows, rows_b: Rows, quantity: str, margin: float | None) -> Comparison:
    """Compare one quantity at one place. If one campaign has none, there is no difference, and the
    remark says so."""
    a, b = estimates(rows_a, quantity), estimates(rows_b, quantity)
    shared = set(a.sample) & set(b.sample)
    are_pooled = is_pooled(a.sample) or is_pooled(b.sample)
    # calibration errors of the benches, which the scatter of trials does not show
    benches: list[Rows] = [rows_a, rows_b]
    single_a = with_interval_of_trial(rows_a, quantity, a)
    single_b = with_interval_of_trial(rows_b, quantity, b)
    if single_a is not None and single_b is not None and shared:
        a, b = single_a, single_b
        benches = []  # a trial's interval includes its bench's errors
    have_ends = a.has_ends or b.has_ends
    comparison = Comparison(
        n_A=a.n,
        n_B=b.n,
        mean_A=mean_of_condition(a.sample, shared, have_ends),
        mean_B=mean_of_condition(b.sample, shared, have_ends),
        n_doubtful_A=a.n_doubtful,
        n_doubtful_B=b.n_doubtful,
        n_left_out_A=a.n_left_out,
        n_left_out_B=b.n_left_out,
    )
    if not a.sample or not b.sample:
        return replace(comparison, remark=f"only in {'A' if a.sample else 'B'}")

    remarks: list[str] = []
    if are_pooled:
        remarks.append(
            "trials without K_d count as repeats of one condition; state K_d, or name like trials"
            " alike"
        )
    either = set(a.sample) | set(b.sample)
    if 0 < len(shared) < len(either):
        remarks.append(f"{len(shared)} of {len(either)} conditions are shared")
    if is_ensemble(rows_a) or is_ensemble(rows_b):
        commanded = [*a.sample, *b.sample]
        if None not in commanded and len(set(commanded)) > 1:
            remarks.append("commanded {:g} in A and {:g} in B".format(*commanded))

    subtract = repeats.of_intervals if have_ends else repeats.difference
    se_of_benches = bench_error(benches, quantity)
    difference = repeats.with_bench(subtract(a.sample, b.sample), se_of_benches)
    comparison = replace(
        comparison,
        difference=difference.estimate,
        difference_low=difference.low,
        difference_high=difference.high,
        method=difference.method,
    )
    if quantity not in WITHOUT_RATIO:
        if min(chain.from_iterable([*a.sample.values(), *b.sample.values()])) > 0:
            relative_se = bench_error(benches, quantity, as_share=True)
            ratio = ratio_of(a.sample, b.sample, subtract, relative_se, margin)
            comparison = replace(comparison, **asdict(ratio))
        else:
            remarks.append("no ratio: an estimate, or an end of its interval, is not above 0")
    return replace(comparison, remark="; ".join(remarks) or None)


def bench_error(benches: Sequence[Rows], quantity: str, as_share: bool = False) -> float:
    """Standard error of the difference between two campaigns due to the stated errors of their
    benches, which all trials of a campaign share: in the quantity's unit, or relative (`as_share`);
    0 if none are stated."""
    se_column = f"{quantity.removesuffix('_viscous')}_se_bench"
    errors = []
    for rows in benches:
        if rows is None or se_column not in rows.columns:
            continue
        stated = rows.drop_nulls([quantity, se_column])
        if stated.is_empty():
            continue
        of_trials = stated[se_column].to_numpy()
        if as_share:
            of_trials = of_trials / stated[quantity].to_numpy()
        errors.append(rms(of_trials))
    return math.hypot(*errors)


def mean_of_condition(
    sample: repeats.Sample, shared: Collection[Any], have_ends: bool
) -> float | None:
    """Mean of the fits of the shared condition, or of all if none is shared; None for several
    conditions. The ends of an interval, which follow an estimate, are not in it."""
    of_conditions = []
    for condition, values in sample.items():
        if condition in shared or not shared:
            of_conditions.append(values[:1] if have_ends else values)
    if len(of_conditions) != 1:
        return None
    return float(np.mean(of_conditions[0]))


def is_pooled(sample: repeats.Sample) -> bool:
    """Whether impedance trials count as repeats although neither a stated K_d nor their names say
    so."""
    for condition, values in sample.items():
        if not isinstance(condition, Condition) or len(values) < 2:
            continue
        if condition.amplitudes is not None and not condition.is_known:
            return True
    return False


def ratio_of(
    sample_a: repeats.Sample,
    sample_b: repeats.Sample,
    subtract: Callable[[repeats.Sample, repeats.Sample], repeats.Difference],
    relative_se_of_benches: float,
    margin: float | None,
) -> Ratio:
    """B over A, by the difference of logarithms. A relative error is an error of a logarithm."""
    of_logarithms = subtract(logarithms(sample_a), logarithms(sample_b))
    of_logarithms = repeats.with_bench(of_logarithms, relative_se_of_benches)
    low, high = percent_of(of_logarithms.low), percent_of(of_logarithms.high)
    margin_percent = None if margin is None else 100 * margin
    return Ratio(
        relative_percent=percent_of(of_logarithms.estimate),
        relative_percent_low=low,
        relative_percent_high=high,
        margin_percent=margin_percent,
        method=of_logarithms.method,
        verdict=repeats.equivalence(low, high, 0.0, margin_percent or 0.0),
    )


def logarithms(sample: repeats.Sample) -> repeats.Sample:
    return {condition: [math.log(value) for value in sample[condition]] for condition in sample}


def percent_of(logarithm: float | None) -> float | None:
    """A logarithm of a ratio as the ratio less 1, in percent."""
    return None if logarithm is None else 100 * math.expm1(logarithm)


def label_of(row: Mapping[str, Any]) -> str:
    """What a row of `comparison.csv` is about, as `impedance K, compensated`."""
    parts = [f"{row['experiment']} {row['quantity']}"]
    for name in ("controller", "group", "joint", "side"):
        if row[name] not in (None, "all", "ankle"):  # the usual ones are not named
            parts.append(row[name])
    label = ", ".join(parts)
    return f"{label} ({row['condition']})" if row["condition"] else label


def verdicts_in_words(table: pl.DataFrame) -> list[str]:
    """A line per verdict of `comparison.csv` with its quantities, one on how many have none, and
    the rule of the means where a fit is doubtful."""
    parts = []
    for verdict in ("equivalent", "different", "undecided"):
        labels = []
        for row in table.filter(pl.col("verdict") == verdict).to_dicts():
            label = label_of(row)
            if row["margin_percent"]:
                label += f" (±{row['margin_percent']:g} %)"
            labels.append(label)
        if labels:
            parts.append(f"{verdict}: {', '.join(labels)}")

    quantities = table.filter(pl.col("condition").is_null())
    without_verdict = quantities["verdict"].null_count()
    in_one_campaign = quantities["method"].null_count()
    parts.append(
        f"without a verdict: {without_verdict} of {len(quantities)} quantities, {in_one_campaign}"
        " of them in one campaign alone."
    )
    if any(table.select("n_doubtful_A", "n_doubtful_B").sum().row(0)):
        parts.append(repeats.RULE_OF_MEANS)
    return parts
