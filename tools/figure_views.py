# SPDX-License-Identifier: Apache-2.0
"""Contact sheets of figures as others see them: in grey and with deuteranopia, at the width of one
and two columns.

    python tools/figure_views.py results/figures/fig7.png results/figures/fig3.svg --output
    /tmp/views

Writes `NAME_views.png` for each figure: as drawn, its luminance, and as seen without the
medium-wavelength cones, once
3.5 in and once 7.16 in wide at 150 dpi. An SVG is rendered by Chromium.
"""

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from osl_analysis.base.errors import InputError
from osl_analysis.figures.style import DOUBLE_COLUMN, SINGLE_COLUMN

Array = NDArray[np.float64]
DPI, EDGE, LETTERS = 150, 12, 16
"""Resolution of a sheet; its margins and the height of its lettering [pixels]."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Luminance of linear sRGB (IEC 61966-2-1)."""
DEUTERANOPIA = np.array([
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.011820, 0.042940, 0.968881],
])  # fmt: skip
"""Machado, Oliveira and Fernandes, IEEE TVCG 15(6), 2009, Table 1: deuteranomaly of severity 1.0,
for linear sRGB."""
XYZ = np.array([
    [0.4123908, 0.3575843, 0.1804808],
    [0.2126390, 0.7151687, 0.0721923],
    [0.0193308, 0.1191948, 0.9505322],
])  # fmt: skip
"""Linear sRGB to XYZ with white D65 (IEC 61966-2-1)."""


def linear(rgb: Array) -> Array:
    """Linear light of sRGB values in 0 to 1, any shape."""
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def coded(light: Array) -> Array:
    """sRGB values of linear light, the inverse of `linear`; light outside 0 to 1 is clipped."""
    light = np.clip(light, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def in_grey(rgb: Array) -> Array:
    """sRGB values (..., 3) in 0 to 1 as a print without colour shows them: their luminance."""
    return coded(np.repeat((linear(rgb) @ LUMINANCE)[..., None], 3, axis=-1))


def with_deuteranopia(rgb: Array) -> Array:
    """sRGB values (..., 3) in 0 to 1 as they look without the medium-wavelength cones."""
    return coded(linear(rgb) @ DEUTERANOPIA.T)


VIEWS = {"as drawn": lambda rgb: rgb, "grey": in_grey, "deuteranopia": with_deuteranopia}


def lab(rgb: Array) -> Array:
    """CIE L*a*b* (..., 3), white D65, of sRGB values (..., 3) in 0 to 1; the distance of two is
    Delta E (CIE 1976)."""
    relative = linear(rgb) @ XYZ.T / XYZ.sum(axis=1)
    f = np.where(
        relative > (6 / 29) ** 3, np.cbrt(relative), relative / (3 * (6 / 29) ** 2) + 4 / 29
    )
    return np.stack(
        [116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])],
        axis=-1,
    )


def lightness(colour: str) -> float:
    """CIE L* of a colour, 0 to 100: what a grey print keeps of it."""
    return float(lab(np.array(to_rgb(colour)))[0])


def distance(one: str, other: str) -> float:
    """Delta E (CIE 1976) of two colours as they look with deuteranopia."""
    seen = (lab(with_deuteranopia(np.array(to_rgb(colour)))) for colour in (one, other))
    return float(np.linalg.norm(np.subtract(*seen)))


def picture(path: Path) -> Image.Image:
    """A figure's PNG, or its SVG as Chromium renders it, on white.

    Raises
    ------
    InputError
        Another format, or there is no Chromium for an SVG.
    """
    if path.suffix == ".png":
        return on_white(Image.open(path))
    if path.suffix != ".svg":
        raise InputError(f"{path}: figures are seen as .png or .svg", "give one of these")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        raise InputError(
            f"{path}: there is no chromium to render an SVG",
            "install it, or give the PNG beside it",
        )
    with tempfile.TemporaryDirectory() as folder:
        page, shot = Path(folder) / "page.html", Path(folder) / "shot.png"
        width = round(2 * DOUBLE_COLUMN * DPI)
        page.write_text(
            f'<body style="margin:0"><img src="{path.resolve().as_uri()}" style="width:{width}px">',
            "utf-8",
        )
        flags = (
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--allow-file-access-from-files",
            "--hide-scrollbars",
        )
        size = f"--window-size={width},{3 * width}"
        command = [chromium, *flags, size, f"--screenshot={shot}", page.as_uri()]
        subprocess.run(command, check=True, capture_output=True, cwd=folder, timeout=60)
        return without_margin(on_white(Image.open(shot)))


def on_white(image: Image.Image) -> Image.Image:
    """The picture without transparency."""
    layer = image.convert("RGBA")
    return Image.alpha_composite(Image.new("RGBA", layer.size, "white"), layer).convert("RGB")


def without_margin(image: Image.Image) -> Image.Image:
    """The picture without the white rows below it."""
    inked = np.flatnonzero((np.asarray(image) < 255).any(axis=(1, 2)))
    return image.crop((0, 0, image.width, int(inked[-1]) + EDGE if len(inked) else image.height))


def contact_sheet(image: Image.Image) -> Image.Image:
    """A row of all views for each width of a page."""
    widths = [round(inches * DPI) for inches in (SINGLE_COLUMN, DOUBLE_COLUMN)]
    heights = [round(image.height * width / image.width) for width in widths]
    size = len(VIEWS) * (widths[-1] + EDGE) + EDGE, sum(heights) + 2 * (LETTERS + 2 * EDGE)
    sheet, top = Image.new("RGB", size, "white"), EDGE
    lettering = ImageDraw.Draw(sheet)
    for width, height, inches in zip(widths, heights, (SINGLE_COLUMN, DOUBLE_COLUMN), strict=True):
        rgb = np.asarray(image.resize((width, height), Image.Resampling.LANCZOS)) / 255
        for number, (name, view) in enumerate(VIEWS.items()):
            left = EDGE + number * (width + EDGE)
            lettering.text((left, top), f"{name}, {inches:g} in", fill="black")
            seen = Image.fromarray(np.round(255 * view(rgb)).astype(np.uint8))
            sheet.paste(seen, (left, top + LETTERS))
        top += height + LETTERS + EDGE
    return sheet


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("figures", nargs="+", type=Path, help="PNG or SVG files")
    parser.add_argument("--output", type=Path, default=Path(), help="folder of the contact sheets")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    for path in arguments.figures:
        sheet = arguments.output / f"{path.stem}_views.png"
        contact_sheet(picture(path)).save(sheet)
        print(sheet)


if __name__ == "__main__":
    main()
