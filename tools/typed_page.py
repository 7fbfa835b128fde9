# SPDX-License-Identifier: Apache-2.0
"""Type the commands of a page in a new folder, and compare what they print: `make five-minutes`.

A line after `$ ` is typed in that folder; the other lines of its block are printed, in this order.
`…` is any text, and alone on a line any lines. The CSV files that the page links to lie in
`recordings` before.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

BLOCK = re.compile(r"^```console\n\$ (.*?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def pattern_of(shown: str) -> str:
    """A regular expression for what a page shows of an output."""
    lines = [
        r"(?:.*\n)*?" if line == "…" else re.escape(line).replace("…", ".*") + r"\n"
        for line in shown.splitlines()
    ]
    return "".join(lines)


def main(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    blocks = BLOCK.findall(text)
    if not blocks:
        sys.exit(f"{page}: no command is typed")
    commands = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "recordings").mkdir()
        for link in re.findall(r"\]\(([\w/]+\.csv)\)", text):
            shutil.copy(page.parent / link, folder / "recordings")
        for command, shown in blocks:
            done = subprocess.run(
                command, shell=True, cwd=folder, env=os.environ | {"PATH": commands},
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", check=False,
            )  # fmt: skip
            if done.returncode or not re.fullmatch(pattern_of(shown), done.stdout):
                sys.exit(
                    f"{page}: `{command}` prints, with exit code {done.returncode},\n{done.stdout}"
                )
    print(f"{page}: {len(blocks)} commands print what the page shows")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
