// Tables of the page: a click on a column's head sorts, columns can be hidden, and what is shown is downloaded as CSV.
//
// A cell with a number has it in full as `data-value`, and the ends of its interval as `data-low` and `data-high`.
// An element inside a cell with `data-name` is a quantity of its own, in CSV a column of its own. The head of a
// column has its unit as `data-unit`.

const NO_VALUE_SIGN = "–";
const POWERS = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const PHONE = "(max-width: 700px)";  // as in report.css

// --- what a cell says

// without quantities of their own, and of what is folded only the summary
function shownText(cell) {
  const copy = cell.cloneNode(true);
  for (const part of copy.querySelectorAll("[data-name]")) part.remove();
  for (const fold of copy.querySelectorAll("details")) fold.replaceWith(fold.querySelector("summary").textContent);
  return copy.textContent.replace(/\s+/g, " ").trim();
}

function cellText(cell) {
  const text = cell.dataset.value ?? shownText(cell);
  return text === NO_VALUE_SIGN ? "" : text;
}

// a number as the page prints it, such as −1.2·10⁻⁵, in the form that programs read
function plainDigits(text) {
  const ascii = text.replace(/[⁰¹²³⁴-⁹]/g, (power) => POWERS.indexOf(power)).replace(/[−⁻]/g, "-");
  return ascii.replace(/·10\^?(?=-?\d)/, "e");
}

// the number at the beginning of a text; null if it begins with none
function leadingNumber(text) {
  const found = /^[-+]?\d+(\.\d+)?(e[-+]?\d+)?(?=\s|$)/.exec(plainDigits(text));
  return found ? Number(found[0]) : null;
}

// --- order

function sortValue(cell) {
  const text = cellText(cell);
  if (text === "") return null;
  return leadingNumber(text) ?? text;
}

// numbers by size and before text, text by its words and the numbers in it
function compareValues(a, b) {
  if (typeof a === "number" && typeof b === "number") return a - b;
  if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
  return a.localeCompare(b, "en", { numeric: true });
}

// empty cells stay last both ways
function compareCells(a, b, descending) {
  if (a === null || b === null) return (a === null) - (b === null);
  return descending ? -compareValues(a, b) : compareValues(a, b);
}

function sortTable(table, head) {
  const descending = head.getAttribute("aria-sort") === "ascending";
  for (const other of table.tHead.rows[0].cells) other.setAttribute("aria-sort", "none");
  head.setAttribute("aria-sort", descending ? "descending" : "ascending");
  const body = table.tBodies[0];
  const keyed = [...body.rows].map((row) => ({ row, value: sortValue(row.cells[head.cellIndex]) }));
  keyed.sort((a, b) => compareCells(a.value, b.value, descending));
  body.append(...keyed.map(({ row }) => row));
}

function addSortButtons(table) {
  for (const head of table.tHead.rows[0].cells) {
    const button = element("button", { type: "button" }, head.firstChild);
    button.addEventListener("click", () => sortTable(table, head));
    head.prepend(button);
    head.setAttribute("aria-sort", "none");
  }
}

// --- columns

const headName = (head) => head.querySelector("button").textContent.trim();

function showColumn(table, index, isShown) {
  for (const row of table.rows) row.cells[index].hidden = !isShown;
}

// the first column names the rows, and stays
function columnChoice(table) {
  const heads = [...table.tHead.rows[0].cells].slice(1);
  const boxes = heads.map((head) => {
    const box = element("input", { type: "checkbox" });
    box.checked = !(head.hasAttribute("data-wide") && matchMedia(PHONE).matches);
    if (!box.checked) showColumn(table, head.cellIndex, false);
    box.addEventListener("change", () => showColumn(table, head.cellIndex, box.checked));
    return element("label", {}, box, ` ${headName(head)}`);
  });
  return folded("Columns", element("div", { class: "boxes" }, ...boxes));
}

// --- CSV

const asciiUnit = (unit) => unit.replaceAll("·", "*").replace(/[²³]/g, (power) => `^${POWERS.indexOf(power)}`);

function titled(name, unit) {
  return unit && unit !== "1" ? `${name} [${asciiUnit(unit)}]` : name;
}

// titles and texts of one quantity: its value, and the ends of its interval if it has one
function quantityCells(part, name, unit) {
  const text = cellText(part);
  const isPrintedNumber = /^[−\d.]+(·10\S+)?$/.test(text);
  const cells = [[titled(name, unit), isPrintedNumber ? plainDigits(text) : text]];
  for (const end of ["low", "high"]) {
    if (part.dataset[end] !== undefined) cells.push([titled(`${name}_${end}`, unit), part.dataset[end]]);
  }
  return cells;
}

function cellsOf(cell, head) {
  const parts = [...cell.querySelectorAll("[data-name]")];
  const own = quantityCells(cell, headName(head), head.dataset.unit);
  return own.concat(parts.flatMap((part) => quantityCells(part, part.dataset.name, part.dataset.unit)));
}

function quoted(text) {
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

// the shown rows and columns of a table
function csvOf(table) {
  const heads = [...table.tHead.rows[0].cells].filter((head) => !head.hidden);
  const rows = [...table.tBodies[0].rows].filter((row) => !row.hidden);
  const columns = heads.map((head) => rows.map((row) => new Map(cellsOf(row.cells[head.cellIndex], head))));
  const titlesOf = (column, head) => {
    const titles = new Set(column.flatMap((cells) => [...cells.keys()]));
    return titles.size ? [...titles] : [titled(headName(head), head.dataset.unit)];
  };
  const titles = columns.map((column, k) => titlesOf(column, heads[k]));
  const lines = rows.map((_, at) => columns.flatMap((column, k) => titles[k].map((title) => column[at].get(title) ?? "")));
  return [titles.flat(), ...lines].map((line) => `${line.map(quoted).join(",")}\r\n`).join("");
}

function download(name, text) {
  const address = URL.createObjectURL(new Blob([text], { type: "text/csv;charset=utf-8" }));
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}

function csvButton(table, name) {
  const button = element("button", { type: "button", class: "csv", "aria-label": `Download ${name} as CSV` }, "Download CSV");
  const file = `${name.replace(/[^\p{L}\d.-]+/gu, "_")}.csv`;
  button.addEventListener("click", () => download(file, csvOf(table)));
  return button;
}

// --- all of it, for a table with a head; `name` is that of its file

function addTableTools(table, name) {
  addSortButtons(table);
  const tools = element("div", { class: "table-tools" }, columnChoice(table), csvButton(table, name));
  table.closest(".scroll").before(tools);
}
