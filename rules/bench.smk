# SPDX-License-Identifier: Apache-2.0
"""Trial -> rows of its fit, by experiment.

The first file has the estimates, `others` is an archive of the other tables of the trial. The line
`job(fit_belt_trial, ...)` calls that function with the inputs and params by their names, and writes
the tables that it returns.
"""

from osl_analysis.commands.fit import (
    fit_actuator_trial,
    fit_belt_trial,
    fit_calibration_trial,
    fit_impedance_trial,
    fit_torque_angle_trial,
    fit_transmission_trial,
)


rule fit_belt:
    """K_s of the belt, with the input shaft locked (Fig. 3)."""
    input:
        trial=of_trials(CAMPAIGN.trials("belt")),
        parameters=device,
    output:
        belt="<results>/fits/belt/{trial}.csv",
        others="<results>/fits/belt/{trial}.zip",
    log:
        "<logs>/belt/{trial}.log",
    params:
        settings=CONFIG.dynamometer.part("BeltAnalysis"),
        made_by=MADE_BY,
    run:
        job(fit_belt_trial, input, output, params, log)


rule fit_transmission:
    """B_j and J_j of the transmission, with the motor detached."""
    input:
        trial=of_trials(CAMPAIGN.trials("transmission")),
        parameters=device,
    output:
        transmission="<results>/fits/transmission/{trial}.csv",
        others="<results>/fits/transmission/{trial}.zip",
    log:
        "<logs>/transmission/{trial}.log",
    priority: 2
    params:
        settings=CONFIG.dynamometer.part("SteppedSineAnalysis"),
        made_by=MADE_BY,
    run:
        job(fit_transmission_trial, input, output, params, log)


rule fit_actuator:
    """k_tau n_m, f_C, f_G, B_m and J_m of the actuator alone (Table I)."""
    input:
        trial=of_trials(CAMPAIGN.trials("actuator")),
        parameters=device,
    output:
        actuator="<results>/fits/actuator/{trial}.csv",
        others="<results>/fits/actuator/{trial}.zip",
    log:
        "<logs>/actuator/{trial}.log",
    params:
        settings=CONFIG.actuator.part("ActuatorAnalysis"),
        made_by=MADE_BY,
    run:
        job(fit_actuator_trial, input, output, params, log)


rule fit_impedance:
    """K, B, I of one trial (Eq. 15), and its frequency response."""
    input:
        trial=of_trials(CAMPAIGN.trials("impedance")),
        parameters=device,
    output:
        impedance="<results>/fits/impedance/{trial}.csv",
        others="<results>/fits/impedance/{trial}.zip",
    log:
        "<logs>/impedance/{trial}.log",
    priority: 2
    params:
        settings=CONFIG.dynamometer.part("ImpedanceAnalysis"),
        weight=as_json(CONFIG.gain_weight),
        condition=cells("controller", "K_d", "B_d"),
        windows=cell("windows"),
        made_by=MADE_BY,
    run:
        job(fit_impedance_trial, input, output, params, log)


rule fit_torque_angle:
    """Stiffness over angle, energy and hysteresis of slow cycles."""
    input:
        trial=of_trials(CAMPAIGN.trials("torque_angle")),
    output:
        torque_angle="<results>/fits/torque_angle/{trial}.csv",
        others="<results>/fits/torque_angle/{trial}.zip",
    log:
        "<logs>/torque_angle/{trial}.log",
    params:
        settings=CONFIG.torque_angle.part("TorqueAngleAnalysis"),
        condition=cells("desired"),
        made_by=MADE_BY,
    run:
        job(fit_torque_angle_trial, input, output, params, log)


rule fit_calibration:
    """Delay and gains that the bench reads of a spring or an inertia that is known."""
    input:
        trial=of_trials(CAMPAIGN.trials("calibration")),
    output:
        calibration="<results>/fits/calibration/{trial}.csv",
        others="<results>/fits/calibration/{trial}.zip",
    log:
        "<logs>/calibration/{trial}.log",
    params:
        settings=CONFIG.dynamometer.part("ImpedanceAnalysis"),
        condition=cells("known_K", "known_I", "known_percent", "fixture"),
        made_by=MADE_BY,
    run:
        job(fit_calibration_trial, input, output, params, log)
