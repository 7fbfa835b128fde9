"""Frequency response of a trial: phasors of angle and torque in each segment of a stepped sine
(Fig. 7), with covariance and harmonics; for any other motion the impedance over frequency."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.effects import Admittance
from osl_analysis.bench.gram import GroupFit
from osl_analysis.bench.record import Record
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.measured import check_finite, check_measured
from osl_analysis.spectral.periods import distinct
from osl_analysis.spectral.response import local_response, periodic_response, record_spectrum
from osl_analysis.spectral.stepped_sine import whole_rows
from osl_analysis.stats import regression
from osl_analysis.trial import Array

# suffixes of the columns of an estimate
COMPLEX_PARTS = ("re", "im", "var_re", "cov", "var_im", "degrees_of_freedom")
POLAR = [
    f"{name}{end}" for name in ("magnitude", "phase_deg") for end in ("", "_se", "_low", "_high")
]
"""Magnitude and phase [deg] with standard errors and 95 % intervals (Student), to first order."""
SHARED = ("Y_se_bench", "Y_gain_se_bench", "Y_phase_se_bench")
DAMPING = ("damping", "damping_low", "damping_high")
PHASORS: dict[str, type[pl.DataType]] = {
    "trial": pl.String,
    **dict.fromkeys(("amplitude_deg", "frequency_hz"), pl.Float64),
    **dict.fromkeys(
        (f"{name}_{part}" for name in ("theta", "torque") for part in COMPLEX_PARTS), pl.Float64
    ),
    **dict.fromkeys(("theta_distortion", "torque_distortion"), pl.Float64),
    **dict.fromkeys((f"Y_{part}" for part in (*COMPLEX_PARTS, *POLAR)), pl.Float64),
    **dict.fromkeys(SHARED, pl.Float64),
    "interval_method": pl.String,
    "commanded_deg": pl.Float64,
}
"""Columns of `phasors.csv`: phasors of angle [rad] and torque [N*m] and Y [rad/(N*m)] with
covariances and degrees of freedom, distortions, magnitude and phase of Y."""
RESPONSE_COLUMNS: dict[str, type[pl.DataType]] = {
    "trial": pl.String, "method": pl.String, "realisations": pl.Int64,
    **dict.fromkeys(("frequency_hz", "angle_deg", "Z_re", "Z_im", "magnitude", "phase_deg"),
    pl.Float64),
    **dict.fromkeys(("noise_sd", "total_sd", "noise_level", "odd_level", "even_level",
    "total_level"), pl.Float64),
    **dict.fromkeys(("magnitude_eq15", "phase_deg_eq15", "magnitude_eq9", "phase_deg_eq9"),
    pl.Float64),
}  # fmt: skip
"""Columns of `response.csv`."""


@dataclass(frozen=True)
class ComplexEstimate:
    """An estimate of a complex number. Raises InputError: value or covariance cannot be
    measured."""

    value: complex
    covariance: Array  # covariance (2, 2) of real and imaginary part
    degrees_of_freedom: float  # of its variances; infinite if these are 0

    def __post_init__(self) -> None:
        check_finite("the estimate", [self.value.real, self.value.imag])
        check_finite("the estimate's standard error", np.sqrt(np.abs(self.covariance)))

    @property
    def magnitude(self) -> float:
        return abs(self.value)

    @property
    def phase(self) -> float:
        """Phase [rad] between -pi and pi."""
        return float(np.angle(self.value))

    @property
    def magnitude_se(self) -> float:
        """Standard error of the magnitude, in the unit of the number."""
        return self._se_along(1)

    @property
    def phase_se(self) -> float:
        """Standard error of the phase [rad]."""
        return self._se_along(1j) / self.magnitude

    def _se_along(self, turn: complex) -> float:
        direction = turn * self.value / self.magnitude
        unit = np.array([direction.real, direction.imag])
        return float(np.sqrt(max(float(unit @ self.covariance @ unit), 0.0)))


def with_errors(value: complex, errors: Sequence[tuple[Array, float]]) -> ComplexEstimate:
    """A number with independent errors: sum of the covariances (2, 2); degrees of freedom, combined
    by the traces."""
    covariances, freedom = zip(*errors, strict=True)
    total = float(regression.welch_satterthwaite([np.trace(C) for C in covariances], freedom))
    return ComplexEstimate(value, np.sum(covariances, axis=0), total)


def complex_quotient(numerator: ComplexEstimate, denominator: ComplexEstimate) -> ComplexEstimate:
    """numerator/denominator. The covariance is of first order; the two errors must be
    independent."""
    ratio = numerator.value / denominator.value
    errors = []
    for slope, number in (
        (1 / denominator.value, numerator),
        (-ratio / denominator.value, denominator),
    ):
        # multiplication, as a matrix
        turn = np.array([[slope.real, -slope.imag], [slope.imag, slope.real]])
        errors.append((turn @ number.covariance @ turn.T, number.degrees_of_freedom))
    return with_errors(ratio, errors)


def complex_mean(numbers: Sequence[ComplexEstimate]) -> ComplexEstimate:
    """Mean of complex numbers whose errors are independent."""
    errors = [
        (number.covariance / len(numbers) ** 2, number.degrees_of_freedom) for number in numbers
    ]
    return with_errors(complex(np.mean([n.value for n in numbers])), errors)


SharedError = Sequence[float]
"""Standard uncertainties of Y that all phasors on a bench share: of its real part, due to the
bench's stiffness; of its magnitude, relative; and of its phase [rad]."""


