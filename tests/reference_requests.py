"""The requests of the jobs of planned campaigns as the last commit left them, in reference_requests.csv: nothing that a
rule hands to a job, or lets it wait for, changes unnoticed. `python tests/reference_requests.py` writes them anew."""

import json
import re
import sys
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import polars as pl
import yaml

HERE = Path(__file__).parent
REFERENCE, SHEET = HERE / "reference_requests.csv", (HERE / "planned_trials.csv").read_text().splitlines(keepends=True)
PLANNED = yaml.safe_load((HERE / "planned_campaigns.yaml").read_text())


def requests_of(space, campaign: str) -> set[tuple[str, ...]]:
    """Campaign, job, and the first digits of the SHA-256 of what it waits for, of what it is given, of its settings."""
    changes, trials = PLANNED[campaign].values()
    (space.folder / "trials.csv").write_text("".join(row for row in SHEET if re.match(trials, row)))
    space.configure(changes)
    targets, found = ["reproduce-all", "study"][: 1 + ("study" in changes)], set()
    planned = space.run("-n", *targets, "--quiet", "host").stdout
    for rule, waits in re.findall(r"^rule (\S+):\n    input: (.*)$", planned, re.MULTILINE):
        request = next((Path(file) for file in waits.split(", ") if file.endswith("job.json")), Path(rule))
        said = json.loads((space.folder / request).read_text()) if request.suffix else {}
        settings, _ = said.pop("settings", {}), said.pop("code", "")
        given = {name: sorted(value) if name in ("made_of", "recorded") else value for name, value in said.items()}
        parts = (json.dumps(part).replace(version("osl-analysis"), "") for part in (waits, given, settings))
        found.add((campaign, f"{rule} {request.parent.name}", *(sha256(p.encode()).hexdigest()[:8] for p in parts)))
    return found


if __name__ == "__main__":
    sys.path.insert(0, str(HERE.parent))
    from test_workflow import Workspace

    jobs = []
    for campaign in PLANNED:
        with TemporaryDirectory() as folder:
            jobs += sorted(requests_of(Workspace(Path(folder)), campaign))
    pl.DataFrame(jobs, ["campaign", "job", "waits_for", "given", "settings"], orient="row").write_csv(REFERENCE)
