"""Time to write the page of a large campaign, and to open it in a browser.

Run from the repository after `make reproduce-all`: `python benchmarks/report_page.py`, or with the
folder of another campaign and numbers of trials, as `python benchmarks/report_page.py FOLDER 117
1000`. The trials of the campaign, its findings and the marks of its figures are repeated under
other names up to each number, and each finding under other causes up to as many as `FINDINGS`. Of
each page: trials, findings, size [MB], processor time [s] of writing it, milliseconds of it for a
trial against those of the first number, elements, and, of three openings in headless Chromium
(Debian: chromium, chromium-driver), the median time [s] to the first paint, to the load event, and
until the first table is seen, by the browser's own clock, and the processor time [s] of all threads
of the page's process, which a busy machine changes little.
"""

import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from statistics import median
from typing import Any

import polars as pl
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from osl_analysis.commands.figure import draw_figure
from osl_analysis.commands.report import write_report
from osl_analysis.figures import FIGURES
from osl_analysis.table import read_table, write_table

ROOT = Path(__file__).resolve().parents[1]
REQUEST = "results/requests/report/job.json"
NUMBERS, FINDINGS = (117, 1000), 10_000
OPENINGS = 3
FLAGS = (
    "headless=new",
    "no-sandbox",
    "disable-gpu",
    "disable-background-networking",
    "window-size=1300,1000",
)
SEEN = """
const done = arguments[0], seen = () => {
  const box = document.querySelector("main table")?.getBoundingClientRect();
  if (!box || !box.height) return requestAnimationFrame(seen);
  requestAnimationFrame(() => setTimeout(() => done([
    performance.getEntriesByType("paint")[0]?.startTime, performance.getEntriesByType("navigation")[0].loadEventEnd,
    performance.now(), document.getElementsByTagName("*").length])));
};
seen();
"""
"""What the browser says of an opening, once a table is painted: times [ms] from its start, and
number of elements."""


def repeated(table: pl.DataFrame, names: Mapping[str, str]) -> pl.DataFrame:
    """The rows of each trial under each of the new `names`, which have its name; all other rows
    once."""
    if "trial" not in table.columns:
        return table
    of = pl.DataFrame({"trial": [*names.values()], "named": [*names]})
    rows = (
        of.join(table, on="trial", maintain_order="left").drop("trial").rename({"named": "trial"})
    )
    others = table.filter(pl.col("trial").is_in([*names.values()]).not_().fill_null(True))
    return pl.concat([others, rows.select(table.columns)])


def findings_of(table: pl.DataFrame, names: Mapping[str, str], most: int) -> pl.DataFrame:
    """The findings of the repeated trials, each several times under other causes, `most` of them or
    more."""
    once = repeated(table, names)
    there = once.select("finding", "trial").n_unique()
    several = [
        once.with_columns(pl.col("cause") + f" {k}" * bool(k))
        for k in range(max(-(-most // there), 1))
    ]
    number = pl.struct("finding", "trial", "cause").rank("dense").alias("finding")
    return pl.concat(several).with_columns(number).sort("finding", maintain_order=True)


def larger(request: Mapping[str, Any], n: int, folder: Path) -> dict[str, Any]:
    """The arguments of `write_report` for a campaign of n trials that are those of a request, again
    and again."""
    given, settings, sheet = (
        request["input"],
        dict(request["settings"]),
        request["settings"]["sheet"],
    )
    own = [*sheet]
    names = {
        own[k % len(own)] + f"_{k // len(own)}" * (k >= len(own)): own[k % len(own)]
        for k in range(n)
    }
    settings["sheet"] = {name: sheet[of] | {"trial": name} for name, of in names.items()}
    files = {key: {name: Path(given[key][of]) for name, of in names.items() if of in given[key]}
             for key in ("trials", "series", "crossings")}  # fmt: skip
    made = {"tables": {}, "figures": {}}
    for name, path in given["tables"].items():
        made["tables"][name] = folder / f"tables/{name}.csv"
        write_table(repeated(read_table(path), names), made["tables"][name])
    for name, path in given["figures"].items():
        made["figures"][name] = folder / f"figures/{name}.svg"
        points = repeated(read_table(Path(path).with_suffix(".csv")), names)
        write_table(points, made["figures"][name].with_suffix(".csv"))
        if name in FIGURES and len(points):
            draw_figure(name, made["figures"][name].with_suffix(".csv"), [made["figures"][name]])
    ends = {name: folder / f"{name}.csv" for name in ("verdicts", "excluded", "findings", "states")}
    for name, path in ends.items():
        table = read_table(given[name])
        write_table(findings_of(table, names, FINDINGS * (n > len(own))) if name == "findings" else
                    repeated(table, names), path)  # fmt: skip
    summary = json.loads(Path(given["summary"]).read_text(encoding="utf-8"))
    for one in summary["findings"]:
        one["trials"] = [name for name, of in names.items() if of in one["trials"]] or one["trials"]
    (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    outputs = {name: folder / Path(path).name for name, path in request["output"].items()}
    return files | made | ends | settings | outputs | {
        "summary": folder / "summary.json",
        "captions": Path(given["captions"]) if "captions" in given else None,
    }  # fmt: skip


def opened(page: Path) -> list[float]:
    os.environ |= {"SE_OFFLINE": "true", "SE_AVOID_STATS": "true"}
    options = webdriver.ChromeOptions()
    for flag in FLAGS:
        options.add_argument(f"--{flag}")
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    driver.set_script_timeout(120)
    try:
        driver.execute_cdp_cmd("Performance.enable", {})
        driver.get(page.as_uri())
        seen = driver.execute_async_script(SEEN)
        known = driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
        return [*seen, *(one["value"] for one in known if one["name"] == "ProcessTime")]
    finally:
        driver.quit()


def main(folder: Path, numbers: list[int]) -> None:
    os.chdir(folder)
    request = json.loads(Path(REQUEST).read_text(encoding="utf-8"))
    print(
        "trials findings   MB  write [s]  per trial  elements  paint [s]  load [s]  table [s] "
        " cpu [s]"
    )
    first = None
    for n in numbers:
        with tempfile.TemporaryDirectory() as made:
            for part in ("tables", "figures"):
                (Path(made) / part).mkdir()
            arguments = larger(request, n, Path(made))
            start = time.process_time()
            write_report(**arguments)
            spent = time.process_time() - start
            findings = read_table(arguments["findings"])["finding"].n_unique()
            page = arguments["output"]
            openings = [opened(page) for _ in range(OPENINGS)]
            paint, load, seen, elements, cpu = (median(one) for one in zip(*openings, strict=True))
            first = first or spent / n
            cells = (
                f"{n:6}",
                f"{findings:8}",
                f"{page.stat().st_size / 1e6:4.1f}",
                f"{spent:10.2f}",
            )
            cells += (
                f"{spent / n / first:10.2f}",
                f"{elements:9.0f}",
                f"{paint / 1e3:10.2f}",
                f"{load / 1e3:9.2f}",
            )
            print(*cells, f"{seen / 1e3:10.2f}", f"{cpu:8.2f}", flush=True)


if __name__ == "__main__":
    own = Path(sys.argv[1]) if sys.argv[1:] and not sys.argv[1].isdecimal() else ROOT
    main(own.resolve(), [int(one) for one in sys.argv[1:] if one.isdecimal()] or list(NUMBERS))
