"""The simulator follows the configuration in what both use: device, gains, protocol, desired impedance."""

import json
from pathlib import Path

import pytest
import yaml
from conftest import ROOT

from osl_analysis.commands.simulate import laboratory_of, read_simulation, settings_files, simulate_trial
from osl_analysis.config.configuration import read_config
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.parameters import read_parameters
from osl_analysis.config.shared_choices import FOLLOWED, SharedChoices
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import select_gains
from osl_analysis.model.gain_selection import Weight
from osl_analysis.simulator.crossing import compensated_damping

TINY = Path("tests/tiny_simulation.yaml")
TRIAL = "impedance_K300_B5.0_compensated"
OTHER = "config/parameters/osl-v2-published.yaml"


@pytest.fixture(autouse=True)
def in_root(monkeypatch):
    monkeypatch.chdir(ROOT)


def configured(tmp_path, **changes):
    """What the simulator follows, from the default configuration with changes."""
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(changes))
    return read_config(tmp_path / "config.yaml")


def test_the_simulated_leg_has_the_gains_that_the_configuration_says(tmp_path):
    """The truth beside the log, against the gains of Eq. 14 for the other weight and the other device."""
    protocol = {"amplitudes_deg": [3], "frequencies_hz": [4], "cycles": 2, "settle_cycles": 1}
    changes = {"gain_weight": {"cutoff_hz": 4, "order": 2}, "parameters": OTHER, "dynamometer": protocol}
    followed = configured(tmp_path, **changes).shared("impedance")
    simulate_trial(TINY, tmp_path / "raw", TRIAL, followed)
    truth = json.loads((tmp_path / f"raw/truth/{TRIAL}.json").read_text())
    expected = select_gains("compensated", 300, 5, read_parameters(Path(OTHER)), Weight(4, 2))
    assert truth["gains"]["B_1"] == pytest.approx(expected.B_1)
    assert truth["gains"]["K_1"] == pytest.approx(expected.K_1)
    usual = select_gains("compensated", 300, 5, read_parameters(ROOT / "config/parameters/default.yaml"))
    assert abs(expected.B_1 / usual.B_1 - 1) > 0.01


def test_the_simulated_protocol_and_walk_are_those_of_the_configuration(tmp_path):
    other = tmp_path / "other.csv"
    other.write_text((ROOT / "config/impedance/synthetic_rising.csv").read_text())
    protocol = {"amplitudes_deg": [3, 1], "frequencies_hz": [4, 2.5], "cycles": 7, "seconds_per_frequency": 2}
    changes = {"dynamometer": protocol, "gain_weight": {"cutoff_hz": 3, "order": 1}, "impedance_trajectory": str(other)}
    followed = configured(tmp_path, **changes).shared()
    settings = read_simulation(Path("config/simulation/default.yaml"), followed)
    stepped = settings.protocol
    assert (stepped.amplitudes_deg, stepped.frequencies_hz, stepped.cycles) == ((3, 1), (4, 2.5), None)
    assert (stepped.seconds, stepped.lead_s) == (2, 1)
    walking = laboratory_of(settings, followed)
    assert walking.impedance == other
    assert walking.gain_weight.weight == Weight(3, 1)
    assert other in settings_files(Path("config/simulation/default.yaml"), followed)
    p, path = read_parameters(ROOT / "config/parameters/default.yaml"), Path("config/impedance/synthetic_walking.csv")
    paper, other = (compensated_damping(path, p, Weight(f, 3))[1] for f in (1.0, 4.0))
    assert abs(other / paper - 1).max() > 0.01


def test_each_experiment_follows_what_it_uses_and_no_more(tmp_path):
    """A belt has no controller: another weight does not simulate it anew."""
    one, other = (configured(tmp_path, gain_weight={"cutoff_hz": f, "order": 3}) for f in (1, 2))
    same = [name for name in EXPERIMENTS if one.shared(name) == other.shared(name)]
    assert {"impedance", "walking"} == EXPERIMENTS.keys() - same
    assert FOLLOWED.keys() <= EXPERIMENTS.keys()
    assert one.shared("static") == SharedChoices()


def test_a_protocol_that_the_simulated_log_cannot_hold_is_refused(tmp_path):
    followed = configured(tmp_path, dynamometer={"frequencies_hz": [1, 200], "cycles": 20}).shared()
    with pytest.raises(InputError, match=r"tiny_simulation.yaml: .*dynamometer.rate_hz = 1000 Hz takes 5 samples"):
        read_simulation(TINY, followed)
    alone = read_simulation(TINY, SharedChoices())  # without a configuration the settings decide
    assert (alone.protocol.frequencies_hz, alone.gain_weight.weight) == ((2, 5), Weight(1, 3))
