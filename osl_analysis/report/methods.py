"""The text of a methods section, from what the campaign did: for the page, as Markdown, and as
LaTeX with its BibTeX.

The sentences stand in `templates/methods.txt.j2`. There `¶` begins a paragraph, `⟨K_d⟩` is a symbol
or an equation, and `[@key]` cites an entry of `sources.yaml`.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from osl_analysis.dictionary import own_yaml
from osl_analysis.judge.summary_findings import CampaignFinding
from osl_analysis.report.headline_files import in_latex
from osl_analysis.report.reported_trial import ReportedTrial
from osl_analysis.report.typography import printed
from osl_analysis.stats.repeats import size_texts
from osl_analysis.trial import Array

HERE = Path(__file__).parent
SOURCES: Mapping[str, Mapping[str, Any]] = own_yaml(HERE / "sources.yaml")
CITATION = re.compile(r"\[@(\w+)\]")
SYMBOL = re.compile(r"⟨(.*?)⟩")
UNITS = r"Hz|ms|s|N|kg|rad|mm|%"
"""Units of the text, from which TeX must not part their number."""
LOW_PASS = ("order", "cutoff_hz")
PLAIN_SIGNS = {"τ_0": "τ₀"}
TEX_SYMBOLS = {"θ̇": r"\dot\theta", "θ̈": r"\ddot\theta", "θ": r"\theta", "τ": r"\tau"}
TEX_SIGNS = {
    "θ": r"$\theta$", "·": r"$\cdot$", "²": "$^2$", "°": r"$^\circ$", "−": "$-$", "–": "--",
}  # fmt: skip
BIBTEX_FIELDS = (
    "author", "title", "journal", "volume", "pages", "institution", "number", "year", "note",
    "doi", "url",
)  # fmt: skip


@dataclass(frozen=True)
class MethodsText:
    """The text of a methods section.

    Attributes
    ----------
    marked : list of str
        Its paragraphs, with marks for symbols and citations.
    sources : dict
        The entries that it cites, by key, in the order of their first citation.
    """

    marked: Sequence[str]
    sources: Mapping[str, Mapping[str, Any]]

    @property
    def paragraphs(self) -> list[str]:
        """Its paragraphs, whose citations are numbers in brackets."""
        numbers = {key: str(number) for number, key in enumerate(self.sources, 1)}
        paragraphs = []
        for text in self.marked:
            cited = CITATION.sub(lambda mark: f"[{numbers[mark[1]]}]", text)
            paragraphs.append(SYMBOL.sub(lambda mark: replaced(mark[1], PLAIN_SIGNS), cited))
        return paragraphs

    @property
    def references(self) -> list[str]:
        """The sources as a list of references has them, in the order of their numbers."""
        return [reference_text(entry) for entry in self.sources.values()]

    def markdown(self) -> str:
        """The text as Markdown, with the list of references."""
        numbered = [f"{k}. {text}" for k, text in enumerate(self.references, 1)]
        parts = ["# Methods", *self.paragraphs, "## References", "\n".join(numbered)]
        return "\n\n".join(parts) + "\n"

    def latex(self) -> str:
        """The text as LaTeX, to be read by `\\input` in a paper's own section."""
        begin = r"% \input this file in a section of the paper, and \bibliography its methods.bib."
        return "\n\n".join([begin, *map(tex_paragraph, self.marked)]) + "\n"

    def bibtex(self) -> str:
        """The cited entries as BibTeX."""
        return "\n".join(bibtex_entry(key, entry) for key, entry in self.sources.items())


def methods_text(content: Mapping[str, Any], about: Mapping[str, str]) -> MethodsText:
    """Write the methods section of a campaign.

    Parameters
    ----------
    content : Mapping
        As `methods_content` gathers it, with `findings` on the campaign.
    about : Mapping of str to str
        The origin of its results.

    Returns
    -------
    MethodsText
    """
    folder = FileSystemLoader(HERE / "templates")
    environment = Environment(loader=folder, autoescape=False, undefined=StrictUndefined)
    environment.filters["printed"] = printed
    written = environment.get_template("methods.txt.j2").render(content, about=about)
    paragraphs = [" ".join(part.split()) for part in written.split("¶")]
    paragraphs = [re.sub(r" (?=[.,;)])", "", part) for part in paragraphs if part]
    cited = dict.fromkeys(CITATION.findall(" ".join(paragraphs)))
    sources = {key: dict(SOURCES[key]) for key in cited}
    version = f"Version {about['version']}, configuration {about['configuration']}"
    if "osl_analysis" in sources:
        sources["osl_analysis"]["note"] = version
    return MethodsText(paragraphs, sources)


