"""Rows of single trials -> tables over trials -> findings and headline numbers."""


rule table:
    """A table from the rows of single trials, with the doubts about each row."""
    input:
        rows=lambda wildcards: rows(wildcards.table),
        fits=lambda wildcards: rows(doubts_of(wildcards.table)),
        quality=lambda wildcards: checks(list(places_in(wildcards.table))),
    output:
        "<results>/tables/{table}.csv",
    log:
        "<logs>/tables/{table}.log",
    wildcard_constraints:
        table=one_of(table for table in GATHERED if table != "impedance"),
    localrule: True
    params:
        limits=lambda wildcards: limits(wildcards.table),
        limits_of_fits=lambda wildcards: limits(doubts_of(wildcards.table)),
        places=lambda wildcards: places_in(wildcards.table),
        excluded=lambda wildcards: excluded(places_in(wildcards.table)),
        made_by=MADE_BY,
    run:
        job("tables.gather", input, output, params, log)


rule impedance_tables:
    """K, B, I of the impedance trials; their evidence stands in a table of its own."""
    input:
        rows=rows("impedance"),
        quality=checks(CAMPAIGN.trials("impedance")),
    output:
        output="<results>/tables/impedance.csv",
        evidence="<results>/tables/impedance_evidence.csv",
    log:
        "<logs>/tables/impedance.log",
    priority: 3
    localrule: True
    params:
        limits=limits("impedance"),
        places=places_in("impedance"),
        evidence_columns=list(described_tables_by_name()["impedance_evidence"].columns),
        excluded=lambda wildcards: excluded(CAMPAIGN.trials("impedance")),
        made_by=MADE_BY,
    run:
        job("tables.gather", input, output, params, log)


rule summary_table:
    """A table that is computed from another one alone."""
    input:
        table=lambda wildcards: f"<results>/tables/{DERIVED[wildcards.table][0]}.csv",
        evidence=lambda wildcards: evidence_of(DERIVED[wildcards.table][0]),
    output:
        "<results>/tables/{table}.csv",
    log:
        "<logs>/tables/{table}.log",
    wildcard_constraints:
        table=one_of(DERIVED),
    localrule: True
    params:
        made_by=MADE_BY,
    run:
        job(DERIVED[wildcards.table][1], input, output, params, log)


rule predict:
    """The impedance that the measured components predict, beside the measured one."""
    input:
        records=rows("record", PREDICTED),
        table="<results>/tables/impedance.csv",
        evidence="<results>/tables/impedance_evidence.csv",
        law="<results>/tables/law.csv",
        components=tables(*PARTS) if PREDICTED else [],
        parameters=PARAMETERS,
    output:
        output="<results>/tables/prediction.csv",
        causes="<results>/tables/prediction_causes.csv",
        frequencies="<results>/tables/prediction_frequencies.csv",
    log:
        "<logs>/tables/prediction.log",
    priority: 3
    localrule: True
    params:
        unpredicted=UNPREDICTED,
        weight=plain(CONFIG.gain_weight),
        sign_width=CONFIG.model_comparison.sign_width,
        settings=CONFIG.dynamometer.part("FilterSettings"),
        made_by=MADE_BY,
    run:
        job("predictions.gather_predictions", input, output, params, log)


rule gains_table:
    """Gains for the impedance over the gait cycle (Fig. 8)."""
    input:
        trajectory=TRAJECTORY,
        parameters=PARAMETERS,
    output:
        "<results>/tables/gains.csv",
    log:
        "<logs>/tables/gains.log",
    localrule: True
    params:
        weight=plain(CONFIG.gain_weight),
        made_by=MADE_BY,
    run:
        job("gains.select_trajectory", input, output, params, log)


rule check_claims:
    """The claims of the paper's text, compared with the campaign's numbers."""
    input:
        tables=tables(*CLAIMED),
        parameters=PARAMETERS,
    output:
        "<results>/tables/claims.csv",
    log:
        "<logs>/tables/claims.log",
    localrule: True
    params:
        settings=plain(CONFIG.claims),
        frequencies_hz=CONFIG.dynamometer.frequencies_hz or (),
        midstance=CONFIG.figures.midstance_stiffness,
        made_by=MADE_BY,
    run:
        job("tables.check_claims", input, output, params, log)


rule settings_table:
    """The settings that judge or label results: which are stated, assumed or measured."""
    input:
        phasors=tables("phasors"),
    output:
        "<results>/tables/settings.csv",
    log:
        "<logs>/tables/settings.log",
    localrule: True
    params:
        states=states_of(CONFIG, config, [name for name in EXPERIMENTS if CAMPAIGN.trials(name)]),
        made_by=MADE_BY,
    run:
        job("tables.write_settings", input, output, params, log)


rule excluded_trials:
    """Every trial that is not used, and why."""
    input:
        fitted=RESULTS_OF_TRIALS,
        verdicts=QUALITY,
    output:
        "<results>/tables/excluded.csv",
    log:
        "<logs>/tables/excluded.log",
    localrule: True
    params:
        by_sheet=CAMPAIGN.excluded,
        places=PLACES,
        made_by=MADE_BY,
    run:
        job("tables.list_excluded", input, output, params, log)


rule findings:
    """What was found on all trials, as values and in words."""
    input:
        tables=tables(*judged_tables(), *JUDGED_FURTHER),
        evidence=evidence_of("impedance"),
        verdicts=QUALITY,
    output:
        "<results>/tables/findings.csv",
    log:
        "<logs>/tables/findings.log",
    localrule: True
    params:
        limits=plain(CONFIG.doubtful),
        places=PLACES,
        made_by=MADE_BY,
    run:
        job("tables.write_findings", input, output, params, log)


rule headline_numbers:
    """The numbers of the paper's text, for programs and for LaTeX."""
    input:
        table_paths=TABLES,
        excluded="<results>/tables/excluded.csv",
        findings="<results>/tables/findings.csv",
        verdicts=QUALITY,
    output:
        summary_json="<results>/summary.json",
        numbers_tex="<results>/numbers.tex",
    log:
        "<logs>/summary.log",
    localrule: True
    params:
        about=ABOUT,
        example=example,
        trials={name: CAMPAIGN.trials(name) for name in EXPERIMENTS if CAMPAIGN.trials(name)},
        beside_draft=CAMPAIGN.beside_draft,
        made_by=MADE_BY,
    run:
        job("tables.write_summary", input, output, params, log)


if "impedance" in TABLE_NAMES:

    rule conditions_for_paper:
        """K, B and I of each condition, as a table for a paper."""
        input:
            table="<results>/tables/impedance.csv",
            evidence="<results>/tables/impedance_evidence.csv",
        output:
            tex="<results>/tables/latex/conditions.tex",
            markdown="<results>/tables/markdown/conditions.md",
        log:
            "<logs>/tables/conditions.log",
        localrule: True
        params:
            about=ABOUT,
            made_by=MADE_BY,
        run:
            job("tables.write_conditions", input, output, params, log)


if COMPONENT_SUMMARIES:

    rule components_for_paper:
        """The measured components, as a table for a paper."""
        input:
            summaries=COMPONENT_SUMMARIES,
        output:
            tex="<results>/tables/latex/components.tex",
            markdown="<results>/tables/markdown/components.md",
        log:
            "<logs>/tables/components.log",
        localrule: True
        params:
            about=ABOUT,
            beside_draft=CAMPAIGN.beside_draft,
            made_by=MADE_BY,
        run:
            job("tables.write_components", input, output, params, log)
