"""`osl-analysis doctor --upgrade` makes a campaign of release 0.4.0 one of this release."""

import pytest

from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.upgrade import upgraded_fields
from osl_analysis.errors import InputError, RemovedFieldError

CONFIG_OF_0_4_0 = """\
campaign: pilot  # of March
raw_data: recordings
sheet: trials.csv
simulation: null
parameters: null
dynamometer:
  human: true
doubtful:
  belt:
    above:
      stiffening: 0.1
  phasors:
    above: {Y_phase_se_deg: 2.5, theta_distortion: 0.1}
quality:
  unzeroed_load_cell: {threshold: 5 N*m, on_failure: flag}
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text(CONFIG_OF_0_4_0, encoding="utf-8")
    return path


def test_a_campaign_of_the_last_release_is_read_after_the_upgrade(config):
    with pytest.raises(RemovedFieldError):
        read_config(config)
    lines = list(upgraded_fields(config))
    assert [line.partition(": ")[0] for line in lines] == [
        "dynamometer.human",
        "doubtful.belt.above.stiffening",
        "doubtful.phasors.above.Y_phase_se_deg",
        "quality.unzeroed_load_cell",
    ]
    assert read_config(config).doubtful.of("phasors").above["Y_phase_deg_se"] == 2.5


def test_other_lines_and_comments_stay(config):
    list(upgraded_fields(config))
    text = config.read_text(encoding="utf-8")
    assert text.startswith("campaign: pilot  # of March\n")
    assert "belt" not in text  # a section that is left empty goes
    assert "theta_distortion: 0.1" in text
    assert "simulation: null" in text


def test_a_campaign_of_this_release_is_not_rewritten(config):
    list(upgraded_fields(config))
    before = config.stat().st_mtime_ns
    assert list(upgraded_fields(config)) == []
    assert config.stat().st_mtime_ns == before


def test_a_mistake_is_left_to_its_author(config):
    config.write_text(CONFIG_OF_0_4_0 + "claimss: {}\n", encoding="utf-8")
    with pytest.raises(InputError, match="unknown field 'claimss'"):
        list(upgraded_fields(config))
