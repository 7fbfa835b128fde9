# SPDX-License-Identifier: Apache-2.0
"""The configuration: what is wrong in it is one line, and the simulator follows it."""

import json
import re
import shlex
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal
from unittest.mock import Mock

import numpy as np
import pytest
import yaml
from c3d_builder import write_c3d
from conftest import ROOT, refused_with
from pydantic import Field, ValidationError
from shipped import SETTINGS as SHIPPED

from osl_analysis import formats
from osl_analysis.base.yaml_settings import Settings, read_mapping, read_yaml, validated
from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import (
    campaign_config,
    config_for_trials,
    overriding,
    read_campaign_file,
    read_config,
)
from osl_analysis.commands.run import check_start, source_problems
from osl_analysis.commands.simulate import (
    laboratory_of,
    read_simulation,
    settings_files,
    simulate_planned_trial,
)
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.sheet import read_sheet
from osl_analysis.ingest.raw_files import read_source
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.judge.recording_checks import QualityRules
from osl_analysis.model.compensator import Weight, select_gains
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.simulator.laboratory_settings import WalkingSettings
from osl_analysis.simulator.simulation_settings import SimulationSettings
from osl_analysis.simulator.trial_plan import plan_trials

SHIPPED_FILE = ROOT / "config/config.yaml"
Cycles = Annotated[int, Field(ge=1, le=100)]


class Inner(Settings):
    """Of every kind of field with numbers, and others."""

    rate: float = 1.0
    name: str = ""
    sign: Literal[1, -1] = 1
    cycles: Cycles | tuple[Cycles, ...] = 1
    vector: tuple[float, float] = (0, 0)
    limits: dict[str, float | None] = Field(default_factory=dict)
    either: bool | float = 0.0
    plates: Literal["all"] | tuple[int, ...] = "all"


class Outer(Settings):
    """A file with a section of it."""

    first: int
    inner: Inner = Inner()
    several: tuple[Inner, ...] = ()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "inner: {rate: a}\nseveral: [{nam: a}]",
            "line 3: several.0.nam: .*rate, name, sign, cycles, vector, limits, either, plates"
            ".*'name'",
        ),
        ("inner:\n  rate: off", "line 3: inner.rate: 'off' .*number"),
        # pydantic makes numbers of truth values
        ("inner:\n  rate: true", "line 3: inner.rate: 'true' .*number"),
        ("inner:\n  limits:\n    K: 1\n    B: true", "line 5: inner.limits.B: 'true' .*number"),
        ("inner: {cycles: [1, 200]}", "line 2: inner.cycles.1: 200 .* 100$"),
        ("inner: 7", "line 2: inner: 7 .*`name: value`"),
        ("inner: {rate: 3 %, name: 1, sign: 3}", "line 2: inner.rate: '3 %' .*0.03"),
        ("a: 1\nb:\n- {b: 2, b: 3}\n", "line 4: .*YAML.*key"),
        ("inner: {rate: 1e999}", "line 2: inner.rate: inf .*finite"),
        ("a: " + "[" * 2000 + "]" * 2000, ".*YAML"),
        ("inner: {rate: 0x" + "f" * 5000 + "}", ".*YAML with a number"),
        ('"\\e31mkey": 3', r"line 2: \\x1b31mkey: "),
    ],
)
def test_what_is_wrong_in_a_file_is_told_by_line_field_value_and_remedy(tmp_path, text, said):
    (tmp_path / "a.yaml").write_bytes(f"first: 1\n{text}".encode("latin-1"))
    with refused_with(f"^{tmp_path}/a.yaml: {said}"):
        read_yaml(tmp_path / "a.yaml", Outer)


NINE = range(1, 10)
ALIASES = "a0: &a0 [x]\n" + "".join(f"a{n}: &a{n} [{f'*a{n - 1}, ' * 9}]\n" for n in NINE)


@pytest.mark.parametrize(
    "text",
    [
        ALIASES,
        "a: &a [*a]",
        f"a: [{'1,' * 200_000}]",
    ],
)
def test_yaml_of_more_values_than_any_file_has_is_refused_within_a_second(tmp_path, text):
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text(text)
    start_s = time.process_time()

    with refused_with(r"metadata\.yaml: YAML of more than 100000 values, with those that aliases"):
        read_mapping(bag / "metadata.yaml")
    with refused_with(r"metadata\.yaml: YAML of more than 100000 values"):
        formats.read(bag)

    assert time.process_time() - start_s < 2


