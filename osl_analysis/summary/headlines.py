"""Headline numbers of a campaign: each with unit, interval and the value that the paper's draft prints."""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np
import polars as pl

from osl_analysis.doubtful import doubtful_count
from osl_analysis.errors import InputError
from osl_analysis.trial import Array

STUDENT = "95 % of the mean (Student)"
FIT = "95 % of the fit (its noise; not what the model lacks)"
BOOTSTRAP = "95 % (bootstrap over crossings and trials of the unloaded plate)"
PAIRED = "95 % of the mean difference of the same trials (Student)"
RANGE = "lowest to highest"
COUNT = "count"
EXAMPLE_K_D, EXAMPLE_B_D = 300.0, 5.0
"""The impedance of Fig. 4 [N*m/rad, N*m*s/rad], whose estimates are headline numbers."""
ENSEMBLE = "ensemble"
"""Estimator of the walking summary that is the headline: its bias shrinks with the number of crossings, that of the
mean over perturbations does not (docs/validation.md)."""

TABLES = {
    "belt": ("doubtful",),
    "belt_summary": ("quantity", "n", "mean", "low", "high"),
    "transmission_summary": ("quantity", "n", "mean", "low", "high"),
    "transmission": ("amplitude_deg", "VAF", "doubtful"),
    "actuator": ("doubtful",),
    "actuator_summary": ("quantity", "n", "mean", "low", "high"),
    "impedance": (
        "controller", "K_d", "B_d", "amplitude_deg", "K", "K_low", "K_high", "K_amplitudes_low", "K_amplitudes_high",
        "B", "B_low", "B_high", "B_amplitudes_low", "B_amplitudes_high", "VAF", "doubtful",
    ),
    "phasors": ("doubtful",),
    "model_comparison_summary": (
        "experiment", "controller", "model", "trials", "VAF_gain", "VAF_gain_low", "VAF_gain_high",
    ),
    "walking_summary": ("quantity", "estimator", "n", "mean", "low", "high"),
    "walking": ("VAF", "doubtful"),
}  # fmt: skip
"""The tables that hold headline numbers, and the columns that are read."""


@dataclass(frozen=True)
class Label:
    """What a number is called (`macro`: in LaTeX, letters only), its unit, the draft's value, and what it means."""

    name: str
    unit: str
    draft: float | None
    macro: str
    meaning: str


@dataclass(frozen=True)
class Headline(Label):
    """A number with the bounds of its interval; `interval` says of what kind, `n` from how many trials or fits.

    `amplitudes_low` and `amplitudes_high`: from where to where the fits to single amplitudes read it.
    """

    value: float
    low: float | None
    high: float | None
    interval: str | None
    n: int
    amplitudes_low: float | None = None
    amplitudes_high: float | None = None


