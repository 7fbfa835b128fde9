"""What makes the simulator fast gives the same numbers, and is loaded before jobs are forked."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from conftest import ROOT
from scipy.interpolate import CubicSpline
from walking_setup import load_setup

from osl_analysis.commands.simulate import row_of_trial, simulate_trial
from osl_analysis.errors import InputError
from osl_analysis.parameters import read_parameters
from osl_analysis.simulator import drivetrain, joint_motion, kernel
from osl_analysis.simulator.bench import simulate_actuator_trial, simulate_dynamometer_trial
from osl_analysis.simulator.kernel import SETTLED, spline_at
from osl_analysis.simulator.preloaded import warm_up
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.yaml_settings import read_yaml

KERNELS = [
    (drivetrain, "integrate"),
    (drivetrain, "belt_path"),
    (joint_motion, "propagate"),
    (kernel, "slopes"),
    (kernel, "evaluated"),
]


@pytest.mark.parametrize("n", [4, 5, SETTLED, SETTLED + 1, SETTLED + 2, 2000])
def test_the_spline_through_even_samples_is_that_of_scipy(n):
    rng = np.random.default_rng(n)
    samples, rate = rng.normal(size=n), 250.0
    instants = np.concatenate([rng.uniform(0, (n - 1) / rate, 500), np.arange(n) / rate, [(n - 0.5) / rate]])
    expected = CubicSpline(np.arange(n) / rate, samples)(instants)
    np.testing.assert_allclose(spline_at(samples, rate, instants), expected, rtol=0, atol=1e-10)


def test_three_samples_are_refused():
    with pytest.raises(InputError, match="3 samples at 1000 Hz is too short"):
        spline_at(np.zeros(3), 1000.0, np.zeros(2))


def test_jobs_find_the_compiled_functions_loaded(monkeypatch):
    """Each simulated trial calls them with the types with which they were called before jobs are forked."""
    called = {}

    def noting(name, function):
        def noted(*arguments):
            called.setdefault(name, set()).add(tuple(str(numba.typeof(argument)) for argument in arguments))
            return function(*arguments)

        return noted

    for module, name in KERNELS:
        monkeypatch.setattr(module, name, noting(name, getattr(module, name)))
    warm_up()
    warmed = {name: set(types) for name, types in called.items()}
    path, setup = ROOT / "tests/tiny_simulation.yaml", load_setup()
    shipped = {"recorder": setup.settings.recorder, "actuator": setup.settings.actuator}
    settings = read_yaml(path, SimulationSettings).model_copy(update=shipped)
    p = replace(read_parameters(ROOT / "config/parameters/default.yaml"), K_s=701.0)  # gains that no test asked for
    for trial in ("belt_01", "transmission_1", "impedance_K300_B5.0_compensated"):
        simulate_dynamometer_trial(row_of_trial(settings, path, trial), settings, p)
    simulate_actuator_trial("actuator_1", settings, p)
    replace(setup, p=p).crossing(perturbed=True)
    assert called == warmed
    assert set(called) == {name for _, name in KERNELS}


def test_without_a_compiler_nothing_is_simulated_and_one_line_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("osl_analysis.compiled.numba", None)
    with pytest.raises(
        InputError, match=r"needs numba, which is not installed; pip install 'osl-analysis\[simulator\]'"
    ):
        simulate_trial(ROOT / "tests/tiny_simulation.yaml", tmp_path, "belt_01")
    assert list(tmp_path.iterdir()) == []
