"""The simulated passive foot: its loops are those of its springs, and the analysis finds them in what is recorded."""

import numpy as np
import polars as pl
import pytest
from conftest import ROOT

from osl_analysis.bench.torque_angle import torque_angle_trial
from osl_analysis.bench.torque_angle_tables import cycle_table, torque_angle_table
from osl_analysis.config import read_config
from osl_analysis.parameters import read_parameters
from osl_analysis.simulator.bench import simulate_dynamometer_trial
from osl_analysis.simulator.drivetrain import slipping_torque
from osl_analysis.simulator.joint_motion import slow_cycles
from osl_analysis.simulator.plan import plan_trials
from osl_analysis.simulator.settings import PassiveFoot, SimulationSettings, SlippingSpring, SlowCycles
from osl_analysis.trial import Trial
from osl_analysis.yaml_settings import read_yaml

SETTINGS = read_yaml(ROOT / "config/simulation/torque_angle.yaml", SimulationSettings)
CYCLES = {"lowest_deg": -10, "highest_deg": 10, "speed_deg_s": [4, 8], "turn_s": 0.2, "rest_s": 1}


def test_a_slipping_spring_is_that_of_its_increments():
    theta = np.random.default_rng(1).standard_normal(300).cumsum() / 50
    spring, torque = SlippingSpring(stiffness=300, limit=20), np.zeros(300)
    for k in range(1, 300):
        torque[k] = np.clip(torque[k - 1] + 300 * (theta[k] - theta[k - 1]), -20, 20)
    np.testing.assert_allclose(slipping_torque(theta, spring), torque, atol=1e-9)
    assert np.abs(torque).max() == 20


def test_the_motion_goes_to_both_ends_at_each_speed_and_comes_back_to_rest():
    cycles = SlowCycles.model_validate(CYCLES)
    motion = slow_cycles(cycles, 500)
    degrees, speed = np.rad2deg(motion.theta), np.rad2deg(np.abs(motion.omega))
    assert motion.theta.size / 500 == pytest.approx(cycles.total_s) == pytest.approx(2 + 40 / 4 + 40 / 8)
    assert (degrees.min(), degrees.max()) == pytest.approx((-10, 10), abs=0.25)  # a tenth of a second at 4 deg/s
    assert degrees[-400:] == pytest.approx(0, abs=1e-9)
    assert {4, 8} <= set(speed.round(9))
    np.testing.assert_allclose(np.diff(motion.theta), (motion.omega[1:] + motion.omega[:-1]) / 1000, atol=1e-12)


def test_a_spring_that_never_slips_is_refused():
    with pytest.raises(ValueError, match="does not reach its limit of 90 N"):
        PassiveFoot.model_validate({"K": 100, "slipping": [{"stiffness": 500, "limit": 90}], "cycles": CYCLES})


def test_torque_angle_trials_without_a_foot_are_refused():
    with pytest.raises(ValueError, match="3 torque-angle trials are planned but there is no 'foot'"):
        SimulationSettings.model_validate(SETTINGS.model_dump() | {"foot": None})


def test_the_analysis_finds_the_springs_of_the_foot_and_what_each_cycle_loses():
    row = plan_trials(SETTINGS).to_dict("records")[0]
    log, truth = simulate_dynamometer_trial(row, SETTINGS, read_parameters(SETTINGS.parameters))
    columns = {"time": log.time - log.time[0], "theta": log["joint_angle"], "torque": -log["load_cell_torque"]}
    campaign = read_config(ROOT / "config/campaigns/torque_angle/config.yaml")
    found = torque_angle_trial(Trial("foot", pl.DataFrame(columns)), campaign.torque_angle)
    cycles, foot = cycle_table(found), SETTINGS.foot
    assert foot is not None
    assert truth["foot"] == foot.model_dump()
    assert cycles["speed_deg_s"].to_list() == pytest.approx([3, 4, 5], rel=0.03)  # the turns are slower
    for cycle, lost in zip(found.cycles.used, cycles["energy_lost"], strict=True):
        half = np.ptp(found.theta[cycle.rows]) / 2
        assert lost == pytest.approx(sum(4 * s.limit * (half - s.limit / s.stiffness) for s in foot.slipping), rel=0.01)
    table = torque_angle_table(found).to_dicts()[0]
    assert table["K_lowest"] == pytest.approx(foot.K, rel=0.01)  # at rest, where both springs slip
    assert table["rate_change"] == pytest.approx(0, abs=0.05)
    assert abs(table["cycle_drift"]) < 0.005
