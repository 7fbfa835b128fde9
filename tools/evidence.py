"""Write into the documentation what its benchmarks print: `make evidence`, or `python
tools/evidence.py PAGE...`.

A figure stands in a block: the comment `<!-- printed by COMMAND -->`, whose first word is `python`,
and fenced text. Nothing else may run meanwhile. `python tools/evidence.py --machine` prints where,
and what, was measured.
"""

import os
import platform
import re
import shlex
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"(<!-- printed by python (.+?) -->\n+```\n).*?(?=```)", re.DOTALL)


def machine() -> str:
    """Cores, versions, and the revision of this checkout."""
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "polars", "snakemake"))
    revision = subprocess.check_output(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, text=True
    ).strip()
    cores = (
        f"{os.cpu_count()} cores ({platform.machine()}), Python {platform.python_version()},"
        f" {libraries}"
    )
    return f"{cores}\nrevision {revision}\n"


def printed(block: re.Match[str]) -> str:
    """A block with what its command prints now."""
    command = [sys.executable, *shlex.split(block[2])]
    print("python", block[2], flush=True)
    said = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout
    return block[1] + said.rstrip() + "\n"


def main() -> None:
    if sys.argv[1:] == ["--machine"]:
        print(machine(), end="")
        return
    pages = [Path(name) for name in sys.argv[1:]] or [
        ROOT / "README.md",
        *sorted((ROOT / "docs").glob("*.md")),
    ]
    for page in pages:
        text = page.read_text(encoding="utf-8")
        if (now := BLOCK.sub(printed, text)) != text:
            page.write_text(now, encoding="utf-8")


if __name__ == "__main__":
    main()
