"""The models of each format's source files. What is read by a source file is a `Recording`."""

# mypy: implicit-reexport

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise, product
from typing import Annotated, Any, Literal, Self

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, PositiveInt, model_validator

from osl_analysis.errors import InputError
from osl_analysis.old_formats.csv_table import MISSING
from osl_analysis.old_formats.mat import checked_address
from osl_analysis.old_formats.table import Ledger, noise_in
from osl_analysis.signals import run_edges
from osl_analysis.source_file import (  # noqa: F401 (until the old modules go)
    LEVEL_UNIT,
    Axes,
    Channel,
    ColumnChannel,
    ColumnName,
    ColumnTime,
    Conversion,
    Corner,
    ExportedPlate,
    FieldChannel,
    InAxes,
    LaboratorySource,
    LogChannel,
    LogSource,
    MarkerSource,
    MessageChannel,
    MessageSource,
    MessageTime,
    Name,
    PlateUnits,
    RowTime,
    SharedAngle,
    Source,
    TableSource,
    Time,
    all_none_or_list,
)
from osl_analysis.trial import Array, median, unit_of
from osl_analysis.units import LengthUnit, TimeUnit, Unit
from osl_analysis.yaml_settings import misplaced

AddressText = Annotated[str, AfterValidator(checked_address)]


class OpenSimChannel(ColumnChannel):
    unit: Unit  # Unit of the numbers, as laboratories spell it.


class VariableChannel(LogChannel):
    ADDRESS = "variable"
    variable: AddressText
    """Its address in MATLAB's notation: `torque`, `Test.run(2).torque`, `data(:,3)`,
    `runs{2}.torque`. It is within `log_part`, unless it begins with `/`."""
    # Where the device counts its samples, which tells the missing ones.
    counter: AddressText | None = None
    unit: Unit  # Unit of the numbers, as laboratories spell it.


class TdmsChannel(LogChannel):
    ADDRESS = "channel"
    channel: Name  # Group and name, as `Measured Data/Torque`, or the name where one group has it.


class C3dChannel(Channel):
    ADDRESS = "channel"
    channel: Name  # Its label.


class DeviceChannel(Channel):
    ADDRESS, BESIDE = "device", ("component",)
    device: Name  # Name of the device's output, such as `EMG2000 - Voltage`.
    component: Name  # Name of the column under it.


class OpenSimTime(ColumnTime):
    column: ColumnName | None = "time"  # Name of the column that holds time.
    unit: TimeUnit | None = "s"  # Unit of the numbers that are time.


class FieldTime(RowTime):
    ADDRESS = "field"
    # Path of the number that is time, or of a stamp of seconds and nanoseconds (no `unit`).
    field: str | None = None


class VariableTime(RowTime):
    ADDRESS = "variable"
    # Address of the variable that holds time, as in `channels`.
    variable: AddressText | None = None


class TdmsTime(RowTime):
    ADDRESS, IN_FILE = "channel", True
    # That of time; LabVIEW's stamps need no unit. Without it: the channels' own timing.
    channel: str | None = None


class OpenSimPlate(ExportedPlate):
    force: str  # Beginning of the names of the force's columns [N]: `R_ground_force_v`.
    # Beginning of the names of the columns of the point of application [m]: `R_ground_force_p`.
    point: str
    # Beginning of the names of the columns of the moment about this point [N*m]:
    # `R_ground_torque_`.
    moment: str
    corners: tuple[Corner, Corner, Corner, Corner]  # Of the surface in the file's axes [m].
    # Whose force it is, where the file has one per foot, not per plate.
    foot: Literal["left", "right"] | None = None


class NexusPlate(ExportedPlate):
    device: str  # The plate's outputs are called `<device> - Force` and `<device> - Moment`.
    corners: tuple[Corner, Corner, Corner, Corner]  # Of the surface in the file's axes [mm].
    # About which the file takes the moment [mm]; without it the corners' centre.
    moment_about: Corner | None = None


