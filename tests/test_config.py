"""The configuration: an old name is refused with the new one, and the shipped file is valid."""

from pathlib import Path
from typing import Annotated, ClassVar, Literal

import pytest
import yaml
from conftest import ROOT
from pydantic import Field

from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.config.campaign import check_files
from osl_analysis.config.configuration import campaign_config, read_section
from osl_analysis.config.yaml_settings import Settings, read_mapping, read_yaml
from osl_analysis.errors import InputError

SHIPPED_FILE = ROOT / "config/config.yaml"
SHIPPED = yaml.safe_load(SHIPPED_FILE.read_text())
Cycles = Annotated[int, Field(ge=1, le=100)]


class Inner(Settings):
    """Of every kind of field with numbers, and others."""

    RENAMED: ClassVar = {"old": "rate"}
    REMOVED: ClassVar = {"gone": "no recording needed it; delete the line"}
    rate: float = 1.0
    name: str = ""
    sign: Literal[1, -1] = 1
    cycles: Cycles | tuple[Cycles, ...] = 1
    vector: tuple[float, float] = (0, 0)
    limits: dict[str, float | None] = Field(default_factory=dict)
    enabled: bool = False
    either: bool | float = 0.0
    plates: Literal["all"] | tuple[int, ...] = "all"


class Outer(Settings):
    """A file with a section of it."""

    first: int
    inner: Inner = Inner()
    several: tuple[Inner, ...] = ()


TRUTH = "write a number; YAML reads true, yes and on, false, no and off as truth values"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("inner: {old: 1.0}", "line 2: field 'inner.old' is now called 'inner.rate'; rename it"),
        ("inner: {gone: true}", "line 2: field 'inner.gone' is gone: no recording needed it; delete the line"),
        ("inner:\n  rate: true", f"line 3: inner.rate: true is not allowed: {TRUTH}"),
        ("inner:\n  rate: off", "line 3: inner.rate: 'off' is not allowed: write a number, without a unit, with a full "
         "stop as decimal sign"),
        ("inner: {sign: true}", f"line 2: inner.sign: true is not allowed: {TRUTH}"),
        ("inner: {cycles: true}", f"line 2: inner.cycles: true is not allowed: {TRUTH}"),
        ("inner:\n  vector:\n  - 1\n  - false", f"line 5: inner.vector.1: {TRUTH}"),
        ("inner:\n  limits:\n    K: 1\n    B: true", f"line 5: inner.limits.B: {TRUTH}"),
        ("several:\n- rate: 1\n- rate: true", f"line 4: several.1.rate: true is not allowed: {TRUTH}"),
        ("inner: {cycles: 2.5}", "line 2: inner.cycles: 2.5 is not allowed: write a whole number, or a list, as ["),
        ("inner: {cycles: [1, 200]}", "line 2: inner.cycles.1: 200 is not allowed: write a number less than or equal "
         "to 100"),
        ("inner: {plates: [a]}", "line 2: inner.plates.0: 'a' is not allowed: write a whole number"),
        ("inner: 7", "line 2: inner: 7 is not allowed: write its fields below it, as `name: value`; the known ones are "
         "rate, "),
        ("inner: {rate: a, name: 1, sign: 3}", "line 2: inner.rate: 'a' is not allowed: write a number, without a unit,"
         " with a full stop as decimal sign (and 2 more problems)"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_file_is_one_line_with_line_field_value_and_remedy_in_our_words(
    tmp_path: Path, text: str, said: str
) -> None:
    (tmp_path / "a.yaml").write_text(f"first: 1\n{text}")
    with pytest.raises(InputError) as refusal:
        read_yaml(tmp_path / "a.yaml", Outer)
    assert "\n" not in str(refusal.value)
    assert str(refusal.value).removeprefix(f"{tmp_path}/a.yaml: ").startswith(said)


def test_truth_values_are_kept_where_they_are_allowed(tmp_path):
    (tmp_path / "a.yaml").write_text("first: 1\ninner: {enabled: yes, either: true, limits: {K: null}}")
    inner = read_yaml(tmp_path / "a.yaml", Outer).inner
    assert (inner.enabled, inner.either, inner.limits) == (True, True, {"K": None})


@pytest.mark.parametrize(("old", "new"), [("gait", "overground"), ("validation", "study")])
def test_an_old_section_is_refused_and_the_new_one_named(old, new):
    content = dict(SHIPPED)
    content[old] = content.pop(new)
    with pytest.raises(InputError, match=f"config.yaml: field '{old}' is now called '{new}'; rename it"):
        campaign_config(content, [SHIPPED_FILE])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"compare_estimators": True}, r"dynamometer: `compare_estimators` is gone with the estimators"),
        ({"cycles": [10, 20]}, "cycles has 2 numbers for 5 frequencies"),
        ({"cycles": [10, 20, 30, 2, 20]}, "settle_cycles = 2 leaves none of 2 cycles; lower it, at most to 1"),
        ({"seconds_per_frequency": 1.5}, r"settle_cycles = 2 leaves none of 1\.5 cycles"),
    ],
)
def test_a_stepped_sine_has_cycles_for_each_frequency_enough_to_settle_and_no_key_that_is_gone(changed, message):
    with pytest.raises(InputError, match=message):
        campaign_config(SHIPPED | {"dynamometer": SHIPPED["dynamometer"] | changed}, [SHIPPED_FILE])


