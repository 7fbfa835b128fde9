"""What sampling makes of a torque whose acceleration jumps, against joints that are known."""

import numpy as np
import pytest

from osl_analysis.inference import BenchSignals, infer_impedance
from osl_analysis.inference.acceleration_jumps import acceleration_jumps, impulses
from osl_analysis.inference.spectra import Spectra

RATE = 1000.0
K, B, I = 300.0, 5.0, 0.02
CORNER = 2 * np.pi * 8.0  # rad/s, of the two lags that the command passes


def commanded(place: float, seconds: float = 40.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle, torque, and moments [s] of a joint that follows steps of random height through two
    lags. It is the sum of its answers to each step, which begin `place` rows after a sample."""
    rng = np.random.default_rng(4)
    time = np.arange(round(seconds * RATE)) / RATE
    moments = np.arange(1.0, seconds - 1.0, 0.31).round(3) + place / RATE
    heights = rng.uniform(-0.08, 0.08, len(moments))
    theta = np.zeros_like(time)
    torque = np.zeros_like(time)
    for moment, height in zip(moments, heights, strict=True):
        u = CORNER * np.clip(time - moment, 0.0, None)
        decayed = height * np.exp(-u) * (time >= moment)
        answer = height * (time >= moment) - decayed * (1 + u)
        omega, alpha = CORNER * decayed * u, CORNER**2 * decayed * (1 - u)
        theta += answer
        torque += K * answer + B * omega + I * alpha
    return theta, torque, moments


def signals(place: float) -> BenchSignals:
    theta, torque, _ = commanded(place)
    noise = 0.05 * np.random.default_rng(6).normal(size=len(torque))
    step = 2 * np.pi / 2**20
    return BenchSignals(np.round(theta / step) * step, torque + noise, RATE, encoder_step=step)


def test_jumps_are_found_with_their_size_and_where_they_are():
    theta, _, moments = commanded(0.4)
    heights = np.diff(theta[np.append(moments * RATE - 1, len(theta) - 1).astype(int)])

    jumps = acceleration_jumps(Spectra(signals(0.4)))

    assert len(jumps.at) > 0.8 * len(moments)
    # steps are 310 rows apart
    place = np.exp(2j * np.pi * jumps.at / 310)
    assert np.abs(np.mean(place)) > 0.999
    largest = np.abs(heights).max() * CORNER**2
    assert np.abs(jumps.sizes).max() == pytest.approx(largest, rel=0.15)


def test_a_smooth_motion_has_no_jumps():
    time = np.arange(round(40 * RATE)) / RATE
    theta = 0.05 * np.sin(2 * np.pi * 2 * time) * np.sin(2 * np.pi * 0.31 * time)
    step = 2 * np.pi / 2**20

    smooth = BenchSignals(np.round(theta / step) * step, K * theta, RATE, encoder_step=step)

    assert len(acceleration_jumps(Spectra(smooth)).at) == 0


@pytest.mark.parametrize("place", [1e-6, 0.5])
def test_impedance_is_held_wherever_the_acceleration_jumps(place):
    found = infer_impedance(signals(place))

    assert found.doubt is None
    assert found.impedance.K.holds(K)
    assert found.impedance.B.holds(B)
    assert found.impedance.I.holds(I)
    assert found.sound.I.half_width < 0.02 * I
    assert abs(found.sound.I.value / I - 1) < 0.01


def test_impulse_between_two_rows_has_its_area_and_its_moment():
    spectra = Spectra(signals(0.4))

    spectrum = impulses(spectra, np.array([5000.25]), np.array([[2.0]]))[0]

    area = spectrum * spectra.padded_seconds / spectra.working_rows
    expected = 2.0 * np.exp(-spectra.s * 5000.25 / RATE)
    assert area[:400] == pytest.approx(expected[:400], abs=1e-3)