def shared_covariance(value: complex, error: SharedError) -> Array:
    """Covariance (2, 2) of a number with these uncertainties."""
    compliance, gain, turn = error
    along, across = np.array([value.real, value.imag]), np.array([-value.imag, value.real])
    of_calibration = gain**2 * np.outer(along, along) + turn**2 * np.outer(across, across)
    return np.asarray(np.diag([compliance**2, 0.0]) + of_calibration)


def with_bench_error(number: ComplexEstimate, error: SharedError) -> ComplexEstimate:
    """The number with these uncertainties, of type B."""
    known = shared_covariance(number.value, error)
    return with_errors(
        number.value, [(number.covariance, number.degrees_of_freedom), (known, np.inf)]
    )


def complex_row(name: str, number: ComplexEstimate) -> dict[str, float]:
    """The number as columns of a table: `name_re`, `name_im`, their covariance and its degrees of
    freedom."""
    C = number.covariance
    values = (
        number.value.real,
        number.value.imag,
        C[0, 0],
        C[0, 1],
        C[1, 1],
        number.degrees_of_freedom,
    )
    return {
        f"{name}_{part}": float(value) for part, value in zip(COMPLEX_PARTS, values, strict=True)
    }


def polar_row(number: ComplexEstimate) -> dict[str, float]:
    """The columns `POLAR`."""
    quantile, values = float(scipy.special.stdtrit(number.degrees_of_freedom, 0.975)), list[float]()
    angle, angle_se = float(np.rad2deg(number.phase)), float(np.rad2deg(number.phase_se))
    for value, se in ((number.magnitude, number.magnitude_se), (angle, angle_se)):
        values += [value, se, value - quantile * se, value + quantile * se]
    return dict(zip(POLAR, values, strict=True))


@dataclass(frozen=True)
class Phasor(ComplexEstimate):
    """Complex amplitude P of a sine: signal = Re(P exp(j w t)) + offset + harmonics, in the unit of
    the signal."""

    harmonics: NDArray[np.complex128]
    """Complex amplitudes of the fundamental and of harmonics 2 to 5, shape (5,): harmonic k is Re(H
    exp(j k w t))."""
    interval_method: str  # source of the covariance, as in `LinearFit`

    @property
    def distortion(self) -> float:
        """Root sum of squares of harmonics 2 to 5, divided by the fundamental."""
        size = np.abs(self.harmonics)
        return float(np.linalg.norm(size[1:]) / size[0])


