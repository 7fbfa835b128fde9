"""What the last commit left, right or not, so that nothing changes unnoticed: reference_numbers.csv has the numbers of
two small campaigns, reference_requests.csv what rules hand to their jobs, and let them wait for, in planned campaigns.
`python tests/reference.py` writes both anew, and the commit shows what changed."""

import json
import re
import sys
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl
import yaml

HERE = Path(__file__).parent
NUMBERS, REQUESTS = HERE / "reference_numbers.csv", HERE / "reference_requests.csv"
SHEET = (HERE / "planned_trials.csv").read_text().splitlines(keepends=True)
PLANNED = yaml.safe_load((HERE / "planned_campaigns.yaml").read_text())
TABLES = ("tables/*.csv", "figures/*.csv", "trials/*.parquet", "crossings/*.parquet")
TEXTS = ("figures/*.svg", "figures/captions.md", "report.html", "numbers.tex")
NUMBER = re.compile(r"(?<![\d.])-?\d+\.\d+(?![\d.])")
NOT_COMPARED = re.compile(
    r"<(script|style|defs)\b.*?</\1>|<metadata>.*?</metadata>|base64,[^\"']*|<(?:use|g) [^>]*>", re.DOTALL
)
"""What comes from other packages, or depends on the hash of the configuration, which pictures show letter by letter."""
UNDETERMINED = re.compile("lag_|noise_share")
"""Columns of what a recording does not determine, where other matrix kernels give other numbers."""


def size_and_shape(x: np.ndarray) -> list[float]:
    """How many numbers, their mean, spread and trend, and the largest."""
    trend = np.arange(1, (x := x[np.isfinite(x)]).size + 1) @ x / max(x.size * (x.size + 1) / 2, 1)
    return [x.size, x.mean(), x.std(), trend, np.abs(x).max()] if x.size else [0]


def numbers_of(results: Path) -> dict[str, list[float]]:
    """Those of every column, headline, text and picture of a campaign, by place. Of texts the letters count."""
    columns: dict[str, list[float]] = {}
    for path in sorted(path for pattern in TABLES for path in results.glob(pattern)):
        one = path.suffix == ".csv"  # or one of several trials of an experiment
        table = pl.read_csv(path, infer_schema_length=None) if one else pl.read_parquet(path)
        place = path.name if one else re.match("[a-z]+", path.name)[0]
        for column in (column.drop_nulls() for column in table if not UNDETERMINED.search(column.name)):
            letters = [sum(map(str.isalpha, text)) for text in column] if column.dtype == pl.String else column
            columns.setdefault(f"{path.parent.name}/{place} {column.name}", []).extend(letters)
    found = {place: size_and_shape(np.array(each, dtype=float)) for place, each in columns.items()}
    for path in sorted(path for pattern in TEXTS for path in results.glob(pattern)):
        text = NOT_COMPARED.sub("", path.read_text(encoding="utf-8"))
        found[str(path.relative_to(results))] = size_and_shape(np.array([*map(float, NUMBER.findall(text))]))
    for name, headline in json.loads((results / "summary.json").read_text())["numbers"].items():
        each = {key: value for key, value in headline.items() if isinstance(value, int | float)}
        found |= {f"summary.json {name} {key}": [0, float(value)] for key, value in each.items()}
    return found


def changed(campaign: str, results: Path) -> list[str]:
    """Where the numbers of a campaign are no longer those of the file: by more than 2e-6 of the largest."""
    table = pl.read_csv(NUMBERS).filter(campaign=campaign)
    kept = {place: np.array(numbers.split(), dtype=float) for place, numbers in table.select("place", "numbers").rows()}
    now = {place: np.array(numbers) for place, numbers in numbers_of(results).items()}
    same = {place for place in kept.keys() & now.keys() if kept[place].shape == now[place].shape}
    near = {p for p in same if np.all(np.abs(now[p] - kept[p]) <= 2e-6 * np.abs([*kept[p][1:], 0]).max())}
    return sorted((kept.keys() | now.keys()) - near)


def requests_of(space, campaign: str) -> set[tuple[str, ...]]:
    """Campaign, job, and the first digits of the SHA-256 of what it waits for, of what it is given, of its settings."""
    changes, trials = PLANNED[campaign].values()
    (space.folder / "trials.csv").write_text("".join(row for row in SHEET if re.match(trials, row)))
    (space.folder / "raw").mkdir(exist_ok=True)
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
    assert found, planned
    return found


if __name__ == "__main__":
    sys.path.insert(0, str(HERE.parent))
    from test_workflow import CAMPAIGNS, Workspace

    rows, jobs = [], []
    for campaign, settings in CAMPAIGNS.items():
        with TemporaryDirectory() as folder:
            space = Workspace(Path(folder), settings)
            assert space.start("reproduce-all").returncode == 0
            every = numbers_of(space.folder / "results")
        rows += [(campaign, place, " ".join(f"{x:.7g}" for x in numbers)) for place, numbers in every.items()]
    for campaign in PLANNED:
        with TemporaryDirectory() as folder:
            jobs += sorted(requests_of(Workspace(Path(folder)), campaign))
    pl.DataFrame(rows, ["campaign", "place", "numbers"], orient="row").write_csv(NUMBERS)
    pl.DataFrame(jobs, ["campaign", "job", "waits_for", "given", "settings"], orient="row").write_csv(REQUESTS)
