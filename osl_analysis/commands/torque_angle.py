"""Jobs of torque against angle: read a trial, call `bench/torque_angle.py`, write its tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from osl_analysis.bench.plausibility import check_recording, saturated
from osl_analysis.bench.settings import TorqueAngleAnalysis
from osl_analysis.bench.torque_angle import torque_angle_trial
from osl_analysis.bench.torque_angle_tables import curve_table, cycle_table, torque_angle_table, torque_angle_time_base
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import read_trial


def fit_torque_angle_trial(
    trial: Path, settings: TorqueAngleAnalysis, condition: Mapping[str, Any], tables: Mapping[str, Path]
) -> None:
    """Analyse one trial: its rows of `torque_angle`, `torque_angle_curves`, `torque_angle_cycles` and so on.

    `condition` has the name of the curve that the trial should follow, `desired`, or None.

    Raises
    ------
    InputError
        As `torque_angle_trial`, or the configuration has no such curve.
    """
    read, desired = read_trial(trial), condition["desired"]
    check_recording(read, settings)
    rails = saturated(read, "torque", "theta")
    found = torque_angle_trial(read, settings)
    write_table(rails.beside(torque_angle_table(found, desired)), tables["torque_angle"])
    write_table(curve_table(found, desired), tables["torque_angle_curves"])
    write_table(cycle_table(found), tables["torque_angle_cycles"])
    write_table(torque_angle_time_base(found), tables["timebase"])
    write_table(found.series().table(), tables["series"])


def plotted_numbers(curves: Path, table: Path, output: Path) -> None:
    """The numbers of the figure `torque_angle`, from `torque_angle_curves.csv` and `torque_angle.csv`."""
    from osl_analysis.figures.torque_angle import TABLE_COLUMNS, points  # matplotlib, which the fits do without

    write_table(points(read_table(curves, required=TABLE_COLUMNS), read_table(table, ["trial", "doubtful"])), output)