def fit_sinusoids(
    time: Array, frequency_hz: float, *signals: Array, cycles: tuple[Array, Array] | None = None
) -> Iterator[Phasor]:
    """Phasors of settled signals (n,) at times (n,) [s], which define zero phase, each with an
    offset and harmonics 2 to 5, which friction makes. `cycles` holds the rows, which may be
    fractional, at which each fitted cycle begins and ends; None: all rows, divided into cycles from
    the first one on.

    The covariance comes from the spread of cycles; with fewer than five, from the autocorrelation
    of the residual. The normal equations are well conditioned: sines are orthogonal over whole
    cycles.

    Raises InputError: less than one cycle, steps too long for harmonic 5, a value that cannot be
    measured, no sine."""
    check_finite("time", time)
    highest, n = 5, len(time)
    step = float(time[-1] - time[0]) / (n - 1) if n > 1 else np.inf
    if n * step < 0.99 / frequency_hz:
        raise InputError(
            f"the signal has less than one cycle at {frequency_hz:g} Hz; record more cycles, or"
            " lower `settle_cycles` in the configuration"
        )
    if 2 * highest * frequency_hz * step >= 1:
        raise InputError(
            f"a step of {step * 1e3:.2f} ms is too long for harmonic {highest} of {frequency_hz:g}"
            " Hz; sample faster"
        )
    turns = np.cumprod(np.tile(np.exp(2j * np.pi * frequency_hz * time), (highest, 1)), axis=0)
    X = np.vstack([np.ones(n), *(part for turn in turns for part in (turn.real, turn.imag))]).T
    inside = np.full(n, cycles is None)
    if cycles is None:
        edges = np.arange(round(n * step * frequency_hz) + 1) / (step * frequency_hz)
        cycles = edges[:-1], np.minimum(edges[1:], n)
    for first, stop in zip(*cycles, strict=True):
        inside[whole_rows(first, stop)] = True
    fitted = X if inside.all() else X[inside]
    inverse, to_phasor = np.linalg.inv(fitted.T @ fitted), np.array([[1.0, -1.0], [-1.0, 1.0]])
    for signal in signals:
        check_measured("the signal", signal)
        estimates = inverse @ (fitted.T @ signal[inside])
        residual = signal - X @ estimates
        if len(cycles[0]) < regression.FEWEST_CYCLES:
            covariance, freedom, method, _ = regression.hac(fitted, inverse, residual[inside])
        else:
            scores = regression.products_between(X, residual[:, None], *cycles)[..., 0] @ inverse
            covariance, freedom = regression.between_cycles(
                scores, np.zeros(len(scores), dtype=np.intp)
            )
            method = "cycles"
        # a cos(wt) + b sin(wt) = Re((a - j b) exp(j w t))
        harmonics = estimates[1::2] - 1j * estimates[2::2]
        if abs(harmonics[0]) <= 1e-12 * np.abs(signal).max():  # rounding error of the fit
            raise InputError(
                f"the signal has no sine of {frequency_hz:g} Hz, it stays at {signal[0]:g}; check"
                " its channel in the source file, or exclude the trial"
            )
        own = to_phasor * covariance[1:3, 1:3], float(np.min(freedom[1:3]))
        yield Phasor(complex(harmonics[0]), *own, harmonics, method)


def with_rounding(
    phasor: Phasor, record: Record, channel: int, frequency_hz: float, cycles: tuple[Array, Array]
) -> Phasor:
    """A phasor of angle (0) or torque (1) with the rounding error that its cycles share."""
    first, stop = cycles
    rows = whole_rows(first.min(), stop.max())
    if not (errors := list(record.roundings(channel, rows))):
        return phasor
    turn = np.exp(-2j * np.pi * frequency_hz * record.time[rows]) * 2 / float(np.sum(stop - first))
    edges = first - rows.start, stop - rows.start
    made = regression.products_between(
        np.column_stack([turn.real, turn.imag]), np.array(errors).T, *edges
    )
    change = made.sum(axis=0)
    known = change @ change.T / len(errors)
    if len(first) >= regression.FEWEST_CYCLES:
        spread, _ = regression.between_cycles(
            made.reshape(len(made), -1), np.zeros(len(made), dtype=np.intp)
        )
        known = regression.less(known, np.diag(spread).reshape(change.shape).mean(axis=1))
    both = with_errors(
        phasor.value, [(phasor.covariance, phasor.degrees_of_freedom), (known, len(errors) - 1.0)]
    )
    return replace(phasor, covariance=both.covariance, degrees_of_freedom=both.degrees_of_freedom)


@dataclass(frozen=True)
class SegmentPhasors:
    """Phasors of raw angle and torque in one segment."""

    amplitude_deg: float  # measured amplitude [deg] that names the fits to all its frequencies
    frequency_hz: float  # frequency [Hz]
    theta: Phasor  # of the joint angle [rad]
    torque: Phasor  # of the resisting torque [N*m]
    bench_error: SharedError = (0.0, 0.0, 0.0)
    commanded_deg: float | None = None  # amplitude [deg] in the protocol

    @property
    def admittance(self) -> ComplexEstimate:
        """Integral admittance Y = theta/torque [rad/(N*m)]. An error c of the bench's compliance
        changes Y by -c."""
        return with_bench_error(complex_quotient(self.theta, self.torque), self.bench_error)