def test_a_file_without_fields_or_that_cannot_be_read_is_one_line(tmp_path, monkeypatch):
    (path := tmp_path / "a.yaml").touch()
    with refused_with(r"a\.yaml: .*`name: value`"):
        read_yaml(path, Outer)
    denied = PermissionError(13, "Permission denied")
    for name, read in (("read_text", read_mapping), ("read_bytes", read_sheet)):
        monkeypatch.setattr(Path, name, Mock(side_effect=denied))
        with refused_with(r"a\.yaml:.*Permission denied"):
            read(path)


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        ("walking.window_s", 0.21, "window_s.*= 0.31.*shortest_stance_s = 0.3,"),
        ("walking.load_of_weight", [1.25, 0.7], "load_of_weight: 0.7.*1.25"),
        ("walking.markers.foot", ["A", "B", "A"], "foot: 'A'"),
        ("walking.plate", 99, "walking.plate.* 1"),
        ("walking.plate", "2nd", "plate: '2nd' .*: write a number without a unit"),
        ("walking.markers.foot", ["A", "B", "PLAT1"], "markers: 'PLAT1'"),
        ("dynamometer.cutoff_hz", 5, "cutoff_hz = 5.*frequencies_hz"),
        ("dynamometer.windows", "2-30 20-40", "windows: '2-30 20-40' .*2-30 40-62"),
        ("doubtful.belt.above", {"stiffenning": 1}, "stiffenning.*'stiffening'"),
        ("quality.gup", "1 s", "gup.*'gap'"),
        # in ms, mm, deg, percent, N*mm
        ("dynamometer.time_base.longest_gap_s", 500, "longest_gap_s: 500 .*10$"),
        (
            "torque_angle.desired",
            {"a": {"angle_deg": [0, 1e4], "torque": [0, 1]}},
            "angle_deg.1:.*180$",
        ),
        ("torque_angle.desired", {"a": {"torque": [0, 1]}}, r"a\.angle_deg: is missing; add it"),
        # of two settings
        ("torque_angle.cutoff_hz", 0.5, "cutoff_hz = 0.5.*shortest_cycle_s = 2"),
        ("data", "measured", "data: data = mea"),
        ("walking.fewest_unperturbed", 900, "900.*unperturbed.*.walking.fewest_unperturbed"),
        ("dynamometer.compare_estimators", True, "dynamometer.compare_estimators: .*changelog"),
        ("dynamometer.cutoff_hz", 0, "cutoff_hz: 0.*0"),
        ("dynamometer.settle_cycles", 19, "19.*= 20"),
        ("campaign", "a b", "campaign: 'a b' "),
        # of files and folders
        ("results", "README.md/below", "README.md: .*`results`"),
        ("results", "raw_data", "results = raw_data "),
        ("impedance_trajectory", "README.md", "^impedance_trajectory: README.md: "),
        ("parameters", "Makefile", "^parameters: Makefile:"),
        ("sources", "source", "^source: .*`s"),
    ],
)
def test_settings_that_contradict_each_other_are_a_line_with_the_remedy(
    in_root, place, value, said
):
    override = value
    for key in reversed(place.split(".")):
        override = {key: override}
    with refused_with(said):
        started(overriding(SHIPPED, override))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"perturbation": {"stance_phase": [0.87, 0.88]}}, "rise_s: "),
        ({"rates": {"controller_hz": 1001}}, "controller_hz:.*1501500;"),
        ({"plate": {"size_m": [600, 500]}}, "size_m.0: 600"),
        ({"rates": {"analogs_hz": 1000}}, r"analogs_hz.*points_hz \(300\)"),
        ({"gait": {"recording_s": 1.5}}, "stance_s =.*recording_s = 1.5"),
    ],
)
def test_a_simulated_laboratory_that_cannot_be_is_a_line_with_the_remedy(
    in_root, tmp_path, change, said
):
    simulation, gait = (
        read_mapping(ROOT / f"config/simulation/{name}.yaml") for name in ("default", "walking")
    )
    (tmp_path / "gait.yaml").write_text(yaml.safe_dump(overriding(gait, change)))
    (tmp_path / "own.yaml").write_text(
        yaml.safe_dump(simulation | {"walking": str(tmp_path / "gait.yaml")})
    )
    with refused_with(rf"gait\.yaml:.*{said}"):
        settings_files(tmp_path / "own.yaml")


