"""The package as a stranger installs it: wheel and sdist in new environments, in folders with blanks and umlauts.

`make test-package` runs it. It needs the environment of the project (for `uv` and `build`), and takes some two minutes.
"""

import hashlib
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
MODULE = """
configfile: "config.yaml"

module osl:
    snakefile: {snakefile!r}
    config: config

use rule * from osl as osl_*
"""


def call(*arguments: object, folder: Path = ROOT, exit_code: int = 0) -> str:
    """Run a command as a stranger does, without a trace of this project's environment; its output.

    Raises
    ------
    SystemExit
        It ended with another exit code.
    """
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run([*map(str, arguments)], cwd=folder, env=clean, text=True, capture_output=True, check=False)
    if done.returncode != exit_code:
        sys.exit(f"{' '.join(map(str, arguments))}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}")
    return done.stdout + done.stderr


def build(folder: Path) -> list[Path]:
    """Wheel and sdist, built into a folder."""
    call(BIN / "python", "-m", "build", "--no-isolation", "--outdir", folder)
    return sorted(folder.iterdir())


def environment(folder: Path, package: Path) -> Path:
    """A new environment with what the lock says and the package; the folder of its commands."""
    call(BIN / "uv", "venv", "--quiet", "--python", sys.executable, folder)
    install = (BIN / "uv", "pip", "install", "--quiet", "--no-deps", "--python", folder / "bin/python")
    call(*install, "--require-hashes", "--requirements", ROOT / "requirements.lock")
    call(*install, "--no-build-isolation", package)
    return folder / "bin"


def check_campaigns(commands: Path, folder: Path) -> None:
    """Make, run and read the example campaign, run it as a module too, and call what must be refused."""
    osl = commands / "osl-analysis"
    call(osl, "doctor", folder=folder)
    call(osl, "init", "Übungs Kampagne", "--example", folder=folder)
    made = folder / "Übungs Kampagne"
    call(osl, "run", folder=made)
    for file in ("report.html", "summary.json", "figures/fig5.pdf", "tables/impedance.csv"):
        assert (made / "results" / file).stat().st_size > 100, file
    assert "stiffness" in call(osl, "results", folder=made)
    again = call(osl, "run", folder=made)
    assert "Nothing to be done" in again, again
    snakefile = call(
        commands / "python",
        "-c",
        "from osl_analysis.files import shipped; print(shipped('Snakefile'))",
        folder=folder,
    )
    (made / "Snakefile").write_text(MODULE.format(snakefile=snakefile.strip()), encoding="utf-8")
    planned = call(
        commands / "snakemake",
        "results/figures/fig3.pdf",
        "--cores",
        "1",
        "--dry-run",
        "--forcerun",
        "osl_ingest",
        folder=made,
    )
    assert "osl_ingest" in planned, planned
    assert "no campaign here" in call(osl, "run", folder=folder, exit_code=1)
    assert "nothing is overwritten" in call(osl, "init", "Übungs Kampagne", folder=folder, exit_code=1)


def main() -> None:
    """Build twice, compare, install each, and use it."""
    with TemporaryDirectory() as place:
        folder = Path(place)
        first, second = build(folder / "first"), build(folder / "second")
        digests = [[hashlib.sha256(file.read_bytes()).hexdigest() for file in files] for files in (first, second)]
        assert digests[0] == digests[1], f"two builds differ: {digests}"
        wheel, sdist = sorted(first, key=lambda file: file.suffix != ".whl")
        (folder / "Ein Ordner").mkdir()
        check_campaigns(environment(folder / "from wheel", wheel), folder / "Ein Ordner")
        files = {
            path.relative_to(folder / "from wheel") for path in (folder / "from wheel").rglob("osl_analysis/**/*.py")
        }
        commands = environment(folder / "from sdist", sdist)
        others = {
            path.relative_to(folder / "from sdist") for path in (folder / "from sdist").rglob("osl_analysis/**/*.py")
        }
        assert files == others
        call(commands / "osl-analysis", "init", "aus sdist", "--recorder", "opensourceleg", folder=folder)
    print("wheel and sdist: the same twice, installed, and used in a folder with blanks and umlauts")


if __name__ == "__main__":
    main()
