# SPDX-License-Identifier: Apache-2.0
"""Whether the numbers of the documentation are those that its commands print.

`docs_numbers.yaml` has, by page and command, texts of the page and what the command prints there.
Commands run in the folder of the repository, whose `results/` are those of `make reproduce-all`. Of
the tutorial every line that it shows below a `$` is compared with what its commands print in an
empty folder; `…` stands for what it leaves out. With a folder as argument, the figure that the
tutorial shows is put there.
"""

import re
import shlex
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

ROOT = Path(__file__).parents[1]
NUMBERS = Path(__file__).with_suffix(".yaml")


SESSION = "tutorial.md"
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FIGURE = "my_campaign/results/figures/fig5.png"


def output_of(command: str, folder: Path) -> str:
    """What a command prints, on one line."""
    program, *arguments = shlex.split(command)
    ours = Path(sys.executable).with_name(program)
    words = [str(ours) if ours.is_file() else program, *arguments]
    done = subprocess.run(
        words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    if done.returncode:
        sys.exit(f"{command}: {done.stdout.strip()}")
    return on_one_line(done.stdout)


@cache
def printed(command: str) -> str:
    """What a command prints in the folder of the repository."""
    return output_of(command, ROOT)


def on_one_line(text: str) -> str:
    """A text without line breaks, repeated blanks and times of a run."""
    return re.sub(r"in \d+ s\b", "in some s", " ".join(text.split()))


def session(page: Path, folder: Path) -> list[str]:
    """Run the commands of a page in a folder, and name what it shows and they do not print."""
    wrong = []
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    script = next(text for language, text in blocks if language == "python")
    (folder / "record.py").write_text(script, encoding="utf-8")
    shown = [text for language, text in blocks if not language and text.startswith("$ ")]
    for command, lines in re.findall(r"^\$ (.+)\n((?:(?!\$ ).*\n)*)", "".join(shown), re.MULTILINE):
        if command.startswith("cd "):
            folder = folder / command.removeprefix("cd ")
            continue
        output = output_of(command, folder)
        for part in filter(None, map(str.strip, re.split("[…\n]", lines))):
            if on_one_line(part) not in output:
                wrong.append(f"{page.name}: {command} does not print '{part}'")
    return wrong


def main() -> None:
    """Name each text that a page or its command has not."""
    count = 0
    wrong = []
    for name, commands in yaml.safe_load(NUMBERS.read_text(encoding="utf-8")).items():
        text = " ".join((ROOT / name).read_text(encoding="utf-8").split())
        for command, numbers in commands.items():
            for in_page, in_output in numbers.items():
                count += 1
                if in_page not in text:
                    wrong.append(f"{name}: '{in_page}' does not stand in the page")
                if in_output not in printed(command):
                    wrong.append(f"{name}: {command} does not print '{in_output}'")
    with TemporaryDirectory() as folder:
        wrong += session(ROOT / "docs" / SESSION, Path(folder))
        for target in sys.argv[1:]:
            shutil.copy(Path(folder) / FIGURE, Path(target) / "tutorial.png")
    if wrong:
        sys.exit("\n".join(wrong))
    print(f"{count} numbers, and the tutorial, are what their commands print")


if __name__ == "__main__":
    main()