class SheetSource(TableSource):
    """The source file of a table of cells with a header, from any program."""

    OF = " of format table"
    channels: Annotated[Mapping[str, ColumnChannel], Field(min_length=1)]
    time: ColumnTime
    # Sign at the beginning of comment lines, of `auto` #, % or //; empty if there are none.
    comment: str = "auto"
    header: Literal["auto", "row", "comment", "none"] = "auto"
    """Place of the names: the row above the numbers, the last comment line, or none; `auto` takes
    what is there."""
    # Whether a row of units follows the header; `auto` looks.
    units_row: bool | Literal["auto"] = "auto"
    # Cells that become NaN: what a logger writes if a reading failed.
    missing: tuple[str, ...] = MISSING
    ragged: Literal["refuse", "skip", "dropped_variable"] = "refuse"
    """Rows whose length differs from the header's: the file is refused, or `skip` skips and counts
    them. `dropped_variable`, for a logger that omits a variable after it failed: from there on, the
    columns that were missing in the last complete row are NaN; a row that this does not explain is
    refused."""

    @model_validator(mode="after")
    def _below_a_header(self) -> Self:
        if self.units_row is True and self.header not in ("auto", "row"):
            raise ValueError("a row of units needs a header row above it")
        return self


class CsvSource(SheetSource):
    OF = " of format csv"
    delimiter: Literal["auto", ",", ";", "tab", "space", "|"] = "auto"
    """Sign between cells; `auto` takes that of tab, `;`, `|`, `,` and blank by which most cells are
    numbers."""
    # Decimal sign; `auto` takes the one that the numbers have.
    decimal: Literal["auto", ".", ","] = "auto"


class JsonSource(TableSource):
    OF = " of format json_lines"
    channels: Annotated[Mapping[str, FieldChannel], Field(min_length=1)]
    time: FieldTime


class MatSource(TableSource):
    OF = " of format mat"
    channels: Annotated[Mapping[str, VariableChannel], Field(min_length=1)]
    time: VariableTime
    log_part: Annotated[
        str, AfterValidator(lambda text: checked_address(text, inside=False) if text else text)
    ] = ""
    """Address of the struct or cell that holds the trial, where there are several; the sample
    sheet's replaces it."""

    def of_part(self, part: str) -> Self:
        return self.model_copy(update={"log_part": part}) if part else self


class TdmsSource(TableSource):
    OF = " of format tdms"
    channels: Annotated[Mapping[str, TdmsChannel], Field(min_length=1)]
    time: TdmsTime = Field(default_factory=TdmsTime)


class OpenSimSource(SheetSource, InAxes):
    OF = " of format opensim"
    clock: Literal["master", "sync", "shared", "common"] = "master"  # type: ignore[assignment]
    """How the log's clock is aligned to motion capture's. `common`: its times are those of the TRC
    beside it."""
    channels: Mapping[str, OpenSimChannel] = Field(default={})
    time: OpenSimTime = Field(default_factory=OpenSimTime)
    # Force plates by number, from 1.
    plates: Mapping[PositiveInt, OpenSimPlate] = Field(default={})
    axes: Axes = ("x", "-z", "y")

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not self.channels and not self.plates:
            raise misplaced(
                "name the columns to read under `channels`, or plates under `plates`", "channels"
            )
        if str(self.clock) == "common" and (not self.time.name or self.time.unit != "s"):
            raise misplaced(
                "`clock: common` needs the column of time in s, as {column: time, unit: s}", "time"
            )
        return self


class TrcSource(MarkerSource):
    OF = " of format trc"
    point_unit: LengthUnit | None = None  # Unit of length, where the file's own is absent or wrong.


class C3dSource(LaboratorySource):
    OF = " of format c3d"
    analogs: Mapping[str, C3dChannel] = Field(default={})
    point_unit: LengthUnit | None = None  # Unit of length, where the file's own is absent or wrong.
    plates: Annotated[
        Literal["all"] | tuple[PositiveInt, ...], BeforeValidator(all_none_or_list)
    ] = "all"
    """Force plates by number, from 1: all, none or a list."""
    # Units of the plates' channels, where the file's are absent or wrong.
    plate_units: PlateUnits | None = None
    plate_zero: Literal["none", "file"] | tuple[PositiveInt, PositiveInt] = "none"
    """Baseline of the plates: none, file (FORCE_PLATFORM:ZERO) or two frames, from 1, between which
    they are empty."""

    @model_validator(mode="after")
    def _zero_lasts(self) -> Self:
        if isinstance(self.plate_zero, tuple) and self.plate_zero[0] > self.plate_zero[1]:
            raise misplaced(
                f"{[*self.plate_zero]} ends before it begins; write the first frame first",
                "plate_zero",
            )
        return self


