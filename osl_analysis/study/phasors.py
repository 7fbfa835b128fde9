"""The frequency response in the study: magnitude and phase of Y at each frequency, from sinusoid fits."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.bench.frequency_response import SegmentPhasors
from osl_analysis.bench.impedance import trial_phasors
from osl_analysis.bench.stepped_sine import stepped_sine_alone
from osl_analysis.signals import LowPass
from osl_analysis.stats.complex_estimate import polar_row
from osl_analysis.study.bench import StudyBench, drivetrain
from osl_analysis.study.trials import Estimate, Estimates, StudyInputs, torque_noise


@dataclass(frozen=True)
class ResponseBench:
    """The integral admittance Y = theta/torque of a bench, at one amplitude and each frequency of its protocol.

    The quantities have the frequency in their names: `magnitude, 2 Hz` [rad/(N*m)] and `phase, 2 Hz` [deg].
    """

    bench: StudyBench

    @property
    def exact(self) -> Mapping[str, float]:
        """Empty: a drivetrain with friction has no exact value. Its truth is the estimate with ideal sensors."""
        return {}

    @property
    def theory(self) -> Mapping[str, float]:
        """Empty: linear theory does not describe a drivetrain with friction."""
        return {}

    def estimates(self, trial: str, low_pass: LowPass, ideal: bool = False) -> Estimates:
        """The estimates from raw signals. Each frequency has its own row, like an estimator."""
        for segment in self.phasors(trial, ideal):
            f, row = segment.frequency_hz, polar_row(segment.admittance)
            parts = {"magnitude": "", "phase": "_deg"}
            yield f"sinusoid, {f:g} Hz", "cycles", {
                f"{part}, {f:g} Hz": Estimate(*(row[f"{part}{end}{unit}"] for end in ("", "_se", "_low", "_high")))
                for part, unit in parts.items()
            }  # fmt: skip

    def phasors(self, trial: str, ideal: bool) -> list[SegmentPhasors]:
        """Phasors of each settled segment of a trial."""
        return trial_phasors(stepped_sine_alone(self.bench.trial(trial, ideal), self.bench.analysis))

    def bounds(self) -> dict[str, float]:
        """Bounds from that of a phasor in white noise, 2 sigma^2/N per quadrature.

        Relative to the torque's amplitude it is the bound of the magnitude, and in radian that of the phase (Rife and
        Boorstyn, IEEE Trans. Inf. Theory 20, 1974).
        """
        white, _ = torque_noise(self.bench.settings, np.zeros(1))
        segments, bounds = self.bench.record("ideal", ideal=True).segments, {}
        for segment, phasors in zip(segments, self.phasors("ideal", ideal=True), strict=True):
            f, torque = segment.frequency_hz, abs(phasors.torque.value)
            relative = white * float(np.sqrt(2 / (segment.stop - segment.start))) / torque
            bounds[f"magnitude, {f:g} Hz"] = abs(phasors.theta.value) / torque * relative
            bounds[f"phase, {f:g} Hz"] = float(np.rad2deg(relative))
        return bounds


def response_bench(inputs: StudyInputs) -> ResponseBench:
    """The compensated drivetrain at the first of the study's amplitudes."""
    single = inputs.study.model_copy(update={"amplitudes_deg": inputs.study.amplitudes_deg[:1]})
    return ResponseBench(drivetrain(replace(inputs, study=single)))