@pytest.mark.parametrize(
    ("changed", "cycles"),
    [
        ({}, (20, 20, 20, 20, 20)),
        ({"cycles": [10, 15, 20, 25, 30]}, (10, 15, 20, 25, 30)),
        ({"seconds_per_frequency": 10}, (10, 20, 30, 40, 50)),
    ],
)
def test_a_time_per_frequency_replaces_the_cycles(changed, cycles):
    config = campaign_config(SHIPPED | {"dynamometer": SHIPPED["dynamometer"] | changed}, [SHIPPED_FILE])
    assert config.dynamometer.protocol.cycles_at == cycles


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            b"torque: {sign: 1}\nunit: N\ntorque: {sign: -1}\n",
            "line 3: key 'torque' stands twice, first in line 1; rem",
        ),
        (b"a:\n  b: 1\n  c: 2\n  b: 3\n", "line 4: key 'b' stands twice, first in line 2; remove one"),
        (b"a: [1, {b: 1, b: 2}]\n", "line 1: key 'b' stands twice, first in line 1; remove one"),
        ("a: 1\nname: M\xfcnchen\n".encode("latin-1"), "line 2 is not UTF-8; save the file as UTF-8"),
        (b"a: 2026-13-45\n", "not YAML"),
        (b"- 1\n", "has no fields"),
    ],
)
def test_a_file_that_is_no_yaml_of_fields_that_stand_once_is_refused_in_one_line(tmp_path, content, message):
    (tmp_path / "a.yaml").write_bytes(content)
    with pytest.raises(InputError, match=f"a.yaml: {message}") as refusal:
        read_mapping(tmp_path / "a.yaml")
    assert "\n" not in str(refusal.value)
    with pytest.raises(InputError, match=f"a.yaml: {message}"):  # Snakemake merges the files itself
        campaign_config(SHIPPED, [SHIPPED_FILE, tmp_path / "a.yaml"])


def test_equal_keys_of_different_mappings_are_no_duplicates(tmp_path):
    (tmp_path / "a.yaml").write_text("a: {b: 1}\nc: {b: 2}\nd: [{b: 1}, {b: 2}]\n'1': x\n1: y\n")
    assert read_mapping(tmp_path / "a.yaml")["d"] == [{"b": 1}, {"b": 2}]


@pytest.mark.parametrize(
    ("results", "message"),
    [("taken", "taken: is a file; name a folder"), ("taken/below", "taken: is a file"), (None, "results is empty")],
)
def test_results_that_are_a_file_or_nothing_are_one_line_before_any_job(tmp_path, results, message):
    (tmp_path / "taken").write_text("mine")
    changes = {"sheet": tmp_path / "trials.csv", "simulation": None, "results": tmp_path / results if results else ""}
    with pytest.raises(InputError, match=message):
        check_files(campaign_config(SHIPPED | changes, [SHIPPED_FILE]))
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.parametrize(("number", "way"), [("1:30", "sixties"), ("1:30.5", "sixties"), ("010", "eights")])
def test_a_number_that_yaml_1_1_counts_is_text_or_plain_and_refused_where_snakemake_reads_it(tmp_path, number, way):
    """Snakemake hands over 90 and 8. YAML 1.2 has a text and 10."""
    path = tmp_path / "a.yaml"
    for text in (f"a:\n  rate:\n  - {number}\n", f"a:\n  b: [1, 2]\n  rate: {number}\n"):
        path.write_text(text)
        with pytest.raises(InputError, match=rf"a\.yaml: line 3: rate: YAML counts {number} in {way}; write a plain"):
            read_mapping(path, by_snakemake=True)
    assert read_mapping(path)["a"]["rate"] == (number if ":" in number else 10)
    text = f"a: '{number}'\nb: [0, 0.5, 00.5, -0, 1.0e+3, 100]\nc: 2026-11-20 10:30:00\n"
    path.write_text(text)
    assert read_mapping(path, by_snakemake=True) == yaml.safe_load(text)


def test_a_section_that_is_wrong_is_named_with_its_key_and_line_where_it_alone_is_read(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    path = tmp_path / "own.yaml"
    for text, said in (
        (
            "campaign: own\ndynamometer:\n  cutoff_hz: .nan\n",
            r"line 3 of own\.yaml: dynamometer\.cutoff_hz: nan is not ",
        ),
        ("dynamometer:\n  cutof_hz: 3\n", r"unknown field 'dynamometer\.cutof_hz'.*did you mean 'cutoff_hz'"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=said):
            read_section(path, "dynamometer", DynamometerAnalysis)