def phasors_of_record(record: Record) -> list[SegmentPhasors]:
    """Phasors of the settled cycles in every segment of a stepped sine, amplitude by amplitude;
    none for other motions. The last cycle is not used: if the lag of the angle grows, it contains
    the beginning of the next frequency.

    Raises InputError: as `fit_sinusoids`; the message names the trial."""
    if not record.is_stepped_sine:
        return []
    groups, found = record.groups, []
    for k in sorted(
        range(len(groups.strata)), key=lambda k: groups.labels.index(groups.strata[k].label)
    ):
        one = groups.strata[k]
        assert isinstance(one.label, float)
        first, stop = groups.first[groups.stratum == k], groups.stop[groups.stratum == k]
        rows = whole_rows(first.min(), stop.max())
        cycles, signals = (
            (first - rows.start, stop - rows.start),
            (record.theta[rows], record.torque[rows]),
        )
        sines = fit_sinusoids(record.time[rows], one.frequency_hz, *signals, cycles=cycles)
        where = one.frequency_hz, (first, stop)
        theta, torque = (with_rounding(phasor, record, k, *where) for k, phasor in enumerate(sines))
        compliance_error = record.bench.compliance_error if record.bench else 0.0
        bench_error = compliance_error, *record.calibration.polar(one.frequency_hz)
        found.append(
            SegmentPhasors(
                one.label, one.frequency_hz, theta, torque, bench_error, one.commanded_deg
            )
        )
    return found


def phasor_table(trial: str, phasors: Sequence[SegmentPhasors]) -> pl.DataFrame:
    """A row per amplitude and frequency; none without sines."""
    rows = list[regression.Row]()
    for segment in phasors:
        Y = segment.admittance
        rows.append(
            {
                "trial": trial,
                "amplitude_deg": segment.amplitude_deg,
                "frequency_hz": segment.frequency_hz,
                **complex_row("theta", segment.theta),
                **complex_row("torque", segment.torque),
                "theta_distortion": segment.theta.distortion,
                "torque_distortion": segment.torque.distortion,
                **complex_row("Y", Y),
                **{f"Y_{name}": value for name, value in polar_row(Y).items()},
                **dict(zip(SHARED, segment.bench_error, strict=True)),
                "interval_method": max(
                    segment.theta.interval_method, segment.torque.interval_method, key=len
                ),
                "commanded_deg": segment.commanded_deg,
            }
        )
    return pl.DataFrame(rows, schema=PHASORS)


def frequency_response_table(phasors: pl.DataFrame) -> pl.DataFrame:
    """Complex mean of Y over the amplitudes, one row per trial and frequency, from the phasor
    tables: magnitude [rad/(N*m)] and phase [deg] with 95 % intervals.

    The intervals contain only the noise of the phasors. `_amplitudes_low` and `_high` are extremes
    over amplitudes; their phases are relative to the mean's, so that none jumps at 180 degrees.
    `doubtful` lists causes of doubt."""
    types: dict[str, Any] = dict.fromkeys(("trial", "joint", "side", "controller"), pl.String)
    types |= dict.fromkeys(("K_d", "B_d", "frequency_hz"), pl.Float64)
    # rows that agree in these differ only in amplitude
    keys = [key for key in types if key in phasors.columns] if len(phasors) else list(types)
    rows = list[regression.Row]()
    for values, amplitudes in phasors.group_by(keys, maintain_order=True) if len(phasors) else ():
        of_single = list(amplitudes.iter_rows(named=True))
        # common to all amplitudes
        shared = [max(float(row[name]) for row in of_single) for name in SHARED]
        responses = []
        for row in of_single:
            re, im, var_re, cov, var_im, freedom = (row[f"Y_{part}"] for part in COMPLEX_PARTS)
            own = np.array([[var_re, cov], [cov, var_im]]) - shared_covariance(
                complex(re, im), shared
            )
            responses.append(ComplexEstimate(complex(re, im), own, freedom))
        mean = with_bench_error(complex_mean(responses), shared)
        phases = [np.rad2deg(mean.phase + np.angle(r.value / mean.value)) for r in responses]
        reasons = (
            amplitudes["doubtful"]
            .drop_nulls()
            .unique(maintain_order=True)
            .replace("", None)
            .drop_nulls()
        )
        rows.append(
            {
                **dict(zip(keys, values, strict=True)),
                **polar_row(mean),
                **complex_row("Y", mean),
                **damping_row(mean, of_single[0]["frequency_hz"]),
                "interval_method": " and ".join(amplitudes["interval_method"].unique().sort()),
                "magnitude_amplitudes_low": min(r.magnitude for r in responses),
                "magnitude_amplitudes_high": max(r.magnitude for r in responses),
                "phase_deg_amplitudes_low": float(min(phases)),
                "phase_deg_amplitudes_high": float(max(phases)),
                "n_amplitudes": len(responses),
                "doubtful": "; ".join(reasons),
            }
        )
    ranges = [
        f"{name}_amplitudes_{end}" for name in ("magnitude", "phase_deg") for end in ("low", "high")
    ]
    schema = {key: phasors.schema.get(key, types[key]) for key in keys}
    numbers = (
        *POLAR,
        *(f"Y_{part}" for part in COMPLEX_PARTS),
        *DAMPING,
        "interval_method",
        *ranges,
    )
    schema |= dict.fromkeys(numbers, pl.Float64)
    schema |= {"interval_method": pl.String, "n_amplitudes": pl.Int64, "doubtful": pl.String}
    return pl.DataFrame(rows, schema=schema)


