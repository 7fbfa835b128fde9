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
