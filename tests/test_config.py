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
from osl_analysis.config.yaml_settings import Settings, read_mapping, read_yaml, validated
from osl_analysis.errors import InputError

SHIPPED_FILE = ROOT / "config/config.yaml"
SHIPPED = yaml.safe_load(SHIPPED_FILE.read_text())


class Renaming(Settings):
    RENAMED: ClassVar = {"old": "new"}
    REMOVED: ClassVar = {"gone": "no recording needed it; delete the line"}
    new: float


class WithRenaming(Settings):
    inner: Renaming


@pytest.mark.parametrize(("old", "new"), [("gait", "overground"), ("validation", "study")])
def test_an_old_section_is_refused_and_the_new_one_named(old, new):
    content = dict(SHIPPED)
    content[old] = content.pop(new)
    with pytest.raises(InputError, match=f"config.yaml: field '{old}' is now called '{new}'; rename it"):
        campaign_config(content, [SHIPPED_FILE])


def test_an_old_field_within_a_section_is_named_with_its_place():
    with pytest.raises(InputError, match=r"field 'inner\.old' is now called 'inner\.new'; rename it"):
        validated({"inner": {"old": 1.0}}, WithRenaming, ROOT)
    with pytest.raises(InputError, match=r"field 'inner\.gone' is gone: no recording needed it; delete the line$"):
        validated({"inner": {"new": 1.0, "gone": True}}, WithRenaming, ROOT)


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


def test_a_time_per_frequency_replaces_the_cycles():
    def cycles(**changed):
        config = campaign_config(SHIPPED | {"dynamometer": SHIPPED["dynamometer"] | changed}, [SHIPPED_FILE])
        return config.dynamometer.protocol.cycles_at

    assert cycles() == (20, 20, 20, 20, 20)
    assert cycles(cycles=[10, 15, 20, 25, 30]) == (10, 15, 20, 25, 30)
    assert cycles(seconds_per_frequency=10) == (10, 20, 30, 40, 50)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("torque: {sign: 1}\nunit: N\ntorque: {sign: -1}\n", "line 3: key 'torque' stands twice, first in line 1"),
        ("a:\n  b: 1\n  c: 2\n  b: 3\n", "line 4: key 'b' stands twice, first in line 2"),
        ("a: [1, {b: 1, b: 2}]\n", "line 1: key 'b' stands twice, first in line 1"),
    ],
)
def test_a_key_that_stands_twice_is_refused_with_both_lines(tmp_path, text, message):
    (tmp_path / "source.yaml").write_text(text)
    with pytest.raises(InputError, match=f"source.yaml: {message}; remove one"):
        read_mapping(tmp_path / "source.yaml")
    with pytest.raises(InputError, match=f"source.yaml: {message}"):  # Snakemake merges the files itself
        campaign_config(SHIPPED, [SHIPPED_FILE, tmp_path / "source.yaml"])


def test_equal_keys_of_different_mappings_are_no_duplicates(tmp_path):
    (tmp_path / "a.yaml").write_text("a: {b: 1}\nc: {b: 2}\nd: [{b: 1}, {b: 2}]\n'1': x\n1: y\n")
    assert read_mapping(tmp_path / "a.yaml")["d"] == [{"b": 1}, {"b": 2}]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a: 1\nname: M\xfcnchen\n".encode("latin-1"), "line 2 is not UTF-8; save the file as UTF-8"),
        (b"a: 2026-13-45\n", "not YAML"),
        (b"- 1\n", "has no fields"),
    ],
)
def test_a_file_that_is_no_yaml_of_fields_is_refused_in_one_line(tmp_path, content, message):
    (tmp_path / "a.yaml").write_bytes(content)
    with pytest.raises(InputError, match=message) as refusal:
        read_mapping(tmp_path / "a.yaml")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("results", "message"),
    [("taken", "taken: is a file; name a folder"), ("taken/below", "taken: is a file"), (None, "results is empty")],
)
def test_results_that_are_a_file_or_nothing_are_one_line_before_any_job(tmp_path, results, message):
    (tmp_path / "taken").write_text("mine")
    (tmp_path / "trials.csv").write_text("trial,experiment,log,log_source\nb,belt,b.mcap,dynamometer\n")
    changes = {"sheet": tmp_path / "trials.csv", "simulation": None, "results": tmp_path / results if results else ""}
    with pytest.raises(InputError, match=message):
        check_files(campaign_config(SHIPPED | changes, [SHIPPED_FILE]))
    assert (tmp_path / "taken").read_text() == "mine"


Cycles = Annotated[int, Field(ge=1, le=100)]


class Inner(Settings):
    """Of every kind of field with numbers, and others."""

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


