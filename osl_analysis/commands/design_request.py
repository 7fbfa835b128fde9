"""What a design is asked for: the motion, the sensors and the distortion that options state."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.bench.bench_settings import DynamometerAnalysis
from osl_analysis.bench.planned_errors import KBI, Distortion, Sensors
from osl_analysis.bench.planned_motion import (
    MOST_DRAWN,
    Continuous,
    PeriodicMultisine,
    Plan,
    SteppedSine,
)
from osl_analysis.errors import InputError, nearest
from osl_analysis.table import with_evidence

USUAL_BAND_HZ = (0.5, 6.0)  # of a motion that is no stepped sine
USUAL_RMS_DEG = 2.0  # of its angle
OPTION_OF = {"K": "stiffness", "B": "damping", "I": "inertia"}  # with the expected value of each


@dataclass(frozen=True)
class DesignRequest:
    """What `osl-analysis design` is asked for, in the units of its options; None: not stated."""

    excitation: str  # stepped-sine, multisine, chirp, noise
    frequencies: Sequence[float] | None  # of a stepped sine [Hz]
    amplitudes: Sequence[float] | None  # of a stepped sine [deg]
    cycles: int | None  # at each frequency
    band: Sequence[float] | None  # lowest and highest frequency of another motion [Hz]
    rms: float | None  # of its angle [deg]
    peak: float | None  # largest angle [deg]
    period: float  # of a multisine [s]
    periods: int  # fitted, per realisation
    realisations: int
    seed: int  # of the multisine's phases
    duration: float  # of a chirp or noise [s]
    stiffness: float  # expected K [N*m/rad]
    damping: float  # expected B [N*m*s/rad]
    inertia: float  # expected I [kg*m^2]
    rate: float  # [Hz]
    torque_noise: float  # standard deviation [N*m]
    noise_band: float | None  # of the torque's noise [Hz]
    torque_step: float  # of the load cell [N*m]
    encoder_bits: int  # per turn
    encoder_step: float | None  # [deg], instead of bits
    angle_noise: float  # standard deviation before rounding [deg]
    drift: float | None  # of the load cell [N*m/min]
    friction: float | None  # Coulomb friction of the joint [N*m]
    pilot: Path | None  # results of a pilot, whose friction is taken
    trial: str | None  # of the pilot
    lag: float  # of the torque, whose effect is stated [ms]
    stiffness_within: float | None  # half width that is asked for, as a share of K
    damping_within: float | None  # the same of B
    inertia_within: float | None  # the same of I

    @property
    def joint(self) -> tuple[float, float, float]:
        """The expected K, B and I."""
        return self.stiffness, self.damping, self.inertia


def check_finite_options(request: DesignRequest) -> None:
    """Refuse an option that is no finite number."""
    for name, value in asdict(request).items():
        numbers = value if isinstance(value, list) else [value]
        if any(isinstance(number, float) and not np.isfinite(number) for number in numbers):
            raise InputError(f"--{name.replace('_', '-')} is {value}; give a finite number")


def wanted_shares(request: DesignRequest) -> dict[str, float]:
    """The half-widths that are asked for, as shares of the expected K, B and I."""
    shares = (request.stiffness_within, request.damping_within, request.inertia_within)
    within = {}
    for name, expected, share in zip(KBI, request.joint, shares, strict=True):
        if share is None:
            continue
        if not expected:
            option = OPTION_OF[name]
            raise InputError(
                f"--{option}-within is a share of an expected {name} of 0; give --{option} above 0"
            )
        within[name] = share
    return within


def sensors_of(request: DesignRequest, bench: DynamometerAnalysis) -> Sensors:
    """What the options say of load cell and encoder, in SI units; else the drift of the
    configuration."""
    encoder_step = 2 * np.pi / 2**request.encoder_bits
    if request.encoder_step is not None:
        encoder_step = float(np.deg2rad(request.encoder_step))
    drift_per_minute = request.drift
    if drift_per_minute is None:
        drift_per_minute = bench.load_cell_drift
    return Sensors(
        rate_hz=request.rate,
        torque_noise=request.torque_noise,
        noise_band_hz=request.noise_band,
        torque_step=request.torque_step,
        encoder_step=encoder_step,
        angle_noise=float(np.deg2rad(request.angle_noise)),
        drift=drift_per_minute / 60,
    )


def pilot_distortion(results: Path, trial: str | None) -> Distortion:
    """Coulomb friction of the joint in an impedance trial of a pilot, and the variances of its K, B
    and I; medians of all trials where none is named. Raises InputError: the results have none."""
    table = with_evidence(results / "tables/impedance.csv", ("trial", "amplitude_deg", *KBI))
    rows = table.filter(pl.col("amplitude_deg").is_null())
    if trial is not None:
        rows = rows.filter(trial=trial)
    medians = []
    for name in ("f_C", *(f"{name}_se" for name in KBI)):
        values = rows[name].drop_nulls().to_list() if name in rows.columns else []
        if not values:
            raise InputError(f"{results}: {no_friction_text(table, trial)}")
        medians.append(float(np.median(values)))
    friction, *standard_errors = medians
    return Distortion(max(friction, 0.0), pilot=tuple(se**2 for se in standard_errors))


def no_friction_text(table: pl.DataFrame, trial: str | None) -> str:
    """Why a pilot's `impedance` table tells no friction, and what to do."""
    names = table["trial"].unique().sort().to_list()
    if trial is not None and trial not in names:
        return f"no impedance trial '{trial}'{nearest(trial, names)}"
    with_friction = []
    if "f_C" in table.columns:
        with_friction = table.drop_nulls("f_C")["trial"].unique().sort().to_list()
    of_trial = f"of trial '{trial}' " if trial else ""
    remedy = "state it by --friction"
    if with_friction:
        remedy = f"name another trial, as {with_friction[0]}, or {remedy}"
    return f"the friction {of_trial}is not certain; {remedy}"