BELT = {"K_s": Label("K_s", "N*m/rad", 685.6, "BeltStiffness", "belt stiffness while loading, mean of trials")}
TRANSMISSION = {
    "B_j": Label("B_j", "N*m*s/rad", 0.452, "JointDamping", "damping of the transmission, mean of trials"),
    "J_j": Label("J_j", "kg*m^2", 5.0e-3, "JointInertia", "inertia of the transmission, mean of trials"),
}
TRANSMISSION_VAF = Label(
    "transmission_VAF", "%", 99.1, "TransmissionVAF", "VAF of the transmission model, mean of trials"
)
ACTUATOR = {
    "k_tau_n_m": Label("k_tau_n_m", "N*m/A", 113.3e-3 * 9, "TorqueConstant", "torque per current, mean of trials"),
    "f_C": Label("f_C", "N*m", 0.377, "CoulombFriction", "Coulomb friction of the actuator, mean of trials"),
    "f_G": Label("f_G", "N*m/A", 89.6e-3, "GearFriction", "gear friction of the actuator, mean of trials"),
    "B_m": Label("B_m", "N*m*s/rad", 5.6e-3, "MotorDamping", "damping of the actuator, mean of trials"),
    "J_m": Label("J_m", "kg*m^2", 9.211e-3, "MotorInertia", "inertia of the actuator, mean of trials"),
}
WALKING = {
    "K": Label(
        "walking_K", "N*m/rad", 340.0, "WalkingStiffness", "ankle stiffness while walking, fit to the mean response"
    ),
    "B": Label(
        "walking_B", "N*m*s/rad", None, "WalkingDamping", "ankle damping while walking, fit to the mean response"
    ),
    "I": Label("walking_I", "kg*m^2", None, "WalkingInertia", "ankle inertia while walking, fit to the mean response"),
}
BELT_GAIN = "held-out VAF of the quadratic belt with hysteresis less the linear belt's, mean of trials"
COULOMB_GAIN = "held-out VAF of the transmission with Coulomb friction less that without, mean of trials"
DRIVETRAIN_GAIN = "held-out VAF of Eq. 9 with friction less Eq. 15's, mean of trials"
MODEL_GAINS: dict[tuple[str, str | None, str], Label] = {
    ("belt", None, "M4"): Label("belt_VAF_gain", "%", None, "BeltVAFGain", BELT_GAIN),
    ("transmission", None, "M2"): Label("coulomb_VAF_gain", "%", None, "CoulombVAFGain", COULOMB_GAIN),
    **{
        ("impedance", controller, "M3"): Label(
            f"drivetrain_VAF_gain_{controller}",
            "%",
            None,
            f"{controller.capitalize()}DrivetrainVAFGain",
            f"{DRIVETRAIN_GAIN}, {controller}",
        )
        for controller in ("compensated", "uncompensated")
    },
}
"""By experiment, controller and model of the comparison's summary."""
WALKING_VAF = Label("walking_VAF", "%", None, "WalkingVAF", "VAF of the walking fits, mean of perturbations")


def headline_numbers(tables: Mapping[str, pl.DataFrame]) -> list[Headline]:
    """Headline numbers of the experiments that the campaign has; `tables` by the names in `TABLES`.

    Raises
    ------
    InputError
        A summary table has no finite mean for a quantity that it lists.
    """
    found: list[Headline] = []
    if "belt_summary" in tables:
        found += means(tables["belt_summary"], BELT)
    if "transmission_summary" in tables:
        found += means(tables["transmission_summary"], TRANSMISSION)
    if "transmission" in tables:
        found += over_fits(TRANSMISSION_VAF, over_all_amplitudes(tables["transmission"])["VAF"], np.mean)
    if "actuator_summary" in tables:
        found += means(tables["actuator_summary"], ACTUATOR)
    if "impedance" in tables:
        for controller in ("compensated", "uncompensated"):
            found += impedance_headlines(controller, tables["impedance"])
    if "model_comparison_summary" in tables:
        found += model_gains(tables["model_comparison_summary"])
    if "walking_summary" in tables:
        walked = tables["walking_summary"].filter(pl.col("estimator") == ENSEMBLE)
        found += means(walked, WALKING, BOOTSTRAP)
    if "walking" in tables:
        found += over_fits(WALKING_VAF, tables["walking"]["VAF"], np.mean)
    return found + [doubtful_fits(name, table) for name, table in tables.items() if "doubtful" in TABLES[name]]


def doubtful_fits(name: str, table: pl.DataFrame) -> Headline:
    """How many fits of a table are doubtful; `n` how many there are."""
    doubtful, n = doubtful_count(table)
    meaning = f"doubtful fits in {name}.csv, whose column says why"
    label = Label(f"doubtful_{name}", "fits", None, f"Doubtful{name.capitalize()}", meaning)
    return Headline(**asdict(label), value=doubtful, low=None, high=None, interval=COUNT, n=n)


def over_all_amplitudes(table: pl.DataFrame) -> pl.DataFrame:
    """The rows that were fitted to all amplitudes of their trial together."""
    return table.filter(pl.col("amplitude_deg").is_null())


def means(table: pl.DataFrame, labels: Mapping[str, Label], interval: str = STUDENT) -> list[Headline]:
    """Means over repeats with their intervals, of the labelled quantities that a summary table lists."""
    rows = {row["quantity"]: row for row in table.iter_rows(named=True)}
    found = []
    for quantity, label in labels.items():
        if quantity not in rows:
            continue
        n, mean, low, high = (rows[quantity][column] for column in ("n", "mean", "low", "high"))
        if mean is None or not math.isfinite(mean):
            raise InputError(
                f"summary table: the mean of '{quantity}' is {mean}; look for a fit without a result in its trials"
            )
        found.append(headline(label, mean, low, high, interval, int(n)))
    return found


