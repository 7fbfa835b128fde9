# SPDX-License-Identifier: Apache-2.0
"""Write the identified leg for MuJoCo (MJCF): python leg_to_mujoco.py RESULTS PARAMETERS > leg.xml

Joint, motor and the belt between them have the means over the component trials, in SI units. The
control of the motor is its current [A]. Angles are positive in dorsiflexion. MJCF cannot express
f_G, the friction that grows with the current: `motor_friction` of osl_analysis.model has it.
"""

import csv
import sys
from pathlib import Path
from xml.etree import ElementTree

from osl_analysis.model.drivetrain import read_parameters

MODEL = """
<mujoco model="leg">
  <compiler angle="radian"/>
  <option timestep="0.0001" integrator="implicitfast"/>
  <worldbody>
    <body name="foot">
      <joint name="ankle" axis="0 1 0" damping="{B_j}"/>
      <inertial pos="0 0 0" mass="0.001" diaginertia="{J_j} {J_j} {J_j}"/>
    </body>
    <body name="motor" pos="0 0.1 0">
      <joint name="motor" axis="0 1 0" damping="{B_m}" frictionloss="{f_C}"/>
      <inertial pos="0 0 0" mass="0.001" diaginertia="{J_m} {J_m} {J_m}"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="belt" stiffness="{K_s}" springlength="0">
      <joint joint="ankle" coef="1"/>
      <joint joint="motor" coef="{minus_ratio}"/>
    </fixed>
  </tendon>
  <actuator>
    <motor name="current" joint="motor" gear="{k_tau_n_m}"/>
  </actuator>
</mujoco>"""


def component_means(results: Path) -> dict[str, float]:
    """Mean of each component over its trials, by symbol."""
    means = {}
    for name in ("belt", "transmission", "actuator"):
        with (results / f"tables/{name}_summary.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        if len({row["joint"] for row in rows}) > 1:
            sys.exit(f"{file.name}: has several joints; keep the rows of one")
        means.update({row["quantity"]: float(row["mean"]) for row in rows if row["mean"]})
    return means


if __name__ == "__main__":
    results, parameters = map(Path, sys.argv[1:])
    means = component_means(results)
    model = MODEL.strip().format(**means, minus_ratio=-1 / read_parameters(parameters).n_T)
    ElementTree.fromstring(model)  # it is valid XML
    print(model)
