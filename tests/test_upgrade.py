"""`osl-analysis doctor --upgrade` makes a campaign of release 0.4.0 one of this release; what has
another name works until its release, with a warning."""

from typing import ClassVar

import pytest

import osl_analysis.renamed
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.upgrade import upgraded_campaign, upgraded_fields
from osl_analysis.errors import InputError, Removal, RemovedFieldError
from osl_analysis.renamed import NewName, RenamedWarning, current_name
from osl_analysis.yaml_settings import Settings, check_has_one_name, read_yaml

CONFIG_OF_0_4_0 = """\
campaign: pilot  # of March
raw_data: recordings
sheet: trials.csv
simulation: null
parameters: null
dynamometer:
  # the mount, measured in March
  bench_stiffness: {value: 218 N*m/deg, standard_error: 10 N*m/deg}   # page 12
  human: true
  # ours is slow
  cutoff_hz: 12
doubtful:
  belt:
    above:
      stiffening: 0.1
  transmission: {above: {coulomb_share: 0.3, load_cell_drift: 0.5,
                         odd_harmonics: 0.2}, below: {VAF: 97}}   # three limits
  phasors:
    above: {Y_phase_se_deg: 2.5, theta_distortion: 0.1}
quality:
  unzeroed_load_cell: {threshold: 5 N*m, on_failure: flag}
"""
CONFIG_OF_NOW = """\
campaign: pilot  # of March
raw_data: recordings
sheet: trials.csv
simulation: null
parameters: null
dynamometer:
  # the mount, measured in March
  bench_stiffness: {value: 218 N*m/deg, standard_error: 10 N*m/deg}   # page 12
  # ours is slow
  cutoff_hz: 12
doubtful:
  transmission: {above: {load_cell_drift: 0.5}, below: {VAF: 97}}   # three limits
  phasors:
    above: {Y_phase_deg_se: 2.5, theta_distortion: 0.1}
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text(CONFIG_OF_0_4_0, encoding="utf-8")
    return path


def test_the_upgrade_takes_out_what_is_gone_and_nothing_else(config):
    with pytest.raises(RemovedFieldError):
        read_config(config)

    lines = list(upgraded_campaign(config))

    assert [line.split(": ")[1] for line in lines[1:]] == [
        "dynamometer.human",
        "doubtful.belt.above.stiffening",
        "doubtful.transmission.above.coulomb_share",
        "doubtful.transmission.above.odd_harmonics",
        "doubtful.phasors.above.Y_phase_se_deg",
        "quality.unzeroed_load_cell",
    ]
    assert config.read_text(encoding="utf-8") == CONFIG_OF_NOW
    assert read_config(config).doubtful.of("phasors").above["Y_phase_deg_se"] == 2.5
    (before,) = config.parent.glob("config.yaml.before-*")
    assert before.read_text(encoding="utf-8") == CONFIG_OF_0_4_0


def test_a_campaign_of_this_release_is_not_rewritten(config):
    list(upgraded_campaign(config))
    before = config.stat().st_mtime_ns

    assert list(upgraded_campaign(config)) == []
    assert config.stat().st_mtime_ns == before


def test_a_mistake_is_left_to_its_author(config):
    config.write_text(CONFIG_OF_0_4_0 + "claimss: {}\n", encoding="utf-8")
    with pytest.raises(InputError, match="unknown field 'claimss'"):
        list(upgraded_campaign(config))


class Bench(Settings):
    rate_hz: float
    note: str = ""
    RENAMED: ClassVar = {"frequency": NewName("rate_hz", "1.2")}


class Laboratory(Settings):
    bench: Bench
    others: tuple[Bench, ...] = ()
    REMOVED: ClassVar = {"person": "nobody needs it"}


def test_a_field_of_lines_goes_with_its_lines_alone(tmp_path):
    path = tmp_path / "laboratory.yaml"
    path.write_bytes(
        b"person:\r\n  - ann\r\n  # bob\r\n  - |\r\n    eve\r\n\r\n# bench\r\nbench: {frequency: 1}"
    )

    lines = list(upgraded_fields(path, lambda file: read_yaml(file, Laboratory)))

    assert lines[1:] == [
        "laboratory.yaml: person: removed; nobody needs it",
        "laboratory.yaml: bench.frequency: renamed to rate_hz",
    ]
    assert path.read_bytes() == b"\r\n# bench\r\nbench: {rate_hz: 1}"


def test_a_field_in_a_list_is_left_to_its_author(tmp_path):
    path = tmp_path / "laboratory.yaml"
    path.write_text(text := "bench: {rate_hz: 1}\nothers: [{frequency: 50}]\n")

    with pytest.raises(InputError, match=r"line 2: field 'others\.0\.frequency' has another"):
        list(upgraded_fields(path, lambda file: read_yaml(file, Laboratory)))
    assert [path.read_text(), *tmp_path.iterdir()] == [text, path]


@pytest.mark.parametrize("version", ["1.1.0", "1.2.0"])
def test_a_field_with_its_old_and_its_new_name_is_refused_before_anything_is_written(
    tmp_path, release, version
):
    release(version)
    path = tmp_path / "laboratory.yaml"
    path.write_text(text := "bench: {rate_hz: 1, frequency: 2}\n")
    refused = pytest.raises(
        InputError, match=r"'bench\.frequency' is called rate_hz now, and that stands there too"
    )

    with refused:
        read_yaml(path, Laboratory)
    with refused:
        list(upgraded_fields(path, lambda file: read_yaml(file, Laboratory)))

    assert [path.read_text(), *tmp_path.iterdir()] == [text, path]


def test_of_two_files_the_later_one_may_have_an_old_name_and_no_earlier_one(tmp_path):
    files = [tmp_path / "default.yaml", tmp_path / "ours.yaml"]
    for file, name in zip(files, ("rate_hz", "frequency"), strict=True):
        file.write_text(f"bench: {{{name}: 1}}")
    removal = Removal(("bench", "frequency"), "", "rate_hz")

    check_has_one_name(files, removal)
    with pytest.raises(InputError, match=r"default\.yaml: field 'bench\.frequency'"):
        check_has_one_name(files[::-1], removal)


@pytest.fixture
def release(monkeypatch):
    """Sets the version that is installed."""
    return lambda text: monkeypatch.setattr(osl_analysis.renamed, "version", lambda _: text)


@pytest.mark.parametrize("version", ["0.4.0", "1.1rc1", "1.1.3"])
def test_an_old_name_works_until_its_release_with_a_warning_that_names_both(
    tmp_path, release, version
):
    release(version)
    path = tmp_path / "laboratory.yaml"
    path.write_text("bench: {note: ours, frequency: 100}\nothers: [{frequency: 50}]")

    first, second = (
        pytest.warns(RenamedWarning, match=rf"field '{field}\.frequency'.*rate_hz.* 1\.2")
        for field in (r"bench", r"others\.0")
    )
    with first, second:
        settings = read_yaml(path, Laboratory)
    ours = Bench(rate_hz=100, note="ours")
    assert settings == Laboratory(bench=ours, others=(Bench(rate_hz=50),))

    with pytest.warns(RenamedWarning, match=r"Response is called Answer now; .* 1\.2"):
        assert current_name("Response", NewName("Answer", "1.2")) == "Answer"


@pytest.mark.parametrize("version", ["1.2rc1", "1.2.0", "1.10.0", "2.0.0rc1"])
def test_from_its_release_on_an_old_name_is_an_error_that_names_the_new_one(
    tmp_path, release, version
):
    release(version)
    path = tmp_path / "laboratory.yaml"
    path.write_text("bench: {frequency: 100}")

    with pytest.raises(
        RemovedFieldError, match=r"'bench\.frequency' has another name; write rate_hz"
    ):
        read_yaml(path, Laboratory)
    with pytest.raises(AttributeError, match="write Answer"):
        current_name("Response", NewName("Answer", "1.2"), AttributeError)
