"""`osl-analysis design`: what it prints and writes, and what it refuses in one line."""

import json
import re

import numpy as np
import polars as pl
import pytest
from click.testing import CliRunner
from conftest import ROOT
from scipy.stats import t as student

from osl_analysis.bench.response_tables import RESPONSE
from osl_analysis.cli import main
from osl_analysis.spectral.periods import periodic_motion


@pytest.fixture(autouse=True)
def in_root(monkeypatch):
    monkeypatch.chdir(ROOT)


def call(*arguments):
    return CliRunner().invoke(main, ["design", *(str(a) for a in arguments)])


def as_json(*arguments):
    result = call(*arguments, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_the_configuration_s_protocol_is_the_default():
    said = as_json()
    assert said["protocol"] == "stepped sine: 2, 4, 6 deg at 1, 2, 3, 4, 5 Hz, 20 cycles at each (17 fitted)"
    assert said["record_s"] == pytest.approx(3 * 20 * (1 + 1 / 2 + 1 / 3 + 1 / 4 + 1 / 5))
    assert {name: one["expected"] for name, one in said["estimates"].items()} == {"K": 300, "B": 5, "I": 0.02}
    assert said["interval_method"] == "units"  # as impedance.csv names it
    assert said["recommended"] is None
    assert said["lag_s"] == pytest.approx(1e-4)
    assert said["lag_errors"]["B"] == pytest.approx(-300 * 1e-4, rel=0.1)


def test_text_and_json_say_the_same_intervals():
    arguments = ("--excitation", "multisine", "--friction", "0.3")
    text, said = call(*arguments).stdout, as_json(*arguments)
    for name, one in said["estimates"].items():
        (line,) = (line.split() for line in text.splitlines() if line.startswith(f"{name} "))
        assert line[1:4] == [
            f"{one['expected']:.4g}",
            f"{one['half_width']:.3g}",
            f"{100 * one['half_width'] / one['expected']:.3g}",
        ]
        assert sum(one["variance"].values()) == pytest.approx(one["se"] ** 2)
        assert one["half_width"] == pytest.approx(student.ppf(0.975, one["degrees_of_freedom"]) * one["se"])
        assert one["half_width"] > 10 * one["half_width_of_noise"]
    assert f"adds to B {said['friction_damping']['in all']:.3g}" in text
    assert "load cell drift 0.05 N·m/min" in text


def test_the_torque_to_expect_is_that_of_the_largest_sine_or_of_all_together():
    """|300 - 0.02 w^2 + 5j w| times 6 deg at 5 Hz; of noise of 2 deg on a spring, four times 300 N*m/rad."""
    w = 10 * np.pi
    largest = abs(300 - 0.02 * w**2 + 5j * w) * np.deg2rad(6)
    assert f"torque about {largest:.3g} N·m" in call().stdout
    said = call("--excitation", "noise", "--band", "0.2,5", "--damping", "0", "--inertia", "0").stdout
    assert f"torque about {4 * 300 * np.deg2rad(2):.3g} N·m" in said


def test_what_is_asked_for_is_reached_and_the_recommended_multisine_is_written(tmp_path):
    output = tmp_path / "multisine.csv"
    asked = ("--friction", "0.5", "--stiffness-within", "0.5%", "--damping-within", "1", "--rate", "200")
    said = as_json("--excitation", "multisine", *asked, "--write", output)
    best, shares = said["recommended"], {"K": 0.005, "B": 0.01}
    assert said["asked_within"] == shares
    for name, share in shares.items():
        assert best["estimates"][name]["half_width"] <= share * best["estimates"][name]["expected"]
    table = pl.read_csv(output)
    time, angle = table["time"].to_numpy(), table["theta_command"].to_numpy()
    np.testing.assert_allclose(np.diff(time), 1 / 200)
    assert angle[0] == angle[-1] == 0
    assert np.max(np.abs(np.diff(angle))) * 200 < 1.3 * 3.3  # rad/s: no jump at the ends of realisations
    found = periodic_motion(angle, 300 * angle, 200.0, 10.0)
    assert found.period == pytest.approx(8, rel=1e-4)
    assert f"{len(found.realisations)} realisations" in best["protocol"]
    assert best["record_s"] == 8 * sum(one.periods + 1 for one in found.realisations)


def test_a_peak_is_kept_by_all_realisations(tmp_path):
    output = tmp_path / "multisine.csv"
    call("--excitation", "multisine", "--peak", "6", "--rate", "100", "--write", output)
    assert np.rad2deg(pl.read_csv(output)["theta_command"].abs().max()) == pytest.approx(6, rel=0.01)


def test_an_earlier_trial_states_the_distortion(tmp_path):
    rows = {"trial": ["a", "a", "b"], "amplitude_deg": [2.0, None, None], "coulomb_torque": [0.4, -0.3, 0.1]}
    pl.DataFrame(rows).write_csv(tmp_path / "impedance.csv")
    earlier = ("--earlier", tmp_path / "impedance.csv")
    assert as_json(*earlier, "--trial", "a")["friction_damping"] == as_json("--friction", "0.3")["friction_damping"]
    assert "2 trials; choose one with --trial, such as a" in call(*earlier).stderr
    pl.DataFrame(rows).head(0).write_csv(tmp_path / "empty.csv")
    assert "0 trials; choose one with --trial" in call("--earlier", tmp_path / "empty.csv").stderr
    f = np.arange(5, 48, 2) / 8
    levels = pl.DataFrame({"trial": "m", "frequency_hz": f, "angle_deg": np.rad2deg(0.01), "odd_level": 2.0})
    levels.write_csv(tmp_path / "response.csv")
    assert set(levels.columns) < set(RESPONSE)
    said = as_json("--excitation", "multisine", "--earlier", tmp_path / "response.csv", "--realisations", "1")
    # 0.02 N*m at each line, half of its square in each quadrature, which is 0.01 of Z = |torque|/0.0119 rad
    share = as_json("--excitation", "multisine", "--realisations", "1", "--distortion", "1%")
    ratio = said["estimates"]["B"]["variance"]["distortion"] / share["estimates"]["B"]["variance"]["distortion"]
    size = np.deg2rad(2) * np.sqrt(2 / 17)
    w = 2 * np.pi * f
    torque = np.mean((np.abs(300 - 0.02 * w**2 + 5j * w) * size * 0.01) ** 2 * w**2) / np.mean(w**2)
    assert ratio == pytest.approx(0.02**2 / torque, rel=0.1)


def test_the_spread_of_an_earlier_multisine_s_realisations_is_that_of_the_next(tmp_path):
    row = {"trial": ["m"], "interval_method": ["realisations"], "realisations": [4], "amplitude_deg": [None]}
    band = {"band_low_hz": [0.63], "band_high_hz": [5.9], "theta_rms_deg": [2.0], "coulomb_torque": [0.1]}
    errors = {"K_se": [0.3], "B_se": [0.01], "I_se": [5e-4]}
    pl.DataFrame({**row, **band, **errors}).write_csv(tmp_path / "impedance.csv")
    asked = ("--excitation", "multisine", "--earlier", tmp_path / "impedance.csv")
    for realisations, rms, factor in ((4, 2, 1.0), (16, 2, 0.5), (4, 4, 0.5)):
        said = as_json(*asked, "--realisations", realisations, "--rms", rms)["estimates"]
        for name, one in said.items():
            assert one["variance"]["distortion"] == pytest.approx((factor * errors[f"{name}_se"][0]) ** 2)
    other = call(*asked, "--band", "0.5,3")
    assert (other.exit_code, "multisine from 0.63 to 5.9 Hz" in other.stderr) == (1, True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--rms", "3"), "a stepped-sine has no --rms"),
        (("--excitation", "noise", "--rms", "3", "--peak", "4"), "not both"),
        (("--excitation", "chirp", "--band", "1,2,3"), "lowest and the highest"),
        (("--excitation", "chirp", "--band", "3,2"), "lower frequency first"),
        (("--excitation", "multisine", "--band", "1,1.2"), "longer period or a wider band"),
        (("--trial", "a"), "give --earlier too"),
        (("--rate", "25"), "twice the cut-off"),
        (("--excitation", "multisine", "--band", "0.5,1.5"), "the analysis would refuse this protocol"),
        (("--excitation", "chirp", "--band", "0.2,1"), "the band from 1 to about 2.3 Hz is missing"),
        (("--stiffness-within", "0"), "no percentage"),
        (("--write", "/tmp/x.csv"), "only a multisine is written"),
        (("--write", "x.yaml"), "writes .csv files"),
        (("--cycles", "2"), "leaves none of 2 cycles"),
        (("--earlier", "config/config.yaml"), "config/config.yaml"),
        (("--excitation", "chirp", "--distortion", "2"), "says nothing on a chirp"),
        (("--stiffness", "nan"), "--stiffness is nan; give a finite number"),
        (("--stiffness", "-1"), "--stiffness is -1; give a number above 0"),
        (("--stiffness", "0"), "--stiffness is 0; give a number above 0"),
        (("--inertia", "-0.1"), "--inertia is -0.1; give a number of 0 or more"),
        (("--frequencies", "1,inf"), "finite"),
        (("--frequencies", "2"), "told apart by 2 Hz alone, where K - I w^2 is one number; excite down to 1 Hz"),
        (("--frequencies", "1,20"), "20 Hz is above the filter's cut-off of 15 Hz"),
        (("--excitation", "multisine", "--period", "1e9"), "0.1<=x<=600"),
        (("--excitation", "multisine", "--rate", "1e6", "--write", "/tmp/x.csv"), "are more than 1e+07"),
    ],
)
def test_a_mistake_is_one_line(arguments, message):
    result = call(*arguments)
    assert result.exit_code != 0
    assert message in result.stderr.splitlines()[-1]
    assert "Traceback" not in result.output


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--friction", "0.1"), ""),
        (("--excitation", "multisine", "--friction", "0.1"), ""),
        (("--excitation", "multisine"), "no distortion is stated"),
        (("--excitation", "multisine", "--realisations", "1"), "1 realisation of a distortion"),
        (("--excitation", "noise", "--friction", "0.1"), "does not tell noise from distortion"),
        (("--encoder-bits", "12"), "rounding of the encoder makes"),
        (("--encoder-bits", "12", "--amplitudes", "0.5"), "steps of the encoder"),
        (("--encoder-step", "0"), "no step of the encoder is stated"),
        (
            ("--excitation", "noise", "--band", "0.01,6", "--duration", "1", "--drift", "500"),
            "the load cell's drift makes",
        ),
        (("--frequencies", "1,3,5,8,10"), "near the filter's cut-off"),
        (("--frequencies", "3,3.5"), "hardly tells K from I .*above 3.5 Hz, up to 7 Hz"),
        (("--amplitudes", "80"), r"largest_angle = 1\.2 rad: the recording would be refused"),
    ],
)
def test_warnings_name_what_no_length_cures(arguments, said):
    warnings = "; ".join(as_json(*arguments)["warnings"])
    assert re.search(said, warnings) if said else warnings == ""


