"""Other channels of a recording's file as its angle or torque, which are tried where K is not what
is stated of the joint."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from osl_analysis import formats
from osl_analysis.errors import Change, OslAnalysisError
from osl_analysis.ingest.raw_files import read_source
from osl_analysis.recording import Channel, Kind, Recording
from osl_analysis.trial import Array, Trial
from osl_analysis.yaml_settings import read_mapping

PARTNERS = {"theta": "torque", "torque": "theta"}
LEAST_CORRELATION = 0.3  # with the other signal; a joint to 8 Hz has 0.6 and more
MOST_TRIED = 3  # channels in place of a signal


def other_channels(read: Callable[[Path], Trial], recording: Path, source: Path) -> list[Change]:
    """Read the file with other channels as its angle or torque: both exchanged, and each that
    moves with the other signal, the likeliest first.

    Parameters
    ----------
    read : callable
        Reads the file by a source file.
    recording, source : Path
        The file, and its source file.

    Returns
    -------
    list of Change
        Each with its trial; none where the file cannot be read so.
    """
    stated = read_mapping(source)
    try:
        settings = read_source(source)
        readings = dict(channels_read_otherwise(formats.read(recording, settings), stated))
    except (OslAnalysisError, OSError):
        return []
    changes = []
    for words, channels in readings.items():
        with TemporaryDirectory() as folder, suppress(OslAnalysisError):
            other_source = Path(folder) / "other.yaml"
            text = yaml.safe_dump({**stated, "channels": channels})
            other_source.write_text(text, encoding="utf-8")
            changes.append(Change(words, recording=read(other_source)))
    return changes


def channels_read_otherwise(
    recording: Recording, stated: Mapping[str, Any]
) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """What a user does, and `channels` of the source file then."""
    channels = stated.get("channels", {})
    address_keys = {key for channel in recording.channels for key in channel.address}
    own: dict[str, Channel] = {}
    for column in PARTNERS:
        entry = channels.get(column)
        if not isinstance(entry, Mapping):
            return
        named = {key: str(entry[key]) for key in entry if key in address_keys}
        own[column] = recording.find(named)
    exchanged = {}
    for column, partner in PARTNERS.items():
        exchanged[column] = {**channels[column], **own[partner].address}
    words = "exchange the channels of theta and torque in the source file"
    yield words, {**channels, **exchanged}
    for column, partner in PARTNERS.items():
        partner_values = own[partner].values
        likeness: dict[float, Channel] = {}
        for channel in recording.channels:
            is_own = channel is own[column] or channel is own[partner]
            if is_own or channel.kind is not Kind.SIGNAL:
                continue
            likeness[correlation(channel.values, partner_values)] = channel
        for size in sorted(likeness, reverse=True)[:MOST_TRIED]:
            if size > LEAST_CORRELATION:
                channel = likeness[size]
                words = f"name '{channel.key}' as {column} in the source file"
                yield words, {**channels, column: {**channels[column], **channel.address}}


def correlation(values: Any, others: Any) -> float:
    """Absolute correlation of two channels; 0 of those with other rows, and of no numbers."""
    if values.shape != others.shape or values.ndim != 1 or values.dtype.kind not in "fiu":
        return 0.0
    pair: Array = np.array([values, others], dtype=float)
    pair = pair[:, np.isfinite(pair).all(axis=0)]
    if pair.shape[1] < 2 or not np.ptp(pair, axis=1).all():
        return 0.0
    return abs(float(np.asarray(np.corrcoef(pair))[0, 1]))
