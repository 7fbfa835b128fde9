let embedding = null;

async function unpacked(packed, columns) {
  const bytes = Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const changes = new Int32Array(await new Response(stream).arrayBuffer());
  const names = Object.keys(columns), rows = changes.length / names.length;
  return Object.fromEntries(names.map((name, k) => {
    const [low, step] = columns[name];
    let steps = 0;
    const value = (change) => ((steps += change) < 0 ? NaN : low + step * steps);
    return [name, Float64Array.from(changes.subarray(k * rows, (k + 1) * rows), value)];
  }));
}

function fill(source, values) {
  const [first] = Object.values(values), empty = new Float64Array(first.length).fill(NaN);
  const number = (value) => value ?? NaN;
  source.data = Object.fromEntries(source.columns().map((name) => [name, values[name]?.map(number) ?? empty]));
}

async function show() {
  const trial = trials[decodeURIComponent(location.hash).replace("#trial=", "")];
  if (!trial) return;
  await (embedding ??= Bokeh.embed.embed_item(plots));
  const [drawing] = Bokeh.documents, [panels] = drawing.roots();
  const signals = await unpacked(trial.packed, trial.columns), drawn = { ...signals, ...trial.response };
  fill(drawing.get_model_by_name("signals"), signals);
  if (trial.response.frequency) fill(drawing.get_model_by_name("response"), trial.response);
  for (const panel of panels.children) {
    panel.visible = panel.tags.every((name) => name in drawn);
    for (const axis of [...panel.below, ...panel.left])
      if (axis.tags.includes("motion")) axis.axis_label = trial.motion;
    panel.reset.emit();
  }
}

function sort(head) {
  const sign = (head.dataset.sign = head.dataset.sign === "1" ? "-1" : "1"), body = head.closest("table").tBodies[0];
  const text = (row) => row.cells[head.cellIndex].innerText.trim().replace("−", "-");
  const order = (a, b) => {
    const [x, y] = [parseFloat(a), parseFloat(b)];
    return isNaN(x) || isNaN(y) ? isNaN(x) - isNaN(y) || a.localeCompare(b) : x - y;
  };
  body.append(...[...body.rows].sort((a, b) => sign * order(text(a), text(b))));
}

document.querySelectorAll(".sort th").forEach((head) => (head.onclick = () => sort(head)));
document.getElementById("search").oninput = ({ target }) => {
  for (const row of document.querySelectorAll("#trials tbody tr"))
    row.hidden = !row.textContent.toLowerCase().includes(target.value.toLowerCase());
};
document.getElementById("colours").onclick = () => {
  const style = document.documentElement.style, isDark = matchMedia("(prefers-color-scheme: dark)").matches;
  style.colorScheme = (style.colorScheme || (isDark ? "dark" : "light")) === "dark" ? "light" : "dark";
};
addEventListener("hashchange", show);
show();