class NexusSource(LaboratorySource):
    OF = " of format nexus_csv"
    analogs: Mapping[str, DeviceChannel] = Field(default={})
    plates: Mapping[PositiveInt, NexusPlate] = Field(default={})  # Force plates by number, from 1.
    delimiter: Literal["auto", ",", ";", "tab", "space", "|"] = "auto"  # Sign between cells.
    decimal: Literal[".", ","] = "."  # Decimal sign.


SOURCES: Mapping[str, type[Source]] = {
    **dict.fromkeys(("mcap", "rosbag1", "rosbag2"), MessageSource),
    "csv": CsvSource, "table": SheetSource, "json_lines": JsonSource, "mat": MatSource,
    "tdms": TdmsSource,
    "opensim": OpenSimSource, "c3d": C3dSource, "nexus_csv": NexusSource, "trc": TrcSource,
}  # fmt: skip

UNKNOWN = "UNKNOWN"  # in a draft: a value that the file does not tell
NAME_OF_TIME = "NAME_OF_TIME"  # in a draft: the column of time, if no column is named like a clock


def open_places(content: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The places of a draft that the user must still edit: placeholder names and UNKNOWN values."""
    for key, value in content.items() if isinstance(content, dict) else ():
        place, is_open = (*above, str(key)), value == UNKNOWN and key in ("unit", "rate")
        if re.fullmatch(r"NAME_\d+", str(key)) or is_open or value == NAME_OF_TIME:
            yield place
        else:
            yield from open_places(value, place)


@dataclass(frozen=True)
class Recording:
    """The raw files of one recorder, as read. Everything but the samples can be written as JSON."""

    samples: pl.DataFrame
    """`time` [s] on the recorder's own clock, and canonical columns in SI units; null where a
    column has no sample."""
    columns: Mapping[str, dict[str, Any]]  # source channel and conversion of each column
    # Further facts: rates, source of time, plates.
    facts: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()  # a sentence each
    damage: Ledger = field(default_factory=Ledger)  # lost messages or rows
    # channel numbers of each topic; None for a table
    topics: Mapping[str, Collection[int]] | None = None

    @property
    def losses(self) -> dict[str, Any]:
        """The report on losses for the provenance; empty for a complete table."""
        report = self.damage.report(self.topics)
        return report if self.topics is not None or not report["complete"] else {}


def check_values(what: str, values: Array, time: Array) -> None:
    """Refuse NaN and infinity in a channel (n,). The message gives the time [s] of the first."""
    finite = np.isfinite(values)
    if not finite.all():
        row = int(np.argmin(finite))
        said = f"{what}: {values[row]} in sample {row + 1} of {values.size}, at {time[row]:.3f} s"
        raise InputError(f"{said}; repair the recording or exclude the trial in the sheet")


LARGEST_MEASURED = {  # largest possible size of a value, by its SI unit
    "m": 1e3,  # no laboratory is a kilometre long
    "rad": 1e6,  # 160 000 turns
    "rad/s": 1e5,  # a million turns per minute
    "N": 1e6,  # the weight of a hundred tonnes
    # moments of a plate in N*mm declared as N*m pass; the centre of pressure shows that error
    # better
    "N*m": 1e7,
    "A": 1e5,
    "V": 1e6,  # counts of a 16-bit converter declared as V pass
    "N*m/rad": 1e8,
    "N*m*s/rad": 1e8,
    "N*m/kg": 1e6,
    "1": 1e9,  # counts of a converter
}


AMID = 5000  # number of samples from which the noise of a channel is estimated
NEXT_TO_ZERO = 1e-30  # size, in SI units, below which a value is no sensor's unless it is exactly 0
MOST_BENDS = 100  # largest number of bends at which leaps are searched for
FAR = 40.0  # ratio of a leap to all other bends; swapped markers of eleven laboratories reached 27
# noisy: seldom two equal values
SELDOM_REPEAT = ("theta", "theta_m", "omega_m", "torque", "torque_m", "current")


@np.errstate(over="ignore", invalid="ignore")
def values_of_no_sensor(
    column: str, time: Array, x: Array, origin: Mapping[str, Any], angle: Array | None = None
) -> NDArray[np.bool_] | None:
    """Mask (n,) of readings that come from lost or changed bytes; None if the column often repeats
    a value. They are: two or more raw zeros in a row (`origin` tells the raw zero), with a jump on
    both sides; a value that a torque holds for less than 0.5 s and takes nowhere else; numbers next
    to zero; one to five readings off the curve, or an angle's leap that no mass can do, four times
    as far as any other bend; six or more readings without noise beside a leap. A torque may leave
    its curve where the joint's `angle` (n,), if known, does too, as at a blow."""
    zero = math.prod(origin.get(key, 1) for key in ("sign", "scale", "factor")) * origin.get(
        "offset", 0
    )
    nought, stays = np.abs(x - zero) < NEXT_TO_ZERO, np.diff(x) == 0
    stands = nought[:-1] & nought[1:]
    sizes, bends = np.abs(x), bends_of(x)
    is_coarse = bool(np.count_nonzero(~stays) <= 0.5 * np.sum(~stands))
    moved = out_of_place(column, time, x, bends, angle, is_coarse)
    if is_coarse:
        return moved if moved.any() else None
    lost = (x != 0) & (sizes < NEXT_TO_ZERO)
    if (
        lost.any()
        and np.sum((between := sizes[sizes >= NEXT_TO_ZERO]) < 1e-9 * np.median(between)) > 10
    ):
        lost[:] = False  # it decays there, as in a simulation
    lost |= moved
    zeros = jumped_into(x, stands, bends, may_rest=not column.startswith(("theta", "torque")))
    # near a zero crossing, one jump
    leaps = {a for a, _ in leaps_of(x, bends, 4.0) if column in ("theta", "torque")}
    zeros += [(a, b) for a, b in run_edges(stands).tolist() if a and {a, b + 1} & leaps]
    # longer: `measure_stuck` reports it
    most = 0.5 * time.size / (np.ptp(time) or np.inf) if time.size else 0.0
    # else the sensor has few levels and may rest at each
    if "torque" in column and np.mean(stays) < 0.1:
        zeros += [
            (a, b)
            for a, b in jumped_into(x, stays, bends, True, (10, most))
            if np.sum(x == x[a]) <= b - a + 3
        ]
    if (
        zeros
        and not noise_in(
            elsewhere := x[~nought], slice(elsewhere.size // 4, elsewhere.size // 4 + AMID)
        )[0]
    ):
        zeros = []  # a quiet sensor, or a simulation, that rests
    for a, b in zeros:
        lost[a : b + 1] = True
    return np.asarray(lost)


def out_of_place(
    column: str, time: Array, x: Array, bends: Array, angle: Array | None, is_coarse: bool
) -> NDArray[np.bool_]:
    """Mask (n,) of readings in blocks that changed places; if there are none, those found
    `by_leaps`."""
    moved, of_joint = exchanged(x, bends), np.zeros(x.shape)
    coarse = is_coarse and column != "theta"  # a joint's angle cannot leap, even a coarse one
    if moved.any() or coarse or not (far := leaps_of(x, bends, 4.0)):
        return moved
    if column != "theta" and angle is not None and angle.shape == x.shape:
        of_joint = bends_of(angle)
    return by_leaps(column, time, x, bends, far, of_joint)


@np.errstate(over="ignore", invalid="ignore")
def by_leaps(
    column: str,
    time: Array,
    x: Array,
    bends: Array,
    far: Sequence[tuple[int, int]],
    of_joint: Array,
) -> NDArray[np.bool_]:
    """Mask (n,) of readings that leaps (`leaps_of`) show to be no sensor's
    (`values_of_no_sensor`)."""
    lost, moved = np.zeros(x.size, bool), np.zeros(x.size, bool)
    stays, usual = np.diff(x) == 0, median(np.diff(time))
    # rad
    farthest = {
        "theta": 2000.0 * usual**2 * (usual > 0.0025),
        "theta_m": math.inf if usual > 0.0025 else 0.0,
    }
    # half the size is enough, unless there are many, as of a stepper
    farther = {a for a, _ in leaps_of(x, bends, FAR)}
    for a, b in far:
        size = abs(x[a] - x[a - 1])
        lost[a:b] = of_joint[max(a - 3, 0) : b + 4].max() < 10
        is_turn = any(abs(size / turn - 1) < 0.1 for turn in (2 * np.pi, 360.0))
        most = farthest.get(column, math.inf) / (2 if a in farther and len(farther) < 5 else 1)
        is_moved = a == b and size > most and not is_turn
        moved[a] = is_moved and time[a] - time[a - 1] <= 1.5 * usual
    # it was elsewhere in between
    lost |= moved if moved.sum() % 2 else np.logical_xor.accumulate(moved)
    # rough in between: another channel's readings
    for a, b in pairwise(sorted(farther)) if column == "theta" else ():
        lost[a:b] |= b - a > 3 and median(bends[a + 2 : b - 1]) > 10
    edges = run_edges((bends[2:-1] < 0.02) & (np.mean(bends[2:-1] < 0.02) < 0.5))
    beside = np.array(
        [any(-1 <= at - a <= 1 or 2 <= at - b <= 4 for at, _ in far) for a, b in edges], bool
    )
    # a coarse encoder at constant speed also has such runs
    usual_run = np.diff(edges)[~beside].max(initial=2)
    for a, b in edges[beside].tolist():
        lost[a : b + 3] |= b - a > usual_run and not stays[a : b + 2].any()
    return lost


@np.errstate(over="ignore", invalid="ignore")
def exchanged(x: Array, bends: Array) -> NDArray[np.bool_]:
    """Mask (n,) of readings in two blocks of equal length that changed places. Two of their four
    leaps stand out; a third, perhaps no larger than noise, gives the length. With the blocks put
    back, all leaps must vanish."""
    at, left, lost = list[int](), bends.copy(), np.zeros(x.size, bool)
    for _ in range(9 if x.size > 9 and bends.max() > 10.0 else 0):
        at.append(int(np.argmax(left)))
        left[max(at[-1] - 3, 0) : at[-1] + 4] = 0
    if not at or bends[at[1]] <= max(10.0, 1.5 * (rest := bends[at[4]])):
        return lost
    most = max(8.0, 1.25 * rest) * np.abs(np.diff(x, 3)).max() / bends[at[0]]
    # noise may shift a leap by a few samples
    near = range(-2, 3) if bends[at[1]] > 3 * rest else range(1)
    for (p, q), k in product(combinations(sorted(at[:4]), 2), at[:8]):
        for size in {one + by for one in (k - p, k - q, 4) for by in near}:
            (a, b), (c, d) = sorted((p, p + size)), sorted((q, q + size))
            if 0 <= a < b <= c < d <= x.size:
                back = np.concatenate([x[:a], x[c:d], x[b:c], x[a:b], x[d:]])
                if np.abs(np.diff(back, 3)).max() < most:
                    lost[a:b] = lost[c:d] = True
                    return lost
    return lost


@np.errstate(over="ignore", invalid="ignore")
def bends_of(x: Array) -> Array:
    """Distance (n,) of readings (n,) from the curve of their neighbours, in units of its median:
    the third differences, placed so that the largest is at the row after a leap. 0 at the ends, and
    where a difference is NaN."""
    bends = np.zeros(x.shape)
    np.fmin(np.fmax(np.abs(np.diff(x, 3)), 0), 1e300, out=bends[2:-1])
    usual = median(counted) if (counted := bends[bends > 0]).size else 0.0
    if x.size and not usual > 1e-9 * max(np.fmax.reduce(x), -np.fmin.reduce(x)):
        usual = max(usual, 1e-9 * float(np.nanmedian(np.abs(x))) + 1e-300)
    return np.divide(bends, usual or 1.0, out=bends)


@np.errstate(over="ignore", invalid="ignore")
def leaps_of(x: Array, bends: Array, times: float) -> list[tuple[int, int]]:
    """Rows into which a channel (n,) leaps, each with the row at which it is back (within five
    rows), or else the same row. A leap is ten times the median bend, `times` (4 or more) any other
    bend, and twice the steps beside it. A corner, or the fall and rise after a blow, is not."""
    found, others, far = list[tuple[int, int]](), bends.copy(), np.flatnonzero(bends > 10.0)
    if far.size >= MOST_BENDS:
        far = far[bends[far] > np.partition(bends[far], -MOST_BENDS)[-MOST_BENDS]]
    apart = bends.copy()
    apart[np.clip(far[:, None] + np.arange(-2, 3), 0, x.size - 1)] = 0
    if not far.size or bends.max() <= times * apart.max():
        return found
    for group in np.split(far, np.flatnonzero(np.diff(far) > 2) + 1):
        begin = max(int(group[0]) - 4, 0)
        steps = np.diff(x[begin : int(group[-1]) + 4])
        steps -= median(steps) + median(np.diff(steps)) * (np.arange(steps.size) - steps.size / 2)
        sizes = np.abs(steps)
        large = np.flatnonzero(sizes > 0.5 * sizes.max())
        is_back = (
            large.size == 2 and np.ptp(large) <= 5 and abs(steps[large].sum()) < 0.5 * sizes.max()
        )
        if large.size < 3:
            places = (begin + 1 + large).tolist()
            found += [(places[0], places[-1])] if is_back else [(one, one) for one in places]
            others[max(int(group[0]) - 2, 0) : int(group[-1]) + 3] = 0
    return [(a, b) for a, b in found if bends[a : b + 2].max() > times * others.max()]


def jumped_into(
    x: Array,
    stands: NDArray[np.bool_],
    bends: Array,
    may_rest: bool,
    held: tuple[float, float] = (0, math.inf),
) -> list[tuple[int, int]]:
    """First and last sample of the runs in which readings (n,) stand still (`stands`, (n - 1,),
    between two each), with a jump on both sides, by their `bends_of` and by 2 % of the range. One
    side is enough for eight samples or more that are no rest, and if `held` limits the length of
    runs (exclusive). `may_rest`: runs at the ends do not count."""
    edges = run_edges(stands)
    edges = edges[np.all(np.sign(np.diff(edges) - held) == [1, -1], axis=1)]
    found = list[tuple[int, int]]()
    far = np.abs(np.diff(x, prepend=x[:1])) > 0.02 * np.ptp(x) if len(edges) else np.zeros(0, bool)
    for a, b in edges.tolist():
        inside, at = a and b < x.size - 1, [one for one in (a, b + 1) if 0 < one < x.size]
        jumps = [far[one - 1 : one + 2].max() * bends[one - 1 : one + 2].max() for one in at]
        on_one_side = held[0] > 0 or (b - a > 6 and not may_rest)
        # a few equal samples may be the turning point of the signal
        turns = (
            b - a <= 3
            and b < x.size - 1
            and not (inside and np.sign(x[a - 1]) == np.sign(x[b + 1]) != 0)
        )
        if (
            (inside or not may_rest)
            and not turns
            and (max if on_one_side else min)(jumps, default=0.0) > 6
        ):
            found.append((a, b))
    return found


def check_sizes(recording: Recording) -> None:
    """Refuse values beyond `LARGEST_MEASURED`, and infinite ones. NaN passes: it marks a value that
    was not seen."""
    time = recording.samples["time"].to_numpy()
    sizes = recording.samples.select(pl.col(*recording.columns).abs().max())
    for column, largest in sizes.row(0, named=True).items():
        bound = LARGEST_MEASURED[unit_of(column)]
        if (largest or 0.0) > bound:
            values = recording.samples[column].to_numpy()
            beyond = np.abs(values) > bound
            row = int(np.argmax(beyond))
            raise InputError(
                f"{column} is {values[row]:.4g} {unit_of(column)} at {time[row]:.3f} s, and beyond"
                f" ±{bound:g} in {beyond.sum()} of {np.count_nonzero(~np.isnan(values))} samples:"
                " nothing here can be so large; correct its unit or scale in the source file, or"
                " repair the recording or the byte order it states"
            )