def replaced(text: str, signs: Mapping[str, str]) -> str:
    """A text with each of some signs replaced."""
    for sign, written in signs.items():
        text = text.replace(sign, written)
    return text


def tex_paragraph(marked: str) -> str:
    """A paragraph as LaTeX."""
    parts: list[str] = []
    for part in re.split(r"(⟨.*?⟩|\[@\w+\])", marked):
        if symbol := SYMBOL.fullmatch(part):
            parts.append(f"${tex_symbols(symbol[1])}$")
        elif citation := CITATION.fullmatch(part):
            parts.append(rf"\cite{{{citation[1]}}}")
        else:
            parts.append(tex_words(part))
    return re.sub(r" (?=\\cite)", "~", "".join(parts))


def tex_symbols(text: str) -> str:
    """Symbols or an equation in LaTeX's mathematical mode."""
    words = re.sub(r"_(\w+)", r"_{\\mathrm{\1}}", text)
    return replaced(words, TEX_SYMBOLS)


def tex_words(text: str) -> str:
    """Words in LaTeX: each sign by itself, since what it becomes has signs of its own."""
    words = "".join(TEX_SIGNS.get(sign) or in_latex(sign) for sign in text)
    return re.sub(rf"(\d) (?=(?:\\?)(?:{UNITS})(?![a-z]))", r"\1~", words)


def reference_text(entry: Mapping[str, Any]) -> str:
    """A source as a list of references has it."""
    authors = "; ".join(entry["author"]).replace("; others", ", et al")
    parts = [authors.rstrip("."), entry["title"]]
    if "journal" in entry:
        parts.append(f"{entry['journal']} {entry['volume']}, {entry['pages']}")
    for name in ("number", "year", "note"):
        if name in entry:
            parts.append(str(entry[name]))
    place = f"https://doi.org/{entry['doi']}" if "doi" in entry else entry.get("url", "")
    end = f" {place}" if place else ""
    text = re.sub("[{}]", "", ". ".join(parts))
    return text + end if text.startswith("http", text.rfind(" ") + 1) else f"{text}.{end}"


def bibtex_entry(key: str, entry: Mapping[str, Any]) -> str:
    fields = []
    for name in BIBTEX_FIELDS:
        if name in entry:
            value = " and ".join(entry[name]) if name == "author" else str(entry[name])
            fields.append(f"  {name} = {{{value.replace('–', '--')}}}")
    return f"@{entry.get('kind', 'article')}{{{key},\n" + ",\n".join(fields) + "\n}\n"


VALUES_OF_METHODS = (
    "excitation",
    "commanded_deg",
    "frequency_hz",
    "band_low_hz",
    "band_high_hz",
    "controller",
    "group",
    "plate_inertia",
    "K_d",
    "B_d",
    "B_viscous",
    "direction",
    "onset_phase",
    "interval_method",
    "theta_rms_deg",
    "fitted_s",
    "n_up",
    "n_down",
)
"""Columns of result tables whose values the methods tell."""


