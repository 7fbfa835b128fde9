"""Units: what laboratories write becomes SI, and nothing else does."""

import math

import pytest

from osl_analysis.errors import InputError
from osl_analysis.ingest.units import SPELLINGS, normalised, si_factor


@pytest.mark.parametrize(
    ("unit", "expected", "factor"),
    [
        ("deg", "rad", math.pi / 180),
        ("mm", "m", 1e-3),
        ("N·mm", "N*m", 1e-3),
        ("N.mm", "N*m", 1e-3),
        ("N mm", "N*m", 1e-3),
        ("Nmm", "N*m", 1e-3),
        ("ntmm", "N*m", 1e-3),
        ("kN", "N", 1e3),
        ("N*mm/kg", "N*m/kg", 1e-3),
        ("N*m/deg", "N*m/rad", 180 / math.pi),
        ("µs", "s", 1e-6),
        ("μV", "V", 1e-6),
        (" mA ", "A", 1e-3),
        ("rpm", "rad/s", 2 * math.pi / 60),
    ],
)
def test_a_laboratorys_spelling_has_its_factor(unit: str, expected: str, factor: float) -> None:
    assert si_factor(unit, expected) == pytest.approx(factor, rel=1e-15)


def test_every_canonical_unit_is_its_own_si_unit() -> None:
    assert all(si_factor(unit, unit) == 1.0 for unit in SPELLINGS)


def test_every_known_spelling_is_reached_through_normalisation() -> None:
    assert all(normalised(spelling) == spelling for spellings in SPELLINGS.values() for spelling in spellings)


def test_an_unknown_unit_is_refused_with_what_would_do() -> None:
    with pytest.raises(InputError, match=r"unit 'furlong' is unknown; write one of m, cm, mm"):
        si_factor("furlong", "m")


def test_an_empty_unit_is_refused() -> None:
    with pytest.raises(InputError, match="the unit is empty"):
        si_factor(" ", "N")


def test_a_unit_of_another_dimension_is_refused_with_its_dimension() -> None:
    with pytest.raises(InputError, match=r"unit 'deg' measures \[rad\], expected one of N, "):
        si_factor("deg", "N")
