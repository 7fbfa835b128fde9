"""Jobs as Snakemake has them, as far as submissions to a cluster look at them."""

from pathlib import Path
from types import SimpleNamespace


class Job(SimpleNamespace):
    """Compared by identity, as Snakemake's are by what they make."""

    __hash__, __eq__ = object.__hash__, object.__eq__


def job(rule: str, group: str | None, output: Path | str = "x.csv", log: Path | str = "x.log", **more):
    """A job as Snakemake has it: of the wildcards in `more`, beside its inputs and resources."""
    inputs, resources = more.pop("input", ()), more.pop("resources", {})
    return Job(
        rule=SimpleNamespace(name=rule, group=group),
        group=group,
        wildcards_dict=more,
        input=inputs,
        output=[str(output)],
        log=[str(log)],
        resources=resources,
        is_group=lambda: False,
    )


def together(*jobs):
    """One submission of these jobs."""
    one = type("Submission", (list,), {"is_group": lambda self: True})
    return one(jobs)
