// The page of one run: filters the table of trials, and draws a trial when its link is followed.
(() => {
  const overview = document.getElementById("overview");
  const view = document.getElementById("trial");
  const { title } = document;
  const trialRows = () => [...document.querySelectorAll("#table tbody tr")];
  const byName = new Map([...document.querySelectorAll("script.packed")].map((script) => [script.dataset.name, script]));
  let drawn = null;  // the views of Bokeh on the page, and their document
  let asked = 0;  // number of the last request to show a trial
  let left = null;  // where the overview was left for a trial: its scroll position, and its place in the address
  let lastPlace = "";

  // --- tables of a trial

  // a number stays in one line, a hash or path breaks anywhere, and text between words
  function kindOf(text) {
    if (/^[-−+\d.]/.test(text) && text.length < 16) return "number";
    return /\S{30}/.test(text) ? "wrap" : "";
  }

  // `values` has, for each cell, its number and the ends of its interval in full, or null
  function cellOf(text, k, numbers) {
    const made = k ? element("td", { class: kindOf(text) }, text) : element("th", { scope: "row" }, text);
    const [value, low, high] = numbers ?? [];
    for (const [name, number] of Object.entries({ value, low, high })) {
      if (number !== null && number !== undefined) made.dataset[name] = number;
    }
    return made;
  }

  function headOf(text, unit) {
    if (!unit || unit === "1") return element("th", { scope: "col" }, text);
    return element("th", { scope: "col", "data-unit": unit }, text, " ", element("small", {}, unit));
  }

  function table(head, lines, { fails = () => false, caption = "", units = [], values = [], hasTools = true } = {}) {
    const made = element("table");
    if (caption) made.append(element("caption", { class: "hidden" }, caption));
    if (head.length) made.append(element("thead", {}, element("tr", {}, ...head.map((text, k) => headOf(text, units[k])))));
    const line = (cells, at) => element(
      "tr", fails(cells) ? { class: "fails" } : {}, ...cells.map((text, k) => cellOf(text, k, values[at]?.[k])),
    );
    made.append(element("tbody", {}, ...lines.map(line)));
    const place = element("div", {}, element("div", { class: "scroll" }, made));
    if (head.length && hasTools) addTableTools(made, `${view.dataset.name} ${caption}`);
    return place;
  }

  // --- the packed trials: the format is described in page.py (packed_table)

  async function inflated(text) {
    const bytes = Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  const NO_VALUE = -(2 ** 31);

  async function unpacked(packed) {
    const columns = {};
    const bytes = await inflated(packed.data);
    const n = packed.rows;
    Object.entries(packed.units).forEach(([name, unit], column) => {
      let count = 0;
      columns[name] = Float64Array.from({ length: n }, (_, k) => {
        const at = 4 * column * n + k;
        count = (count + (bytes[at] | (bytes[at + n] << 8) | (bytes[at + 2 * n] << 16) | (bytes[at + 3 * n] << 24))) | 0;
        return count === NO_VALUE ? NaN : count * unit;
      });
    });
    return columns;
  }

  // --- plots

  const DASHES = { measured: [], model: [6, 3], residual: [], second: [2, 2], third: [8, 3, 2, 3] };
  const MARKERS = { measured: "circle", model: "square", second: "triangle", third: "diamond", residual: "circle" };
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

  function key(line) {
    const space = "http://www.w3.org/2000/svg";
    const svg = document.createElementNS(space, "svg");
    svg.setAttribute("width", 26);
    svg.setAttribute("height", 10);
    svg.setAttribute("aria-hidden", "true");
    const path = document.createElementNS(space, line.kind === "points" ? "circle" : "line");
    const at = line.kind === "points" ? { cx: 13, cy: 5, r: 3.5 } : { x1: 0, x2: 26, y1: 5, y2: 5 };
    for (const [name, value] of Object.entries(at)) path.setAttribute(name, value);
    path.setAttribute("style", line.kind === "points"
      ? `fill: var(--${line.look})`
      : `stroke: var(--${line.look}); stroke-width: ${line.kind === "range" ? 7 : 2}; stroke-dasharray: ${DASHES[line.look].join(" ")}`);
    svg.append(path);
    return svg;
  }

  function styled(plot) {
    const text = colour("text");
    plot.background_fill_color = colour("page");
    plot.border_fill_color = colour("page");
    plot.outline_line_color = colour("rule");
    for (const side of ["below", "left"]) {
      for (const axis of plot[side]) {
        Object.assign(axis, {
          axis_label_text_color: text, major_label_text_color: text, axis_line_color: text, major_tick_line_color: text,
          minor_tick_line_color: null, axis_label_text_font_style: "normal",
        });
      }
    }
    for (const grid of plot.center) grid.grid_line_color = colour("grid");
    plot.toolbar.logo = null;
  }

  // the columns of a line, with the samples k for which isShown(k), and where it has `where`, a value there
  function shownColumns(columns, line, isShown = () => true) {
    const { [line.x]: x, [line.y]: y, [line.where]: known } = columns[line.table];
    const isDrawn = (k) => isShown(k) && !(known && Number.isNaN(known[k]));
    return { [line.x]: x, [line.y]: y.map((value, k) => (isDrawn(k) ? value : NaN)) };
  }

  // a loop has columns of its own, of which a part can be chosen
  function sourceOf(panel, line, sources, columns) {
    if (!line.where && !panel.square) return sources[line.table];
    return new Bokeh.ColumnDataSource({ data: shownColumns(columns, line) });
  }

  // draws of a loop only the samples k for which isShown(k), and shows all of them
  function showPart({ panel, plot, columns, readings }, isShown) {
    plot.renderers.forEach((renderer, i) => {
      renderer.data_source.data = shownColumns(columns, panel.drawn[i], isShown);
    });
    readings.readAgain(isShown);
  }

  function drawPanel(panel, sources, ranges, columns) {
    const shared = panel.linked ? ranges[panel.linked] : undefined;
    const plot = Bokeh.Plotting.figure({
      height: panel.square ? 420 : 300,
      sizing_mode: "stretch_width",
      tools: panel.square || panel.log_x ? "box_zoom,pan,wheel_zoom,reset,save" : "xbox_zoom,pan,xwheel_zoom,reset,save",
      active_scroll: null,
      min_border_left: 72,  // so that the panels' axes stand below one another
      x_axis_label: panel.x_label,
      y_axis_label: panel.y_label,
      x_axis_type: panel.log_x ? "log" : "linear",
      y_axis_type: panel.log_y ? "log" : "linear",
      ...(shared ? { x_range: shared } : {}),
    });
    plot.toolbar.active_drag = plot.toolbar.tools.find((tool) => tool.type === "BoxZoomTool");
    if (panel.linked && !shared) ranges[panel.linked] = plot.x_range;
    for (const line of panel.drawn) {
      const source = sourceOf(panel, line, sources, columns);
      const look = { source, color: colour(line.look) };
      if (line.kind === "range") {
        // both ends and what lies between: where every sample is drawn, the ends are one line
        plot.segment({ field: line.x }, { field: line.y }, { field: line.x }, { field: line.high }, { ...look, line_width: 1.2 });
        for (const end of [line.y, line.high]) plot.line({ field: line.x }, { field: end }, { ...look, line_width: 0.8 });
      } else if (line.kind === "points") {
        if (line.low) plot.segment({ field: line.x }, { field: line.low }, { field: line.x }, { field: line.high }, { ...look, line_width: 1.5 });
        plot.scatter({ field: line.x }, { field: line.y }, { ...look, marker: MARKERS[line.look], size: 7 });
      } else {
        plot.line({ field: line.x }, { field: line.y }, { ...look, line_width: 1.4, line_dash: DASHES[line.look] });
      }
    }
    styled(plot);
    return plot;
  }

  function described(panel, columns) {
    const ends = panel.drawn.map((line) => {
      const values = [...columns[line.table][line.y]].filter(Number.isFinite);
      if (!values.length) return `${line.name}: no values`;
      const [low, high] = values.reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [Infinity, -Infinity]);
      return `${line.name} from ${low.toPrecision(3)} to ${high.toPrecision(3)}`;
    });
    return `${panel.title}, ${panel.y_label} over ${panel.x_label}: ${ends.join("; ")}`;
  }

  function zoomButtons(ranges) {
    const range = Object.values(ranges)[0];
    if (!range) return null;
    const move = (to) => () => {
      const [start, end] = [range.start, range.end];
      [range.start, range.end] = to(start, end - start);
    };
    let whole = null;
    const button = (text, label, to) => {
      const made = element("button", { type: "button", "aria-label": label }, text);
      made.addEventListener("click", () => {
        whole ??= [range.start, range.end];
        move(to)();
      });
      return made;
    };
    return element(
      "div", { class: "steps", role: "group", "aria-label": "Zoom of all panels over time" },
      button("+", "Zoom in", (start, width) => [start + width / 4, start + (3 * width) / 4]),
      button("−", "Zoom out", (start, width) => [start - width / 2, start + (3 * width) / 2]),
      button("‹", "Earlier", (start, width) => [start - width / 2, start + width / 2]),
      button("›", "Later", (start, width) => [start + width / 2, start + (3 * width) / 2]),
      button("Whole", "Show all", () => whole),
      element("span", { class: "note" }, "Or drag in a panel: all panels over time follow. Point at a panel, tap it, or step through it with the arrow keys: values stand there."),
    );
  }

  function forgetPlots() {
    if (!drawn) return;
    drawn.views.clear();
    drawn.sheet.clear();
    Bokeh.documents.splice(Bokeh.documents.indexOf(drawn.sheet), 1);
    drawn = null;
  }

  async function drawPlots(plots, content, columns) {
    forgetPlots();
    const ranges = {};
    const sources = {};
    for (const [name, data] of Object.entries(columns)) sources[name] = new Bokeh.ColumnDataSource({ data });
    const frames = content.panels.map((panel) => {
      const plot = drawPanel(panel, sources, ranges, columns);
      const keys = panel.drawn.map((line) => element("span", {}, key(line), line.name));
      const box = element("div", { role: "img", "aria-label": described(panel, columns) });
      const place = element("div", { class: "readable", role: "group", tabindex: 0, "aria-label": `Values of ${panel.title}, by the arrow keys` }, box);
      const title = element("h3", {}, panel.title, element("span", { class: "legend" }, ...keys));
      const shown = { panel, plot, box, place, columns };
      const choice = panel.square ? loopChoice(columns, (isShown) => showPart(shown, isShown)) : null;
      shown.frame = element("div", { class: "plot" }, title, choice, place);
      return shown;
    });
    const over = frames.filter(({ panel }) => panel.linked && !panel.log_x).map(({ frame }) => frame);
    const beside = frames.filter(({ panel }) => !panel.linked || panel.log_x).map(({ frame }) => frame);
    plots.replaceChildren(
      ...[zoomButtons(ranges), element("div", { class: "plots" }, ...over), element("div", { class: "pairs" }, ...beside)]
        .filter((child) => child !== null),
    );
    const sheet = new Bokeh.Document();
    for (const { plot } of frames) sheet.add_root(plot);
    const views = await Bokeh.embed.add_document_standalone(sheet, plots, frames.map(({ box }) => box));
    drawn = { sheet, frames, views };
    for (const frame of frames) frame.readings = new PlotReadings(frame, views.get(frame.plot));
  }

  const LABELS = 13, NUMBERS = 11;  // px, of the letters of axes on the screen
  const PAPER_WIDTH = 680;  // px, of A4 less its margins
  const PAPER_LETTERS = 9.6;  // px: 7.2 pt

  function sizeLetters(plot, labels, numbers) {
    for (const axis of [...plot.below, ...plot.left]) {
      axis.axis_label_text_font_size = `${labels}px`;
      axis.major_label_text_font_size = `${numbers}px`;
    }
  }

  // on paper a plot is a picture of what the screen shows, as wide as the page, with larger letters
  window.addEventListener("beforeprint", () => {
    for (const { plot, box } of drawn?.frames ?? []) {
      const view = drawn.views.get(plot);
      const size = Math.round(PAPER_LETTERS * Math.max(1, box.clientWidth / PAPER_WIDTH));
      sizeLetters(plot, Math.max(size, LABELS), Math.max(size, NUMBERS));
      view.invalidate_layout();
      view.paint();
      const { canvas } = view.export("png", true);
      const picture = element("canvas", { class: "on-paper", width: canvas.width, height: canvas.height });
      picture.getContext("2d").drawImage(canvas, 0, 0);
      box.after(picture);
    }
  });
  window.addEventListener("afterprint", () => {
    for (const picture of document.querySelectorAll(".on-paper")) picture.remove();
    for (const { plot } of drawn?.frames ?? []) sizeLetters(plot, LABELS, NUMBERS);
  });

  // --- one trial

  const sentence = (text) => (text ? text[0].toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? "" : ".") : "");

  // cause, size and remedy as sentences; columns, values and limits behind a fold
  function doubtList(doubts) {
    return element("ul", { class: "doubts" }, ...doubts.map((doubt) => {
      const numbers = table(["number", "value", "beyond", "what it is"], doubt.numbers, { caption: "limits", hasTools: false });
      const about = doubt.scope === "whole fit" ? null : element("span", { class: "where" }, `At ${doubt.where}: `);
      const line = (name, text) => (text ? element("p", {}, element("b", {}, `${name}: `), sentence(text)) : null);
      return element(
        "li", {}, element("p", { class: "cause" }, about, element("b", {}, sentence(doubt.cause).replace(/\.$/, ""))),
        doubt.says === doubt.cause ? null : element("p", {}, sentence(doubt.says)),
        line("Size", doubt.size), line("What to do", doubt.remedy),
        doubt.numbers.length ? folded("Numbers and limits", numbers) : null,
      );
    }));
  }

  const OUTCOMES = {
    clear: "Used in every table and figure. No check and no limit speaks against it.",
    "doubtful in part": "Used. The fit to all of it is sound; doubtful are",
    flagged: "Used, though its recording does not pass a check.",
    doubtful: "Used and marked as doubtful, because the fit to all of it is beyond a limit. Causes first:",
    excluded: "Excluded: in no table and no figure.",
    refused: "Refused: it has no result.",
  };

  function verdict(content) {
    const { doubts } = content;
    const [whole, flags, single, other] = ["whole fit", "recording", "part of the fit", "other table"].map((scope) => doubts.filter((doubt) => doubt.scope === scope));
    const partly = content.verdict === "doubtful in part";
    const parts = [single.length ? "fits to single amplitudes" : null, other.length ? "other tables of it" : null].filter((part) => part);
    return element(
      "section", { class: `judged ${content.verdict.replaceAll(" ", "-")}` },
      element("p", { class: "outcome" }, OUTCOMES[content.verdict] + (partly ? ` ${parts.join(" and ")}. Causes first:` : "")),
      ...content.left_out.map((reason) => element("p", {}, sentence(reason))),
      whole.length || flags.length ? doubtList([...whole, ...flags]) : null,
      partly ? doubtList(single.length ? single : other) : null,
      single.length && !partly ? folded(`Doubts about single amplitudes (${single.length})`, doubtList(single)) : null,
      other.length && (single.length || !partly) ? folded(`Doubts in its other tables (${other.length})`, doubtList(other)) : null,
      content.not_checked.length ? folded(`What could not be checked, or is to be known (${content.not_checked.length})`, element("ul", {},
        ...content.not_checked.map((what) => element("li", {}, sentence(what))))) : null,
    );
  }

  function section(title, ...children) {
    return element("section", {}, element("h2", {}, title), ...children);
  }

  function estimates(content) {
    if (!content.estimates) return section("Estimates", element("p", {}, "This trial has no fit of its own."));
    const { columns, rows: lines, values } = content.estimates;
    const head = columns.map(({ name }) => name);
    const units = columns.map(({ unit }) => unit);
    const explained = columns.filter(({ name, meaning }) => meaning && /^I$|viscous$|^[fT]_C$/.test(name));
    return section(
      "Estimates with 95 % intervals",
      table(head, lines, { caption: "estimates", units, values }),
      element("p", { class: "note" }, explained.map(({ name, meaning }) => `${name}: ${sentence(meaning)}`).join(" ")),
      folded(`Every column of its row in tables/${content.table}.csv`, table(["column", "value", "unit", "meaning"], content.columns, { caption: `row of ${content.table}`, values: content.column_values })),
    );
  }

  function quality(content) {
    if (!content.quality.length) return section("Quality", element("p", {}, "Quality control did not see this trial."));
    const failed = content.quality.filter((cells) => cells[4] !== "pass").length;
    return section("Quality", folded(`Checks of its recording (${content.quality.length}, ${failed} not passed)`, table(
      ["check", "what its value is", "value", "threshold", "verdict", "remark"], content.quality,
      { fails: (cells) => cells[4] !== "pass", caption: "quality" },
    )));
  }

  function provenance(content) {
    const { files, signals, facts } = content.provenance;
    return section(
      "Provenance",
      files.length ? table(["role", "file", "bytes", "SHA-256", "source file"], files, { caption: "files" }) : element("p", {}, "It was not ingested."),
      signals.length ? folded("Signals: which channel became which", table(["signal", "file", "channel and conversion"], signals, { caption: "signals" })) : null,
      facts.length ? folded("Clocks, stamps, decoding, software", table(["fact", "value"], facts, { caption: "facts" })) : null,
      content.time_base.length ? folded("Time base of the fit", table(content.time_base[0], content.time_base.slice(1), { caption: "time base" })) : null,
    );
  }

  function steps(name) {
    const shown = trialRows().filter((row) => !row.hidden).map((row) => row.dataset.name);
    const at = shown.indexOf(name);
    const link = (other, text, rel) => (other === undefined ? null : element("a", { href: `#trial=${encodeURIComponent(other)}`, rel }, text));
    return element(
      "nav", { class: "steps", "aria-label": "Trials" }, element("a", { href: "#overview", id: "back" }, "↑ all trials"),
      link(shown[at - 1], `← ${shown[at - 1]}`, "prev"), link(at < 0 ? undefined : shown[at + 1], `${shown[at + 1]} →`, "next"),
    );
  }

  async function showTrial(name) {
    const request = ++asked;
    view.dataset.name = name;
    const packed = byName.get(name);
    forgetPlots();
    if (!overview.hidden) left = { scroll: window.scrollY, place: lastPlace };
    overview.hidden = true;
    view.hidden = false;
    delete view.dataset.drawn;
    if (!packed) {
      view.replaceChildren(element("h1", {}, "No such trial"), element("p", {}, `This report has no trial "${name}".`), steps(name));
      return;
    }
    const { content: text, tables } = JSON.parse(packed.textContent);
    const content = JSON.parse(new TextDecoder().decode(await inflated(text)));
    const columns = {};
    for (const [key, value] of Object.entries(tables)) columns[key] = await unpacked(value);
    if (request !== asked) return;
    const plots = element("div");
    view.replaceChildren(...[
      steps(name),
      element("h1", {}, name, " ", element("span", { class: `verdict ${content.verdict.replaceAll(" ", "-")}` }, content.verdict)),
      element("p", { class: "about" }, `${content.experiment}: ${content.description}`),
      content.condition ? element("p", {}, content.condition) : null,
      verdict(content),
      estimates(content),
      content.panels.length ? section("Signals", element("p", { class: "note" }, content.remark), plots) : null,
      quality(content),
      provenance(content),
    ].filter((child) => child !== null));
    view.focus({ preventScroll: true });
    window.scrollTo(0, 0);
    document.title = `${name}: report of osl-analysis`;
    if (content.panels.length) await drawPlots(plots, content, columns);
    view.dataset.drawn = name;
  }

  function showOverview(place) {
    asked += 1;
    const from = view.hidden ? null : view.dataset.name;
    forgetPlots();
    view.hidden = true;
    view.replaceChildren();
    overview.hidden = false;
    document.title = title;
    if (from && left && (place === "overview" || place === left.place)) window.scrollTo(0, left.scroll);
    else document.getElementById(place === "overview" ? "trials" : place)?.scrollIntoView();
    if (from) trialRows().find((row) => row.dataset.name === from)?.querySelector("a").focus({ preventScroll: true });
    lastPlace = place;
  }

  function follow() {
    const place = location.hash.slice(1);
    if (!place.startsWith("trial=")) return showOverview(place);
    let name = place.slice("trial=".length);
    try {
      name = decodeURIComponent(name);
    } catch { /* a lone per cent sign stands for itself */ }
    return showTrial(name);
  }

  // --- the map: its cells have no links and no titles of their own, since a large campaign has ten thousand

  const map = document.querySelector("table.map");
  const trialOf = (cell) => JSON.parse(cell.closest("tbody").dataset.trials)[cell.cellIndex - 1];
  map.addEventListener("click", ({ target }) => {
    if (target.tagName === "TD") location.hash = `#trial=${encodeURIComponent(trialOf(target))}`;
  });
  map.addEventListener("mouseover", ({ target }) => {
    if (target.tagName !== "TD" || target.title) return;
    const row = target.parentElement;
    const cause = row.className === "whole" ? "" : `, ${row.cells[0].textContent}`;
    target.title = `${trialOf(target)}${cause}: ${target.className.replaceAll("-", " ")}`;
  });

  // --- the figures: a point of a trial says what the table of trials says of it

  function trialText(name) {
    const row = trialRows().find((one) => one.dataset.name === name);
    const numbers = [...(row?.querySelectorAll("td.number") ?? [])].filter((cell) => cell.dataset.value);
    const units = [...document.querySelectorAll("#table th")].map((head) => head.dataset.unit ?? "");
    const said = numbers.map((cell) => `${cell.title || cell.dataset.of} ${shownText(cell)} ${units[cell.cellIndex]}`);
    return [name, ...said].join("\n");
  }

  overview.addEventListener("mouseover", ({ target }) => {
    const title = target.closest(".paper a")?.querySelector("title");
    if (title && !title.dataset.hasNumbers) {
      title.textContent = trialText(title.textContent);
      title.dataset.hasNumbers = "yes";
    }
  });

  // --- the table of trials

  const search = document.getElementById("search");
  const selects = [...document.querySelectorAll("#filters select")];

  function filter() {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const rows = trialRows();
    let shown = 0;
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = !words.every((word) => text.includes(word))
        || selects.some(({ value, dataset }) => value && row.dataset[dataset.filter] !== value);
      shown += !row.hidden;
    }
    document.getElementById("shown").textContent = `${shown} of ${rows.length} trials`;
  }

  for (const select of selects) select.addEventListener("change", filter);
  search.addEventListener("input", filter);
  document.getElementById("filters").addEventListener("reset", () => setTimeout(filter));
  document.getElementById("filters").addEventListener("submit", (event) => event.preventDefault());
  for (const count of document.querySelectorAll(".count")) {
    count.addEventListener("click", () => {
      document.querySelector('[data-filter="verdict"]').value = count.dataset.verdict;
      filter();
    });
  }

  // --- text to copy: where the browser does not let a page copy, it stays selected

  for (const button of document.querySelectorAll("button.copy")) {
    const label = button.textContent;
    button.hidden = false;
    button.addEventListener("click", async () => {
      const text = document.getElementById(button.dataset.of);
      getSelection().selectAllChildren(text);
      let done = false;
      try {
        await navigator.clipboard.writeText(text.innerText);
        done = true;
      } catch { done = document.execCommand("copy"); }
      button.textContent = done ? "Copied" : "Selected: copy it with Ctrl+C";
      setTimeout(() => { button.textContent = label; }, 3000);
    });
  }

  for (const one of document.querySelectorAll("#overview table[data-csv]")) addTableTools(one, one.dataset.csv);

  // --- colours and keys

  const themes = ["system", "light", "dark"];
  const theme = document.getElementById("theme");
  theme.addEventListener("click", () => {
    const next = themes[(themes.indexOf(document.documentElement.dataset.theme ?? "system") + 1) % themes.length];
    if (next === "system") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = next;
    theme.textContent = `Colours: ${next}`;
    theme.setAttribute("aria-label", `Colours of this page: ${next === "system" ? "as the system has them" : next}`);
    if (!view.hidden) follow();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (!view.hidden) follow(); });

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, select, textarea")) return;
    if (event.key === "/") {
      event.preventDefault();
      if (!view.hidden) {
        history.pushState(null, "", "#trials");
        showOverview("trials");
      }
      search.focus();
    } else if (event.key === "Escape" && !view.hidden) location.hash = "#overview";
    else if (event.key === "ArrowLeft" && !event.target.closest(".plot")) view.querySelector('a[rel="prev"]')?.click();
    else if (event.key === "ArrowRight" && !event.target.closest(".plot")) view.querySelector('a[rel="next"]')?.click();
  });
  window.addEventListener("hashchange", follow);
  follow();
})();
