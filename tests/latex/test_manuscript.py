# SPDX-License-Identifier: Apache-2.0
"""A manuscript of IEEEtran takes every file of the default campaign's results as it is: figures at
their natural size, captions, tables, numbers, methods and references.

`make test-latex` compiles it after `make reproduce-all`, with pdfLaTeX and BibTeX.
"""

import re
import shutil
import subprocess

import pytest
from conftest import ROOT

from osl_analysis.commands.figure import readable_name
from osl_analysis.report.numbers import macro_name

RESULTS = ROOT / "results"
PROGRAMS = ("pdflatex", "bibtex")
TWO_COLUMNS = {"fig4", "walking_page", "torque_angle"}

pytestmark = [
    pytest.mark.latex,
    pytest.mark.skipif(
        not all(map(shutil.which, PROGRAMS)),
        reason="pdfLaTeX and BibTeX are not installed: the manuscript is not compiled",
    ),
    pytest.mark.skipif(
        not (RESULTS / "figures/captions.tex").is_file(),
        reason="results/ has no figures: run `make reproduce-all` before",
    ),
]

BEGIN = r"""\documentclass[journal]{IEEEtran}
\usepackage{amsmath,booktabs,graphicx,siunitx}
\input{numbers}
\input{figures/captions}
\begin{document}
\title{A manuscript}\author{Nobody}\maketitle
\section{Methods}
\input{methods}
\section{Results}
While walking, $K$ is \oslWalkingK{} (\oslWalkingKLow{} to \oslWalkingKHigh).
"""
END = r"""
\bibliographystyle{IEEEtran}
\bibliography{methods}
\end{document}
"""


def manuscript():
    """A manuscript with every figure and every table of the results."""
    parts = [BEGIN]
    for drawing in sorted((RESULTS / "figures").glob("*.pdf")):
        star = "*" if drawing.stem in TWO_COLUMNS else ""
        caption = rf"\oslCaption{macro_name(readable_name(drawing.stem))}"
        parts.append(
            rf"\begin{{figure{star}}}\centering\includegraphics{{figures/{drawing.name}}}"
            rf"\caption{{{caption}}}\end{{figure{star}}}"
        )
    for table in sorted((RESULTS / "tables/latex").glob("*.tex")):
        parts.append(
            rf"\begin{{table*}}\centering\caption{{{table.stem.capitalize()}}}"
            rf"\input{{tables/latex/{table.stem}}}\end{{table*}}"
        )
    return "\n".join([*parts, r"\clearpage", END])


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """The folder in which the manuscript was compiled, as an author does."""
    folder = tmp_path_factory.mktemp("manuscript")
    for name in ("methods.tex", "methods.bib", "numbers.tex"):
        shutil.copy(RESULTS / name, folder)
    for name in ("figures", "tables/latex"):
        shutil.copytree(RESULTS / name, folder / name)
    (folder / "paper.tex").write_text(manuscript(), encoding="utf-8")
    latex = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    for command in (latex, ["bibtex", "paper"], latex, latex):
        done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
        assert done.returncode == 0, done.stdout.decode(errors="replace")[-3000:]
    return folder


def log_of(folder):
    return (folder / "paper.log").read_text(encoding="utf-8", errors="replace")


def test_the_manuscript_compiles_without_an_overfull_box(compiled):
    assert re.findall(r"^Overfull .*", log_of(compiled), re.MULTILINE) == []


def test_no_reference_citation_or_letter_is_missing(compiled):
    log = log_of(compiled)

    missing = re.findall(
        r"^.*(?:undefined|Missing character|multiply defined).*", log, re.MULTILINE
    )
    assert missing == []


def test_bibtex_has_nothing_to_say(compiled):
    log = (compiled / "paper.blg").read_text(encoding="utf-8", errors="replace")

    assert [line for line in log.splitlines() if line.startswith("Warning")] == []


def test_every_file_that_is_pasted_is_ascii_where_bibtex_reads_it():
    assert (RESULTS / "methods.bib").read_bytes().isascii()