def refused(tmp_path: Path, text: str) -> str:
    """What is said to a file, without its name."""
    path = tmp_path / "a.yaml"
    path.write_text(f"first: 1\n{text}")
    with pytest.raises(InputError) as said:
        read_yaml(path, Outer)
    assert "\n" not in str(said.value)
    return str(said.value).removeprefix(f"{path}: ")


TRUTH = "write a number; YAML reads true, yes and on, false, no and off as truth values"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("inner:\n  rate: true", f"line 3: inner.rate: true is not allowed: {TRUTH}"),
        (
            "inner:\n  rate: off",
            "line 3: inner.rate: 'off' is not allowed: write a number, without a unit, with a full stop as "
            "decimal sign",
        ),
        ("inner: {sign: true}", f"line 2: inner.sign: true is not allowed: {TRUTH}"),
        ("inner: {cycles: true}", f"line 2: inner.cycles: true is not allowed: {TRUTH}"),
        ("inner:\n  vector:\n  - 1\n  - false", f"line 5: inner.vector.1: {TRUTH}"),
        ("inner:\n  limits:\n    K: 1\n    B: true", f"line 5: inner.limits.B: {TRUTH}"),
        ("several:\n- rate: 1\n- rate: true", f"line 4: several.1.rate: true is not allowed: {TRUTH}"),
    ],
)
def test_a_truth_value_is_no_number(tmp_path, text, said):
    assert refused(tmp_path, text) == said


def test_truth_values_are_kept_where_they_are_allowed(tmp_path):
    (tmp_path / "a.yaml").write_text("first: 1\ninner: {enabled: yes, either: true, limits: {K: null}}")
    inner = read_yaml(tmp_path / "a.yaml", Outer).inner
    assert (inner.enabled, inner.either, inner.limits) == (True, True, {"K": None})


@pytest.mark.parametrize(("number", "way"), [("1:30", "sixties"), ("1:30.5", "sixties"), ("010", "eights")])
def test_a_number_that_yaml_1_1_counts_is_text_or_plain_and_refused_where_snakemake_reads_it(tmp_path, number, way):
    """Snakemake hands over 90 and 8. YAML 1.2 has a text and 10."""
    text = f"a:\n  b: [1, 2]\n  rate: {number}\n"
    (tmp_path / "a.yaml").write_text(text)
    (tmp_path / "list.yaml").write_text(f"a:\n  rate:\n  - {number}\n")
    for name in ("a", "list"):
        said = rf"{name}\.yaml: line 3: rate: YAML counts {number} in {way}; write a plain"
        with pytest.raises(InputError, match=said):
            read_mapping(tmp_path / f"{name}.yaml", by_snakemake=True)
    assert read_mapping(tmp_path / "a.yaml")["a"]["rate"] == (number if ":" in number else 10)
    text = f"a: '{number}'\nb: [0, 0.5, 00.5, -0, 1.0e+3, 100]\nc: 2026-11-20 10:30:00\n"
    (tmp_path / "good.yaml").write_text(text)
    assert read_mapping(tmp_path / "good.yaml", by_snakemake=True) == yaml.safe_load(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("inner: {cycles: 2.5}", "inner.cycles: 2.5 is not allowed: write a whole number, or a list, as [first, "),
        ("inner: {cycles: [1, 200]}", "inner.cycles.1: 200 is not allowed: write a number less than or equal to 100"),
        ("inner: {plates: [a]}", "inner.plates.0: 'a' is not allowed: write a whole number"),
        ("inner: 7", "inner: 7 is not allowed: write its fields below it, as `name: value`; the known ones are rate, "),
        ("inner: {rate: a, name: 1, sign: 3}", "inner.rate: 'a' is not allowed: write a number, without a unit, with a "
         "full stop as decimal sign (and 2 more problems)"),
    ],
)  # fmt: skip
def test_no_words_of_the_library_that_validates_reach_a_message(tmp_path, text, said):
    assert refused(tmp_path, text).startswith(f"line 2: {said}")


def test_a_section_that_is_wrong_is_named_with_its_key_and_line(tmp_path, monkeypatch):
    """Where one section alone is read, too."""
    monkeypatch.chdir(ROOT)
    path = tmp_path / "own.yaml"
    path.write_text("campaign: own\ndynamometer:\n  cutoff_hz: .nan\n")
    with pytest.raises(
        InputError, match=r"line 3 of own\.yaml: dynamometer\.cutoff_hz: nan is not allowed: write a fin"
    ):
        read_section(path, "dynamometer", DynamometerAnalysis)
    path.write_text("dynamometer:\n  cutof_hz: 3\n")
    with pytest.raises(InputError, match=r"unknown field 'dynamometer\.cutof_hz'.*did you mean 'cutoff_hz'"):
        read_section(path, "dynamometer", DynamometerAnalysis)
