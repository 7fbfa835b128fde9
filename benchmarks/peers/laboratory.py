# SPDX-License-Identifier: Apache-2.0
"""Recordings of joints whose truth is known, made by the project's own simulator of a bench."""

from copy import deepcopy
from dataclasses import dataclass, field

import numpy as np

from osl_analysis.base.files import shipped
from osl_analysis.base.yaml_settings import read_mapping
from osl_analysis.model.compensator import select_gains
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.simulator.bench_trial import simulate_bench_trial, true_signals
from osl_analysis.simulator.simulation_settings import SimulationSettings

JOINT = {"K": 300.0, "B": 5.0, "I": 0.02}
SINE = {
    "frequencies_hz": [1, 2, 3, 4, 5],
    "cycles": 3,
    "amplitudes_deg": [2, 4, 6],
    "rest_s": 0.5,
    "lead_s": 0.5,
}


def on(size, unit):
    """An effect that is switched on."""
    return {"enabled": True, "size": size, "unit": unit}


# s; of a leg, K, B and I depend on which rows are fitted. From the first whole period to the last
# one every method is asked for the same.
WHOLE_PERIODS_S = (1.0, 23.0)


@dataclass(frozen=True)
class Case:
    """A joint or a leg, its motion, and what differs in sensors and effects."""

    case: str
    motion: str
    joint: dict | None = field(default_factory=lambda: JOINT)
    controller: str = "compensated"
    effects: dict = field(default_factory=dict)
    announce: str = ""
    bits: int = 18
    known: dict[str, float] = field(default_factory=dict)


CASES = [
    *(Case("exact joint", motion) for motion in ("noise", "hand", "stepped sine")),
    Case("friction", "stepped sine", JOINT | {"coulomb": on(0.3, "N*m")}, announce="friction"),
    *(
        Case("drivetrain", motion, None, "uncompensated", announce="higher order")
        for motion in ("multisine", "noise")
    ),
    Case(
        "late torque",
        "stepped sine",
        effects={"load_cell_delay": on(2e-3, "s")},
        announce="late torque",
    ),
    Case("14 bits", "stepped sine", bits=14),
]


def settings_of(case, seed):
    """The shipped simulation, at 500 Hz, with one node and no friction in the drivetrain, which has
    no B of its own."""
    content = deepcopy(read_mapping(shipped("config/simulation/excitations.yaml")))
    motion = {"name": "x", "kind": case.motion, "rms_deg": 2.5, "fade_s": 0.5, "rest_s": 0.5}
    motion |= (
        {"period_s": 5.5, "periods": 4} if case.motion == "multisine" else {"duration_s": 22.0}
    )
    content |= {"seed": seed, "joint": case.joint, "protocol": SINE, "recorder": {}}
    content["excitations"] = [] if case.motion == "stepped sine" else [motion]
    content["dynamometer"]["rate_hz"] = 500
    content["effects"] |= {"joint_encoder": on(case.bits, "bit"), **case.effects}
    for name in ("friction", "belt_hysteresis", "load_cell_quantisation"):
        content["effects"][name]["enabled"] = False
    return SimulationSettings.model_validate(content)


def truth_of(row, settings, p, rows):
    """K, B and I of the joint; of a leg those of the joint that has its true torque in these rows
    most nearly."""
    if settings.joint is not None:
        return {name: getattr(settings.joint, name) for name in "KBI"}
    gains = select_gains(row["controller"], row["K_d"], row["B_d"], p, settings.gain_weight)
    motion, signals = true_signals(row, settings, p, gains)
    X = np.column_stack([motion.theta, motion.omega, motion.alpha, np.ones_like(motion.theta)])
    torque = -signals["load_cell_torque"]
    return dict(zip("KBI", np.linalg.lstsq(X[rows], torque[rows])[0], strict=False))


def recordings(seed, only=CASES):
    """Each case with its truth, and stamps [s], angle [rad] and torque [N*m], (n,) each."""
    for number, case in enumerate(only):
        settings = settings_of(case, 100 * seed + number)
        p = read_parameters(settings.parameters)
        row = {"trial": f"{case.case}_{seed}_x_1".replace(" ", "_"), "experiment": "impedance"}
        row |= {"controller": case.controller, "K_d": 300.0, "B_d": 5.0}
        log, _ = simulate_bench_trial(row, settings, p)
        time = log["time"] - log["time"][0]
        rows = np.full(time.shape, True)
        if case.motion == "multisine":
            rows = (time >= WHOLE_PERIODS_S[0]) & (time < WHOLE_PERIODS_S[1])
        columns = time[rows], log["joint_angle"][rows], -log["load_cell_torque"][rows]
        yield case, truth_of(row, settings, p, rows), columns
