"""A trial: the canonical samples of one recording, checked at construction, and its file (Parquet).

Also: which numbers can be a measurement, and the step to which a signal is rounded. A fit refuses a
number that cannot be measured before it overflows, underflows or becomes NaN."""

import json
import math
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property, reduce
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from osl_analysis.errors import InputError, listing
from osl_analysis.files import atomic_path
from osl_analysis.refusal import check_not_refused

# unit of each canonical column; symbols of the paper in brackets
COLUMNS: dict[str, str] = {
    "time": "s",  # [t] as stamped, never goes back
    # [θ_j] joint angle from the bench's or the leg's joint encoder, dorsiflexion positive
    "theta": "rad",
    "theta_m": "rad",  # [θ_m] actuator output angle, after the gear and before the belt
    # [dθ_m/dt] actuator output velocity, for an actuator bench that logs no theta_m
    "omega_m": "rad/s",
    # slow joint angle recorded beside theta; a person's stiffness changes with it
    "theta_slow": "rad",
    "theta_command": "rad",  # [θ_j*] joint angle that the dynamometer was told to follow
    "current": "A",  # [I_q] q-axis motor current
    # [τ] resisting joint torque, -τ_j of Eq. 4; the internal plantarflexion moment
    "torque": "N*m",
    # [τ_m] torque of the actuator at its output, positive if it drives θ_m up (Eq. 1)
    "torque_m": "N*m",
    "K_1": "N*m/rad",  # stiffness gain that the leg applied at the actuator output
    "B_1": "N*m*s/rad",  # damping gain that the leg applied at the actuator output
    "sync": "V",  # synchronisation pulse train, shared by the recorders
    # trigger of the perturbation platform, or command of another perturbing device; rests otherwise
    "trigger": "V",
    "load": "N",  # vertical force of the ground on the foot, for heel strike and toe-off
}

AXES = ("x", "y", "z")
Array = NDArray[np.float64]
# delays of a stretch reflex [ms]; the one that fits best is taken
REFLEX_DELAYS_MS = (30, 35, 40, 45, 50, 55, 60)

# units of columns that exist once per marker, per plate, per side or per additional signal
FAMILIES = {
    re.compile(r"marker_.+_[xyz]", re.DOTALL): "m",  # a label is the laboratory's own
    re.compile(r"plate[1-9][0-9]*_force_[xyz]"): "N",
    re.compile(r"plate[1-9][0-9]*_moment_[xyz]"): "N*m",
    re.compile(r"reference_ankle_moment_(left|right)"): "N*m/kg",
    # another signal that a person's stiffness may change with, such as an EMG
    re.compile(r"signal_\w+"): "1",
}


def marker_columns(label: str) -> tuple[str, str, str]:
    """Columns of one marker's position in the laboratory [m]; NaN where the marker was not seen."""
    return f"marker_{label}_x", f"marker_{label}_y", f"marker_{label}_z"


def plate_columns(plate: int, quantity: str) -> tuple[str, str, str]:
    """Columns of one force plate, counted from 1: ground reaction `force` [N] or `moment` [N*m] on
    the foot, in laboratory axes, for the plate at rest. The moment is about the centre of the
    plate's surface."""
    name = f"plate{plate}_{quantity}"
    return f"{name}_x", f"{name}_y", f"{name}_z"


def counter_column(column: str) -> str:
    """Column with the device's own sample count, for a column whose source file names a
    `counter`."""
    return f"{column}_counter"


def unit_of(column: str) -> str:
    of_family = (unit for pattern, unit in FAMILIES.items() if pattern.fullmatch(column))
    return next(of_family, None) or COLUMNS[column]


# The surface of a force plate. Its corners (4, 3) [m] go round the edge. The first corner lies in
# the quadrant +x, +y of the plate's own axes, as in C3D files.


