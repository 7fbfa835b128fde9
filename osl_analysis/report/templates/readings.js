// Readings of a plot: the pointer, a tap, or the arrow keys choose a sample, whose values are shown with their units.
//
// A reading is what one line of a panel says at the chosen place: { line, k, x, y }, the k-th sample of its table.

const POINT_REACH = 30;  // px, a finger's half width
const SAME_PLACE = 8;  // px, within which points and curves of two tables are read together

const unitOf = (label) => /\((.*)\)$/.exec(label)?.[1] ?? "";
const withUnit = (value, unit) => `${Number(value.toPrecision(4))} ${unit}`.trim().replace("-", "−");
const quantityOf = (label) => label.replace(/\s*\(.*\)$/, "");

// --- which sample

// what a line has at sample k; null where it has no value or is not drawn
function readingAt(line, columns, k) {
  const data = columns[line.table];
  const [x, y] = [data[line.x][k], data[line.y][k]];
  const isDrawn = !line.where || Number.isFinite(data[line.where][k]);
  return isDrawn && Number.isFinite(x) && Number.isFinite(y) ? { line, k, x, y } : null;
}

function readingsOf(line, columns) {
  const found = [];
  for (let k = 0; k < columns[line.table][line.x].length; k += 1) {
    const reading = readingAt(line, columns, k);
    if (reading) found.push(reading);
  }
  return found;
}

function nearestOf(readings, distance) {
  let [best, least] = [null, Infinity];
  for (const reading of readings) {
    const far = distance(reading);
    if (far < least) [best, least] = [reading, far];
  }
  return best;
}

// --- what is said

function readingText(reading, columns, unit) {
  const { line, k, y } = reading;
  const data = columns[line.table];
  const end = (name) => withUnit(data[name][k], "");
  if (line.kind === "range") return `${line.name}: ${end(line.y)} to ${end(line.high)} ${unit}`;
  const interval = line.low ? ` [${end(line.low)}, ${end(line.high)}]` : "";
  return `${line.name}: ${withUnit(y, "")}${interval} ${unit}`.trim();
}

// the place first, then each line that has a value there; a loop is read at one sample, and says when that was
function readingLines(panel, readings, columns) {
  const [first] = readings;
  const place = `${quantityOf(panel.x_label)} ${withUnit(first.x, unitOf(panel.x_label))}`.trim();
  const time = panel.square ? columns[first.line.table].time?.[first.k] : undefined;
  const when = time === undefined ? "" : `, at ${withUnit(time, "s")}`;
  const said = readings.map((reading) => {
    const isBeside = withUnit(reading.x, "") !== withUnit(first.x, "");
    const where = isBeside ? ` (at ${withUnit(reading.x, unitOf(panel.x_label))})` : "";
    return readingText(reading, columns, unitOf(panel.y_label)) + where;
  });
  return [place + when, ...said];
}

// --- one plot

// of a panel, the element around its plot, and its columns; `plotView` is the view of Bokeh
class PlotReadings {
  constructor({ panel, place, columns }, plotView) {
    Object.assign(this, { panel, place, columns, plotView });
    this.label = element("output", { class: "reading", "aria-live": "polite" });
    this.marks = element("div", { class: "marks", "aria-hidden": "true" });
    place.append(this.marks, this.label);
    this.readAgain(() => true);
    place.addEventListener("pointermove", (event) => this.readPointer(event));
    place.addEventListener("pointerdown", (event) => this.readPointer(event));
    place.addEventListener("pointerleave", () => this.hide());
    place.addEventListener("focus", () => place.matches(":focus-visible") && this.step(0));
    place.addEventListener("blur", () => this.hide());
    place.addEventListener("keydown", (event) => this.readKey(event));
  }

  // of the samples k for which isShown(k)
  readAgain(isShown) {
    this.hide();
    this.chosen = null;
    this.byLine = this.panel.drawn.map((line) => readingsOf(line, this.columns).filter(({ k }) => isShown(k)));
  }

  // pixels in the element, of values
  pixelsOf({ x, y }) {
    const { x_scale, y_scale } = this.plotView.frame;
    return { left: x_scale.compute(x), top: y_scale.compute(y) };
  }

