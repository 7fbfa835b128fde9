# SPDX-License-Identifier: Apache-2.0
"""The package as a stranger installs it: wheel, then sdist in a new environment, in folders with
blanks and umlauts. `make test-package` runs it in some two minutes, with `uv` and `build` of the
project's environment."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
INSTALL = (BIN / "uv", "pip", "install", "--quiet", "--no-deps", "--python")
MODULE = """
configfile: "config.yaml"

module osl:
    snakefile: {snakefile!r}
    config: config

use rule * from osl as osl_*
"""


def call(*arguments: object, folder: Path = ROOT) -> str:
    """Run a command as a stranger does, without a trace of this project's environment; its
    output."""
    clean = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("PYTHON", "VIRTUAL_ENV"))
    }
    done = subprocess.run(
        [*map(str, arguments)], cwd=folder, env=clean, text=True, capture_output=True, check=False
    )
    if done.returncode:
        sys.exit(
            f"{' '.join(map(str, arguments))}: exit code"
            f" {done.returncode}\n{done.stdout}\n{done.stderr}"
        )
    return done.stdout + done.stderr


def installed(python: Path, package: Path) -> set[Path]:
    """The modules of a package that is installed in an environment, in place of the one that was
    there."""
    call(*INSTALL, python, "--no-build-isolation", "--reinstall", package)
    folder = python.parents[1]
    return {path.relative_to(folder) for path in folder.rglob("osl_analysis/**/*.py")}


def check_campaigns(commands: Path, folder: Path) -> None:
    """Make, run and read the example campaign, and run it as a module too."""
    osl = commands / "osl-analysis"
    call(osl, "init", "Übungs Kampagne", "--example", folder=folder)
    made = folder / "Übungs Kampagne"
    call(osl, "run", folder=made)
    for file in ("report.html", "summary.json", "figures/fig5.pdf", "tables/impedance.csv"):
        assert (made / "results" / file).stat().st_size > 100, file
    assert "stiffness" in call(osl, "results", "--all", folder=made)
    told_again = call(osl, "run", folder=made)
    assert "open results/report.html" in told_again
    assert "figures 1" not in told_again, "nothing is to be done"
    code = "from osl_analysis.base.files import shipped; print(shipped('Snakefile'))"
    snakefile = call(commands / "python", "-c", code, folder=folder)
    (made / "Snakefile").write_text(MODULE.format(snakefile=snakefile.strip()), encoding="utf-8")
    again = ("--cores", "1", "--dry-run", "--forcerun", "osl_ingest")
    planned = call(commands / "snakemake", "results/figures/fig3.pdf", *again, folder=made)
    assert "osl_ingest" in planned
    assert "localrules" not in planned


def main() -> None:
    """Build twice, compare, install the wheel and then the sdist in its place, and use both."""
    with TemporaryDirectory() as place:
        folder = Path(place)
        digests = []
        for built in (folder / "first", folder / "second"):
            call(BIN / "python", "-m", "build", "--no-isolation", "--outdir", built)
            wheel, sdist = sorted(built.iterdir(), key=lambda file: file.suffix != ".whl")
            digests.append(
                [hashlib.sha256(file.read_bytes()).hexdigest() for file in (wheel, sdist)]
            )
        assert digests[0] == digests[1], f"two builds differ: {digests}"
        (folder / "Ein Ordner").mkdir()
        call(BIN / "uv", "venv", "--quiet", "--python", sys.executable, folder / "an environment")
        python = folder / "an environment/bin/python"
        call(*INSTALL, python, "--require-hashes", "--requirements", ROOT / "requirements.lock")
        files = installed(python, wheel)
        check_campaigns(python.parent, folder / "Ein Ordner")
        assert files == installed(python, sdist)
        call(
            python.parent / "osl-analysis",
            "init",
            "aus sdist",
            folder=folder,
        )
    print(
        "wheel and sdist: the same twice, installed, and used in a folder with blanks and umlauts"
    )


if __name__ == "__main__":
    main()
