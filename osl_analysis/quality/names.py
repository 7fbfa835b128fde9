"""The checks of quality control: what each measures, in which unit, and on which side of its threshold it fails."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Check:
    """A check's unit, whether it fails `above` or `below` its threshold, and what its value is."""

    unit: str
    fails: Literal["above", "below"]
    meaning: str


CHECKS: dict[str, Check] = {
    "rate": Check("Hz", "below", "lowest median sampling rate of the channels"),
    "jitter": Check("%", "above", "RMS deviation of the sampling steps from their median, gaps apart"),
    "gap": Check("s", "above", "longest time without a sample, beyond one step"),
    "saturation": Check("samples", "above", "longest run at an extreme of torque, current, plate force or moment"),
    "stuck": Check("s", "above", "longest time that a noisy channel repeats one value, or the joint stands in motion"),
    "unzeroed_load_cell": Check("N*m", "above", "torque before the joint first moves"),
    "unzeroed_plate": Check("N", "above", "vertical force of a plate that bears nothing"),
    "encoder_wrap": Check("jumps", "above", "steps of an angle by about 2 pi, or by 360"),
    "marker_gap": Check("s", "above", "longest time that a marker was hidden between two sightings"),
    "clock_residual": Check("s", "above", "RMS residual of the fit of the log's clock to motion capture's"),
    "damage": Check("%", "above", "share of the log that could not be recovered"),
    "unfinished": Check("logs", "above", "logs whose end is lost, so that nobody can say how much is missing"),
    "protocol": Check("segments", "above", "commanded pairs of amplitude and frequency that the joint did not follow"),
}
