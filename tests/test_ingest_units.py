"""Units: what laboratories write becomes SI, and nothing else does."""

import contextlib
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from osl_analysis.errors import InputError
from osl_analysis.ingest.units import EXAMPLES, si_factor


@pytest.mark.parametrize(
    ("unit", "expected", "factor"),
    [
        ("deg", "rad", math.pi / 180), ("Degrees", "rad", math.pi / 180), ("º", "rad", math.pi / 180),
        ("rev", "rad", 2 * math.pi), ("rpm", "rad/s", 2 * math.pi / 60), ("%", "1", 0.01), ("mm", "m", 1e-3),
        ("N·mm", "N*m", 1e-3), ("N mm", "N*m", 1e-3), ("Nmm", "N*m", 1e-3), ("mNm", "N*m", 1e-3), ("kN", "N", 1e3),
        ("N*mm/kg", "N*m/kg", 1e-3), ("Nm/kg", "N*m/kg", 1.0), ("N*m/deg", "N*m/rad", 180 / math.pi),
        ("Nms/deg", "N*m*s/rad", 180 / math.pi), ("µs", "s", 1e-6), ("Milliseconds", "s", 1e-3), ("μV", "V", 1e-6),
        (" mA ", "A", 1e-3), ("Amps", "A", 1.0),
    ],
)  # fmt: skip
def test_a_laboratorys_spelling_has_its_factor(unit: str, expected: str, factor: float) -> None:
    assert si_factor(unit, expected) == pytest.approx(factor, rel=1e-15)


def test_every_canonical_unit_is_its_own_si_unit_and_all_that_messages_offer_are_read() -> None:
    assert all(si_factor(unit, unit) == 1.0 for unit in EXAMPLES)
    assert all(si_factor(unit, expected) > 0 for expected, units in EXAMPLES.items() for unit in units)


@pytest.mark.parametrize(
    ("unit", "expected", "told"),
    [
        ("mmm", "m", r"unit 'mmm' is unknown; write one of m, cm, mm"),
        ("Nm", "N*m/rad", r"unit 'Nm' measures \[N\*m\], expected one of N\*m/rad"),  # torque and stiffness differ
        ("deg", "N", r"unit 'deg' measures \[rad\], expected one of N, "),
        (" ", "N", "the unit is empty"),
        ("Mm", "m", r"is 1e\+06 ., an implausible size"),
        ("MN", "N", r"is 1e\+06 ., an implausible size"),
    ],
)
def test_a_unit_that_cannot_be_is_refused_with_what_would_do(unit: str, expected: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        si_factor(unit, expected)


@pytest.mark.parametrize("unit", ["9**9**9**9", "[1]*999", "(m)", "m;n", "m**2", "1e3*m", "m" * 5000, "m*" * 5000])
def test_text_of_a_file_is_never_evaluated(unit: str) -> None:
    with pytest.raises(InputError, match="is unknown"):
        si_factor(unit, "m")


@given(st.text(max_size=20))
@settings(max_examples=300, deadline=None)
def test_any_text_is_a_factor_or_a_sentence(text: str) -> None:
    with contextlib.suppress(InputError):
        assert 0 < si_factor(text, "N*m") < math.inf


@pytest.mark.parametrize("unit", ["grad", "Grad", "N*m/grad", "grads"])
def test_a_unit_that_means_two_things_is_refused_with_what_to_write(unit):
    with pytest.raises(InputError, match=r"gon.*degree.*write `deg`, or `gon`"):
        si_factor(unit, "N*m/rad" if "/" in unit else "rad")
    assert si_factor("gon", "rad") == pytest.approx(0.0157, rel=1e-3)
