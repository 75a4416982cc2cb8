/* The page of a finished result: what the server says is shown, with the sliders where they stand. */
(function () {
  "use strict";
  const { element, digits, $ } = wb;
  const { STYLE, below } = vtsdtMarks;
  const at = {};
  let running = false, waiting = false;

  async function refresh() {
    waiting = true;
    if (running) return;
    running = true;
    try {
      while (waiting) { waiting = false; show(await wb.send("result", at)); }
    } catch (error) { wb.complain(error); } finally { running = false; }
  }
  function show(found) {
    $("name").textContent = found.name;
    document.title = `${found.name}: vtsdt workbench`;
    $("sentences").replaceChildren(...found.sentences.map((s) => element("p", s)));
    if (!$("sliders").childElementCount) $("sliders").replaceChildren(...found.sliders.map(slider));
    $("figures").replaceChildren();
    for (const f of found.figures) figure($("figures"), f);
    $("tables").replaceChildren();
    $("tables").style.display = found.tables.length ? "" : "none";
    for (const t of found.tables) {
      $("tables").append(element("h3", t.title));
      wb.views.grid($("tables"), t.heads.map(([text, n]) => [text, n]), t.rows);
    }
    document.body.dataset.shown = String(Number(document.body.dataset.shown || 0) + 1);
  }
  function slider({ name, label, unit, low, high, value }) {
    const line = element("label", `${label} `), box = element("input", undefined, { type: "range", min: 0, max: 1000 }), told = element("output", `${digits(value)} ${unit}`);
    box.value = (1000 * (value - low)) / (high - low || 1);
    box.oninput = () => {
      at[name] = low + ((high - low) * box.value) / 1000;
      told.textContent = `${digits(at[name])} ${unit}`;
      refresh();
    };
    line.append(box, told);
    return line;
  }
  function figure(box, f) {
    const names = new Map();
    for (const l of f.lines) if (l.name && !names.has(l.name)) names.set(l.name, STYLE[l.style].stroke);
    wb.views.scatter(box, f.title, f.lines.map((l) => ({ ...STYLE[l.style], points_: l.x.map((x, k) => [x, l.y[k]]) })), [], f.labels, { height: 300, plugins: [below(() => ({ stretches: f.bands, rules: f.marks }))], logarithmic: f.logarithmic });
    wb.views.key(box, [...names].map(([name, colour]) => [colour, name]));
  }
  refresh();
})();
