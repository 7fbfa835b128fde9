"""Parameter files and configuration: what ships is valid, and a mistake is one line that names it."""

from pathlib import Path

import pytest
import yaml
from conftest import ROOT

from osl_analysis.config.parameters import read_parameters
from osl_analysis.errors import InputError

SHIPPED = ROOT / "config/parameters"


def edited(tmp_path: Path, **changes: object) -> Path:
    content = yaml.safe_load((SHIPPED / "default.yaml").read_text())
    for name, value in changes.items():
        if value is None:
            del content["parameters"][name]
        else:
            content["parameters"].setdefault(name, {"value": 1.0, "unit": "1", "source": "test"}).update(value)
    path = tmp_path / "edited.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_the_shipped_files_have_the_numbers_of_hardware_text_table_and_later_publication():
    default, later = (read_parameters(SHIPPED / f"{name}.yaml") for name in ("default", "osl-v2-published"))
    assert (default.n_T, default.n_m * default.n_T, default.K_s) == pytest.approx((83 / 18, 41.5, 685.6))
    assert default.n_T**2 * default.J_m == pytest.approx(0.196, abs=5e-4)  # reflected, as the design states
    with pytest.warns(UserWarning, match="83/11 contradicts the hardware"):
        printed = read_parameters(SHIPPED / "table1-as-printed.yaml")
    assert printed.n_T**2 * printed.J_m == pytest.approx(0.52, abs=5e-3)
    assert (later.K_s, later.K_s2, later.B_m) == (876, 14913, 6.06e-2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"K_s": None}, "K_s .* is missing"),
        ({"K_s": {"unit": "N*mm/rad"}}, r"line \d+: parameters\.K_s\.unit: K_s has unit 'N\*mm/rad', expected 'N\*m/r"),
        ({"K_s": {"value": -3}}, r"line \d+: parameter K_s = -3.* must be positive"),
        ({"K_s": {"value": True}}, r"line \d+: parameters\.K_s\.value: true is not allowed: write a number"),
        ({"B_j": {"value": -0.1}}, "B_j = -0.1 .* zero or positive"),
        ({"J_m": {"value": 1e-300}}, r"J_m = 1e-300 kg\*m\^2 must be positive, 1e-09 to 1e\+09; correct"),
        ({"B_j": {"value": 1e16}}, r"B_j = 1e\+16 .* zero or positive, 1e-09 to 1e\+09"),
        ({"n_T": {"value": "83/0"}}, "ratio such as 83/18"),
        ({"k_tau": {"value": float("nan")}}, "k_tau"),
        ({"mass": {"value": 1.0}}, r"line \d+: parameters\.mass: unknown parameter mass.*; remove it"),
        ({"K_s": {"value": "1e400"}}, "ratio such as 83/18|K_s"),
        ({"f_G": {"value": 2}}, "f_G = 2.0 N\\*m/A is not below k_tau n_m"),
    ],
)
def test_a_wrong_quantity_is_named_with_its_file(tmp_path, changes, message):
    with pytest.raises(InputError, match=f"edited.yaml.*{message}") as caught:
        read_parameters(edited(tmp_path, **changes))
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"nowhere\.yaml: no such file"):
        read_parameters(Path("nowhere.yaml"))
