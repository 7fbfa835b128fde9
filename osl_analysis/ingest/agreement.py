"""Whether the columns of a file agree: the speed of a body with the change of its angle. Also one
that no analysis reads tells that the other has a wrong scale, or is of another side of a gear."""

from collections.abc import Collection, Mapping

import numpy as np

from osl_analysis.draft.likelihood import kinds_of_words, parted_name, word_patterns
from osl_analysis.draft.recorded_channel import likely_unit, name_and_ending
from osl_analysis.ingest import LIMITS
from osl_analysis.ingest.conversion import Converted, numbers_of
from osl_analysis.measured import usual_step, varies
from osl_analysis.recording import Channel, Recording
from osl_analysis.source_file import LogSource
from osl_analysis.trial import Array
from osl_analysis.units import EXAMPLES, base_units, dimension, normalised

UNITS = {"angle": "rad", "speed": "rad/s"}
COLUMNS_OF = {"theta": "angle", "omega": "speed"}  # how their columns begin


def speed_factor(angle: Array, speed: Array, step_s: float) -> float | None:
    """The size of a speed over that of the change of an angle: 1 where both are right.

    Both are compared over `speed_window_s`, in which neither noise nor a filter counts.

    Parameters
    ----------
    angle, speed
        Shape (n,) [rad, rad/s]; NaN where there is none.
    step_s
        Usual step of the samples [s].

    Returns
    -------
    float or None
        Negative where the signs differ; None where the speed does not follow the angle.
    """
    known = np.isfinite(angle + speed)
    rows = max(round(LIMITS.speed_window_s / step_s), 1)
    turned = angle[known]
    covered = np.cumsum(speed[known]) * step_s
    turns = turned[rows:] - turned[:-rows]
    ways = covered[rows:] - covered[:-rows]
    if turns.size < LIMITS.fewest_compared or not (varies(turns) and varies(ways)):
        return None
    r = np.corrcoef(turns, ways)[0, 1]
    return float(np.sign(r) * ways.std() / turns.std()) if abs(r) > LIMITS.least_followed else None


def speed_factors(
    recording: Recording, source: LogSource, converted: Converted
) -> dict[str, float]:
    """Of each body, of which the source file names angle or speed: the factor between both, by a
    sentence that names them."""
    named = {recording.find(one.address): name for name, one in source.channels.items()}
    bodies: dict[tuple[str, str], dict[str, Channel]] = {}
    for channel in dict.fromkeys([*named, *recording.channels]):
        kind, words = kind_and_body(channel, named.get(channel, ""))
        bodies.setdefault((channel.rows.name, words), {}).setdefault(kind, channel)
    by_column = {column: channel for channel, column in named.items()}
    if by_column.keys() >= {"theta_m", "omega_m"}:  # of one body, whatever they are called
        of_actuator = {"angle": by_column["theta_m"], "speed": by_column["omega_m"]}
        bodies["", "actuator"] = of_actuator
    factors = {}
    for body in bodies.values():
        column = next((named[channel] for channel in body.values() if channel in named), "")
        counts = {channel.rows.count for channel in body.values()}
        if not column or not body.keys() >= UNITS.keys() or len(counts) > 1:
            continue
        step_s = usual_step(converted.samples.drop_nulls(column)["time"].to_numpy())
        angle, speed = (in_si(body[kind], named, source, unit) for kind, unit in UNITS.items())
        factor = speed_factor(angle[0], speed[0], step_s) if step_s else None
        if factor is not None and angle[1] and speed[1]:
            signed = factor if {*body.values()} <= named.keys() else abs(factor)
            possible = [signed * high / low for low in angle[1] for high in speed[1]]
            nearest = min(possible, key=lambda each: abs(np.log(abs(each))))
            words = f"'{body['speed'].key}' is {nearest:.3g} times the derivative of"
            factors[f"{words} '{body['angle'].key}'"] = float(nearest)
    return factors


def kind_and_body(channel: Channel, column: str) -> tuple[str, str]:
    """Whether a channel is an angle or a speed, and the other words of its name; a column of a
    source file is what it says."""
    name = channel.address.get("field", channel.name or channel.key)
    words = parted_name(name_and_ending(name)[0])
    kinds = kinds_of_words(words) & UNITS.keys()
    if column:
        kinds = {COLUMNS_OF[start] for start in COLUMNS_OF if column.startswith(start)}
    for each in UNITS:
        words = word_patterns()[each].sub("", words)
    kind = "speed" if "speed" in kinds else "".join(kinds)
    return kind, " ".join(words.split())


def in_si(
    channel: Channel, named: Mapping[Channel, str], source: LogSource, unit: str
) -> tuple[Array, Collection[float]]:
    """The readings of a channel (n,), and the possible factors from their unit to the SI unit: as
    the source file says, or else the file; of a unit that nobody states all usual ones."""
    readings = numbers_of(channel)
    name = channel.name or channel.key
    spelled = channel.unit or channel.likely_unit or likely_unit(name)
    if channel in named:
        setting = source.channels[named[channel]]
        if setting.wraps_at is not None:
            readings[np.isfinite(readings)] = np.unwrap(
                readings[np.isfinite(readings)], period=setting.wraps_at
            )
        readings = readings * setting.sign * setting.scale
        spelled = setting.unit or channel.unit
    if not spelled:
        return readings, EXAMPLES[unit].values()
    factor, base = base_units(normalised(spelled)) or (0.0, "")
    return readings, [factor] if base == dimension(unit) else ()
