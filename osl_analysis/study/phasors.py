"""The frequency response in the validation study: magnitude and phase of Y at each frequency, by sinusoid fits."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from osl_analysis.bench.frequency_response import SegmentPhasors, segment_phasors
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.config import ValidationStudy
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.signals import LowPass
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.stats.complex_estimate import polar_row
from osl_analysis.study.bench import Bench, Estimate, Estimates, drivetrain, torque_noise


@dataclass(frozen=True)
class ResponseBench:
    """The integral admittance Y = theta/torque of a bench at the frequencies of its protocol, at its one amplitude.

    Quantities have the frequency in their names: `magnitude, 2 Hz` [rad/(N*m)] and `phase, 2 Hz` [deg].
    """

    bench: Bench

    @property
    def exact(self) -> Mapping[str, float]:
        """Nothing: what a drivetrain with friction answers is found through ideal sensors."""
        return {}

    @property
    def theory(self) -> Mapping[str, float]:
        """Nothing."""
        return {}

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """Of raw signals; each frequency is a row of its own, as if it were an estimator."""
        for found in self.phasors(trial, ideal):
            f, row = found.frequency_hz, polar_row(found.admittance)
            parts = {"magnitude": "", "phase": "_deg"}
            yield f"sinusoid, {f:g} Hz", found.torque.interval_method, {
                f"{part}, {f:g} Hz": Estimate(*(row[f"{part}{end}{unit}"] for end in ("", "_se", "_low", "_high")))
                for part, unit in parts.items()
            }  # fmt: skip

    def phasors(self, trial: str, ideal: bool) -> list[SegmentPhasors]:
        """Of each settled segment."""
        record = self.bench.record(trial, ideal)
        return [segment_phasors(record.time, record.theta, record.torque, segment) for segment in record.segments]

    def bounds(self) -> dict[str, float]:
        """From the bound of a phasor in white noise, 2 sigma^2/N per quadrature (Rife and Boorstyn, IEEE Trans. Inf.
        Theory 20, 1974): relative to the torque's amplitude that of the magnitude, and in radian that of the phase."""
        white, _ = torque_noise(self.bench.settings, np.zeros(1))
        segments, found = self.bench.record("ideal", ideal=True).segments, {}
        for segment, phasors in zip(segments, self.phasors("ideal", ideal=True), strict=True):
            f, torque = segment.frequency_hz, abs(phasors.torque.value)
            relative = white * float(np.sqrt(2 / (segment.stop - segment.start))) / torque
            found[f"magnitude, {f:g} Hz"] = abs(phasors.theta.value) / torque * relative
            found[f"phase, {f:g} Hz"] = float(np.rad2deg(relative))
        return found


def frequency_response(
    study: ValidationStudy, settings: SimulationSettings, p: DrivetrainParameters, analysis: DynamometerAnalysis
) -> ResponseBench:
    """Of the compensated drivetrain at the first of the study's amplitudes."""
    single = study.model_copy(update={"amplitudes_deg": study.amplitudes_deg[:1]})
    return ResponseBench(drivetrain(single, settings, p, analysis))