CSV = {"format": "csv", "time": {"column": "t", "unit": "s"}, "clock": "master"}
CSV |= {"channels": {"theta": {"column": "a", "unit": "deg"}, "sync": {"column": "s", "unit": "V"}}}


def walkway(folder, log=None, mocap=None, part="", plate=2):
    """Nine crossings `w0` ... of a log and a capture, and a static trial `s`, with other fields of
    their source files. The first capture has no plate, the second has two, the third is none."""
    described = {
        "log": {**CSV, "clock": "sync", **(log or {})},
        "mocap": {"format": "c3d", "analogs": {"sync": {"channel": "Sync"}}} | (mocap or {}),
    }
    for name, content in (described | {"bench": CSV}).items():
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(content))
    write_c3d(folder / "a.c3d", np.ones((2, 1, 4)))
    write_c3d(folder / "b.c3d", np.ones((2, 1, 4)), FORCE_PLATFORM__USED=2)
    (folder / "c.c3d").write_bytes(b"no capture")
    rows = ["trial,experiment,perturbed,log,log_source,mocap,mocap_source,log_part"]
    for n in range(9):
        capture = f"{'abc'[n % 3]}.c3d"
        rows.append(f"w{n},walking,{str(n > 5).lower()},{n}.csv,log,{capture},mocap,{part}")
    rows.append("s,static,,,bench,a.c3d,mocap,")  # the source of a log, and no log
    (folder / "trials.csv").write_text("\n".join(rows))
    own = {"raw_data": str(folder), "sheet": str(folder / "trials.csv"), "sources": str(folder)}
    own |= {"simulation": None, "walking": {"plate": plate, "plate_inertia": "none"}}
    return open_campaign(campaign_config(overriding(SHIPPED, own), [SHIPPED_FILE]), None)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"log": {"clock": "master"}}, "log.yaml, line 8: 'master' "),
        # the capture has no sync line
        ({"mocap": {"analogs": {}}}, "line 8: 'sync'"),
        ({"part": "b"}, "csv: trial 'w0': log_part 'b': .*csv"),
    ],
)
def test_a_wrong_source_file_concerns_its_trials(in_root, tmp_path, changes, said):
    campaign = walkway(tmp_path, **changes)

    problems = source_problems(campaign)

    check_start(campaign)  # which leaves it to their jobs
    assert all(re.search(said, problems[f"w{n}"]) for n in range(9))
    assert "s" not in problems
    some = {trial: campaign.rows[trial] for trial in ("w0", "w3", "w6")}
    assert source_problems(replace(campaign, sheet=some)).keys() == some.keys()


def test_what_is_no_text_is_no_name(tmp_path):
    (tmp_path / "a.yaml").write_text("format: [csv]")
    with refused_with("format '' is not known"):
        read_source(tmp_path / "a.yaml")

    for exclude in ([["gap"]], {"gap": 1}, 5):
        with pytest.raises(ValidationError):
            QualityRules.model_validate({"exclude": exclude})


def test_a_limit_that_stands_in_the_program_is_none_of_the_configuration():
    """A number of any table may have a limit, but for those that have one already."""
    DoubtfulFits.model_validate({"actuator": {"above": {"f_C_ratio": 2}}})

    with pytest.raises(ValueError, match="takes no limit"):
        DoubtfulFits.model_validate({"belt": {"above": {"saturated_samples": 10}}})


def test_a_missing_folder_of_recordings_is_told_by_its_setting(in_root, tmp_path):
    campaign = walkway(tmp_path)
    check_start(campaign)
    gone = campaign.config.model_copy(update={"raw_data": Path("gone")})

    with refused_with(r"^gone: .*`raw_data`"):
        check_start(replace(campaign, config=gone))


def test_settings_at_their_bounds_and_two_dates_are_allowed(in_root):
    own = {"walking": {"window_s": 0.2}, "recorded": "2026-03-14 to 2026-03-16"}
    # up and down
    own |= {
        "dynamometer": {"frequencies_hz": [1, 3, 5, 3, 1], "time_base": {"longest_gap_s": 0.02}}
    }
    own |= {"raw_data": "results_of_others"}
    started(overriding(SHIPPED, own | {"doubtful": {"belt": {"above": {"VAF": None}}}}))


