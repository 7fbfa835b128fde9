# SPDX-License-Identifier: Apache-2.0
"""One trial of a bench, the dynamometer's or the actuator's own: commanded motion, the motor that
follows it with finite bandwidth, true torque, recorded log, truth."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.model.compensator import Gains, select_gains
from osl_analysis.model.drivetrain import DrivetrainParameters, actuator_torque
from osl_analysis.model.multisine import odd_multisine
from osl_analysis.simulator import recorder, two_mass_drivetrain
from osl_analysis.simulator.simulation_settings import (
    ActuatorBench,
    BeltMotion,
    Excitation,
    SimulationSettings,
    SteppedSineSchedule,
)
from osl_analysis.simulator.trial_plan import generator_of

# A person's hand
SLOW_IS_LARGE = 1.5  # power of the frequency by which the lines of a hand's motion fall


@dataclass(frozen=True)
class JointMotion:
    """An angle with its derivatives, each the true derivative of the one before."""

    theta: Array  # (n,) [rad]
    omega: Array  # (n,) [rad/s]
    alpha: Array  # (n,) [rad/s^2]


def sine_command(protocol: SteppedSineSchedule, rate_hz: float) -> JointMotion:
    """Command the stepped sine from rest.

    The velocity jumps where the frequency changes, and the acceleration does not include these
    jumps.
    """
    block = [*zip(protocol.durations, protocol.frequencies_hz, strict=True)]
    block.append((protocol.rest_s, 0.0))  # a rest has no frequency
    pieces = [(protocol.lead_s, 0.0, 0.0)]  # duration [s], frequency [Hz], amplitude [deg]
    for amplitude_deg in protocol.amplitudes_deg:
        pieces += [(duration, frequency, amplitude_deg) for duration, frequency in block]

    ends = np.cumsum([duration for duration, _, _ in pieces])
    time = np.arange(round(ends[-1] * rate_hz)) / rate_hz
    starts = np.array([0.0, *ends[:-1]])
    piece = np.searchsorted(starts, time, side="right") - 1  # (n,) to which a sample belongs
    _, frequency, amplitude_deg = np.array(pieces).T[:, piece]
    w = 2 * np.pi * frequency
    phase = w * (time - starts[piece])
    size = np.deg2rad(amplitude_deg)
    return JointMotion(
        theta=size * np.sin(phase),
        omega=size * (w * np.cos(phase)),
        alpha=size * (-(w**2) * np.sin(phase)),
    )


def there_and_back(belt: BeltMotion, rate_hz: float) -> JointMotion:
    """Command the belt experiment: a raised cosine of one period, between two rests."""
    time = np.arange(round(2 * (belt.ramp_s + belt.rest_s) * rate_hz)) / rate_hz
    w = np.pi / belt.ramp_s
    height = 0.5 * np.deg2rad(belt.amplitude_deg)
    phase = w * np.clip(time - belt.rest_s, 0.0, 2 * belt.ramp_s)
    moves = (phase > 0) & (phase < 2 * np.pi)
    return JointMotion(
        theta=height * (1 - np.cos(phase)),
        omega=height * w * np.sin(phase),
        alpha=height * w**2 * np.where(moves, np.cos(phase), 0.0),
    )


def position_loop(
    command: JointMotion, rate_hz: float, bandwidth_hz: float, damping_ratio: float
) -> JointMotion:
    """Follow a command with a second-order position loop, from rest at the command's first angle.

    Between two samples the solution is exact for the cubic through the command's angles and
    velocities: straight lines would cause corners in the acceleration, which are aliased by the
    rate of the log and bias J_j.
    """
    w = 2 * np.pi * bandwidth_hz
    step = 1 / rate_hz
    # rates of theta, omega, and of the command with its three derivatives
    rates = np.diag(np.ones(5), 1)
    rates[1, :3] = -(w**2), -2 * damping_ratio * w, w**2
    transition = scipy.linalg.expm(rates * step)[:2]  # over a step

    angle = command.theta - command.theta[0]
    speed = command.omega
    mean = np.diff(angle) / step
    before, after = speed[:-1], speed[1:]  # each step
    curvature = 2.0 * (3.0 * mean - 2.0 * before - after) / step
    jerk = 6.0 * (before + after - 2.0 * mean) / step**2
    forced = transition[:, 2:] @ [angle[:-1], before, curvature, jerk]
    # theta and omega, (2, n): from rest, by (z - A)^-1 = (z - trace(A) + A) / det(z - A)
    A = transition[:, :2]
    driven = forced.copy()
    driven[:, 1:] += (A - np.trace(A) * np.eye(2)) @ forced[:, :-1]
    followed = np.pad(scipy.signal.lfilter([1.0], np.poly(A), driven), ((0, 0), (1, 0)))
    theta, omega = followed
    alpha = w**2 * (angle - theta) - 2 * damping_ratio * w * omega
    return JointMotion(command.theta[0] + theta, omega, alpha)


def excitation_motion(excitation: Excitation, trial: str, seed: int, rate_hz: float) -> JointMotion:
    """Command the motion of one trial, from rest to rest, with its fades."""
    duration = excitation.full_s + 2 * excitation.fade_s
    time = np.arange(round(duration * rate_hz)) / rate_hz
    envelope = scipy.signal.windows.tukey(len(time), 2 * excitation.fade_s / duration, sym=False)
    shape = steady_angle(excitation, time, generator_of(seed, trial, "excitation"))
    theta = np.deg2rad(excitation.rms_deg) * envelope * shape
    return with_derivatives(np.pad(theta, round(excitation.rest_s * rate_hz)), rate_hz)


def with_derivatives(theta: Array, rate_hz: float) -> JointMotion:
    """The motion of a smooth angle (n,) [rad], by the cubic spline through it."""
    spline = scipy.interpolate.CubicSpline(np.arange(len(theta)) / rate_hz, theta)
    return JointMotion(theta, spline(spline.x, 1), spline(spline.x, 2))


def steady_angle(excitation: Excitation, time: Array, draws: np.random.Generator) -> Array:
    """The angle at full size over its RMS, at times (n,) [s]; it goes on through the fades."""
    low, high = excitation.band_hz
    if excitation.kind == "multisine":
        seed = int(draws.integers(2**31))
        return odd_multisine(time, excitation.period_s, (low, high), seed)
    if excitation.kind == "chirp":
        since_full = time - excitation.fade_s
        phase_deg = draws.uniform(0, 360) - 90  # of a cosine
        sweep = scipy.signal.chirp(since_full, low, excitation.full_s, high, phi=phase_deg)
        return np.sqrt(2) * sweep
    return noise(excitation, time, draws)


def noise(excitation: Excitation, time: Array, draws: np.random.Generator) -> Array:
    """Gaussian noise (n,) of unit RMS, flat within the band and nothing beyond; or as a person
    moves a joint by `hand`: slow motions are the larger."""
    low, high = excitation.band_hz
    f = np.fft.rfftfreq(len(time), time[1])
    gain = ((f >= low) & (f <= high)).astype(float)
    if excitation.kind == "hand":
        gain /= np.maximum(f, low) ** SLOW_IS_LARGE
    lines = gain * (draws.standard_normal(len(f)) + 1j * draws.standard_normal(len(f)))
    steady = np.fft.irfft(lines, len(time))
    return steady / np.std(steady)


def actuator_command(bench: ActuatorBench, rate_hz: float) -> tuple[JointMotion, Array]:
    """Command the actuator's own bench: tones of velocity and of current.

    Returns
    -------
    motion : JointMotion
        Of the output.
    current : Array
        (n,) [A]. Both fade in and out within `fade_s` with continuous derivatives.
    """
    time = np.arange(round(bench.duration_s * rate_hz)) / rate_hz
    from_ends = np.minimum(time, bench.duration_s - time) / bench.fade_s
    # 10 u^3 - 15 u^4 + 6 u^5: two derivatives vanish at both ends
    fade = scipy.special.betainc(3, 3, np.clip(from_ends, 0.0, 1.0))
    theta, current = np.zeros((2, len(time)))
    for tone in bench.velocity:
        w = 2 * np.pi * tone.frequency_hz
        theta += tone.size / w * (1 - np.cos(w * time))
    for tone in bench.current:
        current += tone.size * np.sin(2 * np.pi * tone.frequency_hz * time)
    return with_derivatives(fade * theta, rate_hz), fade * current


COULOMB_WIDTH = 1e-3  # velocity [rad/s] of a joint's friction: a hundredth of a slow sine's speed


def simulate_bench_trial(
    row: Mapping[str, Any], settings: SimulationSettings, p: DrivetrainParameters
) -> tuple[dict[str, Array], dict[str, object]]:
    """Simulate one trial of the sample sheet.

    Parameters
    ----------
    row : Mapping
        The sheet's trial, experiment (belt, transmission, impedance or actuator),
        controller, K_d and B_d.
    settings : SimulationSettings
    p : DrivetrainParameters

    Returns
    -------
    log : dict
        As `recording_of` gives it.
    truth : dict
    """
    trial = row["trial"]
    experiment = row["experiment"]
    p = parameters_of_trial(trial, experiment, settings, p)
    gains = None
    if experiment == "impedance" and settings.joint is None:
        gains = select_gains(row["controller"], row["K_d"], row["B_d"], p, settings.gain_weight)
    _, signals = true_signals(row, settings, p, gains)
    log, drawn = recorder.recording_of(trial, signals, settings)
    truth = {
        "trial": trial,
        "seed": settings.seed,
        "parameters": asdict(p),  # with this trial's K_s
        "gains": asdict(gains) if gains else None,
        "joint": settings.joint.model_dump() if settings.joint else None,
        "effects": settings.effects.model_dump(),
        "recorder": settings.recorder.model_dump(),
        "drawn": drawn,
    }
    return log, truth


def parameters_of_trial(
    trial: str, experiment: str, settings: SimulationSettings, p: DrivetrainParameters
) -> DrivetrainParameters:
    """The device's parameters in one trial: K_s scatters in the belt experiment, and the actuator's
    own friction is the true one."""
    effects = settings.effects
    if experiment == "belt":
        draw = generator_of(settings.seed, trial, "belt_scatter").standard_normal()
        return replace(p, K_s=p.K_s * (1 + effects.belt_scatter.value * draw))
    if experiment == "actuator":
        return replace(p, f_C=effects.friction.value * p.f_C, f_G=effects.friction.value * p.f_G)
    return p


def true_signals(
    row: Mapping[str, Any],
    settings: SimulationSettings,
    p: DrivetrainParameters,
    gains: Gains | None,
) -> tuple[JointMotion, dict[str, recorder.TrueSignal]]:
    """Find the true motion of a trial, and its true signals.

    Parameters
    ----------
    row : Mapping
        Trial and experiment of the sheet.
    settings : SimulationSettings
    p : DrivetrainParameters
    gains : Gains or None
        Of an impedance trial's controller; None: a joint of Eq. 15.

    Returns
    -------
    motion : JointMotion
    signals : dict
        By channel. The load cell has the torque of the joint on the bench, the paper's tau_j:
        *minus* the canonical torque. The actuator's own transducer has imperfections, too.
    """
    experiment = row["experiment"]
    rate = settings.dynamometer.rate_hz
    if experiment == "actuator" and settings.actuator is not None:
        command, current = actuator_command(settings.actuator, rate)
        motion = followed(command, settings)
        return motion, {
            "actuator_angle": motion.theta,
            "motor_current": current,
            "output_torque": output_torque(motion, current, rate, p),
        }

    command = joint_command(row, settings)
    motion = followed(command, settings)
    losses = p.B_j * motion.omega + p.J_j * motion.alpha
    # an idle actuator reads 0
    theta_m = np.zeros_like(motion.theta)
    current = np.zeros_like(motion.theta)
    if experiment == "belt":
        # the actuator is locked at theta_m = 0: all of the joint's angle deflects the belt
        belt = two_mass_drivetrain.constants(drivetrain_effects(settings), p)
        deflection = np.ascontiguousarray(motion.theta)
        torque = two_mass_drivetrain.belt_path(deflection, belt) + losses
    elif experiment == "transmission":
        # the motor is detached: the belt stays slack
        torque = losses
    elif gains is None:
        assert settings.joint is not None  # else there are gains
        joint = settings.joint
        friction = joint.coulomb.value * np.tanh(motion.omega / COULOMB_WIDTH)
        # Eq. 15, with Coulomb friction
        torque = joint.K * motion.theta + joint.B * motion.omega + joint.I * motion.alpha + friction
    else:
        # the controller renders its impedance about theta_eq = 0, from rest at theta_m = 0
        commands = np.array([[gains.K_1], [gains.B_1], [0.0]])
        effects = drivetrain_effects(settings, gains)
        leg = two_mass_drivetrain.simulate_drivetrain(
            rate, motion.theta, motion.omega, commands, effects, p
        )
        theta_m = leg["theta_m"]
        current = leg["current"]
        torque = leg["belt_torque"] + losses

    return motion, {
        "joint_angle": motion.theta,
        "actuator_angle": theta_m,
        "motor_current": current,
        "commanded_angle": command.theta,
        "load_cell_torque": -torque,
    }


def joint_command(row: Mapping[str, Any], settings: SimulationSettings) -> JointMotion:
    """The motion that the dynamometer is told to follow in a trial."""
    experiment = row["experiment"]
    rate = settings.dynamometer.rate_hz
    if experiment == "belt":
        return there_and_back(settings.belt, rate)
    trial = row["trial"]
    if experiment == "impedance":
        name_without_number = trial.rpartition("_")[0]
        for excitation in settings.excitations:
            if name_without_number.endswith(f"_{excitation.name}"):
                return excitation_motion(excitation, trial, settings.seed, rate)
    return sine_command(settings.protocol, rate)


def followed(command: JointMotion, settings: SimulationSettings) -> JointMotion:
    """The motion of a bench, with finite bandwidth if its effect is on."""
    bandwidth = settings.effects.dynamometer_bandwidth
    if not bandwidth.enabled:
        return command
    bench = settings.dynamometer
    return position_loop(command, bench.rate_hz, bandwidth.size, bench.damping_ratio)


def output_torque(
    motion: JointMotion, current: Array, rate_hz: float, p: DrivetrainParameters
) -> recorder.TrueSignal:
    """The true torque [N*m] of the actuator on the bench, the paper's tau_m, as a function of
    instants [s].

    Friction jumps where the velocity is zero. A curve through the samples has each jump half a step
    after a sample, which looks like inertia to a transducer that samples later.
    """
    samples = np.column_stack([current, motion.omega, motion.alpha])
    exact = scipy.interpolate.CubicSpline(np.arange(len(current)) / rate_hz, samples)

    def torque_at(instants: Array) -> Array:
        current, omega_m, alpha_m = exact(instants).T
        return actuator_torque(current, omega_m, alpha_m, p)

    return torque_at


def drivetrain_effects(
    settings: SimulationSettings, gains: Gains | None = None
) -> dict[str, float]:
    """The effects of the settings, as the drivetrain's simulation takes them, with the controller
    of these gains."""
    effects = settings.effects
    drivetrain = settings.drivetrain
    is_sampled = effects.control_delay.enabled
    return {
        "friction": effects.friction.enabled,
        "friction_scale": effects.friction.size,
        "cancels_friction": gains is not None and gains.cancels_friction,
        "control_delay": int(effects.control_delay.value),
        "encoder_resolution": effects.actuator_encoder.value,
        "velocity_cutoff_hz": effects.velocity_filter.value,
        "sign_width": drivetrain.sign_width,
        "hysteresis_torque": effects.belt_hysteresis.value,
        "hysteresis_width": drivetrain.hysteresis_width,
        "substeps": drivetrain.substeps,
        "control_updates": drivetrain.control_updates if is_sampled else drivetrain.substeps,
    }


def write_bench_log(path: Path, log: Mapping[str, Array]) -> None:
    """Write a log: the standard messages of a node for the angles, and of one for the torque."""
    torque_frame, torque = "load_cell", "load_cell_torque"
    if torque not in log:
        torque_frame, torque = "transducer", "output_torque"
    joints = {"joint": "joint_angle", "actuator": "actuator_angle", "command": "commanded_angle"}
    position = {joint: log[channel] for joint, channel in joints.items() if channel in log}
    effort = {"actuator": log["motor_current"]}
    topics = [
        recorder.joint_states(log["time"], position, effort),
        recorder.wrenches(torque_frame, log["torque_time"], log[torque]),
    ]
    recorder.write_topics(path, topics)
