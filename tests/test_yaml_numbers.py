"""What stands for a number in YAML is a number, and a message names section, key, line, value and remedy."""

from pathlib import Path
from typing import Annotated, Literal

import pytest
import yaml
from conftest import ROOT
from pydantic import Field

from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.config import read_campaign_section
from osl_analysis.errors import InputError
from osl_analysis.yaml_settings import Settings, read_mapping, read_yaml

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
        read_campaign_section(path, "dynamometer", DynamometerAnalysis)
    path.write_text("dynamometer:\n  cutof_hz: 3\n")
    with pytest.raises(InputError, match=r"unknown field 'dynamometer\.cutof_hz'.*did you mean 'cutoff_hz'"):
        read_campaign_section(path, "dynamometer", DynamometerAnalysis)