def test_a_simulated_laboratory_at_its_bounds_is_allowed(in_root, tmp_path):
    """Its platform turns once at 0.87 of a stance, 0.72 s long, behind the heel strike."""
    gait = read_mapping(ROOT / "config/simulation/walking.yaml")
    ends = {"stance_phase": [0.86, 0.87], "hold_s": 10, "angle_deg": 60}
    own = {
        "perturbation": ends,
        "gait": {"heel_strike_s": 0.1},
        "plate": {"nominal_ankle_m": [0.3, -0.25]},
        "rates": {"controller_hz": 700},
    }

    settings = validated(overriding(gait, own), WalkingSettings, tmp_path)

    assert settings.rates.motion_hz == 10500


def test_a_simulation_without_its_libraries_is_refused_before_any_job(monkeypatch, in_root):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    monkeypatch.setattr(Path, "exists", lambda path: path.suffix != ".c3d")
    python = re.escape(shlex.quote(sys.executable))
    with refused_with(rf"ezc3d.*; {python} -m pip install ezc3d$"):
        started(SHIPPED)
    monkeypatch.setattr(Path, "exists", lambda _: True)
    started(SHIPPED)


def started(content):
    """What the workflow does with a configuration before any job."""
    config = campaign_config(content, [SHIPPED_FILE])
    opened = open_campaign(config, plan_trials(read_yaml(config.simulation, SimulationSettings)))
    check_start(opened)


@pytest.mark.parametrize("value", ["1:30", "010", "off"])
def test_a_value_that_yaml_1_1_reads_otherwise_is_refused_for_snakemake(tmp_path, value):
    """Snakemake hands over 90, 8 and a truth value."""
    path = tmp_path / "a.yaml"
    path.write_text(f"a:\n  b: [1, 2]\n  rate: [{value}]\n")

    for door in (read_config, lambda path: campaign_config(SHIPPED, [SHIPPED_FILE, path])):
        with refused_with(r"a\.yaml: line 3: a\.rate: .*Snakemake"):
            door(path)

    assert read_mapping(path)["a"]["rate"] == [10 if value == "010" else value]
    path.write_text(f"a: '{value}'\nb: [0, 0.5, -0, 1.0e+3, 100]\nc: 1e-3\n")
    assert read_campaign_file(path) == {"a": value, "b": [0, 0.5, 0, 1000, 100], "c": 0.001}


def test_a_wrong_section_is_named_with_key_and_line(tmp_path, in_root):
    path = tmp_path / "own.yaml"
    path.write_text("campaign: own\ndynamometer:\n  cutoff_hz: .nan\n")
    with refused_with(r"line 3.*own\.yaml: dynamometer\.cutoff_hz: nan"):
        config_for_trials(path)
    path.write_text("dynamometr: {}\n")
    with refused_with(r"line 1.*own\.yaml:.*dynamometr.*'dynamometer"):
        config_for_trials(path)


def test_a_changed_file_is_read_anew(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = Path("own.yaml")
    device = Path("config/parameters/default.yaml")
    for cutoff_hz in (11, 12):
        path.write_text(f"dynamometer:\n  cutoff_hz: {cutoff_hz}\nparameters: {device}\n")
        assert config_for_trials(path).dynamometer.cutoff_hz == cutoff_hz
    assert config_for_trials(path).parameters == ROOT / device

    device.parent.mkdir(parents=True)
    device.touch()  # a file of one's own stands for the shipped one

    assert config_for_trials(path).parameters == device


# Parameter files: what ships is valid, and a mistake is one line that names it.

PARAMETERS = ROOT / "config/parameters"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"K_s": None}, "K_s"),
        (
            {"K_s": {"unit": "N*mm/rad"}},
            r"line \d+: parameters\.K_s: K_s.*unit 'N\*mm/rad',.*'N\*m/r",
        ),
        (
            {"B_j": {"value": -0.1}, "J_m": {"value": 1e-300}},
            r"B_j = -0.1.*zero.*J_m = 1e-300 kg\*m\^2.*1e-09.*1e\+09",
        ),
        ({"n_T": {"value": "83/0"}}, "n_T.*write a number.*83/18"),
        ({"f_G": {"value": 2}}, r"f_G = 2.0 N\*m/A.*k_tau n_m"),
    ],
)
def test_a_wrong_quantity_is_named_with_its_file(tmp_path, changes, message):
    content = yaml.safe_load((PARAMETERS / "default.yaml").read_text())
    for name, value in changes.items():
        old = content["parameters"].pop(name, {"value": 1.0, "unit": "1", "source": "test"})
        content["parameters"] |= {name: old | value} if value else {}
    path = tmp_path / "edited.yaml"
    path.write_text(yaml.safe_dump(content))

    with refused_with(rf"edited.yaml.*{message}"):
        read_parameters(path)