def methods_content(
    config: Mapping[str, Any],
    accuracy: Mapping[str, float],
    tables: Mapping[str, pl.DataFrame],
    trials: Sequence[ReportedTrial],
    findings: Sequence[CampaignFinding],
) -> dict[str, Any]:
    """Gather the content of `methods.txt.j2`.

    Parameters
    ----------
    config : Mapping
        The settings of the analysis.
    accuracy : Mapping of str to float
        The shares by which findings may move K, B and I without making them doubtful.
    tables : Mapping of str to polars.DataFrame
        Result tables, by name.
    trials : Sequence of ReportedTrial
    findings : Sequence of CampaignFinding

    Returns
    -------
    dict
        `config`; `accuracy`; the values of `tables`; facts on the recordings (`recorded`); by kind
        of motion the number of impedance trials and values of their fits to all amplitudes
        (`motions`); numbers of perturbations by `ways`; which `response` is fitted while walking;
        `n_trials`, and how many are left out by cause (`left_out`); and by verdict the causes of
        doubts with their numbers of trials (`doubts`).
    """
    groups = tables.get("walking_groups", pl.DataFrame())
    ways = {}
    for way in ("up", "down"):
        ways[way] = groups.get_column(f"n_{way}", default=pl.Series([0])).sum()
    left_out = Counter(trial.left_out_for for trial in trials if trial.left_out)
    doubts: dict[str, list[str]] = {}
    for finding in findings:
        count = f"{finding.cause} ({len(finding.trials)} of {finding.n} {finding.kind})"
        doubts.setdefault(finding.verdict, []).append(count)
    return {
        "config": config,
        "accuracy": accuracy,
        "actuator_filter_is_shared": filters_are_shared(config, tables),
        "n_trials": len(trials),
        "left_out": dict(left_out.most_common()),
        "doubts": doubts,
        "tables": values_of_tables(tables),
        "recorded": recorded_of(trials),
        "motions": motions_of(tables),
        "ways": ways,
        "response": response_text(groups),
    }


def filters_are_shared(config: Mapping[str, Any], tables: Mapping[str, pl.DataFrame]) -> bool:
    """Whether actuator trials were fitted behind the filter of the other bench trials."""
    if "actuator" not in tables:
        return False
    return all(config["actuator"][name] == config["dynamometer"][name] for name in LOW_PASS)


ValuesOfTables = defaultdict[str, defaultdict[str, list[Any]]]
"""Values by table and column; empty where there are none, as the template asks for any."""


def values_of_tables(tables: Mapping[str, pl.DataFrame]) -> ValuesOfTables:
    """The values of `VALUES_OF_METHODS`, each once, upwards."""
    values: ValuesOfTables = defaultdict(lambda: defaultdict(list))
    for name, table in tables.items():
        for column in VALUES_OF_METHODS:
            if column in table.columns and len(table):
                values[name][column] = table[column].drop_nulls().unique().sort().to_list()
    if "impedance" in tables:
        amplitudes = [f"{size:g}" for size in values["impedance"]["commanded_deg"]]
        # where nobody stated what was commanded, all that moved, without a fit of its own too
        if not amplitudes:
            sines = tables.get("phasors", tables["impedance"])
            amplitudes = size_texts(sines["amplitude_deg"].cast(pl.Float64))
        values["impedance"]["commanded_deg"] = amplitudes
    frequencies = values["phasors"]["frequency_hz"]
    if frequencies:
        rounded = pl.Series(frequencies).round_sig_figs(3)
        values["phasors"]["frequency_hz"] = rounded.unique().sort().to_list()
    return values


def motions_of(tables: Mapping[str, pl.DataFrame]) -> list[dict[str, Any]]:
    """By kind of motion, the number `n` of impedance trials, and their band, angle and time."""
    impedance = tables.get("impedance", pl.DataFrame(schema=["amplitude_deg", "excitation"]))
    whole = impedance.filter(pl.col("amplitude_deg").is_null())
    motions = []
    for rows in whole.partition_by("excitation", maintain_order=True):
        motion: dict[str, Any] = {"kind": rows["excitation"][0], "n": len(rows)}
        for column in ("band_low_hz", "band_high_hz", "theta_rms_deg", "fitted_s"):
            motion[column] = []
            if column in rows.columns:
                motion[column] = rows[column].drop_nulls().to_list()
        motions.append(motion)
    return motions


