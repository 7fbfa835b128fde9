"""The Monte Carlo study: bias and efficiency of the estimators, and coverage of their intervals.

Here stands which experiments it has. Rules read it, so that nothing is imported that simulates.
"""

BENCH = {
    "second order": ("bench.second_order",),
    "second order, jitter": ("recorded.with_jitter", "bench.second_order"),
    "second order, printed stamps": ("recorded.with_printed_stamps", "bench.second_order"),
    "second order, 14 bits": ("recorded.with_fewer_bits", "bench.second_order"),
    "linear drivetrain": ("bench.linear_drivetrain",),
    "drivetrain": ("bench.drivetrain",),
    "frequency response": ("phasors.response_bench",),
    "transmission": ("bench.transmission",),
    "repeated transmission": ("repeats.repeated_transmission",),
    "belt": ("bench.belt",),
    "repeated belt": ("repeats.repeated_belt",),
    "actuator": ("actuator.actuator",),
}
"""Experiments on a bench, each with the functions of `study/` that turn the study's inputs into it, in their order."""
WALKING = {"walking": ("campaigns", 10), "walking recorded": ("recorded", 5)}
"""Walking, from angle and torque on, and through markers, plate, C3D files and ingest: the field of `study` in the
configuration with the number of campaigns, and how many of them one job takes."""
