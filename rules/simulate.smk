"""Raw logs of a simulated campaign. A campaign with recordings of its own has none of these jobs."""


def simulated_logs() -> list[Path]:
    """The sample sheet and every log that the simulator writes."""
    logs = [log for trial in CAMPAIGN.trials() for log in CAMPAIGN.logs(trial)]
    return [CONFIG.sheet, *logs] if CONFIG.simulation else []


if CONFIG.simulation:

    @step("simulate.write_sheet", {"sheet": CONFIG.sheet}, "simulate/sheet")
    def trial_sheet(_):
        return {"files": {"settings_path": CONFIG.simulation}}

    for experiment, facts in EXPERIMENTS.items():
        if not CAMPAIGN.trials(experiment):
            continue

        @step(
            "simulate.simulate_trial",
            [RAW / path for path in facts.simulated_files("{trial}").values()],
            "simulate/{trial}",
            name=f"simulate_{experiment}",
            trial=CAMPAIGN.pattern(experiment),
        )
        def simulate_trial(wildcards, experiment=experiment):
            return {
                "modules": ("commands.simulate",),
                "made_of": SIMULATION_FILES,
                "settings": {
                    "settings_path": str(CONFIG.simulation),
                    "campaign_folder": str(RAW),
                    "trial": wildcards.trial,
                    "followed": CONFIG.shared(experiment).model_dump(mode="json"),
                },
                "output": {},
            }
