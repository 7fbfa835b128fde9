"""The numbers by which hypotheses are weighed, with unit, meaning and evidence.

Tolerances of numerical methods, and what only saves time, stand where they are used. `TABLE` is
what a page or a test reads.

"Prototype" is a study of 239 planted, 159 sound and 18 human-like recordings, by which two of the
values were chosen (INEXACTNESS, PRIOR_SOUND). "A choice" was not varied.
"""

from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Constant:
    """One row of the table."""

    name: str
    value: Any
    unit: str
    meaning: str
    evidence: str


TABLE: list[Constant] = []


def constant(name: str, value: T, unit: str, meaning: str, evidence: str) -> T:
    """Enter a constant in `TABLE` and return its value."""
    TABLE.append(Constant(name, value, unit, meaning, evidence))
    return value


# What is believed before the recording is seen

PRIOR_SOUND = constant(
    "PRIOR_SOUND",
    0.98,
    "1",
    "share of recordings without a fault that matters",
    "prototype: 0.9, 0.98, 0.995 accuse 1, 1, 0 of 159 sound files; 22, 25, 26 are silent",
)
PRIOR_FRICTION = constant(
    "PRIOR_FRICTION",
    0.5,
    "1",
    "share of joints in which dry friction matters",
    "a choice: no knowledge; 0.2 to 0.8 changes the odds by a factor of 4 at most",
)
INEXACTNESS = constant(
    "INEXACTNESS",
    0.2,
    "1",
    "share of its own torque that a named mechanism misses, since none is exactly its formula",
    "prototype: at 0 and 0.2 69 and 85 % of I's ranges hold under a fault; 0.4 names a quarter",
)
LIKELY = constant(
    "LIKELY",
    0.5,
    "1",
    "probability above which a fault, or friction, is named",
    "more likely than not",
)
HARM_SHARE = constant(
    "HARM_SHARE",
    (0.003, 0.01, 0.02),
    "1",
    "relative change of K, B, I that matters, if the user states none",
    "release 0.4.0, so that both inferences are compared by the same rule",
)
HARM_FLOOR = constant(
    "HARM_FLOOR",
    (2.0, 0.1, 1e-3),
    "N*m/rad, N*m*s/rad, kg*m^2",
    "sizes added in quadrature to K, B, I before the share is taken: 0 has no relative change",
    "release 0.4.0 (HARM), with I as in the prototype",
)
KNOWN_DELAY = constant(
    "KNOWN_DELAY",
    1e-4,
    "s",
    "SD to which a delay is taken as known where the fit says what an unstated delay costs",
    "what the issue asks for: a tenth of a sample at 1 kHz",
)

# How the recording is cut

BLOCKS = constant(
    "BLOCKS",
    24,
    "1",
    "consecutive parts of the recording, each of which is predicted by the others",
    "24 scatters give a standard error to 15 %; blocks of 2 to 6 s outlast the noise's memory",
)
BOOTSTRAP_DRAWS = constant(
    "BOOTSTRAP_DRAWS",
    200,
    "1",
    "draws of the Bayesian bootstrap of blocks",
    "a weight of 0.5 is known to 0.03, far below what decides",
)
EDGE = constant(
    "EDGE",
    0.5,
    "s",
    "left out at both ends, where filters depend on what was not recorded",
    "ten times the longest time constant of a path, and 4 periods of the slowest band's end",
)
TAPER = constant(
    "TAPER",
    0.25,
    "s",
    "time over which rows begin and end at an end or a gap",
    "without a taper the whitening filter spreads the step; longer tapers only lose rows",
)
PADDING = constant(
    "PADDING",
    3.0,
    "s",
    "odd extension of both ends before a Fourier transform",
    "60 times the longest time constant of a path",
)
SHORTEST = constant(
    "SHORTEST",
    6.0,
    "s",
    "shortest recording: with a quarter of a second a block is one motion",
    "blocks of 0.25 s are one half-period of 2 Hz",
)

# Band and noise

