"""Raw logs of a simulated campaign. A campaign with recordings of its own has none of these jobs."""


def simulated_logs() -> list[Path]:
    """The sample sheet and every log that the simulator writes."""
    logs = [log for trial in CAMPAIGN.trials() for log in CAMPAIGN.logs(trial)]
    return [CONFIG.sheet, *logs] if CONFIG.simulation else []


def simulation_of(experiment: str):
    """The input of the rule that simulates the trials of an experiment."""
    return lambda wildcards: job(
        getattr(rules, f"simulate_{experiment}"),
        wildcards,
        "simulate.simulate_trial",
        ("commands.simulate",),
        made_of=SIMULATION_FILES,
        settings={
            "settings_path": str(CONFIG.simulation),
            "campaign_folder": str(RAW),
            "trial": wildcards.trial,
            "followed": CONFIG.shared(experiment).model_dump(mode="json"),
        },
        output={},
    )


if CONFIG.simulation:

    rule trial_sheet:
        input:
            unpack(
                lambda wildcards: job(
                    rules.trial_sheet,
                    wildcards,
                    "simulate.write_sheet",
                    ("simulator.plan",),
                    files={"settings_path": CONFIG.simulation},
                )
            ),
        output:
            sheet=CONFIG.sheet,
        log:
            RESULTS / "logs/simulate/sheet.log",
        shell:
            JOB

    for experiment, facts in EXPERIMENTS.items():
        if not CAMPAIGN.trials(experiment):
            continue

        rule:
            name:
                f"simulate_{experiment}"
            input:
                unpack(simulation_of(experiment)),
            output:
                [RAW / path for path in facts.simulated_files("{trial}").values()],
            log:
                RESULTS / "logs/simulate/{trial}.log",
            wildcard_constraints:
                trial=CAMPAIGN.pattern(experiment),
            shell:
                JOB
