/* The workbench: shows what the server says of the study, and sends what is clicked.  Nothing is computed here. */
(function () {
  "use strict";
  const token = new URLSearchParams(location.search).get("token") || "";
  const $ = (id) => document.getElementById(id);
  const VIEWS = { time: "Over time", spectra: "Over frequency", motion: "Over speed and position", table: "By record", where: "Where it fails" };
  let state = null, drawing = null, candidates = null, machine = null, stageCount = -1;
  const chosen = { view: "time", record: "", against: 1, candidate: "", output: "", values: null, span: null };
  window.vtsdtWorkbench = { times: {} }; // what a test measures

  async function ask(path, given) {
    const query = new URLSearchParams({ token, ...(given || {}) });
    return answer(await fetch(`/${path}?${query}`));
  }
  async function send(path, given) {
    const body = JSON.stringify(given || {});
    return answer(await fetch(`/${path}?token=${encodeURIComponent(token)}`, { method: "POST", body }));
  }
  async function answer(response) {
    const found = await response.json();
    if (!response.ok) throw new Error(found.error || response.statusText);
    return found;
  }
  function element(tag, text, options) {
    const e = document.createElement(tag);
    if (text !== undefined) e.textContent = text;
    return Object.assign(e, options || {});
  }
  function complain(error) {
    $("doing").replaceChildren(element("span", error.message, { className: "error" }));
  }
  const digits = (v) => (v === null || v === undefined ? "–" : Math.abs(v) >= 1e-3 && Math.abs(v) < 1e5 || v === 0 ? String(+Number(v).toPrecision(3)) : Number(v).toExponential(2));

  // ------------------------------------------------------------------ news
  async function listen() {
    let since = -1;
    for (;;) {
      try {
        const news = await ask("state", { since });
        $("gone").style.display = "none";
        since = news.version;
        await take(news);
      } catch (error) {
        if (error instanceof TypeError) $("gone").style.display = "block";
        else complain(error);
        await new Promise((done) => setTimeout(done, 1500));
      }
    }
  }
  async function take(news) {
    const before = state;
    state = news;
    $("name").textContent = news.name;
    document.title = `${news.name}: vtsdt workbench`;
    $("verdict").textContent = news.conclusion.sentence || "";
    showDoing();
    const mark = JSON.stringify([news.stages, news.left_out]);
    if (news.stages.length && !news.doing && mark !== stageCount) {
      const first = stageCount === -1;
      stageCount = mark;
      candidates = null;
      chosen.candidate = "";
      chosen.values = null;
      $("candidates").replaceChildren();
      showStages();
      showSliders();
      showSteps();
      await show();
      if (first || !machine) machine = await ask("machine");
      showMachine("");
    } else if (news.stages.length && (!before || before.stages.length !== news.stages.length)) showStages();
    const busy = !!news.doing;
    for (const b of document.querySelectorAll("button[data-export], #score, #search, #conclude, .add, .leave")) b.disabled = busy;
    $("undo").disabled = busy || !news.can_undo;
    $("redo").disabled = busy || !news.can_redo;
  }
  function showDoing() {
    const { doing, error } = state, box = $("doing");
    if (!doing) {
      box.replaceChildren(...(error ? [element("span", error, { className: "error" })] : []));
      return;
    }
    const bar = element("progress");
    if (doing.share !== null && doing.share !== undefined) bar.value = doing.share;
    const stop = element("button", "Stop", { onclick: () => send("stop").catch(complain) });
    box.replaceChildren(bar, element("strong", doing.what), element("span", doing.text), stop);
  }

  // ------------------------------------------------------------------ stages
  function svg(tag, attributes, text) {
    const e = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [k, v] of Object.entries(attributes || {})) e.setAttribute(k, v);
    if (text !== undefined) e.textContent = text;
    return e;
  }
  function showStages() {
    const box = $("stages"), width = 360, height = 90, left = 4, n = state.stages.length;
    box.replaceChildren();
    for (const { name, unit } of state.outputs) {
      const parts = [["identify", "#0072B2", ""], ["validate", "#D55E00", "5 3"]];
      const picture = svg("svg", { viewBox: `0 0 ${width} ${height + 18}`, role: "img" });
      picture.appendChild(svg("text", { x: left, y: 12 }, `${name} [${unit || "1"}]: fitted ―, held out ┄`));
      const most = Math.max(...parts.flatMap(([p]) => state.stages.map((s) => s.rmse[p][name] || 0)), 1e-300);
      const x = (k) => left + 22 + (n > 1 ? (k * (width - 80)) / (n - 1) : 0);
      const y = (v) => 34 + (height - 50) * (1 - v / most);
      for (const [part, colour, dash] of parts) {
        const values = state.stages.map((s) => s.rmse[part][name]);
        if (values[0] === undefined) continue;
        picture.appendChild(svg("polyline", { points: values.map((v, k) => `${x(k)},${y(v)}`).join(" "), fill: "none", stroke: colour, "stroke-width": 2, "stroke-dasharray": dash }));
        values.forEach((v, k) => {
          picture.appendChild(svg("circle", { cx: x(k), cy: y(v), r: 3, fill: colour }));
          if (part === "validate" || state.stages[0].rmse.validate[name] === undefined) picture.appendChild(svg("text", { x: x(k) + 5, y: y(v) - 5 }, digits(v)));
        });
      }
      state.stages.forEach((s, k) => picture.appendChild(svg("text", { x: Math.max(0, x(k) - 18), y: height + 4 + (k % 2) * 12 }, k < 2 ? s.name : `+ effect ${k - 1}`)));
      box.appendChild(picture);
    }
    const list = element("ol");
    for (const s of state.stages.slice(2)) list.appendChild(element("li", s.title));
    box.appendChild(list);
  }
  function showSteps() {
    const words = (s) => [s.action, s.effect, s.record].filter(Boolean).join(" ") + (s.start != null || s.stop != null ? ` ${digits(s.start)} s to ${digits(s.stop)} s` : "");
    $("steps").replaceChildren(...state.steps.map((s) => element("li", words(s))));
  }

  // ------------------------------------------------------------------ views
  async function show() {
    $("tabs").replaceChildren(...Object.entries(VIEWS).map(([key, text]) => element("button", text, {
      className: key === chosen.view ? "on" : "",
      onclick: () => { chosen.view = key; drawing = null; show().catch(complain); },
    })));
    choices();
    const view = $("view");
    if (chosen.view === "time") return showTime();
    drawing = null;
    view.replaceChildren();
    if (chosen.view === "spectra") return showSpectra(view, await ask("spectra", { record: chosen.record }));
    if (chosen.view === "motion") return showMotion(view, await ask("motion", { output: chosen.output || state.outputs[0].name }));
    if (chosen.view === "table") return showTable(view, await ask("table"));
    for (const { heading, sentences } of await ask("where")) {
      view.appendChild(element("h2", heading));
      const list = view.appendChild(element("ul"));
      for (const s of sentences) list.appendChild(element("li", s));
    }
  }
  function select(label, options, value, change) {
    const box = element("select", undefined, { title: label });
    box.setAttribute("aria-label", label);
    for (const [key, text] of options) box.appendChild(element("option", text, { value: key }));
    box.value = value;
    box.onchange = () => change(box.value);
    return box;
  }
  function choices() {
    const records = state.records.map((r) => [r.name, `${r.name} (${r.part === "identify" ? "fitted" : "held out"})`]);
    if (!records.some(([name]) => name === chosen.record)) { chosen.record = records[0][0]; chosen.span = null; }
    const row = $("choice");
    row.replaceChildren();
    if (["time", "spectra"].includes(chosen.view)) row.appendChild(select("record", records, chosen.record, (v) => { chosen.record = v; chosen.span = null; drawing = null; show().catch(complain); }));
    if (chosen.view === "motion") row.appendChild(select("output", state.outputs.map((o) => [o.name, o.name]), chosen.output || state.outputs[0].name, (v) => { chosen.output = v; show().catch(complain); }));
    if (chosen.view !== "time") return;
    const stages = [...state.stages.map((s, k) => [String(k), `compare with: ${s.title}`]), ...state.kept.map((s, k) => [String(state.stages.length + k), `compare with other branch: ${s.name}`])];
    row.appendChild(select("compare with", stages, String(chosen.against), (v) => { chosen.against = Number(v); showTime().catch(complain); }));
    row.appendChild(element("button", "Leave the visible stretch out", { className: "leave", onclick: () => {
      const [start, stop] = chosen.span || drawing.whole;
      act("leave_out", { record: chosen.record, start, stop });
    } }));
  }
  async function showTime() {
    const begun = performance.now();
    const [start, stop] = chosen.span || [null, null];
    const given = { record: chosen.record, start, stop, against: chosen.against, predict: chosen.candidate, values: chosen.values };
    const figures = await send("figures", given);
    if (chosen.view !== "time" || !figures.length) return;
    if (drawing) drawing.update(figures);
    else {
      drawing = vtsdtZoom.draw($("view"), figures, { onZoom: zoomed, onMark: (figure, mark) => { drawing.show(mark[0], mark[1], true); } });
      drawing.whole = figures[0].whole;
    }
    const times = window.vtsdtWorkbench.times;
    times.last = performance.now() - begun;
    if (times.first === undefined) times.first = performance.now();
  }
  let later = 0;
  function zoomed(from, to) {
    chosen.span = [from, to];
    clearTimeout(later);
    later = setTimeout(() => showTime().catch(complain), 60);
  }
  function plot(box, title, series, data, scales, labels) {
    const inner = box.appendChild(element("div", undefined, { className: "plot" }));
    new uPlot({ title, width: Math.max(260, inner.clientWidth), height: 230, scales, series,
      axes: [{ label: labels[0], size: 36, labelSize: 20 }, { label: labels[1], size: 76, labelSize: 22 }], legend: { show: series.length > 2 } }, data, inner);
  }
  function showSpectra(view, spectra) {
    for (const s of spectra) {
      const series = [{ label: "frequency" }, { label: "measured", stroke: "#000" }, { label: "model", stroke: "#0072B2" }, { label: "residual", stroke: "#D55E00" }];
      plot(view, `${s.output} on '${s.record}'`, series, [s.frequency, s.measured, s.model, s.residual], { x: { time: false, distr: 3 }, y: { distr: 3 } }, ["frequency [Hz]", `amplitude [${s.unit || "1"}/√Hz]`]);
      plot(view, "", [{ label: "frequency" }, { label: "coherence", stroke: "#009E73" }], [s.frequency, s.coherence], { x: { time: false, distr: 3 }, y: { range: [0, 1] } }, ["frequency [Hz]", "coherence"]);
    }
  }
  function showMotion(view, clouds) {
    for (const c of clouds) {
      const order = c.x.map((_, k) => k).sort((a, b) => c.x[a] - c.x[b]);
      const series = [{ label: c.over }, { label: "residual", stroke: "#D55E00", paths: () => null, points: { show: true, size: 3, fill: "#D55E00" } }];
      plot(view, `residual over ${c.over} of ${c.place}`, series, [order.map((k) => c.x[k]), order.map((k) => c.y[k])], { x: { time: false } }, [c.over, "residual"]);
    }
  }
  function showTable(view, rows) {
    const box = view.appendChild(element("div", undefined, { className: "scroll" })), table = box.appendChild(element("table"));
    const head = table.createTHead().insertRow();
    for (const t of ["record", "output", "RMS error", "of the signal", "of the noise"]) head.appendChild(element("th", t));
    for (const r of rows) {
      const line = table.insertRow();
      for (const t of [`${r.record} (${r.part === "identify" ? "fitted" : "held out"})`, r.output, `${digits(r.rmse)} ${r.unit}`, `${digits(100 * r.nrmse)} %`, r.over_noise === null ? "" : `${digits(r.over_noise)} ×`]) line.insertCell().textContent = t;
    }
  }

  // ------------------------------------------------------------------ candidates
  async function showCandidates() {
    candidates = candidates || await ask("candidates");
    const box = $("candidates");
    box.replaceChildren(element("p", "Weights compare single effects by linear scores; a diagnosis refits before it says how sure it is.", { className: "note" }));
    for (const c of candidates.rows) {
      const card = element("div", undefined, { className: "candidate" + (c.name === chosen.candidate ? " chosen" : ""), title: c.what });
      card.dataset.name = c.name;
      card.tabIndex = 0;
      card.append(element("span", `${(100 * c.weight).toFixed(c.weight > 0.1 ? 0 : 1)} %`, { className: "weight" }), element("strong", `${c.title} at ${c.where}`));
      card.append(element("div", "predicted fall of the error: " + Object.entries(c.falls).map(([n, v]) => `${n} ${v.toFixed(0)} %`).join(", "), { className: "falls" }));
      const more = element("div", undefined, { className: "more" });
      more.append(element("p", c.what), element("p", `Usual causes: ${c.causes}`), element("p", `How to confirm it: ${c.confirm}`));
      if (c.tied.length) more.append(element("p", `These records cannot tell it apart from: ${c.tied.join(", ")}`));
      more.append(element("button", "Add it and fit again", { className: "add main", onclick: (e) => { e.stopPropagation(); act("add", { effect: c.name }); } }));
      card.append(more);
      card.onclick = () => choose(c.name === chosen.candidate ? "" : c.name);
      card.onkeydown = (e) => { if (e.key === "Enter" && e.target === card) card.onclick(); };
      box.appendChild(card);
    }
  }
  async function choose(name) {
    chosen.candidate = name;
    for (const card of $("candidates").querySelectorAll(".candidate")) card.classList.toggle("chosen", card.dataset.name === name);
    showMachine(name.split("@")[1] || "");
    if (chosen.view !== "time") { chosen.view = "time"; drawing = null; await show(); } else await showTime();
  }

  // ------------------------------------------------------------------ the machine
  function showMachine(lit) {
    if (!machine) return;
    const names = ["ground", ...machine.nodes.map((n) => n.name).filter((n) => n !== "ground")];
    const layer = Object.fromEntries(names.map((n) => [n, null]));
    let front = ["ground"], depth = 0;
    layer.ground = 0;
    while (front.length) {
      depth += 1;
      const next = [];
      for (const [a, b] of machine.edges) for (const [from, to] of [[a, b], [b, a]]) if (front.includes(from) && layer[to] === null) { layer[to] = depth; next.push(to); }
      front = [...new Set(next)];
    }
    const loose = names.filter((n) => layer[n] === null);
    loose.forEach((n) => { layer[n] = depth; });
    const rows = [];
    for (const n of names) (rows[layer[n]] = rows[layer[n]] || []).push(n);
    const used = rows.filter(Boolean), most = Math.max(...used.map((r) => r.length)), width = Math.max(360, most * 110), at = {};
    const picture = svg("svg", { viewBox: `0 0 ${width} ${used.length * 52 + 8}`, role: "img", "aria-label": "components and connections of the model" });
    used.forEach((row, k) => row.forEach((n, i) => { at[n] = [((i + 0.5) * width) / row.length, k * 52 + 22]; }));
    for (const [a, b] of machine.edges) if (at[a] && at[b]) picture.appendChild(svg("line", { x1: at[a][0], y1: at[a][1], x2: at[b][0], y2: at[b][1], stroke: "#9aa4ae" }));
    const place = lit.split(".")[0];
    for (const n of names) {
      const here = n === lit || n === place;
      picture.appendChild(svg("rect", { x: at[n][0] - 50, y: at[n][1] - 12, width: 100, height: 24, rx: 4, fill: here ? "#f0e442" : "#f4f6f8", stroke: here ? "#a8470a" : "#57606a" }));
      picture.appendChild(svg("text", { x: at[n][0], y: at[n][1] + 4, "text-anchor": "middle" }, n.length > 16 ? n.slice(0, 15) + "…" : n));
    }
    $("machine").replaceChildren(picture);
  }

  // ------------------------------------------------------------------ what if
  function showSliders() {
    const box = $("sliders");
    box.replaceChildren();
    for (const p of state.parameters.slice(0, 12)) {
      const label = element("label", `${p.name}: ${digits(p.value)} ${p.unit}`), slider = element("input", undefined, { type: "range", min: 0, max: 1000 });
      slider.value = (1000 * (p.value - p.low)) / (p.high - p.low || 1);
      slider.setAttribute("aria-label", p.name);
      slider.oninput = () => {
        const value = p.low + ((p.high - p.low) * slider.value) / 1000;
        label.textContent = `${p.name}: ${digits(value)} ${p.unit}`;
        chosen.values = { ...(chosen.values || {}), [p.name]: value };
        latest();
      };
      box.append(label, slider);
    }
    if (state.parameters.length) box.appendChild(element("button", "Back to the fitted values", { onclick: () => { chosen.values = null; showSliders(); showTime().catch(complain); } }));
  }
  let running = false, waiting = false;
  async function latest() {
    // One simulation at a time; only the latest position of a slider counts.
    waiting = true;
    if (running) return;
    running = true;
    try {
      while (waiting) { waiting = false; await showTime(); }
    } catch (error) { complain(error); } finally { running = false; }
  }

  // ------------------------------------------------------------------ steps
  async function act(action, given) {
    try { await send("do", { action, ...(given || {}) }); } catch (error) { complain(error); }
  }
  $("undo").onclick = () => act("undo");
  $("redo").onclick = () => act("redo");
  $("search").onclick = () => act("search");
  $("conclude").onclick = () => act("conclude");
  $("score").onclick = async () => {
    await act("score");
    const wait = setInterval(() => {
      if (state.doing) return;
      clearInterval(wait);
      if (!state.error) showCandidates().catch(complain);
    }, 60);
  };
  for (const button of document.querySelectorAll("button[data-export]")) button.onclick = async () => {
    $("written").textContent = "writing …";
    try { $("written").textContent = `written: ${(await send("export", { what: button.dataset.export })).written.join(", ")}`; } catch (error) { $("written").textContent = error.message; }
  };
  listen();
})();
