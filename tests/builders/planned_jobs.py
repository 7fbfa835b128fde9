# SPDX-License-Identifier: Apache-2.0
"""The jobs that Snakemake plans, with their params, which none of its options prints: `planned
SNAKEFILE CONFIGFILE TARGET ...` writes them as JSON to `planned.json` in the working folder."""

import json
import sys
from pathlib import Path

from snakemake.api import SnakemakeApi
from snakemake.settings.types import ConfigSettings, DAGSettings, OutputSettings, ResourceSettings


def main() -> None:
    _, snakefile, configfile, *targets = sys.argv
    with SnakemakeApi(OutputSettings()) as api:
        workflow = api.workflow(
            ResourceSettings(cores=1),
            ConfigSettings(configfiles=[Path(configfile)]),
            snakefile=Path(snakefile),
        )
        dag = workflow.dag(DAGSettings(targets=set(targets), forceall=True))
        dag.printrulegraph()
        jobs = [
            {
                "rule": job.rule.name,
                "input": {name: listed(files) for name, files in job.input.items()},
                "output": {name: listed(files) for name, files in job.output.items()},
                "files": [*map(str, job.output)],
                "needed": [*map(str, job.input)],
                "params": dict(job.params.items()),
                "log": [*map(str, job.log)],
            }
            for job in workflow._workflow.dag.jobs
        ]
    Path("planned.json").write_text(json.dumps(jobs, default=str))


def listed(files: object) -> list[str]:
    return [files] if isinstance(files, str) else [*map(str, files)]  # type: ignore[call-overload]
