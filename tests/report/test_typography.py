"""The report: how numbers and units are printed, and how to read each figure."""

from osl_analysis.report.typography import printed


def test_units_symbols_powers_and_minus_signs_are_set_in_one_way_and_names_are_left():
    said = printed(
        "-0.2 N*m*s/rad, [-720, +1e-07] kg*m^2, `delay`, K_d theta + B_d omega, a-1, theta_m"
    )
    assert said == "−0.2 N·m·s/rad, [−720, +1·10⁻⁷] kg·m², “delay”, K_d θ + B_d ω, a-1, theta_m"
    assert [printed(one) for one in ("1", "N*m/deg", "torque - model")] == [
        "",
        "N·m/deg",
        "torque − model",
    ]
