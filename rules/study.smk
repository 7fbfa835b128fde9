"""`snakemake validate`, or `study`: the Monte Carlo study of bias, efficiency and coverage of the estimators."""

STUDY = CONFIG.study
STUDIED = {name: (STUDY.trials, STUDY.batch) for name in BENCH_EXPERIMENTS}
STUDIED |= {name: (STUDY.campaigns, batch) for name, batch in STUDY_OF_REPEATS.items()}
STUDIED |= {name: (getattr(STUDY, number), batch) for name, (number, batch) in WALKING_EXPERIMENTS.items()}
"""Trials or campaigns of each experiment, and how many of them one job takes at least."""
STUDIED_BY_FILE = {name.replace(",", "").replace(" ", "_"): name for name in STUDIED}
FILE_OF = {name: file for file, name in STUDIED_BY_FILE.items()}
BATCH = "{experiment}_{first}_{number}"
OF_BATCH = {"experiment": "|".join(STUDIED_BY_FILE), "first": "[0-9]+", "number": "[0-9]+"}


@step("study.run_batch", f"study/batches/{BATCH}.csv", f"study/{BATCH}", **OF_BATCH)
def study_batch(wildcards):
    from osl_analysis.commands.simulate import settings_files  # it loads the simulator

    settings = {"study": STUDY.part("StudyTrials")}
    settings |= {"dynamometer": setting("dynamometer"), "actuator_analysis": setting("actuator")}
    settings |= {"walking": setting("walking"), "first": wildcards.first, "number": wildcards.number}
    settings |= {"experiment": STUDIED_BY_FILE[wildcards.experiment], "sources": CONFIG.sources}
    return {"made_of": settings_files(STUDY.simulation), "settings": settings}


STUDY_JOBS = [f"{FILE_OF[name]}_{first}_{number}" for name, first, number in study_batches(STUDIED)]
TABLE_OF_STUDY, BATCHES = RESULTS / "study/study.csv", [RESULTS / f"study/batches/{name}.csv" for name in STUDY_JOBS]
single("study.summarise_study", TABLE_OF_STUDY, "study/table", {"input": {"batches": BATCHES}}, "study_table")
single("study.write_page", "study/study.md", "study/page", {"input": {"table": TABLE_OF_STUDY}}, "study_page")


rule study:
    input:
        [RESULTS / f"study/study.{suffix}" for suffix in ("csv", "md")],


rule validate:
    input:
        rules.study.input,
