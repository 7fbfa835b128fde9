# SPDX-License-Identifier: Apache-2.0
"""`mujoco.sysid`: torque as control, angle as a sensor that may be late; K, B, I, friction and the
rest angle of a hinge are fitted. A gain cannot be told from them.

https://mujoco.readthedocs.io/en/latest/sysid.html ("Measurement parameters", "Identifiability",
`calculate_intervals`; iterations and optimizer as preset). A load cell's offset is a rest angle: as
the sensor's bias it would begin the simulation with a leap. Friction is as stiff as the solver
allows, two steps (https://mujoco.readthedocs.io/en/latest/modeling.html#solver-parameters); preset
is 20 ms, which acts as a delay. At this step the integrator takes less than 0.1 % off K and 6 % off
I.
"""

import mujoco
import numpy as np
from mujoco import sysid

PACKAGES = ("mujoco",)
HINGE = """<mujoco><option timestep="{step}" integrator="implicitfast">
<flag gravity="disable" contact="disable"/></option><worldbody><body>
<geom size="0.001" mass="1e-6"/>
<joint name="joint" axis="0 1 0" solreffriction="{hardest} 1"/></body></worldbody><sensor>
<jointpos name="angle" joint="joint"/></sensor>
<actuator><motor name="torque" joint="joint"/></actuator></mujoco>"""
STEPS_PER_SAMPLE = 4
OF_JOINT = {
    "stiffness": (100.0, 1.0, 2000.0),
    "damping": (2.0, 0.01, 100.0),
    "armature": (0.02, 5e-4, 0.5),
    "frictionloss": (0.1, 0.0, 5.0),
    "springref": (0.0, -10.0, 10.0),  # deg
}
DELAY = (0.0, -0.02, 0.02)  # s
TOLD_DELAY, TOLD_FRICTION = 1.0, 0.1  # ms and N*m


def set_field(spec, parameter):
    joint, name = spec.joint("joint"), parameter.name
    rest = np.zeros(np.size(getattr(joint, name)) - 1)
    setattr(joint, name, np.r_[parameter.value, rest].squeeze())


def estimate(t, theta, torque, rate_hz=500.0, **known):
    step = 1 / (STEPS_PER_SAMPLE * rate_hz)
    parameters, transform = sysid.ParameterDict(), sysid.SignalTransform()
    for name, ends in OF_JOINT.items():
        parameters.add(sysid.Parameter(name, *ends, modifier=set_field))
    parameters.add(sysid.Parameter("delay", *DELAY))
    parameters["stiffness"].value[:] = np.std(torque) / np.std(theta)
    transform.delay("angle", parameters["delay"])

    spec = mujoco.MjSpec.from_string(HINGE.format(step=step, hardest=2 * step))
    model, even = spec.compile(), np.arange(t[0], t[-1], step)
    control = sysid.TimeSeries.from_control_names(
        even - t[0], np.interp(even, t, torque)[:, None], model
    )
    measured = sysid.TimeSeries.from_names(t - t[0], theta[:, None], model)
    start = sysid.create_initial_state(model, theta[:1], np.zeros(1))
    sequences = sysid.ModelSequences("joint", spec, "recording", start, control, measured)
    residual = sysid.build_residual_fn(
        models_sequences=[sequences], modify_residual=transform.apply
    )
    _, fit = sysid.optimize(parameters, residual, verbose=False, x_scale="jac")
    halves = sysid.calculate_intervals(residual(fit.x, parameters)[0], fit.jac)[1]

    K, B, I, friction, _, delay = fit.x
    intervals = {
        name: (x - half, x + half) for name, x, half in zip("KBI", fit.x, halves, strict=False)
    }
    late = -1e3 * (delay + step)  # ms; the control is held for a step
    doubts = [f"torque late by {late:.2f} ms, corrected"] if abs(late) > TOLD_DELAY else []
    if friction > TOLD_FRICTION:
        doubts.append(f"friction of {friction:.2g} N*m, corrected")
    return K, B, I, intervals, doubts
