"""What could not be checked on a row of a result table, and what was checked and is to be known, by its columns."""

from collections.abc import Iterator

from osl_analysis.judge.finding import AnyRow, Finding, Grade, cell_number, subject_of

LATENESS = "whether the torque is late"
HAVE_UNCHECKED = ("belt", "transmission", "actuator", "impedance", "human_joint", "torque_angle", "walking_groups")
"""Judged tables of which something may not be checked."""
MUCH_OF_K = 0.02  # share of K that an unknown gain of the plate's moments may change
WIDE, SEEN = 3.0, 0.5  # widths of the interval of K that a reflex leaves open, or may hide within it


def unchecked_in(table: str, row: AnyRow) -> Iterator[Finding]:
    """The findings `not checked` and `notes` about a row of the table of this name."""
    subject = subject_of(row)
    amplitude = cell_number(row, "amplitude_deg")
    names = {
        "impedance": of_impedance,
        "human_joint": of_human_joint,
        "torque_angle": of_torque_angle,
        "walking_groups": of_walking,
    }.get(table)
    for what in [*(names(row) if names else ()), *of_components(table, row)]:
        yield Finding(table, subject, what, Grade.UNCHECKED, amplitude_deg=amplitude)
    for name in ("I", "J_j") if table in ("impedance", "transmission", "walking_groups") else ():
        if (cell_number(row, f"{name}_high") or 0.0) < 0:
            yield Finding(table, subject, f"{name} is certainly negative", Grade.NOTES, amplitude_deg=amplitude)


def lacks(row: AnyRow, name: str) -> bool:
    """Whether a row has no value in a column of its table."""
    return name in row and row[name] is None


def of_human_joint(row: AnyRow) -> Iterator[str]:
    if lacks(row, "lag_s"):
        yield LATENESS
    yield "whether the fixture rubs, or has play"
    yield "whether a linear response is one of K, B and I"


def of_impedance(row: AnyRow) -> Iterator[str]:
    asked = "controller" in row  # a fit that knows a command
    if lacks(row, "K_over_K_s"):
        yield "K against the belt's K_s"
    if asked and lacks(row, "K_predicted"):
        yield "whether K is what the gains should give"
        yield "whether the bench's frame yields"
    if asked and lacks(row, "path_shift") and lacks(row, "lag_s"):
        yield LATENESS
    if row.get("certain_theta_m_lag_s"):
        yield "whether theta_m or B_j is wrong"
    if lacks(row, "K_drift") and lacks(row, "time_shift"):
        yield "whether K changes while it is recorded"
    if (cell_number(row, "clocks") or 1) > 1 and lacks(row, "clock_drift_ppm"):
        yield "whether the clocks of angle and torque drift apart"


def of_components(table: str, row: AnyRow) -> Iterator[str]:
    known = {"belt": "K_s_ratio", "transmission": "B_j_ratio", "actuator": "k_tau_n_m_ratio"}
    if table == "transmission" and lacks(row, "path_shift"):
        yield LATENESS
    if table == "actuator" and lacks(row, "B_m"):
        yield "f_C, f_G, B_m and J_m"
    if table in known and lacks(row, known[table]):
        yield "estimates against those of a parameter file"
    if table == "prediction":
        if row.get("missing_components") is not None:
            yield "prediction by components"
        elif lacks(row, "K_low"):
            yield "the prediction's interval"


def of_torque_angle(row: AnyRow) -> Iterator[str]:
    if row.get("smaller_cycles"):
        yield "cycles that are smaller than the largest"
    if row.get("zero_unsure") is not None:
        yield "whether the torque at rest is the load cell's offset or what hysteresis leaves in the device"
    if lacks(row, "rate_change"):
        yield LATENESS


def of_walking(row: AnyRow) -> Iterator[str]:
    if row.get("K") is None:
        return
    K = cell_number(row, "K") or 0.0
    by_log, error = lacks(row, "plate_K_per_m"), cell_number(row, "moment_error_half")
    if by_log:
        yield LATENESS
    elif lacks(row, "shoe_share"):
        yield "whether K is that of the joint alone"
    per_percent = cell_number(row, "moment_K_per_percent") or 0.0
    if error is not None and abs(100 * error * per_percent) > MUCH_OF_K * abs(K):
        yield "whether the plate's moments are right"
    if lacks(row, "plate_height_m") and not by_log:
        yield "the height of the plate's corners and ORIGIN"
    if lacks(row, "filled_share") and not by_log:
        yield "whether markers were filled before the export"
    if row.get("reflex_delay_ms") is not None and (cell_number(row, "reflex_K_widths") or 0.0) > WIDE:
        yield "how much of K a reflex is"
    if (cell_number(row, "hidden_reflex_K_widths") or 0.0) > SEEN:
        yield "whether a reflex is in K"
    if row.get("hidden_slope_low") is not None:
        yield "whether B holds a change of K with stance"
    if lacks(row, "common_K"):
        yield "whether a voluntary torque or a change of pace is in K"
