"""Recordings of a simulated campaign, where the configuration names a `simulation`."""

if CONFIG.simulation:

    localrules:
        trial_sheet,

    rule trial_sheet:
        """The sample sheet: a row for each trial."""
        input:
            settings_path=CONFIG.simulation,
        output:
            sheet=CONFIG.sheet,
        log:
            "<logs>/simulate/sheet.log",
        params:
            made_by=MADE_BY,
        run:
            job("simulate.write_sheet", input, output, params, log)

    rule simulate_dynamometer:
        """The recordings of a trial, and the truth beside them."""
        input:
            settings_path=CONFIG.simulation,
            made_of=SIMULATION_FILES,
        output:
            log="<raw>/dynamometer/{trial}.mcap",
        log:
            "<logs>/simulate/{trial}.log",
        priority: 1
        params:
            campaign_folder=lambda wildcards: str(CONFIG.raw_data),
            trial="{trial}",
            followed=followed,
            made_by=MADE_BY,
        run:
            job("simulate.simulate_trial", input, output, params, log)

    use rule simulate_dynamometer as simulate_actuator with:
        output:
            log="<raw>/actuator/{trial}.mcap",

    use rule simulate_dynamometer as simulate_capture with:
        output:
            mocap="<raw>/vicon/{trial}.c3d",
        wildcard_constraints:
            trial="|".join([CAMPAIGN.pattern("static"), CAMPAIGN.pattern("plate")]),

    use rule simulate_dynamometer as simulate_crossing with:
        output:
            log="<raw>/leg/{trial}.mcap",
            mocap="<raw>/vicon/{trial}.c3d",
        wildcard_constraints:
            trial=CAMPAIGN.pattern("walking"),
        priority: 0