def damping_row(Y: ComplexEstimate, frequency_hz: float) -> regression.Row:
    """`damping` [N*m*s/rad], the real part of the impedance torque/velocity, 1/(j w Y), with its 95
    % interval to first order. It is positive if the joint takes in energy at this frequency."""
    w, Z = 2 * np.pi * frequency_hz, 1 / Y.value
    turned = -(Z**2)  # dZ = turned dY
    along = np.array([turned.imag, turned.real]) / w
    variance = max(float(along @ Y.covariance @ along), 0.0)
    half = float(scipy.special.stdtrit(Y.degrees_of_freedom, 0.975) * np.sqrt(variance))
    value = Z.imag / w
    return {"damping": value, "damping_low": value - half, "damping_high": value + half}


def impedance_over_frequency(
    record: Record, fit: GroupFit | None = None, expected: Admittance | None = None
) -> pl.DataFrame:
    """The trial's rows of `response.csv`; none for a stepped sine, whose response is in
    `phasors.csv`, or for a motion without one. Lines are of unfiltered signals: of the periods up
    to the filter's cut-off, else of the longest stretch. Beside them stand Eq. 15 with K, B and I
    of a `fit`, and the response `expected` from the gains (Eq. 9)."""
    nothing = pl.DataFrame(schema=RESPONSE_COLUMNS)
    if record.is_stepped_sine:
        return nothing
    try:
        if (found := record.periodic) is not None:
            band = slice(int(np.floor(record.low_pass.cutoff_hz * found.period + 1e-9)) + 1)
            made = [replace(one, spectra=one.spectra[..., band]) for one in found.realisations]
            count, columns = len(distinct(made)), periodic_response(made)
            method = "robust" if count > 1 else "fast"
        else:
            longest = max(record.pieces, key=lambda piece: piece.stop - piece.start)
            signals = record.theta[longest], record.torque[longest]
            count, method = 1, "local polynomial"
            columns = local_response(
                record_spectrum(*signals, record.rate_hz, record.low_pass.cutoff_hz)
            )
    except OslAnalysisError:
        return nothing
    s = np.asarray(2j * np.pi * columns["frequency_hz"], dtype=np.complex128)
    curves = {"eq15": None if fit is None else fit["K"] + fit["B"] * s + fit["I"] * s**2}
    curves["eq9"] = None if expected is None else 1 / expected(s)
    frame: dict[str, object] = {
        **dict.fromkeys(RESPONSE_COLUMNS),
        "trial": record.name,
        "method": method,
    }
    frame |= {"realisations": count, **columns}
    for short, Z in curves.items():
        if Z is not None:
            frame |= {
                f"magnitude_{short}": np.abs(Z),
                f"phase_deg_{short}": np.rad2deg(np.angle(Z)),
            }
    return pl.DataFrame(frame, schema=RESPONSE_COLUMNS).fill_nan(None)
