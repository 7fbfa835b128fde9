"""Raw logs of a simulated campaign; a laboratory's campaign has none of these jobs."""


def simulated_logs() -> list[Path]:
    """The sample sheet and every log that the simulator writes."""
    return (
        [CONFIG.sheet, *(log for trial in CAMPAIGN.trials() for log in CAMPAIGN.logs(trial))]
        if CONFIG.simulation
        else []
    )


if CONFIG.simulation:

    rule trial_sheet:
        input:
            settings=CONFIG.simulation,
        output:
            CONFIG.sheet,
        log:
            RESULTS / "logs/simulate/sheet.log",
        params:
            code=jobs.code("simulator.plan"),
        run:
            jobs.run_job(log[0], "simulate.write_sheet", settings_path=CONFIG.simulation, sheet=Path(output[0]))

    rule simulate_dynamometer_trial:
        input:
            settings=SIMULATION_FILES,
        output:
            CONFIG.raw_data / "dynamometer/{trial}.mcap",
        log:
            RESULTS / "logs/simulate/{trial}.log",
        params:
            code=jobs.code("commands.simulate"),
        run:
            simulate(log[0], wildcards.trial)

    rule simulate_actuator_trial:
        input:
            settings=SIMULATION_FILES,
        output:
            CONFIG.raw_data / "actuator/{trial}.mcap",
        log:
            RESULTS / "logs/simulate/{trial}.log",
        params:
            code=jobs.code("commands.simulate"),
        run:
            simulate(log[0], wildcards.trial)

    rule simulate_crossing:
        input:
            settings=SIMULATION_FILES,
        output:
            CONFIG.raw_data / "leg/{trial}.mcap",
            CONFIG.raw_data / "vicon/{trial}.c3d",
        log:
            RESULTS / "logs/simulate/{trial}.log",
        wildcard_constraints:
            trial=CAMPAIGN.pattern("walking"),
        params:
            code=jobs.code("commands.simulate"),
        run:
            simulate(log[0], wildcards.trial)

    rule simulate_platform_trial:
        input:
            settings=SIMULATION_FILES,
        output:
            CONFIG.raw_data / "vicon/{trial}.c3d",
        log:
            RESULTS / "logs/simulate/{trial}.log",
        wildcard_constraints:
            trial=CAMPAIGN.pattern("static", "plate"),
        params:
            code=jobs.code("commands.simulate"),
        run:
            simulate(log[0], wildcards.trial)


def simulate(log: str, trial: str) -> None:
    """Simulate one trial of the plan."""
    jobs.run_job(
        log, "simulate.simulate_trial", settings_path=CONFIG.simulation, campaign_folder=CONFIG.raw_data, trial=trial
    )
