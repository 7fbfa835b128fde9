"""Headline numbers of a campaign, computed from its result tables, each with its label and its interval."""

import math
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import count

import numpy as np
import polars as pl

from osl_analysis.config.campaign import ABOUT_MACROS
from osl_analysis.config.experiments import EXPERIMENTS, judged_tables
from osl_analysis.errors import InputError
from osl_analysis.judge.doubts import DOUBTFUL, causes_by_trial, counted, doubtful_count
from osl_analysis.trial import Array

CONTROLLERS = ("compensated", "uncompensated")  # the controllers of the draft
DRAFT_JOINT = "ankle"  # the joint whose numbers the draft prints
LONGEST_NAME = 32  # letters of a controller's name in a macro
NO_CONTROLLER = "no controller"
DIGITS = ("Zero", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")
ONE_GROUP = "all"  # name of the group of crossings of a campaign that is not split


@dataclass(frozen=True)
class Label:
    name: str  # its key in the summary
    unit: str
    draft: float | None  # the value that the paper's draft prints; None if it prints none
    macro: str  # its LaTeX macro without the prefix, letters only
    meaning: str


@dataclass(frozen=True)
class Example:
    """The desired impedance of Fig. 4, whose estimates are headline numbers."""

    K_d: float | None = 300.0  # desired stiffness [N*m/rad]; None: not stated
    B_d: float | None = 5.0  # desired damping [N*m*s/rad]; None: not stated
    chosen: str = ""  # why this one, where the configuration does not name it

    def meaning(self) -> str:
        stated = [f"{name} = {value:g}" for name, value in (("K_d", self.K_d), ("B_d", self.B_d)) if value is not None]
        words = f"for {', '.join(stated)}" if stated else "of trials without K_d and B_d"
        return f"{words} (that of {self.chosen})" if self.chosen else words


BELT_LABELS = {"K_s": Label("K_s", "N*m/rad", 685.6, "BeltStiffness", "belt stiffness while loading, mean of trials")}
TRANSMISSION_LABELS = {
    "B_j": Label("B_j", "N*m*s/rad", 0.452, "JointDamping", "damping of the transmission, mean of trials"),
    "J_j": Label("J_j", "kg*m^2", 5.0e-3, "JointInertia", "inertia of the transmission, mean of trials"),
}
TRANSMISSION_VAF = Label(
    "transmission_VAF", "%", 99.1, "TransmissionVAF", "VAF of the transmission model, mean of trials"
)
ACTUATOR_LABELS = {
    "k_tau_n_m": Label("k_tau_n_m", "N*m/A", 113.3e-3 * 9, "TorqueConstant", "torque per current, mean of trials"),
    "f_C": Label("f_C", "N*m", 0.377, "CoulombFriction", "Coulomb friction of the actuator, mean of trials"),
    "f_G": Label("f_G", "N*m/A", 89.6e-3, "GearFriction", "gear friction of the actuator, mean of trials"),
    "B_m": Label("B_m", "N*m*s/rad", 5.6e-3, "MotorDamping", "damping of the actuator, mean of trials"),
    "J_m": Label("J_m", "kg*m^2", 9.211e-3, "MotorInertia", "inertia of the actuator, mean of trials"),
}
TORQUE_ANGLE_LABELS = {
    "K": Label("torque_angle_K", "N*m/rad", None, "TorqueAngleStiffness", "stiffness while loading, mean of cycles"),
    "energy_stored": Label("energy_stored", "J", None, "EnergyStored", "energy taken up in a cycle, mean of cycles"),
    "energy_returned": Label("energy_returned", "J", None, "EnergyReturned", "energy given back, mean of cycles"),
    "energy_lost": Label("energy_lost", "J", None, "EnergyLost", "energy lost in a cycle, mean of cycles"),
}
DRAFT_EXAMPLE = Example()  # that of the draft
DRAFT_GAINS = (("belt", None, "M4"), ("transmission", None, "M2"), *(("impedance", c, "M3") for c in CONTROLLERS))
"""Experiment, controller and model of the draft's rival models."""
SYMMETRY = "of the ankle while walking, turns up minus turns down"
WALKING_LABELS = {
    "K": Label(
        "walking_K", "N*m/rad", 340.0, "WalkingStiffness", "ankle stiffness while walking, fit to the mean response"
    ),
    "B": Label(
        "walking_B", "N*m*s/rad", None, "WalkingDamping", "ankle damping while walking, fit to the mean response"
    ),
    "I": Label("walking_I", "kg*m^2", None, "WalkingInertia", "ankle inertia while walking, fit to the mean response"),
}
SYMMETRY_LABELS = {
    quantity: Label(f"{label.name}_up_minus_down", label.unit, None, f"{label.macro}UpMinusDown", f"{word} {SYMMETRY}")
    for (quantity, label), word in zip(WALKING_LABELS.items(), ("stiffness", "damping", "inertia"), strict=True)
}
WALKING_VAF = Label("walking_VAF", "%", None, "WalkingVAF", "VAF of the walking fits, mean of perturbations")
BELT_GAIN = "held-out VAF of the quadratic belt with hysteresis less the linear belt's, mean of trials"
COULOMB_GAIN = "held-out VAF of the transmission with Coulomb friction less that without, mean of trials"
DRIVETRAIN_GAIN = "held-out VAF of Eq. 9 with friction less Eq. 15's, mean of trials"


def controller_label(controller: str | None, name: str, unit: str, macro: str, meaning: str) -> Label:
    known = controller or NO_CONTROLLER
    return Label(
        f"{name}_{known.replace(' ', '_')}", unit, None, letters(known)[:LONGEST_NAME] + macro, f"{meaning}, {known}"
    )


def impedance_labels(controller: str | None, example: Example = DRAFT_EXAMPLE) -> dict[str, Label]:
    rows = (
        ("VAF_median", "%", "VAFMedian", "median VAF of trials and amplitudes"),
        ("VAF_mean", "%", "VAFMean", "mean VAF of trials and amplitudes"),
        ("K_error", "%", "StiffnessError", "mean |K/K_d - 1| of trials"),
        ("B_error", "N*m*s/rad", "DampingError", "mean |B - B_d| of trials"),
        ("K_example", "N*m/rad", "ExampleStiffness", f"K {example.meaning()}"),
        ("B_example", "N*m*s/rad", "ExampleDamping", f"B {example.meaning()}"),
    )
    return {name: controller_label(controller, name, *rest) for name, *rest in rows}


def model_gain_label(experiment: str, controller: str | None, model: str) -> Label | None:
    """The difference between a rival model and the draft's; None for a model whose difference is no headline."""
    if (experiment, model) == ("impedance", "M3"):
        return controller_label(controller, "drivetrain_VAF_gain", "%", "DrivetrainVAFGain", DRIVETRAIN_GAIN)
    return {
        ("belt", "M4"): Label("belt_VAF_gain", "%", None, "BeltVAFGain", BELT_GAIN),
        ("transmission", "M2"): Label("coulomb_VAF_gain", "%", None, "CoulombVAFGain", COULOMB_GAIN),
    }.get((experiment, model))


def label_of_place(label: Label, joint: str | None, side: str | None, several: bool) -> Label:
    """The label of one joint and side, told apart where there are `several`; the draft's is an ankle."""
    where = ", ".join(filter(None, [joint or DRAFT_JOINT, side]))
    draft = label.draft if (joint or DRAFT_JOINT) == DRAFT_JOINT else None
    if not several:
        named = label.meaning if where == DRAFT_JOINT else f"{label.meaning}, {where}"
        return replace(label, draft=draft, meaning=named)
    name, macro = f"{label.name} ({where})", label.macro + letters(where)
    return replace(label, name=name, draft=draft, macro=macro, meaning=f"{label.meaning}, {where}")


def of_group(label: Label, group: str) -> Label:
    """The label of one group of crossings; that of a campaign of one group, as the draft's, is unchanged."""
    if group == ONE_GROUP:
        return label
    named = f"{label.meaning}, {group}"
    return replace(label, name=f"{label.name} ({group})", draft=None, macro=label.macro + letters(group), meaning=named)


def letters(text: str) -> str:
    """Text as letters only, for the name of a macro: `K_d 200, timing 41 %` gives `KdTwoZeroZeroTimingFourOne`. A sign
    beyond the Latin letters gives the last word of its name: `PD α` gives `PDAlpha`."""
    spelled = "".join(latin(sign) for sign in unicodedata.normalize("NFKD", text))
    words = re.findall(r"[A-Za-z]+|[0-9]", spelled.replace("_", ""))
    return "".join(DIGITS[int(word)] if word.isdigit() else word[0].upper() + word[1:] for word in words) or "Unnamed"


def latin(sign: str) -> str:
    """A sign of ASCII, or for another letter or number the last word of its name; nothing for an accent."""
    if sign.isascii():
        return sign
    if not sign.isalnum():
        return "" if unicodedata.combining(sign) else " "
    return f" {unicodedata.name(sign, '').rpartition(' ')[2].capitalize()} "


def doubtful_label(table: str) -> Label:
    of, counted_are = DOUBTS_OF.get(table), "groups" if table == "walking_groups" else "trials"
    why = f"for another cause than in {of}.csv" if of else "whose column says why"
    meaning = f"doubtful {counted_are} in {table}.csv, {why}"
    return Label(f"doubtful_{table}", counted_are, None, f"Doubtful{letters(table)}", meaning)


def all_labels() -> list[Label]:
    """Every number that the summary of the draft's campaign can have, and those of a trial of torque against angle."""
    return [
        *BELT_LABELS.values(),
        *TRANSMISSION_LABELS.values(),
        TRANSMISSION_VAF,
        *ACTUATOR_LABELS.values(),
        *(label for controller in CONTROLLERS for label in impedance_labels(controller).values()),
        *(label for key in DRAFT_GAINS if (label := model_gain_label(*key)) is not None),
        *TORQUE_ANGLE_LABELS.values(),
        *WALKING_LABELS.values(),
        *SYMMETRY_LABELS.values(),
        WALKING_VAF,
        *map(doubtful_label, judged_tables()),
    ]


STUDENT = "95 % of the mean (Student)"
FIT = "95 % for another motion of this kind"
FEW = "95 % for a repetition of this motion"
BOOTSTRAP = "95 % (bootstrap over crossings and trials of the unloaded plate)"
OF_CYCLES = "95 % of the mean of cycles (Student)"
PAIRED = "95 % of the mean difference of the same trials (Student)"
RANGE = "lowest to highest"
COUNT = "count"
RESERVED = ABOUT_MACROS.values()  # macros that are no numbers
ENDINGS = ("", "Low", "High", "AmplitudesLow", "AmplitudesHigh")  # endings of the macros of a number and its bounds


@dataclass(frozen=True)
class Headline(Label):
    value: float  # in `unit`
    low: float | None
    high: float | None
    interval: str | None  # kind of the interval; None if there is none
    n: int  # number of trials or fits that the number is computed from
    n_doubtful: int = 0  # number of doubtful trials or fits among those that could be in the number
    n_left_out: int = 0  # number of these that are not in it
    doubt: str | None = None  # why the number itself is doubtful; None if it is not, or not judged
    amplitudes_low: float | None = None  # lowest result of the fits to single amplitudes; None if there are none
    amplitudes_high: float | None = None  # highest result of the fits to single amplitudes; None if there are none


def said_of(numbers: Iterable[Headline], candidates: pl.DataFrame, used: pl.DataFrame | None = None) -> list[Headline]:
    """The numbers with the count of doubtful rows among their candidates, and of those that are not in `used`. A VAF
    uses all rows: to leave out fits that are doubtful for a low VAF would raise it."""
    left_out = 0 if used is None else len(candidates) - len(used)
    return [replace(n, n_doubtful=doubtful_count(candidates)[0], n_left_out=left_out) for n in numbers]


def over_fits(label: Label, values: pl.Series, middle: Callable[[Array], np.floating]) -> list[Headline]:
    """Mean or median of the finite values, with their range if there are several. Empty without finite values."""
    finite = values.filter(values.is_finite()).to_numpy()
    if not len(finite):
        return []
    low, high = (float(finite.min()), float(finite.max())) if len(finite) > 1 else (None, None)
    return [headline(label, float(middle(finite)), len(finite), low, high, RANGE)]


def over_trials(label: Label, fits: pl.DataFrame, middle: Callable[[Array], np.floating] = np.mean) -> list[Headline]:
    return said_of(over_fits(label, fits["VAF"], middle), fits)


def headline(label: Label, value: float, n: int, low: float | None, high: float | None, kind: str) -> Headline:
    """A number, without an interval where a bound is missing (a single trial has no scatter)."""
    if low is None or high is None or not np.isfinite([low, high]).all():
        return Headline(**asdict(label), value=value, low=None, high=None, interval=None, n=n)
    return Headline(**asdict(label), value=value, low=low, high=high, interval=kind, n=n)


def summary_means(table: pl.DataFrame, labels: Mapping[str, Label], interval: str = STUDENT) -> list[Headline]:
    """The labelled quantities that a summary table lists, with their intervals."""
    rows = {row["quantity"]: row for row in table.iter_rows(named=True)}
    numbers = []
    for quantity, label in labels.items():
        if quantity not in rows:
            continue
        n, mean, low, high = (rows[quantity][column] for column in ("n", "mean", "low", "high"))
        if mean is None or not math.isfinite(mean):
            raise InputError(
                f"summary table: the mean of '{quantity}' is {mean}; look for a fit without a result in its trials"
            )
        found = headline(label, mean, int(n), low, high, interval)
        doubtful, left_out = (int(rows[quantity].get(column) or 0) for column in ("n_doubtful", "n_left_out"))
        doubt = rows[quantity].get("doubt") or None
        numbers.append(replace(found, n_doubtful=doubtful, n_left_out=left_out, doubt=doubt))
    return numbers


def with_own_names(numbers: Sequence[Headline]) -> list[Headline]:
    """The numbers with names and macros that no other one has, with its endings; the first one keeps its own. Different
    names of a campaign may have the same letters: the second `PD 1` and `PD-1` becomes `PDOneB`."""
    names, macros, found = set[str](), set[str](RESERVED), []
    for number in numbers:
        name = next(free for k in count(1) if (free := number.name + (f" ({k})" if k > 1 else "")) not in names)
        macro = next(free for k in count() if not macros & with_endings(free := number.macro + "B" * k))
        names.add(name)
        macros |= with_endings(macro)
        found.append(replace(number, name=name, macro=macro))
    return found


def with_endings(macro: str) -> set[str]:
    return {macro + ending for ending in ENDINGS}


def over_all_amplitudes(table: pl.DataFrame) -> pl.DataFrame:
    return table.filter(pl.col("amplitude_deg").is_null())


HEADLINE_ESTIMATOR = "ensemble"
"""Estimator of the walking summary that is the headline. Its bias decreases with the number of crossings; the bias of
the mean over perturbations does not."""

BETWEEN_DIRECTIONS = "up minus down"  # estimator of the walking summary that compares the directions of the platform

JOINT_AND_SIDE = ("joint", "side")
SUMMARY_COLUMNS = ("quantity", "n", "mean", "low", "high")
READ_TABLES = {
    "belt_summary": SUMMARY_COLUMNS,
    "transmission_summary": SUMMARY_COLUMNS,
    "transmission": ("amplitude_deg", "VAF"),
    "actuator_summary": SUMMARY_COLUMNS,
    "impedance": (
        "controller", "K_d", "B_d", "amplitude_deg", "K", "K_low", "K_high", "K_amplitudes_low", "K_amplitudes_high",
        "B", "B_low", "B_high", "B_amplitudes_low", "B_amplitudes_high", "VAF",
    ),
    "torque_angle": (
        "trial", "cycles", "K", "K_low", "K_high", "energy_stored", "energy_stored_low", "energy_stored_high",
        "energy_returned", "energy_returned_low", "energy_returned_high", "energy_lost", "energy_lost_low",
        "energy_lost_high",
    ),
    "model_comparison_summary": (
        "experiment", "controller", "model", "trials", "VAF_gain", "VAF_gain_low", "VAF_gain_high",
    ),
    "walking_summary": ("group", "quantity", "estimator", "n", "mean", "low", "high"),
    "walking": ("VAF",),
}  # fmt: skip
"""The tables with headline numbers, and the columns that these need."""
DOUBTS_OF = {table.name: table.doubts_of for facts in EXPERIMENTS.values() for table in facts.tables if table.doubts_of}
"""Per table, the table of the same trials whose doubts its rows share."""


def needed_columns(table: str) -> tuple[str, ...] | None:
    """Columns of a result table that the summary needs, the doubts among them; None for one that it does not read."""
    judged = (DOUBTFUL,) if table in judged_tables() else ()
    return (*READ_TABLES.get(table, ()), *judged) or None


def headline_numbers(tables: Mapping[str, pl.DataFrame], example: Example = DRAFT_EXAMPLE) -> list[Headline]:
    """Headline numbers of the experiments that the campaign has; `tables` by name, `example` of Fig. 4. The bench's are
    of one joint and side each. Raises InputError: a summary table has no finite mean for a quantity that it lists."""
    numbers = [
        number for name, of_table in BENCH if name in tables for number in per_place(tables[name], of_table, example)
    ]
    numbers += [number for name, of_table in WALKING if name in tables for number in of_table(tables[name])]
    doubts = [
        doubtful_trials(name, table, tables.get(DOUBTS_OF.get(name, "")))
        for name, table in tables.items()
        if name in judged_tables()
    ]
    return with_own_names([*numbers, *doubts])


def per_place(
    table: pl.DataFrame, of_table: Callable[[pl.DataFrame, Example], list[Headline]], example: Example
) -> list[Headline]:
    if not set(JOINT_AND_SIDE) <= set(table.columns):
        return of_table(table, example)
    numbers, parts = [], table.partition_by(JOINT_AND_SIDE, maintain_order=True)
    for part in parts:
        joint, side = part.select(JOINT_AND_SIDE).row(0)
        for number in of_table(part, example):
            own = Label(**{field.name: getattr(number, field.name) for field in fields(Label)})
            label = label_of_place(own, joint, side, several=len(parts) > 1)
            numbers.append(replace(number, **asdict(label)))
    return numbers


def walking_summary_headlines(table: pl.DataFrame) -> list[Headline]:
    found = table.filter(pl.col("mean").is_not_null())
    numbers = []
    for rows in found.partition_by("group", maintain_order=True):
        for estimator, labels in ((HEADLINE_ESTIMATOR, WALKING_LABELS), (BETWEEN_DIRECTIONS, SYMMETRY_LABELS)):
            own = {quantity: of_group(label, rows["group"][0]) for quantity, label in labels.items()}
            numbers += summary_means(rows.filter(pl.col("estimator") == estimator), own, BOOTSTRAP)
    return numbers


def impedance_headlines(impedance: pl.DataFrame, example: Example) -> list[Headline]:
    found = set(impedance["controller"])
    others = sorted(name for name in found if name is not None and name not in CONTROLLERS)
    known = [*(name for name in CONTROLLERS if name in found), *others, *([None] if None in found else [])]
    return [number for controller in known for number in controller_headlines(controller, impedance, example)]


def controller_headlines(controller: str | None, impedance: pl.DataFrame, example: Example) -> list[Headline]:
    """The numbers of the rendered impedance with one controller; None: without one."""
    fits = impedance.filter(pl.col("controller").eq_missing(pl.lit(controller, pl.String)))
    labels, trials = impedance_labels(controller, example), over_all_amplitudes(fits)
    alone = pl.len().over("trial") == 1 if "trial" in fits.columns else pl.lit(False)
    single = fits.filter(pl.col("amplitude_deg").is_not_null() | alone)
    used = counted(trials)
    errors = (
        *over_fits(labels["K_error"], 100 * (used["K"] / used["K_d"] - 1).abs().drop_nulls(), np.mean),
        *over_fits(labels["B_error"], (used["B"] - used["B_d"]).abs().drop_nulls(), np.mean),
    )
    return [
        *over_trials(labels["VAF_median"], single, np.median),
        *over_trials(labels["VAF_mean"], single),
        *said_of(errors, trials, used),
        *example_headlines("K", labels["K_example"], trials, example),
        *example_headlines("B", labels["B_example"], trials, example),
    ]


def example_headlines(symbol: str, label: Label, trials: pl.DataFrame, example: Example) -> list[Headline]:
    """K or B of the trial that Fig. 4 shows; the mean over its repeats, if there are several."""
    asked = {"K_d": example.K_d, "B_d": example.B_d}
    rows = trials.filter(pl.col(name).eq_missing(pl.lit(value, pl.Float64)) for name, value in asked.items())
    if len(rows) != 1:
        used = counted(rows)
        return said_of(over_fits(label, used[symbol], np.mean), rows, used)
    value, low, high, method = rows.select(symbol, f"{symbol}_low", f"{symbol}_high", "interval_method").row(0)
    lowest, highest = rows.select(f"{symbol}_amplitudes_low", f"{symbol}_amplitudes_high").row(0)
    number = headline(label, value, 1, low, high, FEW if method == "repeats" else FIT)
    return said_of([replace(number, amplitudes_low=lowest, amplitudes_high=highest)], rows)


def model_gain_headlines(table: pl.DataFrame) -> list[Headline]:
    numbers = []
    for row in table.drop_nulls("VAF_gain").iter_rows(named=True):
        label = model_gain_label(row["experiment"], row["controller"], row["model"])
        if label is not None:
            ends = row["VAF_gain_low"], row["VAF_gain_high"]
            numbers.append(headline(label, row["VAF_gain"], int(row["trials"]), *ends, PAIRED))
    return numbers


def torque_angle_headlines(table: pl.DataFrame) -> list[Headline]:
    numbers = []
    for row in table.iter_rows(named=True):
        for quantity, label in TORQUE_ANGLE_LABELS.items():
            ends = row[f"{quantity}_low"], row[f"{quantity}_high"]
            number = headline(of_group(label, row["trial"]), row[quantity], int(row["cycles"]), *ends, OF_CYCLES)
            numbers.append(replace(number, doubt=row[DOUBTFUL] or None))
    return numbers


def doubtful_trials(name: str, table: pl.DataFrame, of: pl.DataFrame | None) -> Headline:
    """How many trials are doubtful, of those with a fit; a table whose rows share the doubts of another one, `of`,
    counts those with a cause of their own."""
    causes = causes_by_trial(table, of)
    doubtful = sum(map(bool, causes.values()))
    return Headline(**asdict(doubtful_label(name)), value=doubtful, low=None, high=None, interval=COUNT, n=len(causes))


BENCH: tuple[tuple[str, Callable[[pl.DataFrame, Example], list[Headline]]], ...] = (
    ("belt_summary", lambda table, _: summary_means(table, BELT_LABELS)),
    ("transmission_summary", lambda table, _: summary_means(table, TRANSMISSION_LABELS)),
    ("transmission", lambda table, _: over_trials(TRANSMISSION_VAF, over_all_amplitudes(table))),
    ("actuator_summary", lambda table, _: summary_means(table, ACTUATOR_LABELS)),
    ("impedance", impedance_headlines),
    ("torque_angle", lambda table, _: torque_angle_headlines(table)),
    ("model_comparison_summary", lambda table, _: model_gain_headlines(table)),
)
"""The tables of the bench with headline numbers, and what computes these, in the order of the summary."""
WALKING: tuple[tuple[str, Callable[[pl.DataFrame], list[Headline]]], ...] = (
    ("walking_summary", walking_summary_headlines),
    ("walking", lambda table: over_fits(WALKING_VAF, table["VAF"], np.mean)),
)
"""Those of the walkway, which follow."""