def own_axes(corners: Array) -> Array:
    """Axes of a plate as columns (3, 3), from its corners (4, 3) [m]: x along corners 2 to 1, z
    normal to the surface; not finite where the corners span no plane."""
    x = corners[0] - corners[1]
    z = np.cross(x, corners[0] - corners[3])
    with np.errstate(invalid="ignore", divide="ignore"):
        x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def plate_axes(corners: Array) -> Array:
    """As `own_axes`, with a normal that points up. x and y may point either way along the edges."""
    axes = own_axes(corners)
    return axes if axes[2, 2] >= 0 else axes * [1.0, -1.0, -1.0]


def beside(points: Array, corners: Array) -> Array:
    """Distance (k,) [m] from the plate to points (k, 2) [m] given in its axes, from its centre; 0
    on the plate."""
    half = (
        np.array([np.linalg.norm(corners[0] - corners[1]), np.linalg.norm(corners[0] - corners[3])])
        / 2
    )
    return np.asarray(np.hypot(*np.maximum(np.abs(points) - half, 0.0).T))


def furthest_outside(points: Array, corners: Array) -> float:
    """Largest distance [m] of points (m, 3) [m] outside the plate with these corners (4, 3) [m]; 0
    if all are on it."""
    away = (points - corners.mean(axis=0)) @ plate_axes(corners)[:, :2]
    return float(beside(away, corners).max(initial=0.0))


def stretches(text: str) -> list[tuple[float, float]]:
    """Parts [s] of a recording, written as `2-30 40-62`. Raises InputError: not in this form, or
    not in time order."""
    parts = [re.fullmatch(r"(\d+\.?\d*)-(\d+\.?\d*)", word) for word in text.split()]
    found = [(float(part[1]), float(part[2])) for part in parts if part]
    if not found or len(found) < len(parts) or any(start >= stop for start, stop in found):
        raise InputError(f"windows '{text}' are not from-to in s; write them as 2-30 40-62")
    if any(start < stop for (_, stop), (start, _) in pairwise(found)):
        raise InputError(
            f"windows '{text}' overlap, or are not in the order of time; write them as 2-30 40-62"
        )
    return found


NAME_KEY = "osl_analysis.trial"
PROVENANCE_KEY = "osl_analysis.provenance"
CHECKSUM_KEY = "osl_analysis.checksum"


@dataclass(frozen=True)
class Trial:
    """Samples of one trial in canonical columns (`COLUMNS`), a row per time stamp. *null*: the
    column has no sample at that time, because its recorder has another rate. *NaN*: the column was
    sampled but has no reading, such as a hidden marker. Raises InputError: no rows, no `time`, or a
    time that goes back or is not finite."""

    name: str
    samples: pl.DataFrame
    provenance: Mapping[str, Any] = field(default_factory=dict)
    clocks: dict[bytes, Any] = field(default_factory=dict, repr=False, compare=False)
    """Cache of the devices' clocks, by their stamps. `signals.samples.take` fills it."""

    def __post_init__(self) -> None:
        if "time" not in self.samples.columns:
            raise InputError(f"trial {self.name}: no column 'time'; map one in the source file")
        if self.samples.is_empty():
            raise InputError(
                f"trial {self.name}: no samples; record the trial again or exclude it in the sheet"
            )
        check_time(self.name, self.samples["time"].to_numpy())

    @property
    def columns(self) -> Sequence[str]:
        return self.samples.columns

    def present(self, column: str) -> NDArray[np.bool_]:
        """Mask (n,) of the rows in which a column was sampled. NaN counts as sampled."""
        self.check_columns(column)
        return self._there[column].to_numpy()

    def sampled(self, *columns: str) -> pl.DataFrame:
        """The rows in which every named column has a sample (NaN counts as one), with `time` [s]
        first."""
        self.check_columns(*columns)
        rows = self.samples[["time", *columns]]
        if not any(one.has_nulls() for one in rows):
            return rows
        there = reduce(lambda one, other: one & other, (self._there[name] for name in columns))
        # faster than a polars query for fifty columns
        return pl.DataFrame([one.filter(there) for one in rows])

    @cached_property
    def _there(self) -> pl.DataFrame:
        """Masks (n,) of the rows in which each column was sampled."""
        return self.samples.select(pl.all().is_not_null())

    def arrays(self, *columns: str) -> list[Array]:
        """The columns of `sampled`, (n,) each."""
        return [rows.to_numpy() for rows in self.sampled(*columns).iter_columns()]

    def signals(self, *columns: str) -> tuple[Array, ...]:
        """The columns of `sampled`, (n,) each. Raises InputError: a column has a NaN."""
        time, *values = self.arrays(*columns)
        for column, found in zip(columns, values, strict=True):
            if np.isnan(found).any():
                raise InputError(
                    f"trial {self.name}: column '{column}' is NaN in {np.isnan(found).sum()} of"
                    f" {len(time)} samples; repair the log or exclude the trial in the sheet"
                )
        return time, *values

    def check_columns(self, *columns: str) -> None:
        """Refuse a column that the trial does not have. The message names similar columns, or else
        the first ones."""
        for column in columns:
            if column not in self.columns:
                near = get_close_matches(column, self.columns, n=6)
                like = f"the nearest of {len(self.columns)} are" if near else "it has"
                raise InputError(
                    f"trial {self.name}: no column '{column}'; map the channel in the source file "
                    f"({like} {listing(near or self.columns, 6)})"
                )


