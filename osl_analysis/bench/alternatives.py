"""What repeats of a cycle cannot show: another time base, and the uncertainty of the bench's own stiffness."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.settings import BenchStiffness
from osl_analysis.errors import InputError
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import LinearFit, with_shared_error
from osl_analysis.timebase.grid import StreamReport
from osl_analysis.trial import Array
from osl_analysis.uniform import UniformSignals


def joint_angle(theta: Array, torque: Array, compliance: float) -> Array:
    """Angle of the joint (n,) [rad] from that of the bench, whose frame the resisting torque [N*m] winds up. The bench
    turns the joint by its frame, of some `compliance` [rad/(N*m)]: theta_bench = theta + torque/k."""
    return theta - compliance * torque if compliance else theta


def without_drift(time: Array, torque: Array, rate: float) -> Array:
    """The torque (n,) [N*m] at times [s] minus a drift of `rate` [N*m/s]; the mean over all samples is kept."""
    return np.asarray(torque - rate * (time - time.mean()))


def widened(fit: LinearFit, softer: LinearFit | None) -> LinearFit:
    """The fit with the error of the bench's stiffness in its intervals. `softer` is the same fit with a compliance of
    the bench that is one standard error larger; None without one."""
    return fit if softer is None else with_shared_error(fit, softer.estimates - fit.estimates)


def time_base_row(fit: LinearFit, other: LinearFit | None, names: Sequence[str]) -> Row:
    """`time_base_shift`: the largest change of an estimate if undecided stamps were taken the other way. In half-widths
    of its 95 % interval; null where the stamps are decided and there is no `other` fit."""
    if other is None:
        return {"time_base_shift": None}
    half = {name: fit.interval(name)[1] - fit[name] for name in names}
    return {"time_base_shift": max(abs(other[name] - fit[name]) / half[name] for name in names)}


def time_base_words(fit: LinearFit, other: LinearFit | None, names: Sequence[str]) -> str | None:
    """The change of each estimate under the other hypothesis [%], for people."""
    if other is None:
        return None
    return ", ".join(f"{name} {100 * (other[name] / fit[name] - 1):+.2g} %" for name in names)


def check_stiffer(trial: str, symbol: str, stiffness: float, bench: BenchStiffness | None) -> None:
    """Refuse a stiffness [N*m/rad] that is not below that of the bench."""
    if bench is not None and not 0 < stiffness * bench.compliance < 1:
        raise InputError(
            f"trial {trial}: {symbol} = {stiffness:.4g} N*m/rad is not between 0 and the bench's stiffness of "
            f"{bench.value}, so that the frame would yield more than the joint; correct `bench_stiffness` "
            "and its unit in the configuration"
        )


def timebase_table(
    signals: UniformSignals | None, other_hypothesis: str | None, bench: BenchStiffness | None = None
) -> pl.DataFrame:
    """The rows of `timebase.csv` for one trial, a row per stream. `other_hypothesis` says what estimates would become
    if undecided stamps were taken the other way."""
    assert signals is not None  # a trial that was read from a file
    report = signals.report
    shared = {
        "grid_rate_hz": report.rate_hz,
        "first_s": report.first_s,
        "last_s": report.last_s,
        "rows": report.rows,
        "masked": report.masked,
        "farthest_s": report.farthest_s,
        "other_hypothesis": other_hypothesis,
        "bench_stiffness": 1 / bench.compliance if bench else None,
        "bench_stiffness_se": bench.compliance_error / bench.compliance**2 or None if bench else None,
    }
    rows = [{"trial": signals.trial, **stream_row(stream, signals), **shared} for stream in report.streams]
    text, numbers = ("low_pass", "other_hypothesis"), ("ppm", "g", "g_se", "bench_stiffness", "bench_stiffness_se")
    schema = dict.fromkeys(text, pl.String) | dict.fromkeys(numbers, pl.Float64)
    return pl.DataFrame(rows, schema_overrides=schema, infer_schema_length=None)


def stream_row(stream: StreamReport, signals: UniformSignals) -> dict[str, Any]:
    """What the time base found and did in one stream; g is that of the signal that knows it best."""
    known = {name: se for name, se in stream.g_se.items() if se is not None}
    best = min(known, key=lambda name: known[name], default=None)
    filters = [f"{name}: {one}" for name, one in signals.low_passes.items() if name in stream.signals]
    plain = {f.name: getattr(stream, f.name) for f in fields(stream) if f.name not in ("name", "even", "g", "g_se")}
    return {
        **plain,
        "signals": ", ".join(stream.signals),
        "stamps": "even" if stream.even else "exact",
        "g": None if best is None else stream.g[best],
        "g_se": None if best is None else known[best],
        "low_pass": "; ".join(filters) or None,
    }
