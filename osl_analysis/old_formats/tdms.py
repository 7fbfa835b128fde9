"""LabVIEW's TDMS, read by npTDMS from bytes, so that it looks at no index beside the file, maybe
another's."""

import logging
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, nearest, optional_module, quoted
from osl_analysis.old_formats.csv_table import CONTROL
from osl_analysis.old_formats.table import Ledger, reason_of

SAVE_AGAIN = "copy it again, or open it in LabVIEW or DIAdem and save it under a new name"


@dataclass(frozen=True)
class TdmsChannel:
    group: str
    name: str
    count: int
    kind: np.dtype[Any]  # type of its values
    unit: str  # its unit, as the file spells it
    step: float | None  # time between two values [s]; None where the properties do not tell
    begin: int  # when the first value was taken, since 1970 [ns]

    @property
    def address(self) -> str:
        return f"{self.group}/{self.name}"

    @property
    def holds_numbers(self) -> bool:
        return self.kind.kind in "biuf"

    @property
    def holds_times(self) -> bool:
        return self.kind.kind == "M"  # LabVIEW's time stamps


@dataclass(frozen=True)
class TdmsFile:
    data: bytes
    channels: list[TdmsChannel]  # its channels, in the order of the file
    properties: Mapping[str, str]  # what the file says about itself
    damage: Ledger

    def channel(self, address: str) -> TdmsChannel:
        """A channel by group and name, or by its name alone where one group only has it."""
        exact = [one for one in self.channels if one.address == address]
        found = exact or [one for one in self.channels if one.name == address]
        if len(found) > 1:
            raise InputError(
                f"channel '{address[:80]}' is in {len(found)} groups; name it as group/channel"
            )
        if not found:
            names = [one.address for one in self.channels]
            near = nearest(address, [*names, *(one.name for one in self.channels)])
            advice = near or "; correct the name in the source file"
            raise InputError(f"no channel '{address[:80]}'; the file has {listing(names)}{advice}")
        return found[0]

    def values(
        self, wanted: Sequence[TdmsChannel], most: int | None = None
    ) -> dict[str, NDArray[Any]]:
        """The numbers of some channels, at `most` so many, by address, as the file scales them;
        stamps in s."""
        for one in wanted:
            if not one.count:
                raise InputError(
                    f"channel '{one.address}' is empty; take another one, or record again"
                )
            if not (one.holds_numbers or one.holds_times):
                what = {"O": "text", "V": "nothing", "c": "complex numbers"}.get(
                    one.kind.kind, one.kind.name
                )
                raise InputError(
                    f"channel '{one.address}' holds {what} and no numbers; take another one"
                )
        with library() as (tdms, _), tdms.open(BytesIO(self.data), raw_timestamps=True) as file:
            found: dict[str, Any] = {
                one.address: file[one.group][one.name].read_data(length=most) for one in wanted
            }
            for one in (one for one in wanted if one.holds_times):
                stamps = found[one.address].as_datetime64("ns")
                found[one.address] = (stamps - stamps[0]) / np.timedelta64(1, "ns") * 1e-9
        return {address: np.asarray(values) for address, values in found.items()}


def is_tdms(begin: bytes) -> bool:
    """Whether a file that begins with these bytes is TDMS or its index. Text never is: `TDSm` may
    name a column."""
    return begin.startswith((b"TDSm", b"TDSh")) and CONTROL.search(begin) is not None


@contextmanager
def library() -> Iterator[tuple[Any, list[str]]]:
    """npTDMS's `TdmsFile`, and what npTDMS says meanwhile; its many errors on damaged bytes become
    one."""
    said: list[str] = []

    def keep(record: logging.LogRecord) -> bool:
        said.append(record.getMessage())
        return False

    nptdms = optional_module("nptdms", "a TDMS file")
    handler = optional_module("nptdms.log", "a TDMS file").log_manager.console_handler
    handler.addFilter(keep)
    try:
        yield nptdms.TdmsFile, said
    except InputError:
        raise
    except Exception as error:
        what = f"the TDMS file is damaged or of a kind that is not read ({reason_of(error)})"
        raise InputError(f"{what}; {SAVE_AGAIN}") from error
    finally:
        handler.removeFilter(keep)


def read_tdms(path: Path) -> TdmsFile:
    """The channels of a file with their timing; InputError if npTDMS is not installed, or the file
    is damaged."""
    data = path.read_bytes()
    if data[:4] == b"TDSh":
        raise InputError("the index of a TDMS file; name the .tdms file beside it")
    if data[:4] != b"TDSm":
        raise InputError(
            f"no TDMS file (it begins with {quoted(data[:8])}); check the path and the source's"
            " format"
        )
    with library() as (tdms, said), tdms.read_metadata(BytesIO(data)) as file:
        channels = [channel_of(one) for group in file.groups() for one in group.channels()]
        status = file.file_status
        about = {str(key): str(value)[:200] for key, value in list(file.properties.items())[:20]}
    odd = [text for text in said if "not a multiple" in text]
    # the library would give one channel the bytes of the next
    if len(odd) > status.incomplete_final_segment:
        raise InputError(
            f"the length of a segment contradicts that of its channels ({odd[0][:80]});"
            f" {SAVE_AGAIN}"
        )
    if not channels:
        raise InputError(
            f"the TDMS file holds no channels, or is cut off before them; {SAVE_AGAIN}"
        )
    damage, end = Ledger(end_unknown=True), end_of_segments(data)
    lost = [
        one.expected_length - one.read_length for one in (status.channel_statuses or {}).values()
    ]
    count = f"at least {max(lost)} values of a channel" if any(lost) else "how much is not known"
    if status.incomplete_final_segment or end != len(data):
        what = "the last segment is not complete: the recorder did not finish, or the end is lost"
        damage.miss_end(f"{what}; {count}")
    return TdmsFile(data, channels, about, damage)


def channel_of(one: Any) -> TdmsChannel:
    about, step = one.properties, one.properties.get("wf_increment")
    is_timed = isinstance(step, float | int) and np.isfinite(step) and step > 0
    kind = np.dtype("V" if one.dtype is None else one.dtype)
    unit = str(about.get("unit_string") or about.get("NI_UnitDescription") or "")
    since = about.get("wf_start_time")
    begin = (
        int(since.astype("datetime64[ns]").astype(np.int64))
        if isinstance(since, np.datetime64)
        else 0
    )
    begin += round(float(about.get("wf_start_offset", 0.0)) * 1e9)
    return TdmsChannel(
        one.group_name, one.name, len(one), kind, unit, float(step) if is_timed else None, begin
    )


def end_of_segments(data: bytes) -> int:
    """Where the last segment should end [bytes]; InputError if a second recording begins in one."""
    end, starts = 0, dict[str, set[str]]()
    # npTDMS is silent about a cut lead-in
    while end + 28 <= len(data) and data[end : end + 4] == b"TDSm":
        begin, flags = end, int(data[end + 4])
        end += 28 + int(struct.unpack_from(">Q" if flags & (1 << 6) else "<Q", data, end + 12)[0])
        if flags & 6 == 6:  # it describes all of its channels anew
            with library() as (tdms, _), tdms.read_metadata(BytesIO(data[begin:end])) as file:
                every = [one for group in file.groups() for one in group.channels()]
            for one in (one for one in every if "wf_start_time" in one.properties):
                known = starts.setdefault(one.path, set())
                known.add(str(one.properties["wf_start_time"]))
                if len(known) > 1:
                    what = f"channel '{one.name}' starts anew there: two recordings in one file"
                    raise InputError(f"byte {begin}: {what}; save each under a name of its own")
    return end
