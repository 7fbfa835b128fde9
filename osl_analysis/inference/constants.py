# SPDX-License-Identifier: Apache-2.0
"""The numbers by which rivals are weighed, with unit, meaning and evidence.

Tolerances of numerical methods, and what only saves time, stand where they are used.

"Prototype" is a study of 239 planted, 159 sound and 18 human-like recordings, by which two of the
values were chosen (INEXACTNESS, PRIOR_SOUND). "A choice" was not varied.
"""

# What is believed before the recording is seen

# Share of recordings without a fault that matters; prototype: 0.9, 0.98, 0.995 accuse 1, 1, 0 of
# 159 sound files; 22, 25, 26 are silent
PRIOR_SOUND = 0.98
# Share of joints in which dry friction matters; a choice: no knowledge; 0.2 to 0.8 changes the
# odds by a factor of 4 at most
PRIOR_FRICTION = 0.5
# Share of its own torque that a named mechanism misses, since none is exactly its formula;
# prototype: at 0 and 0.2 69 and 85 % of I's ranges hold under a fault; 0.4 names a quarter
INEXACTNESS = 0.2

# How the recording is cut

# Consecutive parts of the recording, each of which is predicted by the others; 24 scatters give a
# standard error to 15 %; blocks of 2 to 6 s outlast the noise's memory
BLOCKS = 24
# Draws of the Bayesian bootstrap of blocks; a weight of 0.5 is known to 0.03, far below what
# decides
BOOTSTRAP_DRAWS = 200
# Left out at both ends, where filters depend on what was not recorded [s]; ten times the longest
# time constant of a path, and 4 periods of the slowest band's end
EDGE = 0.5
# Time over which rows begin and end at an end or a gap [s]; without a taper the whitening filter
# spreads the step; longer tapers only lose rows
TAPER = 0.25
# Odd extension of both ends before a Fourier transform [s]; 60 times the longest time constant of
# a path
PADDING = 3.0
# Shortest recording: with a quarter of a second a block is one motion [s]; blocks of 0.25 s are
# one half-period of 2 Hz
SHORTEST = 6.0

# Least squares

# Added to the normal equations of scaled columns; far below any that a recording tells, keeps equal
# ones apart
RIDGE = 1e-11
# Length of a column of zeros, whose square is a number, too
TINY = 1e-150

# Band and noise

# Power of the angle over its noise below which the band ends; noise is then 1 % of a column's
# power at the band's end
VISIBLE_ABOVE_NOISE = 100.0
# End of the band at most [Hz]; prototype; not varied
HIGHEST_BAND = 40.0
# End of the band over the sampling rate at most; the working rate of 3.4 bands must stay below the
# sampling rate
BAND_OF_RATE = 0.28
# Rate at which signals are multiplied, or pass a nonlinearity [Hz]; prototype; not varied
PRODUCT_RATE = 250.0
# Width over which the noise's spectrum is averaged [Hz]; 45 lines in a minute, as many as Welch's
# estimate averages in segments of 4 s
COLOUR_BAND = 0.75

# Rounding by the encoder

# Draws of the encoder's zero and the motion's size; they give a standard error to 20 %; as random
# effects in the model they would be fitted away
ROUNDING_DRAWS = 12
# Least play, dead zone, motion or RMS of what is cut, over K, that is not rounding [encoder steps];
# at 1.5 steps a joint at rest explains its own rounding as a dead zone, with a log-likelihood of
# 143; sound steps between levels look cut by up to 2.1, and what is cut and named by 9 or more
FEWEST_STEPS = 3.0

# Ranges of the rivals' own parameters

# Largest delay of torque or angle [s]; a choice: 30 frames at 1 kHz
LARGEST_DELAY_S = 0.03
# Time constants of low-passes [s]; 500 to 3 Hz: amplifiers' filters, held samples at 20 Hz
LAG_S = (3e-4, 0.05)
# Spring in series with the joint [rad/(N*m)]; a frame of 100 kN*m/rad to a belt of 250 N*m/rad
COMPLIANCE = (1e-5, 4e-3)
# Relaxation of a viscoelastic branch [s]; faster than the band it is a damper, slower a spring
BRANCH_S = (5e-3, 0.5)
# Play [rad]; 0.03 to 1.1 deg
PLAY = (5e-4, 2e-2)
# Angles over which friction builds up before it slides [rad]; bristles of 3e-5 to 1e-3 rad are
# sums of these: docs/bench_validation.md
FRICTION_WINDS = (5e-5, 1.5e-4, 5e-4, 1.5e-3)
# Velocity over which sliding friction changes sign, if the velocity's noise is smaller [SD of
# the velocity]; the next wider shape, five times as wide, is a column too
SIGN_WIDTH = 0.01
