# SPDX-License-Identifier: Apache-2.0
"""benchmarks/mutants.py on a package of a few lines."""

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script there
import mutants

sys.path.pop(0)

ARITHMETIC = """\
LARGEST = 3


def total(values):
    result = 0
    for value in values:
        result += value
    return result


def ratio(part, whole):
    return part / whole


def untested(a):
    return -a
"""
ROOM_TEST = """\
from osl_analysis.tiny.arithmetic import total


def test_a_total_is_the_sum():
    assert total([1, 2]) == 3
"""
OTHER_TEST = """\
from osl_analysis.tiny import arithmetic


def test_a_half_is_half_of_one():
    assert arithmetic.ratio(1, 2) == 0.5
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A repository with one room, of which another room tests a part."""
    root = tmp_path / "project"
    files = {
        "osl_analysis/__init__.py": "",
        "osl_analysis/tiny/__init__.py": "",
        "osl_analysis/tiny/arithmetic.py": ARITHMETIC,
        "tests/tiny/test_arithmetic.py": ROOM_TEST,
        "tests/other/test_ratio.py": OTHER_TEST,
    }
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=root, check=True)
    subprocess.run(["git", "add", "-A"], cwd=root, check=True)
    return root


@pytest.mark.parametrize(
    ("source", "kind", "change"),
    [
        ("y = a + b", "sign", "a + b → ((a) - (b))"),
        ("y = a + b", "contribution", "a + b → (a)"),
        ("y = -a", "sign", "-a → a"),
        ("y = 2 * a", "factor", "2 * a → (a)"),
        ("y = a / b", "factor", "a / b → ((a) * (b))"),
        ("if a > b:\n    y = 1", "guard", "a > b → False"),
        ("y = a and b", "guard", "a and b → (a)"),
        ("y = f(a, b, c)", "arguments", "a, b → b, a"),
        ("y = a > 0.5", "threshold", "0.5 → (2 * 0.5)"),
        ("class Limits:\n    largest: float = 3.0", "threshold", "3.0 → (2 * 3.0)"),
        ("LARGEST = 3", "threshold", "3 → (2 * 3)"),
        ("y += a", "contribution", "y += a → pass"),
        ("rows.append(a)", "contribution", "rows.append(a) → pass"),
        ("é = 'μ'; y = -a", "sign", "-a → a"),
    ],
)
def test_a_mutant_of_each_kind_is_made_of_its_syntax(tmp_path, source, kind, change):
    (tmp_path / "module.py").write_text(source, "utf-8")
    module = mutants.Module(tmp_path, "module.py")

    (mutant,) = [mutant for mutant in module.mutants() if mutant.kind == kind]

    assert mutant.change == change
    before, after = source.encode(), mutant.apply(source.encode())
    assert after == before.replace(mutant.before.encode(), mutant.after.encode())


@pytest.mark.parametrize(
    "source",
    [
        "y = 'a' + b",
        "y = [a] * n",
        "y = max(a, b)",
        "def f(a: -1) -> -1: pass",
        "raise ValueError(f'{-a}', -a)",
        "if a:\n    y = 1\nelse:\n    y = 2",
        "y = a == 0",
    ],
)
def test_words_lists_and_what_changes_nothing_have_no_mutant(tmp_path, source):
    (tmp_path / "module.py").write_text(source)

    assert [*mutants.Module(tmp_path, "module.py").mutants()] == []


def test_a_seed_draws_the_same_mutants_again_each_of_another_line(project):
    def drawn(seed: int) -> list[mutants.Mutant]:
        return mutants.drawn_mutants(project, "tiny", seed, 3)

    lines = [mutant.line for mutant in drawn(1)]

    assert drawn(1) == drawn(1)
    assert len(set(lines)) == 3
    assert any(drawn(seed) != drawn(1) for seed in range(2, 6))


def test_a_mutant_dies_in_its_room_or_elsewhere_or_lives_or_is_equivalent(
    project, tmp_path, monkeypatch
):
    listed = tmp_path / "equivalent.yaml"
    listed.write_text(
        "- file: osl_analysis/tiny/arithmetic.py\n"
        "  change: 3 → (2 * 3)\n"
        "  reason: nothing uses it\n"
    )
    monkeypatch.setattr(mutants, "EQUIVALENT", listed)

    rows = [*mutants.Plan(root=project, seed=1, rooms=["tiny"], copies=1).rows()]

    outcomes = {row.mutant.line: (row.outcome, row.test) for row in rows}
    assert outcomes == {
        1: ("equivalent", "nothing uses it"),
        7: ("room", "tests/tiny/test_arithmetic.py::test_a_total_is_the_sum"),
        12: ("suite", "tests/other/test_ratio.py::test_a_half_is_half_of_one"),
        16: ("alive", ""),
    }
    assert (project / "osl_analysis/tiny/arithmetic.py").read_text() == ARITHMETIC
    assert "Of 3 mutants 1 die in their room, 2 in all that was run." in mutants.table(rows)


def test_a_room_whose_tests_fail_without_a_fault_is_refused(project):
    (project / "tests/tiny/test_arithmetic.py").write_text("def test_it():\n    assert False\n")

    with pytest.raises(SystemExit, match=r"tiny: .*test_it fails without a fault"):
        next(mutants.Plan(root=project, seed=1, rooms=["tiny"], copies=1).rows())


def test_a_mutant_that_hangs_is_dead(project):
    (project / "tests/tiny/test_arithmetic.py").write_text(
        "import time\n\n\ndef test_it():\n    time.sleep(60)\n"
    )

    death = mutants.run_tests(project, ["tests/tiny"], limit_s=0.5)

    assert death.test == "(hangs)"
    assert death.duration_s < 30
