"""Labels of the headline numbers: name, unit, value in the paper's draft, LaTeX macro and meaning."""

import re
from dataclasses import dataclass, replace

from osl_analysis.experiments import judged_tables

CONTROLLERS = ("compensated", "uncompensated")
EXAMPLE_K_D, EXAMPLE_B_D = 300.0, 5.0
"""The desired impedance of Fig. 4 [N*m/rad, N*m*s/rad], whose estimates are headline numbers."""
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


def controller_label(controller: str, name: str, unit: str, macro: str, meaning: str) -> Label:
    """The label of a number that each controller has."""
    return Label(f"{name}_{controller}", unit, None, controller.capitalize() + macro, f"{meaning}, {controller}")


def impedance_labels(controller: str) -> dict[str, Label]:
    """The numbers of the rendered impedance with one controller."""
    example = f"for K_d = {EXAMPLE_K_D:g}, B_d = {EXAMPLE_B_D:g}"
    rows = (
        ("VAF_median", "%", "VAFMedian", "median VAF of trials and amplitudes"),
        ("VAF_mean", "%", "VAFMean", "mean VAF of trials and amplitudes"),
        ("K_error", "%", "StiffnessError", "mean |K/K_d - 1| of trials"),
        ("B_error", "N*m*s/rad", "DampingError", "mean |B - B_d| of trials"),
        ("K_example", "N*m/rad", "ExampleStiffness", f"K {example}"),
        ("B_example", "N*m*s/rad", "ExampleDamping", f"B {example}"),
    )
    return {name: controller_label(controller, name, *rest) for name, *rest in rows}


def model_gain_labels() -> dict[tuple[str, str | None, str], Label]:
    """Differences between rival models and the draft's, by experiment, controller and model of the comparison's
    summary."""
    drivetrain = {
        controller: controller_label(controller, "drivetrain_VAF_gain", "%", "DrivetrainVAFGain", DRIVETRAIN_GAIN)
        for controller in CONTROLLERS
    }
    return {
        ("belt", None, "M4"): Label("belt_VAF_gain", "%", None, "BeltVAFGain", BELT_GAIN),
        ("transmission", None, "M2"): Label("coulomb_VAF_gain", "%", None, "CoulombVAFGain", COULOMB_GAIN),
        **{("impedance", controller, "M3"): label for controller, label in drivetrain.items()},
    }


def of_group(label: Label, group: str) -> Label:
    """The label of one group of crossings; unchanged for a campaign of one group.

    The draft's value is of one group. The macro has the group's name in letters, digits as words.
    """
    if group == ONE_GROUP:
        return label
    named = f"{label.meaning}, {group}"
    return replace(label, name=f"{label.name} ({group})", draft=None, macro=label.macro + letters(group), meaning=named)


def letters(text: str) -> str:
    """Text as letters only, for the name of a macro: `K_d 200, timing 41 %` gives `KdTwoZeroZeroTimingFourOne`."""
    words = re.findall(r"[A-Za-z]+|[0-9]", text.replace("_", ""))
    return "".join(DIGITS[int(word)] if word.isdigit() else word[0].upper() + word[1:] for word in words)


def doubtful_label(table: str) -> Label:
    """The number of doubtful fits of a table."""
    meaning = f"doubtful fits in {table}.csv, whose column says why"
    return Label(f"doubtful_{table}", "fits", None, f"Doubtful{table.capitalize()}", meaning)


def all_labels() -> list[Label]:
    """Every number that a summary can have."""
    return [
        *BELT_LABELS.values(),
        *TRANSMISSION_LABELS.values(),
        TRANSMISSION_VAF,
        *ACTUATOR_LABELS.values(),
        *(label for controller in CONTROLLERS for label in impedance_labels(controller).values()),
        *model_gain_labels().values(),
        *WALKING_LABELS.values(),
        *SYMMETRY_LABELS.values(),
        WALKING_VAF,
        *map(doubtful_label, judged_tables()),
    ]
