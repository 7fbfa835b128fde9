"""Raw logs of a simulated campaign. A campaign with recordings of its own has none of these jobs."""


def simulated_logs() -> list[Path]:
    """The sample sheet and every log that the simulator writes."""
    logs = [log for trial in CAMPAIGN.trials() for log in CAMPAIGN.logs(trial)]
    return [CONFIG.sheet, *logs] if CONFIG.simulation else []


if CONFIG.simulation:

    rule trial_sheet:
        input:
            settings_path=CONFIG.simulation,
        output:
            sheet=CONFIG.sheet,
        log:
            RESULTS / "logs/simulate/sheet.log",
        params:
            code=jobs.code("simulator.plan"),
        run:
            jobs.run_job(log, "simulate.write_sheet", input, output, params)

    for experiment, facts in EXPERIMENTS.items():
        if not CAMPAIGN.trials(experiment):
            continue

        rule:
            name:
                f"simulate_{experiment}"
            input:
                SIMULATION_FILES,
            output:
                [RAW / path for path in facts.simulated_files("{trial}").values()],
            log:
                RESULTS / "logs/simulate/{trial}.log",
            wildcard_constraints:
                trial=CAMPAIGN.pattern(experiment),
            group:
                "trials"
            params:
                code=jobs.code("commands.simulate"),
                settings_path=str(CONFIG.simulation),
                campaign_folder=str(RAW),
                trial="{trial}",
                followed=CONFIG.shared(experiment).model_dump(mode="json"),
            run:
                jobs.run_job(log, "simulate.simulate_trial", input, {}, params, output)