def check_time(name: str, time: Array) -> None:
    """Refuse stamps [s] that are not finite, go back, or span a time that no log can have. Equal
    stamps pass: a logger may print few decimals or write a row twice. The time base handles
    them."""
    if not np.isfinite(time).all():
        raise InputError(
            f"{name}: time is not finite at row {int(np.argmin(np.isfinite(time)))}; repair the log"
        )
    span = float(np.max(np.abs(time), initial=0.0)), float(np.ptp(time)) if len(time) else 0.0
    # later than ns since 1970 taken for s; shorter than any log
    if span[0] > 1e20 or 0 < span[1] < 1e-9:
        raise InputError(
            f"{name}: time reaches {span[0]:.3g} s and spans {span[1]:.3g} s; correct its `unit` in"
            " the source file, take another time source, or, if bytes are damaged or in another"
            " order, copy the file or ingest it again"
        )
    step = np.diff(time)
    if (step < 0).any():
        row, in_order = int(np.argmax(step < 0)), np.diff(np.sort(time))
        why = (
            "the recorder's clock was set back: cut the log there, or take another time source in"
            " the source file"
        )
        late = time[row + 1 :][time[row + 1 :] <= time[row]]
        if np.isin(late, time[: row + 1]).all():
            why = (
                "its stamps stand there already: delete rows that stand twice; where their values"
                " are others, " + why
            )
        elif in_order.min() > 0.5 * in_order.max():
            why = (
                "no stamp is missing, so that rows changed places: sort them by time, or copy the"
                " file again"
            )
        raise InputError(
            f"{name}: time goes from {time[row]:.6f} s to {time[row + 1]:.6f} s at row {row + 1};"
            f" {why}"
        )


def write_trial(trial: Trial, path: Path) -> None:
    """Write the trial completely or not at all. Name, provenance (JSON) and a checksum are in the
    file's metadata."""
    metadata = {NAME_KEY: trial.name, PROVENANCE_KEY: json.dumps(trial.provenance, sort_keys=True)}
    metadata[CHECKSUM_KEY] = checksum_of(trial.samples, *metadata.values())
    with atomic_path(path) as temporary:
        trial.samples.write_parquet(temporary, compression="lz4", metadata=metadata)


def checksum_of(samples: pl.DataFrame, *texts: str) -> str:
    """CRC-32 of texts, column names and values. Parquet itself does not detect a changed value."""
    value = zlib.crc32("\n".join([*texts, *samples.columns]).encode())
    for column in samples.iter_columns():
        value = zlib.crc32(np.ascontiguousarray(column.to_numpy()).view(np.uint8).data, value)
    return f"{value:08x}"


