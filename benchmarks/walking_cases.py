"""The imperfections of whole walking campaigns: the name of each row of `walking_validation.md`, and what differs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

Changes = Mapping[str, Any]
STATED = "stated in the sheet"


@dataclass(frozen=True)
class Remedy:
    """What the user states: fields of the configuration, of the source file, and columns of the sheet."""

    label: str
    config: Changes = field(default_factory=dict)
    source: Changes = field(default_factory=dict)
    sheet: Changes = field(default_factory=dict)
    """Column and value, for every trial."""
    stated: tuple[str, ...] = ()
    """Columns in which the sheet states what the plan of the simulation has."""


@dataclass(frozen=True)
class Case:
    """One imperfection."""

    label: str
    walking: Changes = field(default_factory=dict)
    """Fields of `config/simulation/walking.yaml` that differ."""
    experiments: Changes = field(default_factory=dict)
    """Fields of `experiments` in `config/simulation/default.yaml` that differ."""
    asked: Remedy = field(default_factory=lambda: Remedy(""))
    """What the campaign states without the remedy."""
    remedy: Remedy | None = None


def effect(name: str, size: float, unit: str) -> Changes:
    """An effect that is switched on."""
    return {"effects": {name: {"enabled": True, "size": size, "unit": unit}}}


def off(*names: str) -> Changes:
    """Effects that are switched off."""
    return {"effects": {name: {"enabled": False} for name in names}}


def change(**fields: Any) -> Changes:
    """A change of some crossings."""
    return {"changes": [fields]}


def capture(**fields: Any) -> Changes:
    """Another recording of the capture."""
    return {"capture": fields}


def conditions(**lists: Any) -> Changes:
    """Conditions of the crossings."""
    return {"conditions": lists}


K_D = {"K_d": [280, 340, 420]}
TWO_SESSIONS = {"static": 2, "walking": 20, "conditions": {"sessions": 2}}
SMALL = {"perturbation": {"angle_deg": 2.5, "rise_s": 0.1}, "effects": {"marker_noise": {"size": 0.3}}}
OWN = Remedy("", config={"walking": {"perturbed_stance": "own"}})
MATCHED = Remedy("`perturbed_stance: matched`, the default")

PROTOCOL = (
    Case("none"),
    Case("2.5° in 100 ms, markers 0.3 mm", SMALL),
    Case("platform up and down", experiments={"walking": 16} | conditions(directions=["up", "down"])),
    Case(
        "K_d 280, 340, 420 in one campaign",
        experiments={"walking": 24} | conditions(**K_D),
        remedy=Remedy("K_d " + STATED, stated=("K_d",)),
    ),
    Case(
        "onset at 20, 40, 60 % of stance, K 120, 300, 450 N·m/rad",
        {"impedance": "config/impedance/synthetic_rising.csv"},
        {"walking": 24} | conditions(stance_phases=[0.2, 0.4, 0.6]),
    ),
    Case(
        "two persons, 60 kg and 95 kg, stance 0.62 s and 0.78 s",
        experiments={
            "walking": 20,
            "static": 2,
            "conditions": {
                "subjects": [
                    {"name": "A", "body_mass_kg": 60, "stance_s": 0.62},
                    {"name": "B", "body_mass_kg": 95, "stance_s": 0.78},
                ]
            },
        },
        asked=Remedy("", sheet={"static": "static_1"}),
        remedy=Remedy("subject " + STATED, stated=("subject",)),
    ),
    Case("platform shifts by 50 mm in place of a turn", {"perturbation": {"shift_mm": 50}}),
)

GAIT = (
    Case("load scatters by 5 %", effect("load_scatter", 5, "%")),
    Case("timing within stance scatters by 1 %", effect("timing_wander", 1, "%")),
    Case("torque wanders by 2 N·m", effect("torque_wander", 2, "N*m")),
    Case("amplitude scatters by 5 %", effect("amplitude_scatter", 5, "%")),
    Case(
        "stance 8 % shorter after the window, `perturbed_stance: own`",
        change(of="perturbed", after_window_percent=-8),
        asked=OWN,
        remedy=MATCHED,
    ),
    Case(
        "stance 8 % longer after the window, `perturbed_stance: own`",
        change(of="perturbed", after_window_percent=8),
        asked=OWN,
        remedy=MATCHED,
    ),
    Case(
        "perturbed crossings 8 % slower throughout, `perturbed_stance: own`",
        change(of="perturbed", slower_percent=8),
        asked=OWN,
        remedy=MATCHED,
    ),
    Case("60 % of the unperturbed crossings with 70 % of the load", change(of="unperturbed", share=0.6, load=0.7)),
    Case("perturbed crossings with 70 % of the load", change(of="perturbed", load=0.7)),
)

PLATE = (
    Case("plate of type 1 (moving)", capture(plate_type=1)),
    Case("plate of type 3", capture(plate_type=3)),
    Case("plate of type 4", capture(plate_type=4)),
    Case("moment channels clipped at 35 N·m", effect("moment_clip", 35, "N*m")),
    Case("sensors of type 3 clipped at 200 N", effect("sensor_clip", 200, "N") | capture(plate_type=3)),
    Case("Mx, My, Mz stand still", capture(dead_channels={"Mx1": 0, "My1": 0, "Mz1": 0})),
    Case(
        "moments in N·mm under the label Nm",
        capture(moment_label="Nm"),
        remedy=Remedy("`plate_units` in the source file", source={"plate_units": {"force": "N", "moment": "N*mm"}}),
    ),
    Case("a second foot on the plate, 25 % of the weight", change(second_foot_percent=25)),
    Case("… in 3 of 10 perturbed crossings", change(of="perturbed", share=0.3, second_foot_percent=25)),
    Case("foot 30 mm beside the plate", change(overhang_mm=30)),
    Case("… in 3 of 10 unperturbed crossings", change(of="unperturbed", share=0.3, overhang_mm=30)),
    Case("light plate (its inertia removed by the maker)", off("plate_inertia")),
    Case(
        "light plate without plate trials",
        off("plate_inertia"),
        {"plate": 0},
        remedy=Remedy("`plate_inertia: none`", config={"walking": {"plate_inertia": "none"}}),
    ),
)

PLATFORM = (
    Case("ramps 5 % faster and slower", effect("rise_scatter", 5, "%")),
    Case("servo shivers by 0.05°", effect("servo_shiver", 0.05, "deg")),
    Case("hexapod heaves by 3 mm", effect("platform_heave", 3, "mm")),
    Case(
        "axis 0.12 m below the surface, 25 kg",
        {"perturbation": {"axis_depth_m": 0.12}} | effect("plate_inertia", 25, "kg"),
    ),
    Case("trigger's latency scatters by 2 ms", effect("trigger_scatter", 2, "ms")),
)

LABORATORY = (
    Case(
        "FOOT1 and SHANK1 swapped in the crossings",
        capture(swapped_labels=[["FOOT1", "SHANK1"]], swapped_in=["walking_03", "walking_04"]),
    ),
    Case(
        "FOOT2 and FOOT3 swapped in the static trial",
        capture(swapped_labels=[["FOOT2", "FOOT3"]], swapped_in=["static_1"]),
    ),
    Case(
        "y up, stated by the file only",
        capture(up_axis="y"),
        remedy=Remedy("`axes` in the source file", source={"axes": ["x", "-z", "y"]}),
    ),
    Case("y up, stated nowhere", capture(up_axis="y", states_axes=False)),
    Case(
        "side: left for a right leg, no leg log",
        asked=Remedy("", sheet={"side": "left"}, config={"walking": {"side": "left"}}),
    ),
    Case(
        "markers placed anew by 5 mm for a second session",
        effect("marker_placement", 5, "mm"),
        TWO_SESSIONS,
        asked=Remedy("", sheet={"static": "static_1"}),
        remedy=Remedy("session " + STATED, stated=("session",)),
    ),
    Case(
        "the files state 80 kg, the sheet 40 kg",
        capture(states_body_mass=True),
        asked=Remedy("", sheet={"body_mass_kg": 40}),
        remedy=Remedy("the true mass in the sheet", sheet={"body_mass_kg": 80}),
    ),
)

TABLES = {"protocol": PROTOCOL, "gait": GAIT, "plate": PLATE, "platform": PLATFORM, "laboratory": LABORATORY}
"""Cases by the name of their table."""
