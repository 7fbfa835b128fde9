"""How many decimal places a number has in print."""

from dataclasses import replace

from osl_analysis.report.headline import HeadlineValue
from osl_analysis.report.headline_text import written_number

ESTIMATE = HeadlineValue(300.12, 299.5, 300.6, "95 %")


def test_a_wider_range_over_amplitudes_leaves_a_number_fewer_places_than_its_interval():
    wide = replace(ESTIMATE, amplitudes_low=280.0, amplitudes_high=320.0)
    narrow = replace(ESTIMATE, amplitudes_low=300.0, amplitudes_high=300.2)

    assert written_number(ESTIMATE).value == "300.1"
    assert written_number(narrow).value == "300.1"
    assert written_number(wide).value == "300"
    assert written_number(wide).interval == "299.5 to 300.6"
