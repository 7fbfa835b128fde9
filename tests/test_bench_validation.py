"""The page of bench imperfections: what it says of each, without making it again."""

import importlib.util
import sys
from itertools import pairwise

import pytest
from conftest import ROOT

PAGE = (ROOT / "docs/bench_validation.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def benchmark():
    sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script there
    spec = importlib.util.spec_from_file_location("bench_imperfections", ROOT / "benchmarks/bench_imperfections.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.path.pop(0)
    return module


def test_the_page_has_a_row_for_every_case_and_remedy_none_silently_wrong_and_what_must_be_stated_right_once_it_is(
    benchmark,
):
    for name, (_, cases) in benchmark.TABLES.items():
        rows = PAGE.partition(f"<!-- {name} -->\n")[2].partition("<!-- end -->")[0].splitlines()[2:]
        expected = [
            label for case in cases for label in (case.label, case.remedy and f"… {case.remedy.label}") if label
        ]
        labels = [line.split(" | ")[0].removeprefix("| ") for line in rows]
        assert labels == expected, f"run benchmarks/bench_imperfections.py: {name} is not its table"
        assert [line for line in rows if benchmark.SILENT in line or "| CRASH |" in line] == []
        assert all("| right |" in after for before, after in pairwise(rows) if "must be stated" in before)


def test_a_row_is_judged_by_what_a_reader_accepts_and_by_its_interval(benchmark):
    fit = {"K": 301.0, "K_se": 0.1, "K_low": 300.8, "K_high": 301.2, "doubtful": None}

    def judged(flags=(), **more):
        return benchmark.verdict(benchmark.result_of(fit | more, {"K": 300.0}, list(flags)), None)

    wrong = benchmark.result_of(fit, {"K": 300.0}, [])
    assert wrong.errors["K"] == pytest.approx((1 / 3, 10))
    assert judged() == benchmark.SILENT
    assert judged(doubtful="VAF 80 is below 95") == "doubtful"
    assert judged(["saturation (flag)"]) == "flagged"
    assert judged(K_low=299.9) == "right"