@dataclass
class RecordedFacts:
    """Facts on the recordings of one experiment, which grow trial by trial.

    Attributes
    ----------
    n, used, perturbed_used
        Numbers of trials.
    rates
        Lowest rate of each trial [Hz].
    streams
        Rates of each group of signals that was recorded apart [Hz].
    grids
        Rates of the grids to which these were brought [Hz].
    plates
        Rates of force plates [Hz].
    turns
        Size [deg] and rise time [ms] of each turn of the platform.
    """

    n: int = 0
    used: int = 0
    perturbed_used: int = 0
    rates: list[float] = field(default_factory=list)
    streams: dict[str, list[float]] = field(default_factory=dict)
    grids: list[float] = field(default_factory=list)
    plates: list[float] = field(default_factory=list)
    turns: list[tuple[float, float]] = field(default_factory=list)

    def add(self, trial: ReportedTrial) -> None:
        is_used = not trial.left_out
        is_perturbed = bool(trial.row.get("perturbed"))
        self.n += 1
        self.used += is_used
        self.perturbed_used += is_perturbed and is_used
        if "timebase" in trial.tables:
            self.add_time_base(trial.tables["timebase"])
        if trial.quality is not None:
            for check, value in trial.quality[["check", "value"]].iter_rows():
                if check == "rate" and value is not None:
                    self.rates.append(value)
        frames = trial.provenance.get("mocap") or {}
        if trial.provenance.get("plates") and frames.get("samples_per_frame"):
            self.plates.append(frames["frame_rate_hz"] * frames["samples_per_frame"])
        crossing = trial.pictures.tables.get("crossing", pl.DataFrame())
        if is_perturbed and is_used and "platform_deg" in crossing.columns:
            self.turns.append(turn_of(crossing))

    def add_time_base(self, time_base: pl.DataFrame) -> None:
        for signals, rate_hz in time_base[["signals", "rate_hz"]].iter_rows():
            if signals is not None and rate_hz is not None:
                self.streams.setdefault(signals, []).append(rate_hz)
        self.grids += time_base["grid_rate_hz"].drop_nulls().to_list()

    def rounded(self) -> "RecordedFacts":
        """The facts with all rates to three digits, which of all at once takes less time."""
        streams = {signals: three_digits(rates) for signals, rates in self.streams.items()}
        return replace(
            self, rates=three_digits(self.rates), grids=three_digits(self.grids), streams=streams
        )


def three_digits(values: Sequence[float]) -> list[float]:
    """The values, rounded to three digits."""
    return pl.Series(values, dtype=pl.Float64).round_sig_figs(3).to_list()


def recorded_of(trials: Sequence[ReportedTrial]) -> dict[str, dict[str, Any]]:
    """`RecordedFacts` by experiment, as the template reads them."""
    by_experiment: dict[str, RecordedFacts] = {}
    for trial in trials:
        by_experiment.setdefault(trial.row["experiment"], RecordedFacts()).add(trial)
    return {
        experiment: asdict(recorded.rounded()) for experiment, recorded in by_experiment.items()
    }


def response_text(groups: pl.DataFrame) -> str:
    """A text on which response is fitted in the `walking_groups`."""
    mean, half_difference = "the mean response", "half the difference of both directions"
    if not {"n_up", "n_down"} <= set(groups.columns):
        return mean
    has_both = groups.select((pl.col("n_up") > 0) & (pl.col("n_down") > 0)).to_series()
    if has_both.all():
        return half_difference if has_both.any() else ""
    return f"{mean} or {half_difference}" if has_both.any() else mean


REST_SHARE = 0.9  # of the largest angle: the platform has turned
RISE = (0.1, 0.9)  # shares of a turn, between which its rise time lies


def turn_of(crossing: pl.DataFrame) -> tuple[float, float]:
    """Size [deg] of the platform's turn in a perturbed crossing, and its rise time [ms] from 10 to
    90 %."""
    time = crossing["time"].to_numpy()
    angle = crossing["platform_deg"].fill_nan(None).fill_null(0.0).abs().to_numpy()
    size = float(np.median(angle[angle >= REST_SHARE * angle.max()]))  # beside the noise of markers
    begin, end = RISE
    after_rise = int(np.argmax(angle > end * size))
    before_rise = np.flatnonzero(angle[:after_rise] < begin * size)
    last_before = int(before_rise[-1]) if len(before_rise) else 0
    # between two samples, of which a turn of 50 ms may have ten
    begins_s = time_between(angle, time, last_before, begin * size)
    ends_s = time_between(angle, time, after_rise - 1, end * size)
    return size, 1e3 * (ends_s - begins_s)


def time_between(angle: Array, time: Array, sample: int, value: float) -> float:
    """When an angle passes a value between a sample and the next one [s]."""
    both = slice(sample, sample + 2)
    return float(np.interp(value, angle[both], time[both]))
