"""The identified leg as MJCF, MuJoCo's model format: Eqs. 1-4, what it cannot say of them, and the
torque in MuJoCo.

MuJoCo adds the current's torque, damping, inertia and Coulomb friction of the actuator, and the
belt as a tendon. The gear's friction f_G |I_q| is no element of MJCF: who simulates sets
`dof_frictionloss` before every step."""

import math
import re

import numpy as np
import scipy

from osl_analysis.errors import optional_module
from osl_analysis.model.compensator import Controller
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.trial import Array

STEP_S = 2.5e-4
"""Largest time step [s] of the round trip."""
EQUATIONS = {
    "actuator (Eqs. 1-2)": (
        "tau_m = k_tau n_m I_q - sign(omega_m) (f_C + f_G |I_q|) - B_m omega_m - J_m alpha_m"
    ),
    "belt (Eqs. 3 and 8)": "theta_s = theta_j - theta_m/n_T; tau_s = K_s theta_s",
    "joint (Eq. 4)": "tau = tau_s + B_j omega_j + J_j alpha_j, the resisting torque",
    "actuator in the leg": "tau_m + tau_s/n_T = 0",
    "controller (Eqs. 5 and 7)": (
        "u = -K_1 theta_m - B_1 omega_m; compensated: I_q = r/(k_tau n_m - s f_G) for r >= 0,"
        " r/(k_tau n_m + s f_G) for r < 0, r = u + s f_C, s = tanh(omega_m/sign_width);"
        " uncompensated: I_q = u/(k_tau n_m)"
    ),
}
"""The model, and the controller, which has the numbers of the parameter file."""
CANNOT = (
    (
        "f_G |I_q|, the gear's friction: before every step set dof_frictionloss of theta_m to f_C +"
        " f_G |ctrl|"
    ),
    (
        "dry friction without creep: MuJoCo's is a soft constraint; its solreffriction must be"
        " 0.001 1, not the default of 0.02 1, and the time constant in it is never shorter than two"
        " time steps"
    ),
    "the belt's hysteresis, and a belt that is not linear (K_s2)",
    "the controller: ctrl is the current I_q [A], which a program computes",
)
"""What MJCF, or MuJoCo's default, does not say of the leg, and what to do."""


def mjcf_text(p: DrivetrainParameters, comment: str = "") -> str:
    """The leg as MJCF: joints theta_m and theta_j [rad], ctrl the current I_q [A]. `comment`: lines
    for the reader."""
    said = re.sub(r"-(?=-)", "- ", comment)  # two hyphens would end a comment of XML
    body = (
        '    <body name="{0}">\n      <inertial pos="0 0 0" mass="1" diaginertia="{1:.9g} {1:.9g}'
        ' {1:.9g}"/>\n      <joint name="{2}" type="hinge" axis="0 1 0" damping="{3:.9g}"{4}/>\n   '
        " </body>\n"
    )
    friction = f' frictionloss="{p.f_C:.9g}" solreffriction="0.001 1"'
    return (
        f'<mujoco model="identified by osl-analysis">\n  <!--\n{said}\n  -->\n  <option'
        f' timestep="{STEP_S:g}" integrator="implicitfast" gravity="0 0 0"/>\n  <worldbody>\n'
        + body.format("actuator", p.J_m, "theta_m", p.B_m, friction)
        + body.format("foot", p.J_j, "theta_j", p.B_j, "")
        + f'  </worldbody>\n  <tendon>\n    <fixed name="belt" stiffness="{p.K_s:.9g}"'
        ' springlength="0">\n      <joint joint="theta_j" coef="1"/>\n      <joint'
        f' joint="theta_m" coef="{-1 / p.n_T:.12g}"/>\n    </fixed>\n  </tendon>\n  <actuator>\n '
        f'   <motor name="current" joint="theta_m" gear="{p.k_tau * p.n_m:.9g}"/>\n '
        " </actuator>\n</mujoco>\n"
    )


def mujoco_torque(
    rate_hz: float,
    theta: Array,
    omega: Array,
    alpha: Array,
    law: Controller,
    p: DrivetrainParameters,
) -> Array:
    """Resisting torque [N*m] of the leg `p` in MuJoCo, (n,), whose joint is turned and whose
    actuator is under a controller without delay: theta [rad], omega [rad/s] and alpha [rad/s^2],
    (n,) each, at `rate_hz`. The actuator starts at rest, in equilibrium with the first angle. All
    NaN where it runs away. Raises InputError: no MuJoCo."""
    mujoco = optional_module("mujoco", "the round trip")
    every, gains = math.ceil(1 / (rate_hz * STEP_S) - 1e-6), law.gains  # steps per sample
    model = mujoco.MjModel.from_xml_string(mjcf_text(p))
    model.opt.timestep = 1 / (rate_hz * every)
    data, torque, sample = (
        mujoco.MjData(model),
        np.empty(len(theta)),
        np.arange(len(theta)) / rate_hz,
    )
    turned = scipy.interpolate.CubicHermiteSpline(sample, theta, omega)
    grid = np.arange((len(theta) - 1) * every + 1) * model.opt.timestep
    # views: slow to ask for
    angle, velocity, current, passive = data.qpos, data.qvel, data.ctrl, data.qfrc_passive
    friction = model.dof_frictionloss
    angle[0] = p.K_s / p.n_T * theta[0] / (gains.K_1 + p.K_s / p.n_T**2)
    constant, f_C, f_G = law.p.k_tau * law.p.n_m, law.p.f_C, law.p.f_G
    for k, (theta_j, omega_j) in enumerate(
        zip(turned(grid).tolist(), turned(grid, 1).tolist(), strict=True)
    ):
        angle[1], velocity[1] = theta_j, omega_j
        theta_m, omega_m = float(angle[0]), float(velocity[0])
        # of the output, 16 turns [rad]: beyond it the control loop is unstable
        if not abs(theta_m) < 100.0:
            return np.full(len(theta), np.nan)
        s = math.tanh(omega_m / law.sign_width) if gains.cancels_friction else 0.0
        r = -gains.K_1 * theta_m - gains.B_1 * omega_m + s * f_C
        current[0] = I_q = r / (constant - (s if r >= 0.0 else -s) * f_G)
        friction[0] = p.f_C + p.f_G * abs(I_q)
        mujoco.mj_step(model, data)
        if k % every == 0:
            torque[k // every] = -passive[1]  # belt and damping in the state before the step
    return torque + p.J_j * alpha
