/* Two branches of the history side by side: their stages, the error of every output, and the curves of both. */
wb.showBranches = function (box, found) {
  "use strict";
  const { titles, shown } = found, { element, svg, select, digits, chosen } = wb, { grid } = wb.views;
  const LOOK = [["A", "#0072B2", ""], ["B", "#D55E00", "6 3"]], PARTS = [["identify", "fitted"], ["validate", "held out"]];
  const last = (branch) => branch.stages[branch.stages.length - 1], error = (branch, part, name) => last(branch).rmse[part][name];
  const named = (k) => `${k ? `branch ${k}: ` : ""}${titles[k]}`;

  const columns = box.appendChild(element("div", undefined, { className: "branches" }));
  shown.forEach((branch, side) => {
    const column = columns.appendChild(element("div", undefined, { className: "branch", style: `border-top-color:${LOOK[side][1]}` }));
    column.append(element("h3", LOOK[side][0]), select(`branch ${LOOK[side][0]}`, titles.map((t, k) => [String(k), named(k)]), String(branch.number), (v) => { chosen.ends[side] = Number(v); chosen.branchSpan = null; wb.views.show().catch(wb.complain); }));
    const list = column.appendChild(element("ol"));
    for (const s of branch.stages) list.append(element("li", s.title));
    if (branch.differs) column.append(element("p", `Fitted ${branch.differs}.`, { className: "note" }));
    if (branch.number > 0) column.append(element("button", "Go on from this branch", { className: "switch", disabled: wb.isBusy(), title: "Nothing is computed; Undo comes back", onclick: () => { chosen.ends = [0, 1]; wb.act("switch", { branch: branch.number - 1 }); } }));
  });
  const outputs = shown[0].outputs.filter((n) => shown[1].outputs.includes(n)), unit = (n) => (wb.state.outputs.find((o) => o.name === n) || {}).unit || "";
  const rows = outputs.flatMap((n) => PARTS.filter(([p]) => shown.some((b) => error(b, p, n) !== undefined)).map(([p, word]) => {
    const [a, b] = shown.map((s) => error(s, p, n)), share = a > 0 && b !== undefined ? (100 * (b - a)) / a : null;
    return [n, word, `${digits(a)} ${unit(n)}`, `${digits(b)} ${unit(n)}`, share === null ? "–" : Math.abs(share) < 0.05 ? "0 %" : `${share < 0 ? "−" : "+"}${Math.abs(share).toFixed(Math.abs(share) < 10 ? 1 : 0)} %`];
  }));
  const table = grid(box, [["output"], ["records"], ["RMS error, A", 1], ["RMS error, B", 1], ["B against A", 1]], rows);
  table.className = "errors";
  const falls = box.appendChild(element("div", undefined, { className: "grid" }));
  for (const n of outputs) falls.append(fall(n));
  curves();

  /* The error over the stages of both branches. */
  function fall(name) {
    const width = 300, top = 8, floor = 62, panel = element("div", undefined, { className: "fall" });
    panel.append(element("h3", `${name}, over the stages`));
    const drawing = svg("svg", { viewBox: `0 0 ${width} 70`, preserveAspectRatio: "none", role: "img", "aria-label": `error of ${name} over the stages of both branches` });
    const part = shown.every((b) => error(b, "validate", name) !== undefined) ? "validate" : "identify", values = shown.map((b) => b.stages.map((s) => s.rmse[part][name]));
    const most = Math.max(...values.flat(), 1e-300), count = Math.max(...values.map((v) => v.length), 2);
    const x = (k) => 6 + (k * (width - 12)) / (count - 1), y = (v) => top + (floor - top) * (1 - v / most);
    drawing.append(svg("line", { x1: 0, x2: width, y1: floor, y2: floor, stroke: "#c3cad2" }));
    values.forEach((line, side) => {
      const [word, stroke, dash] = LOOK[side];
      drawing.append(svg("polyline", { points: line.map((v, k) => `${x(k)},${y(v)}`).join(" "), fill: "none", stroke, "stroke-width": 2, "stroke-dasharray": dash, "vector-effect": "non-scaling-stroke" }));
      line.forEach((v, k) => {
        const dot = svg("line", { x1: x(k), x2: x(k), y1: y(v), y2: y(v), stroke, "stroke-width": 7, "stroke-linecap": "round", "vector-effect": "non-scaling-stroke" });
        dot.append(svg("title", {}, `${word}, ${shown[side].stages[k].title}: ${digits(v)} ${unit(name)}`));
        drawing.append(dot);
      });
    });
    panel.append(drawing, element("p", `${part === "validate" ? "held-out" : "fitted"} records, up to ${digits(most)} ${unit(name)}`, { className: "note" }));
    return panel;
  }
  function curves() {
    const [a, b] = shown.map((s) => s.records), records = a;
    if (!records.includes(chosen.record)) chosen.record = records[0];
    const row = box.appendChild(element("div", undefined, { className: "row" }));
    row.append(select("record", records.map((n) => [n, n]), chosen.record, (v) => { chosen.record = v; chosen.branchSpan = null; wb.views.show().catch(wb.complain); }));
    if (!b.includes(chosen.record)) row.append(element("span", "B was fitted without this record as a whole: only A is drawn.", { className: "note" }));
    const place = box.appendChild(element("div", undefined, { className: "zoom" }));
    let drawing = null, later = 0;
    const wanted = () => {
      const [start, stop] = chosen.branchSpan || [null, null];
      return { record: chosen.record, start, stop, ends: chosen.ends, columns: Math.ceil(place.clientWidth * devicePixelRatio), outputs: drawing ? drawing.inSight() : undefined };
    };
    async function draw() {
      const found = await wb.send("figures", wanted());
      if (!place.isConnected) return;
      if (drawing) drawing.update(found);
      else {
        drawing = vtsdtZoom.draw(place, found, {
          onZoom: (from, to) => { chosen.branchSpan = [from, to]; clearTimeout(later); later = setTimeout(() => draw().catch(wb.complain), 60); },
          onSight: () => draw().catch(wb.complain), onPrint: () => wb.sendAndWait("figures", { ...wanted(), outputs: undefined }),
          onMark: (figure, mark) => drawing.show(mark[0], mark[1], true),
        });
      }
      document.body.dataset.branches = String(Number(document.body.dataset.branches || 0) + 1);
    }
    draw().catch(wb.complain);
  }
};