def plan_of(request: DesignRequest, bench: DynamometerAnalysis, may_be_longer: bool) -> Plan:
    """The motion that options ask for; `may_be_longer`: a longer one may be recommended."""
    if request.excitation == "stepped-sine":
        return stepped_sine_of(request, bench)
    rms = float(np.deg2rad(request.rms or USUAL_RMS_DEG))
    if request.excitation == "multisine":
        return multisine_of(request, rms, may_be_longer)
    is_chirp = request.excitation == "chirp"
    plan = Continuous(band_of(request), rms, request.duration, is_chirp)
    if request.peak is None:
        return plan
    return replace(plan, rms=rms * float(np.deg2rad(request.peak)) / plan.peak.angle)


def band_of(request: DesignRequest) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] of a motion that is no stepped sine."""
    low, high = request.band or USUAL_BAND_HZ
    return low, high


def multisine_of(request: DesignRequest, rms: float, may_be_longer: bool) -> PeriodicMultisine:
    """A multisine of an RMS angle [rad], or of which no realisation goes beyond the stated peak."""
    plan = PeriodicMultisine(
        period_s=request.period,
        band_hz=band_of(request),
        rms=rms,
        periods=request.periods,
        realisations=request.realisations,
        seed=request.seed,
    )
    if request.peak is None:
        return plan
    of_unit_size = replace(plan, rms=1.0)
    n_drawn = max(plan.realisations, MOST_DRAWN) if may_be_longer else plan.realisations
    highest = max(of_unit_size.motion(number).peak for number in range(n_drawn))
    return replace(plan, rms=float(np.deg2rad(request.peak)) / highest)


def stepped_sine_of(request: DesignRequest, bench: DynamometerAnalysis) -> SteppedSine:
    """The stepped sine of the configuration, with what options state in its place."""
    frequencies = tuple(request.frequencies or bench.frequencies_hz or ())
    amplitudes = tuple(request.amplitudes or bench.amplitudes_deg or ())
    cycles = bench.protocol.cycles_at
    if not (frequencies and amplitudes and (request.cycles or cycles)):
        raise InputError(
            "the configuration states no whole protocol; give --frequencies, --amplitudes and"
            " --cycles, or state amplitudes_deg, frequencies_hz and cycles under `dynamometer`"
        )
    if not all(0 < number < np.inf for number in (*frequencies, *amplitudes)):
        raise InputError(
            "frequencies and amplitudes of sines are above 0; correct --frequencies, --amplitudes"
        )
    if request.cycles is not None:
        cycles = (float(request.cycles),) * len(frequencies)
    elif len(set(cycles)) == 1:
        cycles = (float(cycles[0]),) * len(frequencies)
    elif len(cycles) != len(frequencies):
        raise InputError(
            "the configuration has cycles for its own frequencies; give --cycles for these"
        )
    if min(cycles) <= bench.settle_cycles:
        raise InputError(
            f"settle_cycles = {bench.settle_cycles} leaves none of {min(cycles):g} cycles; give"
            " --cycles above it"
        )
    return SteppedSine(
        tuple(np.deg2rad(amplitudes).tolist()), frequencies, cycles, bench.settle_cycles
    )
