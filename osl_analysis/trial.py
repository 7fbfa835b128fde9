"""A trial: the canonical samples of one recording, checked at construction, and its file (Parquet).

Which numbers can be a measurement, and the steps to which signals are rounded: a fit refuses what can be none before it
overflows, vanishes or turns into NaN."""

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
    "theta": "rad",  # [θ_j] joint angle from the bench's or the leg's joint encoder, dorsiflexion positive
    "theta_m": "rad",  # [θ_m] actuator output angle, after the gear and before the belt
    "omega_m": "rad/s",  # [dθ_m/dt] actuator output velocity, for the actuator's own bench where that logs no theta_m
    "theta_slow": "rad",  # slow angle that a person's stiffness changes with, where it was recorded beside theta
    "theta_command": "rad",  # [θ_j*] joint angle that the dynamometer was told to follow
    "current": "A",  # [I_q] q-axis motor current
    "torque": "N*m",  # [τ] resisting joint torque, minus the τ_j of Eq. 4; internal plantarflexion moment
    "torque_m": "N*m",  # [τ_m] torque that the actuator exerts at its output, positive if it drives θ_m up (Eq. 1)
    "K_1": "N*m/rad",  # stiffness gain that the leg applied at the actuator output
    "B_1": "N*m*s/rad",  # damping gain that the leg applied at the actuator output
    "sync": "V",  # synchronisation pulse train, shared by the recorders
    "trigger": "V",  # trigger of the perturbation platform, or command of what else perturbs, which else rests
    "load": "N",  # vertical force of the ground on the foot, for heel strike and toe-off
}

AXES = ("x", "y", "z")
Array = NDArray[np.float64]
REFLEX_DELAYS_MS = (30, 35, 40, 45, 50, 55, 60)  # of a stretch reflex [ms], of which the one that fits best is taken

# units of columns that exist once per marker, plate, side of the laboratory or further signal
FAMILIES = {
    re.compile(r"marker_.+_[xyz]", re.DOTALL): "m",  # a label is the laboratory's own
    re.compile(r"plate[1-9][0-9]*_force_[xyz]"): "N",
    re.compile(r"plate[1-9][0-9]*_moment_[xyz]"): "N*m",
    re.compile(r"reference_ankle_moment_(left|right)"): "N*m/kg",
    re.compile(r"signal_\w+"): "1",  # any other that a person's stiffness may change with, as an EMG
}


def marker_columns(label: str) -> tuple[str, str, str]:
    """Columns of one marker's position in the laboratory [m]; NaN where the marker was not seen."""
    return f"marker_{label}_x", f"marker_{label}_y", f"marker_{label}_z"


def plate_columns(plate: int, quantity: str) -> tuple[str, str, str]:
    """Columns of one force plate, counted from 1: ground reaction `force` [N] or `moment` [N*m] on the foot, in the
    laboratory axes of the plate's resting pose; the moment is about the centre of the surface."""
    name = f"plate{plate}_{quantity}"
    return f"{name}_x", f"{name}_y", f"{name}_z"


def counter_column(column: str) -> str:
    """Column with the device's own count of the samples of a column, where the source file names its `counter`."""
    return f"{column}_counter"


def unit_of(column: str) -> str:
    of_family = (unit for pattern, unit in FAMILIES.items() if pattern.fullmatch(column))
    return next(of_family, None) or COLUMNS[column]


# The surface of a force plate. Its corners (4, 3) [m] go round it; the first lies in the quadrant of +x and +y of its
# own axes, as in C3D files.


def own_axes(corners: Array) -> Array:
    """Axes of a plate as columns (3, 3), from its corners (4, 3) [m]: x along corners 2 to 1, z normal to the surface;
    not finite where the corners span no plane."""
    x = corners[0] - corners[1]
    z = np.cross(x, corners[0] - corners[3])
    with np.errstate(invalid="ignore", divide="ignore"):
        x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def plate_axes(corners: Array) -> Array:
    """The same with a normal that points up; the signs along the edges do not matter."""
    axes = own_axes(corners)
    return axes if axes[2, 2] >= 0 else axes * [1.0, -1.0, -1.0]


def beside(points: Array, corners: Array) -> Array:
    """Distance (k,) [m] by which points (k, 2) [m], from the plate's centre along its axes, lie beside it; 0 on it."""
    half = np.array([np.linalg.norm(corners[0] - corners[1]), np.linalg.norm(corners[0] - corners[3])]) / 2
    return np.asarray(np.hypot(*np.maximum(np.abs(points) - half, 0.0).T))


