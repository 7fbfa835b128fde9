"""The configuration: an old name is refused with the new one, and the shipped file is valid."""

from typing import ClassVar

import pytest
import yaml
from conftest import ROOT

from osl_analysis.config import campaign_config
from osl_analysis.errors import InputError
from osl_analysis.yaml_settings import Settings, validated

SHIPPED = yaml.safe_load((ROOT / "config/config.yaml").read_text())


class Inner(Settings):
    RENAMED: ClassVar = {"old": "new"}
    new: float


class Outer(Settings):
    inner: Inner


def test_the_shipped_configuration_is_valid():
    assert campaign_config(SHIPPED, "config.yaml").campaign == "default"


@pytest.mark.parametrize(("old", "new"), [("gait", "overground"), ("validation", "study")])
def test_an_old_section_is_refused_and_the_new_one_named(old, new):
    content = dict(SHIPPED)
    content[old] = content.pop(new)
    with pytest.raises(InputError, match=f"config.yaml: field '{old}' is now called '{new}'; rename it"):
        campaign_config(content, "config.yaml")


def test_an_old_field_within_a_section_is_named_with_its_place():
    with pytest.raises(InputError, match=r"field 'inner\.old' is now called 'inner\.new'; rename it"):
        validated({"inner": {"old": 1.0}}, Outer, ROOT)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"cycles": [10, 20]}, "cycles has 2 numbers for 5 frequencies"),
        ({"cycles": [10, 20, 30, 2, 20]}, "settle_cycles = 2 leaves none of 2 cycles; lower it, at most to 1"),
        ({"seconds_per_frequency": 1.5}, r"settle_cycles = 2 leaves none of 1\.5 cycles"),
    ],
)
def test_cycles_of_a_stepped_sine_are_one_for_each_frequency_and_enough_to_settle(changed, message):
    with pytest.raises(InputError, match=message):
        campaign_config(SHIPPED | {"dynamometer": SHIPPED["dynamometer"] | changed}, "a")


def test_a_time_per_frequency_replaces_the_cycles():
    def cycles(**changed):
        config = campaign_config(SHIPPED | {"dynamometer": SHIPPED["dynamometer"] | changed}, "a")
        return config.dynamometer.protocol.cycles_at

    assert cycles() == (20, 20, 20, 20, 20)
    assert cycles(cycles=[10, 15, 20, 25, 30]) == (10, 15, 20, 25, 30)
    assert cycles(seconds_per_frequency=10) == (10, 20, 30, 40, 50)