def test_the_shipped_parameters_are_those_of_hardware_and_publications():
    """The reflected inertia n_T^2 J_m is that of the design, 0.196 kg*m^2; with the teeth that the
    draft's Table I prints, 83/11, it would be 0.52."""
    default, later = (
        read_parameters(PARAMETERS / f"{name}.yaml") for name in ("default", "osl-v2-published")
    )
    with pytest.warns(UserWarning, match="83/11"):
        printed = read_parameters(PARAMETERS / "table1-as-printed.yaml")

    assert (default.n_T, default.n_m * default.n_T, default.K_s) == pytest.approx(
        (83 / 18, 41.5, 685.6)
    )
    assert default.n_T**2 * default.J_m == pytest.approx(0.196, abs=5e-4)
    assert printed.n_T**2 * printed.J_m == pytest.approx(0.52, abs=5e-3)
    assert (later.K_s, later.K_s2, later.B_m) == (876, 14913, 6.06e-2)


# The simulator follows the configuration in what both use: device, gains, protocol, desired
# impedance.

TRIAL = "impedance_K300_B5.0_compensated"
OTHER = "config/parameters/osl-v2-published.yaml"


def configured(tmp_path, **changes):
    """What the simulator follows, from the default configuration with changes."""
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(changes))
    return read_config(tmp_path / "config.yaml")


def test_the_simulated_leg_has_the_gains_that_the_configuration_says(tmp_path, in_root):
    """The truth beside the log, against the gains of Eq. 14 for the other weight and the other
    device."""
    protocol = {"amplitudes_deg": [3], "frequencies_hz": [4], "cycles": 3, "settle_cycles": 1}
    changes = {
        "gain_weight": {"cutoff_hz": 4, "order": 2},
        "parameters": OTHER,
        "dynamometer": protocol,
    }
    simulate_planned_trial(
        Path("tests/tiny_simulation.yaml"),
        tmp_path / "raw",
        TRIAL,
        configured(tmp_path, **changes).shared(EXPERIMENTS["impedance"].follows),
    )
    truth = json.loads((tmp_path / f"raw/truth/{TRIAL}.json").read_text())["gains"]
    expected = select_gains(
        "compensated", 300, 5, read_parameters(Path(OTHER)), Weight(cutoff_hz=4, order=2)
    )
    assert (truth["K_1"], truth["B_1"]) == pytest.approx((expected.K_1, expected.B_1))


def test_the_simulated_protocol_and_walk_are_those_of_the_configuration(tmp_path, in_root):
    other = Path("config/impedance/synthetic_rising.csv")
    default = Path("config/simulation/default.yaml")
    protocol = {
        "amplitudes_deg": [3, 1],
        "frequencies_hz": [4, 2.5],
        "cycles": 7,
    }
    changes = {
        "dynamometer": protocol,
        "gain_weight": {"cutoff_hz": 3, "order": 1},
        "impedance_trajectory": str(other),
    }
    followed = configured(tmp_path, **changes).shared()
    settings = read_simulation(default, followed)
    stepped = settings.protocol
    assert (stepped.amplitudes_deg, stepped.frequencies_hz, stepped.cycles) == (
        (3, 1),
        (4, 2.5),
        7,
    )
    assert stepped.lead_s == 1
    walking = laboratory_of(settings, followed)
    assert (walking.impedance, walking.gain_weight) == (other, Weight(cutoff_hz=3, order=1))
    assert other in settings_files(default, followed)


def test_each_experiment_follows_what_it_uses_and_no_more(tmp_path, in_root):
    """A belt has no controller: another weight does not simulate it anew."""
    own = configured(tmp_path)
    for change, following in (
        ({"gain_weight": {"cutoff_hz": 2}}, "impedance walking"),
        ({"impedance_trajectory": None}, "walking"),
        ({"parameters": OTHER}, "belt transmission actuator impedance walking"),
        ({"dynamometer": {"cycles": 7}}, "transmission impedance"),
    ):
        other = configured(tmp_path, **change)
        assert [
            name
            for name, facts in EXPERIMENTS.items()
            if own.shared(facts.follows) != other.shared(facts.follows)
        ] == following.split()