def furthest_outside(points: Array, corners: Array) -> float:
    """Largest distance [m] by which points (m, 3) [m] lie outside the plate with these corners (4, 3) [m], or 0."""
    away = (points - corners.mean(axis=0)) @ plate_axes(corners)[:, :2]
    return float(beside(away, corners).max(initial=0.0))


def stretches(text: str) -> list[tuple[float, float]]:
    """Stretches [s] of a recording, as `2-30 40-62`; InputError if they are not that, or not in the order of time."""
    parts = [re.fullmatch(r"(\d+\.?\d*)-(\d+\.?\d*)", word) for word in text.split()]
    found = [(float(part[1]), float(part[2])) for part in parts if part]
    if not found or len(found) < len(parts) or any(start >= stop for start, stop in found):
        raise InputError(f"windows '{text}' are not from-to in s; write them as 2-30 40-62")
    if any(start < stop for (_, stop), (start, _) in pairwise(found)):
        raise InputError(f"windows '{text}' overlap, or are not in the order of time; write them as 2-30 40-62")
    return found


NAME_KEY = "osl_analysis.trial"
PROVENANCE_KEY = "osl_analysis.provenance"
CHECKSUM_KEY = "osl_analysis.checksum"


@dataclass(frozen=True)
class Trial:
    """Samples of one trial in canonical columns (`COLUMNS`), a row per time stamp. A *null* means that the column has
    no sample at that time (another recorder's rate). A *NaN* means that it was sampled and nothing was seen (a hidden
    marker). Raises InputError: No rows, no `time`, time that goes back or is not finite."""

    name: str
    samples: pl.DataFrame
    provenance: Mapping[str, Any] = field(default_factory=dict)
    clocks: dict[bytes, Any] = field(default_factory=dict, repr=False, compare=False)
    """The clocks of its devices by their stamps, as `signals.samples.take` finds them, once."""

    def __post_init__(self) -> None:
        if "time" not in self.samples.columns:
            raise InputError(f"trial {self.name}: no column 'time'; map one in the source file")
        if self.samples.is_empty():
            raise InputError(f"trial {self.name}: no samples; record the trial again or exclude it in the sheet")
        check_time(self.name, self.samples["time"].to_numpy())

    @property
    def columns(self) -> Sequence[str]:
        return self.samples.columns

    def present(self, column: str) -> NDArray[np.bool_]:
        """Rows (n,) in which a column was sampled; NaN, a value that is missing there, counts."""
        self.check_columns(column)
        return self._there[column].to_numpy()

    def sampled(self, *columns: str) -> pl.DataFrame:
        """The rows in which every named column has a sample (NaN counts as one), with `time` [s] first."""
        self.check_columns(*columns)
        rows = self.samples[["time", *columns]]
        if not any(one.has_nulls() for one in rows):
            return rows
        there = reduce(lambda one, other: one & other, (self._there[name] for name in columns))
        return pl.DataFrame([one.filter(there) for one in rows])  # a query takes longer, for each of fifty columns

    @cached_property
    def _there(self) -> pl.DataFrame:
        """Rows (n,) in which each column was sampled, as bits."""
        return self.samples.select(pl.all().is_not_null())

    def arrays(self, *columns: str) -> list[Array]:
        """The columns of `sampled`, (n,) each."""
        return [rows.to_numpy() for rows in self.sampled(*columns).iter_columns()]

    def signals(self, *columns: str) -> tuple[Array, ...]:
        """The columns of `sampled`, (n,) each; one with a NaN is refused."""
        time, *values = self.arrays(*columns)
        for column, found in zip(columns, values, strict=True):
            if np.isnan(found).any():
                raise InputError(
                    f"trial {self.name}: column '{column}' is NaN in {np.isnan(found).sum()} of {len(time)} samples; "
                    "repair the log or exclude the trial in the sheet"
                )
        return time, *values

    def check_columns(self, *columns: str) -> None:
        """Refuse a column that the trial does not have, and name those that are like it, or the first ones."""
        for column in columns:
            if column not in self.columns:
                near = get_close_matches(column, self.columns, n=6)
                like = f"the nearest of {len(self.columns)} are" if near else "it has"
                raise InputError(
                    f"trial {self.name}: no column '{column}'; map the channel in the source file "
                    f"({like} {listing(near or self.columns, 6)})"
                )


