/* The views of the residual: over time, frequency and motion, by record, and in sentences. */
wb.views = (function () {
  "use strict";
  const { element, select, digits, chosen, $ } = wb;
  const VIEWS = {
    time: "Over time", spectra: "Over frequency", motion: "Over motion", table: "By record", where: "Where it fails",
    force: "Unknown force", branches: "Two branches",
  };
  const FONT = "12px system-ui, sans-serif";
  let drawing = null, later = 0, asked = 0;

  async function show() {
    if (chosen.view === "branches" && !wb.state.branches.length) chosen.view = "time";
    $("tabs").replaceChildren(...Object.entries(VIEWS).filter(([key]) => key !== "branches" || wb.state.branches.length).map(([key, text]) => {
      const tab = element("button", text, { className: key === chosen.view ? "on" : "", onclick: () => { chosen.view = key; drawing = null; show().catch(wb.complain); } });
      tab.dataset.view = key;
      tab.setAttribute("role", "tab");
      tab.setAttribute("aria-selected", key === chosen.view);
      return tab;
    }));
    choices();
    if (chosen.view === "time") return drawTime();
    drawing = null;
    const view = chosen.view, number = ++asked, box = element("div");
    const found = await {
      spectra: () => wb.ask("spectra", { record: chosen.record }),
      motion: () => wb.ask("motion", { output: output() }),
      table: () => wb.ask("table", { against: chosen.against }),
      where: () => wb.ask("where"),
      force: () => wb.ask("force", { where: chosen.place }),
      branches: () => {
        chosen.ends = chosen.ends.map((k, side) => (k <= wb.state.branches.length ? k : side));
        return wb.ask("branches", { one: chosen.ends[0], other: chosen.ends[1] });
      },
    }[view]();
    if (number !== asked) return;
    $("view").replaceChildren(box);
    $("view").dataset.view = view; // what stands there now
    ({ spectra, motion, table, where, force: wb.showForce, branches: wb.showBranches })[view](box, found);
  }
  const output = () => (wb.state.outputs.some((o) => o.name === chosen.output) ? chosen.output : wb.state.outputs[0].name);

  function choices() {
    const { state } = wb, row = $("choice");
    const records = state.records.map((r) => [r.name, `${r.name} (${r.part === "identify" ? "fitted" : "held out"})`]);
    if (!records.some(([name]) => name === chosen.record)) { chosen.record = records[0][0]; chosen.span = null; }
    row.replaceChildren();
    if (["time", "spectra"].includes(chosen.view)) row.append(select("record", records, chosen.record, (v) => { chosen.record = v; drawing = null; show().catch(wb.complain); }));
    if (chosen.view === "motion") row.append(select("output", state.outputs.map((o) => [o.name, o.name]), output(), (v) => { chosen.output = v; show().catch(wb.complain); }));
    if (!["time", "table"].includes(chosen.view)) return;
    const stages = [...state.stages.map((s, k) => [String(k), `compare with: ${s.title}`]), ...state.branches.map((s, k) => [String(state.stages.length + k), `compare with branch ${k + 1}: ${s.title}`])];
    if (chosen.against >= stages.length) chosen.against = 1;
    row.append(select("compare with", stages, String(chosen.against), (v) => { chosen.against = Number(v); (chosen.view === "time" ? drawTime() : show()).catch(wb.complain); }));
    if (chosen.view !== "time") return;
    row.append(element("button", leaveWords(), { className: "leave", disabled: wb.isBusy(), title: "Fit every stage again without it", onclick: () => {
      const [start, stop] = isPart() ? chosen.span : [];
      wb.act("leave_out", { record: chosen.record, start, stop });
    } }));
  }

  const isPart = () => !!(chosen.span && drawing && (chosen.span[0] > drawing.whole[0] || chosen.span[1] < drawing.whole[1]));
  const leaveWords = () => (isPart() ? "Leave the visible stretch out" : "Leave this record out");

  // ------------------------------------------------------------------ over time
  async function time() {
    if (chosen.view === "time") return drawTime();
    chosen.view = "time";
    drawing = null;
    return show();
  }
  const wanted = () => {
    const [start, stop] = chosen.span || [null, null], columns = Math.ceil($("view").clientWidth * devicePixelRatio);
    return { record: chosen.record, start, stop, against: chosen.against, predict: chosen.candidate, values: chosen.values, columns };
  };
  /* Figures drawn because the person scrolled to them are not counted: nothing was asked of the model. */
  async function drawTime(counted = true) {
    const begun = performance.now(), given = wanted();
    if (drawing) given.outputs = drawing.inSight(); // the numbers of the others are asked for when they come into sight
    const figures = await wb.send("figures", given);
    if (chosen.view !== "time" || !figures.length || given.record !== chosen.record) return;
    if (!drawing && chosen.span) { // the stretch of another record: what this one has of it, or all of it
      const [from, to] = figures[0].whole, low = Math.max(from, chosen.span[0]), high = Math.min(to, chosen.span[1]);
      const outside = !(high > low);
      chosen.span = outside ? null : [low, high];
      if (outside) return drawTime(counted);
    }
    if (drawing) drawing.update(figures);
    else {
      const box = element("div", undefined, { className: "zoom" });
      $("view").replaceChildren(box);
      $("view").dataset.view = "time";
      drawing = vtsdtZoom.draw(box, figures, { onZoom: zoomed, onSight: () => drawTime(false).catch(wb.complain), onPrint: () => wb.sendAndWait("figures", wanted()), onMark: (figure, mark) => drawing.show(mark[0], mark[1], true) });
      drawing.whole = figures[0].whole;
      if (chosen.span) drawing.show(chosen.span[0], chosen.span[1], false);
      const leave = document.querySelector("button.leave");
      if (leave) leave.textContent = leaveWords();
    }
    await new Promise(requestAnimationFrame); // what uPlot has put off until the end of this task is drawn by then
    if (!counted) return;
    wb.times.last = performance.now() - begun;
    if (wb.times.first === undefined) wb.times.first = performance.now();
    document.body.dataset.figures = String(Number(document.body.dataset.figures || 0) + 1);
  }
  function zoomed(from, to) {
    chosen.span = from > drawing.whole[0] || to < drawing.whole[1] ? [from, to] : null;
    const leave = document.querySelector("button.leave");
    if (leave) leave.textContent = leaveWords();
    clearTimeout(later);
    later = setTimeout(() => drawTime().catch(wb.complain), 60);
  }

  // ------------------------------------------------------------------ the others
  const axis = (label, size, labelSize) => ({ label, size, labelSize, font: FONT, labelFont: FONT, grid: { stroke: "#e5e9ed", width: 1 }, ticks: { stroke: "#c3cad2", width: 1 } });
  /* Of a logarithmic axis only whole decades are written and ruled. */
  const decades = (u, k, low, high) => {
    const found = [], step = Math.max(1, Math.ceil(Math.log10(high / low) / 6));
    for (let e = Math.floor(Math.log10(low)); e <= Math.ceil(Math.log10(high)); e += step) found.push(10 ** e);
    return found.filter((v) => v > 0.999 * low && v < 1.001 * high);
  };
  const power = (u, ticks) => ticks.map((v) => (v >= 0.01 && v < 1e4 ? String(+v.toPrecision(3)) : `1e${Math.round(Math.log10(v))}`));
  function plot(box, title, series, data, scales, labels, options) {
    const look = (scale, ...rest) => ({ ...axis(...rest), ...(scale && scale.distr === 3 ? { splits: decades, values: power, filter: (u, ticks) => ticks } : { values: (u, ticks) => ticks.map((v) => +v.toPrecision(5)) }) });
    if (scales.x.distr === 3) scales = { ...scales, x: { ...scales.x, range: [data[0][0], data[0][data[0].length - 1]] } };
    const inner = box.appendChild(element("div", undefined, { className: "plot" }));
    const size = () => Math.max(220, inner.clientWidth);
    const drawn = new uPlot({ title, width: size(), height: (options && options.height) || 215, plugins: (options && options.plugins) || [], scales, series, axes: [look(scales.x, labels[0], 34, 20), look(scales.y, labels[1], 62, 20)], legend: { show: false }, cursor: { drag: { x: true, y: true, uni: 20 } } }, data, inner);
    new ResizeObserver(() => { if (Math.abs(size() - drawn.width) > 1) drawn.setSize({ width: size(), height: drawn.height }); }).observe(inner);
  }
  function key(box, entries) {
    const line = box.appendChild(element("p", undefined, { className: "note" }));
    for (const [colour, text] of entries) line.append(element("span", "■ ", { style: `color:${colour}` }), element("span", `${text}   `));
  }
  function spectra(box, found) {
    const logarithmic = { x: { time: false, distr: 3 }, y: { distr: 3 } }, unity = { x: { time: false, distr: 3 }, y: { range: [0, 1] } };
    key(box, [["#000000", "measured"], ["#0072B2", "model"], ["#D55E00", "residual"], ["#009E73", "coherence"]]);
    for (const s of found) {
      const row = box.appendChild(element("div", undefined, { className: "grid" }));
      plot(row, s.output, [{}, { stroke: "#000000" }, { stroke: "#0072B2" }, { stroke: "#D55E00" }], [s.frequency, s.measured, s.model, s.residual], logarithmic, ["frequency [Hz]", `amplitude [${s.unit}/√Hz]`]);
      plot(row, "coherence of measurement and model", [{}, { stroke: "#009E73" }], [s.frequency, s.coherence], unity, ["frequency [Hz]", "coherence"]);
      for (const r of s.responses) {
        plot(row, `response to ${r.input}`, [{}, { stroke: "#000000" }, { stroke: "#0072B2" }], [s.frequency, r.measured, r.model], logarithmic, ["frequency [Hz]", r.unit]);
        plot(row, `coherence with ${r.input}`, [{}, { stroke: "#009E73" }], [s.frequency, r.coherence], unity, ["frequency [Hz]", "coherence"]);
      }
    }
    box.append(element("p", "A response is to be trusted where the coherence with its input is near one.", { className: "note" }));
  }
  const DIRECTIONS = [[1, "#0072B2", "forwards"], [-1, "#D55E00", "backwards"], [0, "#8b96a1", "at rest"]];
  const dots = (colour) => ({ stroke: colour, paths: () => null, points: { show: true, size: 3, fill: colour, width: 0 } });
  function motion(box, found) {
    key(box, DIRECTIONS.map(([, colour, word]) => [colour, word]));
    const row = box.appendChild(element("div", undefined, { className: "grid" }));
    for (const c of found.clouds) {
      const lines = Object.entries(c.means).map(([sign, m]) => [DIRECTIONS.find(([s]) => String(s) === sign)[1], m]);
      const parts = DIRECTIONS.map(([sign]) => c.x.map((x, k) => [x, c.direction[k] === sign ? c.y[k] : null]));
      scatter(row, `over ${c.over} of ${c.place}`, parts.map((p, k) => ({ ...dots(DIRECTIONS[k][1]), points_: p })), lines.map(([colour, m]) => ({ stroke: colour, width: 2.2, points_: m.x.map((x, k) => [x, m.y[k]]) })), [`${c.over} [${c.unit}]`, `residual [${found.unit}]`]);
    }
    const heads = [["connection"], ["when"], ["share of the time", 1], ["RMS residual", 1]];
    grid(box, heads, found.regimes.map((r) => [r.place, r.regime, `${(100 * r.share).toFixed(0)} %`, `${digits(r.rms)} ${found.unit}`]));
  }
  /* Series of unlike abscissae in one plot: they are put on the union of all. */
  function scatter(box, title, dotted, lined, labels, options) {
    const all = [...dotted, ...lined], x = [...new Set(all.flatMap((s) => s.points_.map((p) => p[0])))].sort((a, b) => a - b);
    const place = new Map(x.map((v, k) => [v, k]));
    const data = all.map((s) => { const y = new Array(x.length).fill(null); for (const [a, b] of s.points_) if (b !== null) y[place.get(a)] = b; return y; });
    plot(box, title, [{}, ...all.map(({ points_, ...s }) => ({ spanGaps: true, ...s, points: s.points || { show: false } }))], [x, ...data], { x: { time: false }, ...(options && options.logarithmic ? { y: { distr: 3 } } : {}) }, labels, options);
  }
  function grid(box, heads, rows) {
    const scroll = box.appendChild(element("div", undefined, { className: "scroll" })), drawn = scroll.appendChild(element("table"));
    const head = drawn.createTHead().insertRow(), body = drawn.createTBody();
    for (const [t, n] of heads) head.append(element("th", t, { className: n ? "n" : "" }));
    for (const r of rows) {
      const line = body.insertRow();
      r.forEach((t, k) => line.append(element("td", t, { className: heads[k][1] ? "n" : "" })));
    }
    vtsdtTables.fit(scroll);
    return drawn;
  }
  function table(box, rows) {
    const other = rows.some((r) => r.before !== null);
    const heads = [["record"], ["output"], ...(other ? [["RMS error, compared", 1]] : []), ["RMS error, latest", 1], ["of the signal", 1], ["of the noise", 1]];
    grid(box, heads, rows.map((r) => [`${r.record} (${r.part === "identify" ? "fitted" : "held out"})`, r.output, ...(other ? [r.before === null ? "–" : `${digits(r.before)} ${r.unit}`] : []), `${digits(r.rmse)} ${r.unit}`, `${digits(100 * r.nrmse)} %`, r.over_noise === null ? "–" : `${digits(r.over_noise)} ×`]));
  }
  function where(box, found) {
    for (const { heading, sentences } of found) {
      box.append(element("h3", heading));
      const list = box.appendChild(element("ul"));
      for (const s of sentences) list.append(element("li", s));
    }
  }
  return { show, time, plot, scatter, dots, grid, key };
})();