  isInside({ left, top }) {
    const { left: from, right, top: above, bottom } = this.plotView.frame.bbox;
    return left >= from - 1 && left <= right + 1 && top >= above - 1 && top <= bottom + 1;
  }

  readPointer(event) {
    const { left, top } = this.place.getBoundingClientRect();
    const pointer = { left: event.clientX - left, top: event.clientY - top };
    if (this.isInside(pointer)) this.readNear(pointer);
    else this.hide();
  }

  // points are taken before a line on which they lie
  readNear(pointer) {
    const across = (reading) => Math.abs(this.pixelsOf(reading).left - pointer.left);
    const away = (reading) => Math.hypot(across(reading), this.pixelsOf(reading).top - pointer.top);
    const readings = this.byLine.flat();
    const points = readings.filter((reading) => reading.line.kind === "points" && away(reading) < POINT_REACH);
    const chosen = points.length ? nearestOf(points, away) : nearestOf(readings, this.panel.square ? away : across);
    if (chosen) this.show(chosen);
  }

  // what each line has at the place of a sample: lines of its table the same sample, others one close by
  readingsBeside(chosen) {
    const at = this.pixelsOf(chosen).left;
    const beside = this.panel.drawn.map((line, i) => {
      if (line.table === chosen.line.table) return readingAt(line, this.columns, chosen.k);
      const near = this.panel.square ? null : nearestOf(this.byLine[i], ({ x }) => Math.abs(x - chosen.x));
      return near && Math.abs(this.pixelsOf(near).left - at) < SAME_PLACE ? near : null;
    });
    return beside.filter(Boolean);
  }

  show(chosen) {
    this.chosen = chosen;
    const readings = this.readingsBeside(chosen);
    const at = this.pixelsOf(chosen);
    const lines = readingLines(this.panel, [chosen, ...readings.filter(({ line }) => line !== chosen.line)], this.columns);
    this.label.replaceChildren(...lines.map((text) => element("div", {}, text)));
    this.marks.replaceChildren(...readings.map((reading) => this.markOf(reading)));
    const { width } = this.plotView.frame.bbox;
    const isRight = at.left > this.plotView.frame.bbox.left + width / 2;
    this.label.style.left = isRight ? "auto" : `${at.left + 12}px`;
    this.label.style.right = isRight ? `${this.place.clientWidth - at.left + 12}px` : "auto";
    this.label.style.top = `${this.plotView.frame.bbox.top + 4}px`;
  }

  markOf(reading) {
    const { left, top } = this.pixelsOf(reading);
    const mark = element("span");
    Object.assign(mark.style, { left: `${left}px`, top: `${top}px`, color: `var(--${reading.line.look})` });
    mark.hidden = !this.isInside({ left, top });
    return mark;
  }

  hide() {
    this.label.replaceChildren();
    this.marks.replaceChildren();
  }

  // --- the keyboard: a loop is followed in time, all else to the right, at least a pixel at a time

  order() {
    const longest = this.byLine.reduce((a, b) => (b.length > a.length ? b : a), []);
    const visible = longest.filter((reading) => this.isInside(this.pixelsOf(reading)));
    if (this.panel.square) return visible;
    visible.sort((a, b) => a.x - b.x);
    let last = -Infinity;
    return visible.filter((reading) => {
      const { left } = this.pixelsOf(reading);
      if (left - last < 1) return false;
      last = left;
      return true;
    });
  }

  step(by) {
    const order = this.order();
    if (!order.length) return;
    const at = this.chosen ? order.indexOf(nearestOf(order, ({ x, k }) => Math.abs(this.panel.square ? k - this.chosen.k : x - this.chosen.x))) : 0;
    this.show(order[Math.min(Math.max(at + by, 0), order.length - 1)]);
  }

  readKey(event) {
    const steps = { ArrowLeft: -1, ArrowRight: 1, PageDown: -20, PageUp: 20, Home: -Infinity, End: Infinity };
    if (!(event.key in steps) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    this.step(steps[event.key]);
  }
}
