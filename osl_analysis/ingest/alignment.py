"""The log's clock aligned to motion capture's, by sync edges or else by a signal that both recorded."""

from collections.abc import Sequence

import numpy as np

from osl_analysis.columns import marker_columns
from osl_analysis.errors import InputError
from osl_analysis.ingest.clock import ClockFit, Edges, find_edges, fit_clock
from osl_analysis.ingest.correlation import Course, correlate_clocks
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_fields import SharedAngle
from osl_analysis.trial import Array


def aligned_clock(log: Recording, mocap: Recording, shared: SharedAngle | None) -> tuple[ClockFit, list[str]]:
    """The clock fit, and a warning if the edges of the sync channels could not be used.

    A log that says `clock: common` has the times of motion capture's file.

    In this case the clocks are aligned by correlation: of the angle that motion capture's source file names under
    `shared`, or else of the two sync voltages.

    Raises
    ------
    InputError
        Neither edges nor correlation align the clocks; the message has both reasons.
    """
    if log.facts.get("clock") == "common":
        return common_clock(log, mocap), []
    try:
        return fit_clock(edges_of(log, "log"), edges_of(mocap, "motion capture")), []
    except InputError as error:
        refused = error
    if shared is None and not all("sync" in one.samples.columns for one in (log, mocap)):
        raise refused
    what = f"'{shared.column}' and the angle at marker {shared.markers[1]}" if shared else "the sync level"
    try:
        ours = course_of(log, shared.column if shared else "sync", "log")
        theirs = marker_angle(mocap, shared.markers) if shared else course_of(mocap, "sync", "motion capture")
        fit = correlate_clocks(ours, theirs)
    except InputError as error:
        raise InputError(f"{refused}; cross-correlation of {what} does not align them either: {error}") from error
    return fit, [f"clocks aligned by cross-correlation of {what}, because of the sync edges: {refused}"]


def common_clock(log: Recording, mocap: Recording) -> ClockFit:
    """The clock of a log whose times [s] are those of the capture's file, by the time of each one's first row."""
    starts = [one.facts.get("time", {}).get("start") for one in (log, mocap)]
    if None in starts:
        raise InputError(
            "the log says `clock: common`, but the capture's file states no times, as only TRC does; write `clock: "
            "sync` and map the column sync"
        )
    return ClockFit(starts[0] - starts[1], 0.0, 0.0, 0.0, 0, 0, "common")


def course_of(recording: Recording, column: str, who: str) -> Course:
    """A column over the time of its recorder."""
    if column not in recording.samples.columns:
        raise InputError(f"no column '{column}' from {who}; map the channel in its source file")
    rows = recording.samples.select("time", column).drop_nulls()
    return Course(rows["time"].to_numpy(), rows[column].to_numpy())


def marker_angle(mocap: Recording, labels: Sequence[str]) -> Course:
    """Angle [rad] at the second of three markers, where all of them are seen."""
    absent = [label for label in labels if marker_columns(label)[0] not in mocap.samples.columns]
    if absent:
        raise InputError(f"no marker '{absent[0]}', which `shared` names; correct the source file of motion capture")
    columns = [marker_columns(label) for label in labels]
    seen = mocap.samples.select("time", *(name for three in columns for name in three)).fill_nan(None).drop_nulls()
    first, vertex, last = (seen.select(three).to_numpy() for three in columns)
    return Course(seen["time"].to_numpy(), angle_between(first - vertex, last - vertex))


def angle_between(first: Array, second: Array) -> Array:
    """Angle [rad] between vectors, (n, 3) each."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), (first * second).sum(axis=1)))


def edges_of(recording: Recording, who: str) -> Edges:
    """Edges of a recording's sync channel."""
    if "sync" not in recording.samples.columns:
        raise InputError(
            f"no column 'sync' from {who}: the clocks cannot be aligned; map the channel in its source file"
        )
    rows = recording.samples.select("time", "sync").drop_nulls()
    return find_edges(rows["time"].to_numpy(), rows["sync"].to_numpy())