def check_time(name: str, time: Array) -> None:
    """Refuse stamps [s] that are not finite, go back, or span no time that a clock can tell. Equal stamps are allowed:
    a logger printed few decimals or wrote a row twice. The time base handles them."""
    if not np.isfinite(time).all():
        raise InputError(f"{name}: time is not finite at row {int(np.argmin(np.isfinite(time)))}; repair the log")
    span = float(np.max(np.abs(time), initial=0.0)), float(np.ptp(time)) if len(time) else 0.0
    if span[0] > 1e20 or 0 < span[1] < 1e-9:  # later than ns since 1970 taken for s; shorter than any log
        raise InputError(
            f"{name}: time reaches {span[0]:.3g} s and spans {span[1]:.3g} s; correct its `unit` in the source file, "
            "take another time source, or, if bytes are damaged or in another order, copy the file or ingest it again"
        )
    step = np.diff(time)
    if (step < 0).any():
        row, in_order = int(np.argmax(step < 0)), np.diff(np.sort(time))
        why = "the recorder's clock was set back: cut the log there, or take another time source in the source file"
        late = time[row + 1 :][time[row + 1 :] <= time[row]]
        if np.isin(late, time[: row + 1]).all():
            why = "its stamps stand there already: delete rows that stand twice; where their values are others, " + why
        elif in_order.min() > 0.5 * in_order.max():
            why = "no stamp is missing, so that rows changed places: sort them by time, or copy the file again"
        raise InputError(f"{name}: time goes from {time[row]:.6f} s to {time[row + 1]:.6f} s at row {row + 1}; {why}")


def write_trial(trial: Trial, path: Path) -> None:
    """Write the trial completely or not at all. Name, provenance (JSON) and a checksum are in the file's metadata."""
    metadata = {NAME_KEY: trial.name, PROVENANCE_KEY: json.dumps(trial.provenance, sort_keys=True)}
    metadata[CHECKSUM_KEY] = checksum_of(trial.samples, *metadata.values())
    with atomic_path(path) as temporary:
        trial.samples.write_parquet(temporary, compression="lz4", metadata=metadata)


def checksum_of(samples: pl.DataFrame, *texts: str) -> str:
    """CRC-32 of texts, and names and values of columns: Parquet does not tell that a value has changed."""
    value = zlib.crc32("\n".join([*texts, *samples.columns]).encode())
    for column in samples.iter_columns():
        value = zlib.crc32(np.ascontiguousarray(column.to_numpy()).view(np.uint8).data, value)
    return f"{value:08x}"


def read_trial(path: Path | str) -> Trial:
    """A trial from the Parquet file of `osl-analysis ingest` or of a campaign (`results/trials/NAME.parquet`).

    `trial.samples` is a polars data frame in SI units with a row per time stamp, `trial.provenance` says where each
    column comes from. Raises InputError: the file is missing, or is not Parquet that ingest wrote."""
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
    """What Polars says of a file that is not Parquet, in one line."""
    try:
        yield
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{path}: not what `ingest` wrote ({reason}); ingest the trial again, or make a campaign of recordings, as "
            f"`osl-analysis init FOLDER --from {path.parent}`, which `osl-analysis run` in that folder fits"
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
"""Between units, and between ways to state a current, that are taken for one another, by the signal that has them."""


def known_factor(ratio: float, signals: Sequence[str] = ("torque", "angle"), near: float = 0.08) -> tuple[str, float]:
    """The factor between two units of some signals that may make a number `ratio` times too large, and its size; ("",
    1) if none is `near`."""
    size = max(abs(ratio), 1 / abs(ratio)) if ratio else math.inf
    factors: dict[str, float] = {name: x for signal in signals for name, x in UNIT_FACTORS[signal].items()}
    name = min(factors, key=lambda known: abs(math.log(size / factors[known])), default="")
    return (name, factors[name]) if name and abs(size / factors[name] - 1) < near else ("", 1.0)


LARGEST_VARIANCE = 1e150  # its square is finite
EXACT_FIT_SHARE = 1e-24
"""Mean square of the rounding error of an exact fit, as a share of that of y. Whether an exact fit leaves 0 or 1e-16
depends on the processor's kernels; nothing may depend on which."""