VISIBLE_ABOVE_NOISE = constant(
    "VISIBLE_ABOVE_NOISE",
    100.0,
    "1",
    "power of the angle over its noise below which the band ends",
    "noise is then 1 % of a column's power at the band's end",
)
HIGHEST_BAND = constant(
    "HIGHEST_BAND", 40.0, "Hz", "end of the band at most", "prototype; not varied"
)
BAND_OF_RATE = constant(
    "BAND_OF_RATE",
    0.28,
    "1",
    "end of the band over the sampling rate at most",
    "the working rate of 3.4 bands must stay below the sampling rate",
)
PRODUCT_RATE = constant(
    "PRODUCT_RATE",
    250.0,
    "Hz",
    "rate at which signals are multiplied, or pass a nonlinearity",
    "prototype; not varied",
)
COLOUR_SEGMENT = constant(
    "COLOUR_SEGMENT",
    4.0,
    "s",
    "segments of Welch's estimate of the noise's spectrum",
    "resolves 0.25 Hz, and averages 29 overlapping spectra in a minute",
)

# Rounding by the encoder

ROUNDING_DRAWS = constant(
    "ROUNDING_DRAWS",
    12,
    "1",
    "draws of the encoder's zero",
    "they give a standard error to 20 %; as random effects in the model they would be fitted away",
)
DWELL_PERIODS = constant(
    "DWELL_PERIODS",
    1.0,
    "periods of the band's end",
    "time after which an encoder that shows one step stands at a level",
    "prototype; not varied",
)
SMALLEST_SIZE = constant(
    "SMALLEST_SIZE",
    0.1,
    "steps",
    "range of drawn sizes for a joint that never stands; 1 if it always does",
    "levels and sines may lie anywhere within a step",
)
FEWEST_STEPS = constant(
    "FEWEST_STEPS",
    3.0,
    "encoder steps",
    "least play, dead zone or motion that is not rounding",
    "at 1.5 steps a joint at rest explains its own rounding as a dead zone, with 143 nats",
)

# Sampling of a torque that jumps


# A leg's actuator

SLIDING = constant(
    "SLIDING",
    (0.2, 0.1, 0.3),
    "SD of the actuator's velocity",
    "speed above which an actuator slides; what the further two would change is an error",
    "16 uncompensated legs: B is off by 0.037, 0.016, 0.012 N*m*s/rad (RMS) at 0.05, 0.1, 0.2",
)
SETTLING = constant(
    "SETTLING",
    0.02,
    "s",
    "time about a standstill that is left out, since filters spread it",
    "16 legs, sliding above 0.05 SD: B is off by 0.028 with 0.01 s, 0.037 with 0.02 s (RMS)",
)
FRICTION_INEXACTNESS = constant(
    "FRICTION_INEXACTNESS",
    0.005,
    "1",
    "share of what an actuator's friction does to K, B, I that its formula misses",
    "32 legs of other seeds: B is held in 28 without it, in 31 with it",
)

# Ranges of the hypotheses' own parameters

DELAYS = constant(
    "DELAYS",
    (-0.02, 0.03),
    "s",
    "torque after angle",
    "a choice: 20 frames at 1 kHz early, 30 late",
)
LAGS = constant(
    "LAGS",
    (3e-4, 0.05),
    "s",
    "time constants of low-passes, means, and period/2 pi of resonances",
    "500 to 3 Hz: amplifiers' filters, held samples at 20 Hz",
)
RESONANCE_DAMPING = constant(
    "RESONANCE_DAMPING",
    0.1,
    "1",
    "twice the damping ratio of a path that resonates",
    "a choice: lightly damped",
)
COMPLIANCES = constant(
    "COMPLIANCES",
    (1e-5, 4e-3),
    "rad/(N*m)",
    "spring in series with the joint",
    "a frame of 100 kN*m/rad to a belt of 250 N*m/rad",
)
PLAYS = constant("PLAYS", (5e-4, 2e-2), "rad", "play and dead zones", "0.03 to 1.1 deg")
MOMENTS = constant(
    "MOMENTS",
    tuple(k / 24 for k in range(6, 19)),
    "share of the recording",
    "moments at which stiffness or lag may step",
    "before a quarter and after three quarters too little is left to tell",
)
FRICTION_WINDS = constant(
    "FRICTION_WINDS",
    (5e-5, 1.5e-4, 5e-4, 1.5e-3),
    "rad",
    "angles over which friction builds up before it slides",
    "bristles of 3e-5 to 1e-3 rad are sums of these: docs/bench_validation.md",
)
SIGN_WIDTH = constant(
    "SIGN_WIDTH",
    0.01,
    "SD of the velocity",
    "velocity over which sliding friction changes sign, if the velocity's noise is smaller",
    "the next wider shape, five times as wide, is a column too",
)
