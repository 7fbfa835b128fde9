"""Labels of the headline numbers: name, unit, value in the paper's draft, LaTeX macro and meaning."""

import re
import unicodedata
from dataclasses import dataclass, replace

from osl_analysis.experiments import judged_tables

CONTROLLERS = ("compensated", "uncompensated")
"""The controllers of the draft."""
DRAFT_JOINT = "ankle"
"""The joint whose numbers the draft prints."""
LONGEST = 32
"""Letters of a controller's name in a macro."""
NO_CONTROLLER = "no controller"
DIGITS = ("Zero", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")
ONE_GROUP = "all"
"""Name of the group of crossings of a campaign that is not split."""


@dataclass(frozen=True)
class Label:
    """Label of a headline number."""

    name: str
    """Its key in the summary."""
    unit: str
    draft: float | None
    """The value that the paper's draft prints; None if it prints none."""
    macro: str
    """Its LaTeX macro without the prefix, letters only."""
    meaning: str


@dataclass(frozen=True)
class Example:
    """The desired impedance of Fig. 4, whose estimates are headline numbers."""

    K_d: float | None = 300.0
    """Desired stiffness [N*m/rad]; None: not stated."""
    B_d: float | None = 5.0
    """Desired damping [N*m*s/rad]; None: not stated."""
    chosen: str = ""
    """Why this one, where the configuration does not name it."""

    def meaning(self) -> str:
        """Which trials they are, in words."""
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
DRAFT_EXAMPLE = Example()
"""That of the draft."""
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
    """The label of a number that each controller has; None: trials without a controller."""
    known = controller or NO_CONTROLLER
    return Label(
        f"{name}_{known.replace(' ', '_')}", unit, None, letters(known)[:LONGEST] + macro, f"{meaning}, {known}"
    )


def impedance_labels(controller: str | None, example: Example = DRAFT_EXAMPLE) -> dict[str, Label]:
    """The numbers of the rendered impedance with one controller."""
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


def of_place(label: Label, joint: str | None, side: str | None, several: bool) -> Label:
    """The label of one joint and side. The draft's values are those of an ankle.

    Where a campaign has `several`, its names and macros tell them apart.
    """
    where = ", ".join(filter(None, [joint or DRAFT_JOINT, side]))
    draft = label.draft if (joint or DRAFT_JOINT) == DRAFT_JOINT else None
    if not several:
        named = label.meaning if where == DRAFT_JOINT else f"{label.meaning}, {where}"
        return replace(label, draft=draft, meaning=named)
    name, macro = f"{label.name} ({where})", label.macro + letters(where)
    return replace(label, name=name, draft=draft, macro=macro, meaning=f"{label.meaning}, {where}")


def of_group(label: Label, group: str) -> Label:
    """The label of one group of crossings; unchanged for a campaign of one group.

    The draft's value is of one group. The macro has the group's name in letters, digits as words.
    """
    if group == ONE_GROUP:
        return label
    named = f"{label.meaning}, {group}"
    return replace(label, name=f"{label.name} ({group})", draft=None, macro=label.macro + letters(group), meaning=named)


def letters(text: str) -> str:
    """Text as letters only, for the name of a macro: `K_d 200, timing 41 %` gives `KdTwoZeroZeroTimingFourOne`.

    A sign beyond the Latin letters gives the last word of its name: `PD α` gives `PDAlpha`.
    """
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
    """The number of doubtful fits of a table."""
    meaning = f"doubtful fits in {table}.csv, whose column says why"
    return Label(f"doubtful_{table}", "fits", None, f"Doubtful{letters(table)}", meaning)


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