def read_trial(path: Path | str) -> Trial:
    """A trial from the Parquet file of `osl-analysis ingest` or of a campaign
    (`results/trials/NAME.parquet`).

    `trial.samples` is a polars data frame in SI units with a row per time stamp, `trial.provenance`
    says where each column comes from. Raises InputError: the file is missing, or is not Parquet
    that ingest wrote."""
    path = Path(path)
    name, provenance = metadata_of(path)
    with told_as_parquet(path):
        samples = pl.read_parquet(path)
        checksum = checksum_of(samples, name, json.dumps(provenance, sort_keys=True))
        if pl.read_parquet_metadata(path).get(CHECKSUM_KEY, checksum) != checksum:
            raise ValueError("its content is not what was written")
    return Trial(name, samples, provenance)


def metadata_of(path: Path) -> tuple[str, dict[str, Any]]:
    """Name and provenance of a trial without its samples; raises as `read_trial`."""
    check_not_refused(path)
    if not path.is_file():
        raise InputError(f"{path}: no such trial; ingest it first (osl-analysis ingest)")
    with told_as_parquet(path):
        metadata = pl.read_parquet_metadata(path)
        provenance = json.loads(metadata.get(PROVENANCE_KEY, "null"))
        if provenance is None or NAME_KEY not in metadata:
            raise ValueError("Parquet without provenance")
    return metadata[NAME_KEY], provenance


@contextmanager
def told_as_parquet(path: Path) -> Iterator[None]:
    """Turn Polars' error about a file that is not Parquet into an InputError of one line."""
    try:
        yield
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{path}: not what `ingest` wrote ({reason}); ingest the trial again, or make a"
            f" campaign of recordings, as `osl-analysis init FOLDER --from {path.parent}`, which"
            " `osl-analysis run` in that folder fits"
        ) from error


UNIT_FACTORS: dict[str, dict[str, float]] = {
    "torque": {
        "between lbf*ft and N*m": 1.3558,
        "between lbf and N": 4.4482,
        "between lbf*in and N*m": 8.8507,
        "between kgf*m and N*m": 9.8067,
        "between N*m and kgf*cm": 10.1972,
        "between N*cm and N*m": 100.0,
        "between N*mm and N*m": 1000.0,
    },
    "angle": {
        "between rpm and rad/s": 9.5493,
        "between degrees and radians": 57.29577951308232,
        "between mrad and rad": 1000.0,
    },
    "current": {
        "between q-axis currents of equal power and of equal amplitude": 1.224744871391589,
        "between peak and RMS current": 1.4142135623730951,
        "between line and phase": 1.7320508075688772,
        "between mA and A": 1000.0,
    },
}
"""By signal: factors between units, or between ways to state a current, that are often confused."""


def known_factor(
    ratio: float, signals: Sequence[str] = ("torque", "angle"), near: float = 0.08
) -> tuple[str, float]:
    """Name and size of the unit factor of these signals that explains a number `ratio` times too
    large or too small. ("", 1) if none is within `near`, a relative difference."""
    size = max(abs(ratio), 1 / abs(ratio)) if ratio else math.inf
    factors: dict[str, float] = {
        name: x for signal in signals for name, x in UNIT_FACTORS[signal].items()
    }
    name = min(factors, key=lambda known: abs(math.log(size / factors[known])), default="")
    return (name, factors[name]) if name and abs(size / factors[name] - 1) < near else ("", 1.0)


LARGEST_VARIANCE = 1e150  # its square is finite
EXACT_FIT_SHARE = 1e-24
"""Mean square of an exact fit's rounding error, as a share of the mean square of y. The processor
decides whether an exact fit leaves 0 or 1e-16. No result may depend on it."""


def significant(value: float, digits: int = 2) -> str:
    """A number with `digits` significant digits, for a sentence: -720 and 0.00012, never
    -7.2e+02."""
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def check_finite(name: str, values: ArrayLike, limit: float = 1e30, least: float = 0.0) -> None:
    """Refuse numbers, of any shape: one is not finite, one is larger than `limit` in size, or the
    largest is below `least` in size but not 0. `name` is for the message."""
    array = np.asarray(values)
    largest = float(np.abs(array).max(initial=0.0))
    no_sensor = (
        "no sensor gives that; check its channel and unit in the source file, and the bytes of"
        " the log"
    )
    if not np.isfinite(largest):
        row = int(np.argmin(np.isfinite(array).ravel()))
        raise InputError(f"{name} is not finite at sample {row}; repair the log, or cut it there")
    if largest > limit:
        raise InputError(f"{name} reaches {largest:.3g}, more than {limit:g}: {no_sensor}")
    if 0 < largest < least:
        raise InputError(
            f"{name} reaches {largest:.3g}, less than {least:g} and not 0: {no_sensor}"
        )