def significant(value: float, digits: int = 2) -> str:
    """A number with so many significant digits for a sentence: -720 and 0.00012, never -7.2e+02."""
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def check_finite(name: str, values: ArrayLike, limit: float = 1e30, least: float = 0.0) -> None:
    """Refuse numbers, of any shape, of which one is not finite or beyond the limit, or all are below `least` without
    being 0 throughout. `name` is for the message."""
    array = np.asarray(values)
    largest = float(np.abs(array).max(initial=0.0))
    no_sensor = "no sensor gives that; check its channel and unit in the source file, and the bytes of the log"
    if not np.isfinite(largest):
        row = int(np.argmin(np.isfinite(array).ravel()))
        raise InputError(f"{name} is not finite at sample {row}; repair the log, or cut it there")
    if largest > limit:
        raise InputError(f"{name} reaches {largest:.3g}, more than {limit:g}: {no_sensor}")
    if 0 < largest < least:
        raise InputError(f"{name} reaches {largest:.3g}, less than {least:g} and not 0: {no_sensor}")


def check_measured(name: str, values: ArrayLike) -> None:
    """Refuse a signal, of any shape, that no sensor can have given. In SI units no signal of a laboratory comes near
    1e30 or 1e-30, and within them a squared variance of a quotient of two signals, the largest power that any estimate
    needs, neither overflows nor vanishes."""
    check_finite(name, values, least=1e-30)


def rounding_of(y: Array) -> float:
    """Mean square of what rounding alone leaves of an exact fit to y (n,), in its squared unit; 0 for no samples."""
    return EXACT_FIT_SHARE * float(y @ y) / len(y) if len(y) else 0.0


def varies(y: Array) -> bool:
    """Whether y (n,) varies by more than its rounding. A constant 0.1 has a variance of 2e-34, not of 0."""
    return bool(len(y)) and float(np.var(y)) > rounding_of(y)


def median(values: Array) -> float:
    """That of `numpy.median` for numbers (n,), n > 0, none of them NaN, in a third of its time: one place is selected,
    and the largest number before it stands beside it."""
    middle, is_even = len(values) // 2, len(values) % 2 == 0
    selected = np.partition(values, middle)
    low = np.max(selected[:middle]) if is_even else selected[middle]
    return float(low + selected[middle]) / 2


SHORT = 0.8  # of the usual length of recordings


def unusual(lengths: Array) -> tuple[NDArray[np.bool_], float]:
    """Which of some recordings are shorter than `SHORT` times the median of their lengths (n,), or longer by as much,
    and the median; none of two, or unless two in three are within a tenth of it."""
    usual = median(lengths)
    are_alike = lengths.size > 2 and np.mean(np.abs(lengths / usual - 1) < 0.1) > 0.6
    return ((lengths < SHORT * usual) | (SHORT * lengths > usual)) & are_alike, usual


def usual_size(values: Array) -> float:
    return median(np.abs(values))


def rms(values: Array) -> float:
    """Root of the mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def factor_of(y: Array, x: Array) -> float | None:
    """The factor by which y (n,) is another signal x (n,), but for an offset and the rounding of both, or a thousandth
    of y; None if it is not. What two sensors measure differs by more, even if one follows the other closely."""
    known = np.isfinite(y) & np.isfinite(x) if len(y) == len(x) else np.zeros(0, dtype=bool)
    if np.count_nonzero(known) < 10 or not (np.any(y[known]) and np.any(x[known])):
        return None
    of_y, of_x = (float(np.max(np.abs(one[known]))) for one in (y, x))  # squares of any signal then are numbers
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
    """The step to which a signal (n,) was rounded, in its unit, between distinct values. None if it is not seen (more
    than half of the values are distinct, or less than 99 % of the differences are a whole number of steps), and for a
    signal that is constant, empty or not finite."""
    if not len(values) or not np.isfinite(values).all():
        return None
    distinct = np.unique(values)
    if not 2 <= len(distinct) <= len(values) // 2:
        return None
    apart = np.diff(distinct)
    apart = apart[apart > 1e-9 * np.ptp(values)]  # nearer ones are one, converted with another error
    if len(apart) < 2:
        return None
    step = float(np.median(apart[apart < 1.5 * np.min(apart)]))
    off = np.abs(apart / step - np.rint(apart / step))
    return step if float(np.mean(off < 0.02)) >= 0.99 else None
