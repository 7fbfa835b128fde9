"""`mujoco.sysid`: torque as control, angle as sensor with delay and bias, K, B and I of a hinge; a
gain cannot be told.

https://mujoco.readthedocs.io/en/latest/sysid.html ("Measurement parameters", "Identifiability",
`calculate_intervals`).
"""

import mujoco
import numpy as np
from mujoco import sysid

HINGE = """<mujoco><option timestep="{step}" integrator="RK4">
<flag gravity="disable" contact="disable"/></option><worldbody><body>
<geom size="0.001" mass="1e-6"/><joint name="joint" axis="0 1 0"/></body></worldbody><sensor>
<jointpos name="angle" joint="joint"/></sensor>
<actuator><motor name="torque" joint="joint"/></actuator></mujoco>"""
OF_JOINT = {
    "stiffness": (100.0, 1.0, 2000.0),
    "damping": (2.0, 0.01, 12.0),
    "armature": (0.02, 5e-3, 0.2),
}
OF_SENSOR = {"delay": (0.0, -0.02, 0.02), "bias": (0.0, -0.1, 0.1)}  # s, rad


def set_field(spec, parameter):
    joint, name = spec.joint("joint"), parameter.name
    setattr(
        joint, name, np.r_[parameter.value, np.zeros(np.size(getattr(joint, name)) - 1)].squeeze()
    )


def estimate(t, theta, torque, rate_hz=500.0, **known):
    step, p, transform = 0.5 / rate_hz, sysid.ParameterDict(), sysid.SignalTransform()
    for name, ends in (OF_JOINT | OF_SENSOR).items():
        p.add(sysid.Parameter(name, *ends, modifier=set_field if name in OF_JOINT else None))
    p["stiffness"].value[:] = np.std(torque) / np.std(theta)
    transform.delay("angle", p["delay"])
    transform.bias("angle", p["bias"], target="predicted")
    spec, even = mujoco.MjSpec.from_string(HINGE.format(step=step)), np.arange(t[0], t[-1], step)
    model = spec.compile()
    control = sysid.TimeSeries.from_control_names(
        even - t[0], np.interp(even, t, torque)[:, None], model
    )
    measured = sysid.TimeSeries.from_names(t - t[0], theta[:, None], model)
    start = sysid.create_initial_state(model, theta[:1], np.zeros(1))
    sequences = sysid.ModelSequences("joint", spec, "recording", start, control, measured)
    residual = sysid.build_residual_fn(
        models_sequences=[sequences], modify_residual=transform.apply
    )
    _, fit = sysid.optimize(p, residual, verbose=False, x_scale="jac", max_iters=6)
    half = sysid.calculate_intervals(residual(fit.x, p)[0], fit.jac)[1]
    # [ms]; the control is held, and the angle is that at a step's end
    late = -1e3 * (fit.x[3] + 1.5 * step)
    intervals = {name: (fit.x[k] - half[k], fit.x[k] + half[k]) for k, name in enumerate("KBI")}
    return (
        *fit.x[:3],
        intervals,
        [f"torque late by {late:.2f} ms, corrected"] if abs(late) > 1 else [],
    )
