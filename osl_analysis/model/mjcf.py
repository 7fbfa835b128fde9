"""The identified leg as MJCF, MuJoCo's model format: Eqs. 1-4, what it cannot say of them, and the
torque in MuJoCo.

MuJoCo adds the current's torque, damping, inertia and Coulomb friction of the actuator, and the
belt as a tendon. The gear's friction f_G |I_q| is no element of MJCF: who simulates sets
`dof_frictionloss` before every step.
"""

import math
import re

import numpy as np
import scipy

from osl_analysis.errors import optional_module
from osl_analysis.model.actuator_in_time import Controller
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.trial import Array

STEP_S = 2.5e-4  # largest time step [s] of the round trip
RUNS_AWAY = 100.0  # angle of the output, 16 turns [rad]: beyond it the control loop is unstable

# the model, and the controller, which has the numbers of the parameter file
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
# what MJCF, or MuJoCo's default, does not say of the leg, and what to do
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

MODEL = """\
<mujoco model="identified by osl-analysis">
  <!--
{comment}
  -->
  <option timestep="{step:g}" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
{actuator}{foot}  </worldbody>
  <tendon>
    <fixed name="belt" stiffness="{p.K_s:.9g}" springlength="0">
      <joint joint="theta_j" coef="1"/>
      <joint joint="theta_m" coef="{belt_of_actuator:.12g}"/>
    </fixed>
  </tendon>
  <actuator>
    <motor name="current" joint="theta_m" gear="{torque_constant:.9g}"/>
  </actuator>
</mujoco>
"""
BODY = """\
    <body name="{name}">
      <inertial pos="0 0 0" mass="1" diaginertia="{inertia:.9g} {inertia:.9g} {inertia:.9g}"/>
      <joint name="{joint}" type="hinge" axis="0 1 0" damping="{damping:.9g}"{friction}/>
    </body>
"""


def mjcf_text(p: DrivetrainParameters, comment: str = "") -> str:
    """Write the leg as MJCF.

    Parameters
    ----------
    p : DrivetrainParameters
    comment : str
        Lines for the reader.

    Returns
    -------
    str
        Joints theta_m and theta_j [rad], ctrl the current I_q [A].
    """
    actuator = BODY.format(
        name="actuator",
        inertia=p.J_m,
        joint="theta_m",
        damping=p.B_m,
        friction=f' frictionloss="{p.f_C:.9g}" solreffriction="0.001 1"',
    )
    foot = BODY.format(name="foot", inertia=p.J_j, joint="theta_j", damping=p.B_j, friction="")
    return MODEL.format(
        comment=re.sub(r"-(?=-)", "- ", comment),  # two hyphens would end a comment of XML
        step=STEP_S,
        actuator=actuator,
        foot=foot,
        p=p,
        belt_of_actuator=-1 / p.n_T,
        torque_constant=p.k_tau * p.n_m,
    )


def mujoco_torque(
    rate_hz: float,
    theta: Array,
    omega: Array,
    alpha: Array,
    law: Controller,
    p: DrivetrainParameters,
) -> Array:
    """Simulate the leg `p` in MuJoCo, whose joint is turned, under a controller without delay.

    Parameters
    ----------
    rate_hz : float
        Sampling rate [Hz].
    theta, omega, alpha : Array
        Motion of the joint, (n,) each [rad, rad/s, rad/s^2].
    law : Controller
    p : DrivetrainParameters

    Returns
    -------
    Array
        Resisting torque (n,) [N*m]. The actuator starts at rest, in equilibrium with the first
        angle. All NaN where it runs away.

    Raises
    ------
    InputError
        MuJoCo is not installed.
    """
    mujoco = optional_module("mujoco", "the round trip")
    steps_per_sample = math.ceil(1 / (rate_hz * STEP_S) - 1e-6)
    model = mujoco.MjModel.from_xml_string(mjcf_text(p))
    model.opt.timestep = 1 / (rate_hz * steps_per_sample)
    data = mujoco.MjData(model)

    sample_time = np.arange(len(theta)) / rate_hz
    joint = scipy.interpolate.CubicHermiteSpline(sample_time, theta, omega)
    grid = np.arange((len(theta) - 1) * steps_per_sample + 1) * model.opt.timestep
    joint_angles = joint(grid).tolist()
    joint_velocities = joint(grid, 1).tolist()

    # views: slow to ask for
    angle = data.qpos
    velocity = data.qvel
    current = data.ctrl
    passive = data.qfrc_passive
    friction = model.dof_frictionloss

    gains = law.gains
    constant = law.p.k_tau * law.p.n_m
    f_C = law.p.f_C
    f_G = law.p.f_G
    torque = np.empty(len(theta))
    angle[0] = p.K_s / p.n_T * theta[0] / (gains.K_1 + p.K_s / p.n_T**2)
    for k, (theta_j, omega_j) in enumerate(zip(joint_angles, joint_velocities, strict=True)):
        angle[1] = theta_j
        velocity[1] = omega_j
        theta_m = float(angle[0])
        omega_m = float(velocity[0])
        if not abs(theta_m) < RUNS_AWAY:
            return np.full(len(theta), np.nan)
        s = math.tanh(omega_m / law.sign_width) if gains.cancels_friction else 0.0
        r = -gains.K_1 * theta_m - gains.B_1 * omega_m + s * f_C
        I_q = r / (constant - (s if r >= 0.0 else -s) * f_G)
        current[0] = I_q
        friction[0] = p.f_C + p.f_G * abs(I_q)
        mujoco.mj_step(model, data)
        if k % steps_per_sample == 0:
            # belt and damping in the state before the step
            torque[k // steps_per_sample] = -passive[1]
    return torque + p.J_j * alpha