def impedance_headlines(controller: str, impedance: pl.DataFrame) -> list[Headline]:
    """VAF over trials and amplitudes, errors of K and B over trials, and the example of Fig. 4, for one controller."""
    fits = impedance.filter(pl.col("controller") == controller)
    trials = over_all_amplitudes(fits)
    vaf = fits.filter(pl.col("amplitude_deg").is_not_null())["VAF"]
    K_error = 100 * (trials["K"] / trials["K_d"] - 1).abs()
    B_error = (trials["B"] - trials["B_d"]).abs()

    def label(name: str, unit: str, macro: str, meaning: str) -> Label:
        return Label(f"{name}_{controller}", unit, None, controller.capitalize() + macro, f"{meaning}, {controller}")

    return [
        *over_fits(label("VAF_median", "%", "VAFMedian", "median VAF of trials and amplitudes"), vaf, np.median),
        *over_fits(label("VAF_mean", "%", "VAFMean", "mean VAF of trials and amplitudes"), vaf, np.mean),
        *over_fits(label("K_error", "%", "StiffnessError", "mean |K/K_d - 1| of trials"), K_error, np.mean),
        *over_fits(label("B_error", "N*m*s/rad", "DampingError", "mean |B - B_d| of trials"), B_error, np.mean),
        *example_headlines(controller, trials),
    ]


def example_headlines(controller: str, trials: pl.DataFrame) -> list[Headline]:
    """K and B of the trial that Fig. 4 shows; over repeats of it, their mean."""
    rows = trials.filter((pl.col("K_d") == EXAMPLE_K_D) & (pl.col("B_d") == EXAMPLE_B_D))
    found = []
    for symbol, word, unit in (("K", "Stiffness", "N*m/rad"), ("B", "Damping", "N*m*s/rad")):
        meaning = f"{symbol} for K_d = {EXAMPLE_K_D:g}, B_d = {EXAMPLE_B_D:g}, {controller}"
        label = Label(f"{symbol}_example_{controller}", unit, None, f"{controller.capitalize()}Example{word}", meaning)
        if len(rows) == 1:
            value, low, high = rows.select(symbol, f"{symbol}_low", f"{symbol}_high").row(0)
            lowest, highest = rows.select(f"{symbol}_amplitudes_low", f"{symbol}_amplitudes_high").row(0)
            number = headline(label, value, low, high, FIT, 1)
            found.append(replace(number, amplitudes_low=lowest, amplitudes_high=highest))
        else:
            found += over_fits(label, rows[symbol], np.mean)
    return found


def model_gains(table: pl.DataFrame) -> list[Headline]:
    """What the draft's models lose in VAF on data held out, of the comparisons that have a mean."""
    found = []
    for row in table.drop_nulls("VAF_gain").iter_rows(named=True):
        label = MODEL_GAINS.get((row["experiment"], row["controller"], row["model"]))
        if label is not None:
            bounds = row["VAF_gain_low"], row["VAF_gain_high"]
            found.append(headline(label, row["VAF_gain"], *bounds, PAIRED, int(row["trials"])))
    return found


def over_fits(label: Label, values: pl.Series, middle: Callable[[Array], np.floating]) -> list[Headline]:
    """Mean or median of the finite values, with their range if they are several; nothing where none is finite."""
    finite = values.filter(values.is_finite()).to_numpy()
    if not len(finite):
        return []
    low, high = (float(finite.min()), float(finite.max())) if len(finite) > 1 else (None, None)
    return [headline(label, float(middle(finite)), low, high, RANGE, len(finite))]


def headline(label: Label, value: float, low: float | None, high: float | None, interval: str, n: int) -> Headline:
    """A number without an interval where a bound is missing (a single trial has no scatter)."""
    if low is None or high is None or not (math.isfinite(low) and math.isfinite(high)):
        return Headline(**asdict(label), value=value, low=None, high=None, interval=None, n=n)
    return Headline(**asdict(label), value=value, low=low, high=high, interval=interval, n=n)
