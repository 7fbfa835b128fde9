"""The planned sample sheet and the settings that it comes from."""

import itertools
import os
from pathlib import Path

import pytest
import yaml

from osl_analysis.commands.simulate import simulate_campaign, simulate_trial, write_sheet
from osl_analysis.config.sheet import read_sheet
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.simulator.plan import plan_trials
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.yaml_settings import read_yaml

ROOT = Path(__file__).parents[1]
DEFAULT = ROOT / "config" / "simulation" / "default.yaml"
TINY = ROOT / "tests" / "tiny_simulation.yaml"


def settings_with(tmp_path, place, value):
    """The tiny settings with a value set at a dotted place, as a file."""
    content = inner = yaml.safe_load(TINY.read_text())
    *parents, last = place.split(".")
    for parent in parents:
        inner = inner[parent]
    inner[last] = value
    path = tmp_path / "settings.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_the_default_campaign_is_the_papers_with_about_half_of_its_crossings_perturbed():
    plan = plan_trials(read_yaml(DEFAULT, SimulationSettings))
    names = [f"belt_{i:02d}" for i in range(1, 11)] + [f"transmission_{i}" for i in range(1, 6)]
    names += [f"actuator_{i}" for i in range(1, 4)]
    pairs = itertools.product(CONTROLLERS, (100, 200, 300, 400), ("0.0", "2.5", "5.0", "7.5"))
    names += [f"impedance_K{K_d}_B{B_d}_{controller}" for controller, K_d, B_d in pairs]
    names += ["static_1", *(f"plate_{i:02d}" for i in range(1, 7)), *(f"walking_{i:02d}" for i in range(1, 61))]
    assert list(plan) == names
    row, log = plan["impedance_K400_B2.5_uncompensated"], "dynamometer/impedance_K400_B2.5_uncompensated.mcap"
    assert [row[name] for name in ("K_d", "B_d", "controller", "log")] == [400, 2.5, "uncompensated", log]
    assert plan["static_1"]["mocap"] == "vicon/static_1.c3d"
    files = ["leg/walking_60.mcap", "leg", "vicon/walking_60.c3d", "vicon"]
    assert [plan["walking_60"][name] for name in ("log", "log_source", "mocap", "mocap_source")] == files
    assert 20 <= sum(plan[f"walking_{i:02d}"]["perturbed"] for i in range(1, 61)) <= 40  # 30 +- 2.6 SD of a fair coin


def test_the_written_sheet_is_the_plan_and_a_crossing_s_perturbation_does_not_depend_on_their_number(tmp_path):
    settings = read_yaml(DEFAULT, SimulationSettings)
    write_sheet(DEFAULT, tmp_path / "trials.csv")
    plan = plan_trials(settings)
    assert read_sheet(tmp_path / "trials.csv") == plan
    fewer = settings.model_copy(update={"experiments": settings.experiments.model_copy(update={"walking": 9})})
    few, many = ([row["perturbed"] for name, row in one.items() if name.startswith("walking")]
                 for one in (plan_trials(fewer), plan))  # fmt: skip
    assert few == many[:9]


@pytest.mark.parametrize(
    ("place", "value", "match"),
    [
        ("effects.load_cell_noise.unit", "mN*m", r"effects.load_cell_noise.*unit must be 'N\*m'"),
        ("effects.control_delay.size", 1.5, "effects.control_delay.*whole number"),
        ("effects.fricton", {}, "unknown field 'effects.fricton'"),
        ("drivetrain.control_updates", 3, "drivetrain.*control_updates must divide substeps"),
        ("experiments.controllers", ["ideal"], "experiments.controllers.0: 'ideal'"),
        ("experiments.walking", 3, "'walking' names no settings file"),
        ("dynamometer.rate_hz", 1, r"dynamometer\.rate_hz = 1 Hz takes 0\.2 samples of a cycle at 5 Hz; take 50 Hz"),
        ("protocol.amplitudes_deg", [4, 200], r"protocol\.amplitudes_deg\.1: 200 .* less than or equal to 180"),
        ("experiments.belt", 1_000_000_000, r"experiments\.belt: 1000000000 .* less than or equal to 100000"),
        ("belt.rest_s", 1e9, r"line \d+: belt: 2e\+09 s at 1000 Hz are 2e\+12 samples; shorten it to 1e\+07 samples"),
        ("effects.velocity_filter.size", 2500, r"velocity_filter of 2500 Hz does nothing .* less than 2500 Hz"),
        (
            "experiments",
            {"belt": 0, "transmission": 0, "K_d": [], "B_d": [], "controllers": []},
            "ask for at least one",
        ),
        ("effects.control_delay.size", 300, r"control_delay of 300 updates is 60 ms.* choose 150 updates \(30 ms\)"),
    ],
)
def test_a_wrong_setting_is_named_with_its_place(tmp_path, place, value, match):
    path = settings_with(tmp_path, place, value)
    with pytest.raises(InputError, match=match) as refused:
        read_yaml(path, SimulationSettings)
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value)


def test_an_unstable_loop_or_a_missing_file_is_refused_and_nothing_is_written(tmp_path, monkeypatch):
    """20 ms of delay: an actuator that turned by 1e18 rad was logged."""
    monkeypatch.chdir(ROOT)
    path = settings_with(tmp_path, "effects.control_delay.size", 100)
    with pytest.raises(InputError, match=r"runs away, beyond 100 rad.* lower effects\.control_delay"):
        simulate_trial(path, tmp_path / "raw", "impedance_K300_B5.0_compensated")
    assert not (tmp_path / "raw").exists()
    missing = settings_with(tmp_path, "walking", "none.yaml")  # of the gait laboratory, for a trial of the bench
    with pytest.raises(InputError, match=r"walking: none\.yaml is no file; correct it, or write null"):
        simulate_trial(missing, tmp_path / "raw", "belt_01")


@pytest.mark.parametrize("written", ["dynamometer/belt_01.mcap", "trials.csv"])
def test_the_simulator_writes_to_no_file_that_it_reads_and_to_no_device(tmp_path, monkeypatch, written):
    monkeypatch.chdir(ROOT)
    path, raw = settings_with(tmp_path, "seed", 3), tmp_path / "raw"
    (raw / "truth").mkdir(parents=True)
    (raw / written).parent.mkdir(exist_ok=True)
    (raw / written).hardlink_to(path)
    before = path.read_text()
    with pytest.raises(InputError, match=f"{written} would be overwritten while it is used; simulate into another"):
        simulate_campaign(path, raw)
    assert path.read_text() == before
    (raw / written).unlink()
    os.mkfifo(raw / written)
    with pytest.raises(InputError, match=f"{written}: is a named pipe"):
        simulate_campaign(path, raw)
