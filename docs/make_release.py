"""Complete dist/ to a release and say how it is attached: `make release`, which builds all that is
collected here."""

import hashlib
import shutil
import subprocess
from pathlib import Path

DIST = Path("dist")


def said(*command: str) -> str:
    """What a command prints; nothing if it fails."""
    done = subprocess.run(command, text=True, capture_output=True, check=False)
    return "" if done.returncode else done.stdout.strip()


def missing(version: str) -> list[str]:
    """What stands between dist/ and a release that others can load, each with its remedy."""
    tag, found = f"v{version}", []
    if said("git", "status", "--porcelain"):
        found.append("there are changes that are not committed; commit them and run again")
    at = said("git", "rev-list", "-1", tag)
    if not at or at != said("git", "rev-parse", "HEAD"):
        found.append(
            f"{'the tag is of another commit' if at else 'there is no tag'}; git tag --annotate"
            f" {tag}"
        )
    if not said("git", "remote"):
        found.append("there is no remote; git remote add origin ADDRESS, and git push --tags")
    if "\n[project.urls]\n" not in Path("pyproject.toml").read_text(encoding="utf-8"):
        found.append(
            "pyproject.toml has no [project.urls]; add the addresses of the project, once it has"
            " some"
        )
    if shutil.which("gh") is None:
        found.append(
            "gh is not installed, the command line of GitHub; install it, or attach dist/* by hand"
        )
    return found


def main() -> None:
    (wheel,) = DIST.glob("*.whl")
    version = wheel.name.split("-")[1]
    name = f"osl-analysis-{version}"
    shutil.copyfile("results/report.html", DIST / f"{name}-demo-report.html")
    shutil.make_archive(str(DIST / f"{name}-docs"), "zip", "build/docs")
    files = sorted(file for file in DIST.iterdir() if file.name != "SHA256SUMS")
    sums = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files]
    (DIST / "SHA256SUMS").write_text("".join(sums), encoding="utf-8")
    for file in files:
        print(f"{file}: {file.stat().st_size / 1e6:.1f} MB")
    for one in missing(version):
        print(f"to do: {one}")
    print(
        f"then: gh release create v{version} --verify-tag --title 'osl-analysis {version}'"
        " --notes-from-tag dist/*"
    )


if __name__ == "__main__":
    main()
