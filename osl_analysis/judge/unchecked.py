"""What could not be checked of the rows of result tables, and what was checked and is worth
knowing."""

import math
from collections.abc import Iterator

from osl_analysis.judge.causes import suspected_unit
from osl_analysis.judge.finding import AnyRow, Finding, Grade, cell_number, subject_of
from osl_analysis.judge.known_findings import known_finding

HAVE_STIFFNESS = ("impedance", "torque_angle")
HAVE_INERTIA = ("impedance", "transmission", "walking_groups")
MEASURED_BY = {"belt": "K_s", "transmission": "B_j", "actuator": "k_tau_n_m"}
"""What a component trial measures. `NAME_ratio` is its ratio to the parameter file's value."""
USUAL_DIFFERENCE = {"K_s": 0.05, "B_j": 0.1, "k_tau_n_m": 0.05}
"""Of a component from its parameter file; most differ by less, of 10 trials of the default belt by
2 %. Data sheets give torque constants to 0.1, which is why more is a remark and no doubt."""
HIDDEN_SHARE = 0.1  # of J_j, by which a delay of two standard errors may change it
LEAST_REST_SHARE = 0.02  # of K, that a weight about another angle may change
USUAL_DAMPING = (0.5, 1.5)  # times B_d, that a controller renders beside friction and delays


def unchecked_in(table: str, row: AnyRow) -> Iterator[Finding]:
    """Find what could not be checked of a row, and what is worth knowing of it.

    Parameters
    ----------
    table : str
        The name of its table.
    row : AnyRow

    Yields
    ------
    Finding
        Of the grades `not checked` and `notes`, in this order.
    """
    for name in unchecked_names(table, row):
        yield finding_in_row(name, table, row, Grade.UNCHECKED)
    yield from remarks_on(table, row)


def finding_in_row(name: str, table: str, row: AnyRow, grade: Grade, about: str = "") -> Finding:
    """A finding without evidence; `about` is a part of the device that its title names."""
    return Finding(
        name=name,
        table=table,
        subject=subject_of(row),
        grade=grade,
        amplitude_deg=cell_number(row, "amplitude_deg"),
        title=known_finding(name).title.format(about=about),
    )


def unchecked_names(table: str, row: AnyRow) -> Iterator[str]:
    """What could not be checked of a row of a table, by name."""
    is_fixture_alone = row.get("rest_deg") is not None
    if lacks(row, "fixture") and not is_fixture_alone:
        yield "fixture_inertia"
    elif table in HAVE_STIFFNESS and row.get("fixture"):
        yield "cross_talk"
    if table == "impedance":
        yield from unchecked_in_impedance(row)
    elif table == "transmission":
        if delay_may_hide(row):
            yield "late_torque_unseen"
    elif table == "torque_angle":
        yield from unchecked_in_torque_angle(row)
    elif table == "walking_groups" and not lacks(row, "K"):
        yield "walking_unseen"
    elif table == "actuator" and lacks(row, "B_m"):
        yield "actuator_at_rest"
    if table in ("belt", "actuator") and lacks(row, f"{MEASURED_BY[table]}_ratio"):
        yield "wrong_gain_unseen"


def remarks_on(table: str, row: AnyRow) -> Iterator[Finding]:
    """What was checked in a row of a table and is worth knowing."""
    quantity = MEASURED_BY.get(table, "")
    ratio = cell_number(row, f"{quantity}_ratio") or 1.0
    usual = USUAL_DIFFERENCE.get(quantity, math.inf)
    if abs(ratio - 1) > usual and not suspected_unit(f"{quantity}_ratio", ratio, row):
        yield finding_in_row("parameter_differs", table, row, Grade.NOTES, about=quantity)
    if table not in HAVE_INERTIA:
        return
    for inertia in ("I", "J_j"):
        if (cell_number(row, f"{inertia}_high") or 0.0) < 0:
            yield finding_in_row("negative_inertia", table, row, Grade.NOTES, about=inertia)


def lacks(row: AnyRow, name: str) -> bool:
    """Whether a row has no value in a column of its table."""
    return name in row and row[name] is None


def unchecked_in_impedance(row: AnyRow) -> Iterator[str]:
    has_commanded = "controller" in row  # a fit with a commanded impedance
    if (cell_number(row, "band_high_hz") or 0.0) > (cell_number(row, "cutoff_hz") or math.inf):
        yield "motion_above_cutoff"
    is_device_known = not lacks(row, "K_over_K_s")
    if has_commanded and lacks(row, "K_predicted") and is_device_known:
        yield "K_of_gains"
    is_not_sought = lacks(row, "fault_probability") and lacks(row, "lag_s")
    if is_not_sought or row.get("delay_told_s") is not None:
        yield "late_torque_unseen"
    if lacks(row, "gain_error"):
        yield "wrong_gain_unseen"
    if lacks(row, "clock_ppm") and row.get("amplitude_deg") is None:
        yield "clock_rate_unseen"
    if weight_by_rest(row) > LEAST_REST_SHARE * abs(cell_number(row, "K") or 0.0):
        yield "zeros_disagree"
    low, high = USUAL_DAMPING
    ratio = cell_number(row, "B_over_B_d")
    if ratio is not None and not low < ratio < high:
        yield "damping_unlike_B_d"


def weight_by_rest(row: AnyRow) -> float:
    """By how much K changes [N*m/rad] if the constant torque of the fit is that of the fixture's
    weight about another angle than is stated: of weight sin(angle), 1 - cos(angle) is not seen."""
    weight, offset = cell_number(row, "fixture_weight"), cell_number(row, "offset")
    if not weight or offset is None:
        return 0.0
    return weight - math.sqrt(max(weight**2 - offset**2, 0.0))


def delay_may_hide(row: AnyRow) -> bool:
    """Whether a delay that the recording does not show may change J_j by a tenth."""
    delay_se_s = cell_number(row, "delay_told_s")
    B_j, J_j = cell_number(row, "B_j"), cell_number(row, "J_j")
    if delay_se_s is None or B_j is None or J_j is None:
        return lacks(row, "fault_probability")
    return abs(B_j) * 2 * delay_se_s > HIDDEN_SHARE * abs(J_j)


def unchecked_in_torque_angle(row: AnyRow) -> Iterator[str]:
    if row.get("other_cycles"):
        yield "left_out_cycles"
    if row.get("zero_unsure") is not None:
        yield "rest_torque"
    if lacks(row, "torque_zero"):
        yield "torque_zero_unseen"
    if row.get("energy_lost") is not None:
        yield "late_torque_unseen"