def check_measured(name: str, values: ArrayLike) -> None:
    """Refuse a signal, of any shape, that no sensor can give: its largest size is above 1e30 or
    below 1e-30 in SI units. No laboratory signal comes near that. Within these limits no estimate
    overflows or underflows: the highest power that one needs is the squared variance of a quotient
    of two signals."""
    check_finite(name, values, least=1e-30)


def rounding_of(y: Array) -> float:
    """Mean square of the residual that rounding leaves in an exact fit to y (n,), in y's unit
    squared; 0 if n is 0."""
    return EXACT_FIT_SHARE * float(y @ y) / len(y) if len(y) else 0.0


def varies(y: Array) -> bool:
    """Whether y (n,) varies by more than its rounding. The computed variance of a constant 0.1 is
    2e-34, not 0."""
    return bool(len(y)) and float(np.var(y)) > rounding_of(y)


SHORT = 0.8  # share of the median length, below which a recording is unusually short


def unusual(lengths: Array) -> tuple[NDArray[np.bool_], float]:
    """Mask (n,) of recordings whose length is below `SHORT` times the median, or above the median /
    `SHORT`; and the median. None is marked if there are only two, or if fewer than 60 % are within
    10 % of the median."""
    usual = float(np.median(lengths))
    are_alike = lengths.size > 2 and np.mean(np.abs(lengths / usual - 1) < 0.1) > 0.6
    return ((lengths < SHORT * usual) | (SHORT * lengths > usual)) & are_alike, usual


def usual_size(values: Array) -> float:
    return float(np.median(np.abs(values)))


def rms(values: Array) -> float:
    """Root of the mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def factor_of(y: Array, x: Array) -> float | None:
    """The factor in y = factor * x + offset, for signals (n,); None if the residual is larger than
    the rounding of both and than 0.1 % of y. Two sensors differ by more, even if one follows the
    other closely."""
    known = np.isfinite(y) & np.isfinite(x) if len(y) == len(x) else np.zeros(0, dtype=bool)
    if np.count_nonzero(known) < 10 or not (np.any(y[known]) and np.any(x[known])):
        return None
    # scaled to 1, squares cannot overflow
    of_y, of_x = (float(np.max(np.abs(one[known]))) for one in (y, x))
    y, x = y[known] / of_y, x[known] / of_x
    if not (varies(y) and varies(x)):
        return None
    y, x = y - y.mean(), x - x.mean()
    factor = float(x @ y) / float(x @ x)
    step_y, step_x = (float(np.median(np.diff(np.unique(one)))) for one in (y, x))
    rounding = 1.2 * math.hypot(step_y, factor * step_x) / math.sqrt(12)
    is_same = rms(y - factor * x) <= max(1e-3 * rms(y), min(rounding, 0.01 * rms(y)))
    return factor * of_y / of_x if is_same else None


def visible_step(values: Array) -> float | None:
    """The step to which a signal (n,) was rounded, in its unit. None if it cannot be seen: more
    than half of the values are distinct, or less than 99 % of their differences are whole numbers
    of steps. None also for a signal that is constant, empty or not finite."""
    if not len(values) or not np.isfinite(values).all():
        return None
    distinct = np.unique(values)
    if not 2 <= len(distinct) <= len(values) // 2:
        return None
    apart = np.diff(distinct)
    # closer values are one value with different rounding errors
    apart = apart[apart > 1e-9 * np.ptp(values)]
    if len(apart) < 2:
        return None
    step = float(np.median(apart[apart < 1.5 * np.min(apart)]))
    off = np.abs(apart / step - np.rint(apart / step))
    return step if float(np.mean(off < 0.02)) >= 0.99 else None
