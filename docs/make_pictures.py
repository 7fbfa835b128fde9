"""Take the pictures that README.md opens with, from the results of the default campaign: `make
pictures`.

Each says in its text `Source` what it shows: version, configuration, and what draws it. A test
compares. Debian: chromium.
"""

import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image, PngImagePlugin

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.campaign.origin import about
from osl_analysis.commands.simulate import planned_sheet, settings_files
from osl_analysis.figures import FIGURES
from osl_analysis.files import PACKAGE, default_config
from osl_analysis.report import TEMPLATES

DOCS, RESULTS = Path(__file__).parent, Path("results")
SIZE = 1280, 860  # of the page [px]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


def sources() -> dict[str, str]:
    """What each picture shows if it is taken now."""
    config = read_config(default_config())
    if config.simulation is None:
        sys.exit(
            f"{default_config()}: names no simulation; the pictures are of a simulated campaign"
        )
    campaign = open_campaign(config, planned_sheet(config.simulation, config.sheet))
    of = about(campaign, settings_files(config.simulation, config.shared()))
    said = f"osl-analysis {of['version']}, configuration {of['configuration']}"
    made_by = {
        "report.png": [
            TEMPLATES / "report.html.j2",
            TEMPLATES / "report.css",
            *sorted(TEMPLATES.glob("*.js")),
        ],
        "fig5.png": [
            PACKAGE / f"figures/{name}.py"
            for name in (FIGURES["fig5"].module, "desired_axis", "marks")
        ],
    }
    code = {
        name: hashlib.sha256(b"".join(map(Path.read_bytes, files)))
        for name, files in made_by.items()
    }
    return {name: f"{said}, drawn by {digest.hexdigest()[:8]}" for name, digest in code.items()}


def taken(picture: Path) -> str | None:
    """What a picture says that it shows; None if nothing."""
    with Image.open(picture) as image:
        return image.info.get("Source")


def photographed(page: Path, picture: Path) -> None:
    """The first screen of a page in headless Chromium."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit(f"none of {', '.join(BROWSERS)} is installed; Debian: apt-get install chromium")
    quiet = (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--virtual-time-budget=20000",
    )
    size = f"--window-size={SIZE[0]},{SIZE[1]}"
    with TemporaryDirectory() as profile:
        own = f"--user-data-dir={profile}"
        command = [
            browser,
            *quiet,
            own,
            size,
            f"--screenshot={picture.resolve()}",
            page.resolve().as_uri(),
        ]
        subprocess.run(command, check=True, capture_output=True, timeout=300)


def main() -> None:
    summary, now = RESULTS / "summary.json", sources()
    of = json.loads(summary.read_text(encoding="utf-8")) if summary.is_file() else {}
    if (
        f"osl-analysis {of.get('version')}, configuration {of.get('configuration')}"
        not in now["fig5.png"]
    ):
        sys.exit(
            f"{summary}: is not of the default campaign as it is configured now; run `make"
            " reproduce-all`"
        )
    with TemporaryDirectory() as folder:
        page = Path(folder, "report.png")
        photographed(RESULTS / "report.html", page)
        for picture in (page, RESULTS / "figures/fig5.png"):
            with Image.open(picture) as image:
                text = PngImagePlugin.PngInfo()
                text.add_text("Source", now[picture.name])
                image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(
                    DOCS / picture.name, pnginfo=text, optimize=True
                )
            print(f"{DOCS / picture.name}: {now[picture.name]}")


if __name__ == "__main__":
    main()