def test_a_band_is_refused_as_the_analysis_refuses_it():
    """0.1 % of the torque over what of the acceleration angle and velocity do not explain; moments of a flat band."""
    w = 2 * np.pi * np.linspace(0.5, 1.5, 2001)
    own = np.sqrt(np.mean(w**4) - np.mean(w**2) ** 2)
    change = 1e-3 * np.sqrt(np.mean(np.abs(300 - 0.02 * w**2 + 5j * w) ** 2)) / own
    for kind in ("noise", "chirp"):
        assert f"changes I by {change:.2g} kg*m^2" in call("--excitation", kind, "--band", "0.5,1.5").stderr
    assert call("--band", "0.5,2.5", "--excitation", "noise").exit_code == 0


def test_what_only_a_longer_record_reaches_is_not_called_out_of_reach():
    """White noise averages out: the interval shrinks by the root of the time, down to the longest that is searched."""
    asked = ("--excitation", "noise", "--encoder-step", "0", "--drift", "0")
    one = as_json(*asked, "--duration", "7200")["estimates"]["K"]
    share = 100 * one["half_width"] / one["expected"]
    said = call(*asked, "--stiffness-within", share / 2).stdout
    assert f"the longest record that is searched, 2 h, which gives K ± {share:.2g} % (variance by torque noise" in said
    best = as_json(*asked, "--stiffness-within", 1.01 * share)["recommended"]
    assert best["record_s"] == pytest.approx(7200, rel=0.03)
    never = as_json("--encoder-bits", "10", "--stiffness-within", "0.01%")
    assert never["recommended"] is None
    assert re.search("beyond the longest record that is searched.*encoder rounding", never["warnings"][-1])
