# SPDX-License-Identifier: Apache-2.0
"""Check what a public project has beside its code: `make public`, and before each commit.

`python tools/public.py --write` puts the line of the licence into files that lack it.
"""

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
LICENCE = "# SPDX-License-Identifier: Apache-2.0"
LICENSED = ("*.py", "*.smk", "Snakefile", "Makefile", "Containerfile", "*.sh")
LINK = re.compile(r"\]\((?!https?:|#|mailto:)([^)#\s]+)(?:#[^)]*)?\)")
PLACEHOLDER = re.compile(r"^\| `(.+?)` \|[^|]*\| (`.+`) \|$", re.MULTILINE)
CONDA_NAMES = {"matplotlib": "matplotlib-base", "snakemake": "snakemake-minimal"}


def tracked(*patterns: str) -> list[Path]:
    """The files of the repository, new ones too."""
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "--", *patterns]
    names = subprocess.check_output(listed, cwd=ROOT, text=True).splitlines()
    return [ROOT / name for name in names if (ROOT / name).is_file()]


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def links() -> Iterator[str]:
    for page in tracked("*.md"):
        for link in LINK.findall(page.read_text(encoding="utf-8")):
            if not (page.parent / link).exists():
                yield f"{page}: {link} leads nowhere"


def placeholders() -> Iterator[str]:
    """Placeholders whose files are not those that RELEASING.md names."""
    for placeholder, cells in PLACEHOLDER.findall(text_of("RELEASING.md")):
        stated = set(re.findall(r"`(.+?)`", cells))
        search = ["git", "grep", "--untracked", "-lF", "-e", placeholder, "--", ":!RELEASING.md"]
        done = subprocess.run(search, cwd=ROOT, text=True, capture_output=True, check=False)
        found = set(done.stdout.split()) - {"CHANGELOG.md"}
        if found != stated:
            yield f"RELEASING.md: {placeholder}: {sorted(found ^ stated)} too many or too few"


def parsed() -> Iterator[str]:
    """YAML and JSON that do not parse."""
    for path in tracked("*.yml", "*.yaml", "*.cff", "*.json", ":!config/new_campaign"):
        try:
            text = path.read_text(encoding="utf-8")
            json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
        except (ValueError, yaml.YAMLError) as error:
            yield f"{path}: {error}"


def metadata() -> Iterator[str]:
    """Name, version and licence that differ between the files that state them."""
    project = tomllib.loads(text_of("pyproject.toml"))["project"]
    citation = yaml.safe_load(text_of("CITATION.cff"))
    codemeta = json.loads(text_of("codemeta.json"))
    recipe = yaml.safe_load(text_of("conda/recipe.yaml"))
    stated = {
        "title": {citation["title"], codemeta["name"]},
        "name": {project["name"], recipe["package"]["name"], citation["title"].split(":")[0]},
        "version": {
            project["version"], citation["version"], codemeta["version"],
            recipe["context"]["version"],
        },
        "day": {str(citation["date-released"]), codemeta["datePublished"]},
        "licence": {
            project["license"], citation["license"], recipe["about"]["license"],
            codemeta["license"].rpartition("/")[2],
        },
        "summary": {project["description"], recipe["about"]["summary"]},
    }  # fmt: skip
    for what, values in stated.items():
        if len(values) > 1:
            yield f"{what}: {sorted(values)}"
    needed = [re.sub(r"(?=>=)", " ", each) for each in project["dependencies"]]
    needed = [
        " ".join([CONDA_NAMES.get(name, name), least]) for name, least in map(str.split, needed)
    ]
    recipe_has = {each for each in recipe["requirements"]["run"] if not each.startswith("python ")}
    if differing := recipe_has ^ set(needed):
        yield f"conda/recipe.yaml: {sorted(differing)} are not as in pyproject.toml"


def hosted_parts() -> Iterator[str]:
    """Targets of the Makefile that only one of `.ci/run` and the public host makes."""
    (listed,) = re.findall(r"^\.PHONY: (.+)", text_of("Makefile"), re.MULTILINE)
    checks = [name for name in listed.split() if re.match("test|check|docs|public|repro", name)]
    own, hosted = (
        set(re.findall(r"[\w-]+", text_of(name)))
        for name in (".ci/run", ".github/workflows/ci.yml")
    )
    for name in checks:
        if (name in own) != (name in hosted):
            yield f"make {name} is a part of only one of .ci/run and .github/workflows/ci.yml"


def paper() -> Iterator[str]:
    checked = [sys.executable, ROOT / "paper/paper.py", "--check"]
    done = subprocess.run(checked, text=True, capture_output=True, check=False)
    if done.returncode:
        yield done.stderr.strip()


def licences() -> Iterator[str]:
    for path in tracked(*LICENSED):
        text = path.read_text(encoding="utf-8")
        if LICENCE in text.split("\n", 2)[:2]:
            continue
        if "--write" not in sys.argv:
            yield f"{path}: its first lines have no {LICENCE}: --write puts it there"
            continue
        first, shebang, rest = text.partition("\n") if text.startswith("#!") else ("", "", text)
        path.write_text(f"{first}{shebang}{LICENCE}\n{rest}", encoding="utf-8")


def main() -> None:
    checks = (licences, links, placeholders, parsed, metadata, hosted_parts, paper)
    faults = [fault for check in checks for fault in check()]
    if faults:
        sys.exit("\n".join(faults))


if __name__ == "__main__":
    main()
