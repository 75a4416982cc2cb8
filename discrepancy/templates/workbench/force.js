/* The missing force at a place: over what it depends on, with its curve and the simple laws near it. */
wb.showForce = function (box, found) {
  "use strict";
  const { element, select, digits, chosen } = wb, { scatter, dots, grid, key } = wb.views;
  if (!found.places.includes(chosen.place)) chosen.place = likely() || found.places[0] || "";
  const row = box.appendChild(element("div", undefined, { className: "row" }));
  if (!found.places.length) { box.append(element("p", "The model has no connection at which a force could be missing.", { className: "empty" })); return; }
  row.append(select("place", found.places.map((p) => [p, p]), chosen.place, (v) => { chosen.place = v; wb.views.show().catch(wb.complain); }));
  if (!found.known || found.where !== chosen.place) {
    row.append(element("button", "Estimate the missing force here", { className: "main estimate", disabled: wb.isBusy(), onclick: () => wb.act("force", { where: chosen.place }) }));
    box.append(element("p", "No law is assumed: the force over time that would explain all of the residual is estimated, and then drawn over whatever it may depend on. It takes some seconds.", { className: "empty" }));
    return;
  }
  box.append(element("p", found.sentence));
  if (found.over.length) draw();
  keep();

  function draw() {
    key(box, [["#8b96a1", "estimated force"], ["#0072B2", "curve, ± 2 standard deviations"], ["#D55E00", "simple law nearest to it"]]);
    const figures = box.appendChild(element("div", undefined, { className: "grid" }));
    for (const o of found.over.slice(0, 6)) {
      const { x, y, std } = o.curve, line = (f, style) => ({ stroke: "#0072B2", width: 2, ...style, points_: x.map((v, k) => [v, f(y[k], std[k] || 0)]) });
      const laws = o.laws.slice(0, 1).map((l) => ({ stroke: "#D55E00", width: 2, dash: [6, 3], points_: l.x.map((v, k) => [v, l.y[k]]) }));
      const turned = o.parity === "odd" ? " × direction" : "";
      scatter(figures, `over ${o.regressor}${turned && ", turning with the direction"}: explains ${(100 * o.explained).toFixed(0)} %`, [{ ...dots("#aab3bc"), points_: o.x.map((v, k) => [v, o.y[k]]) }], [line((m) => m), line((m, s) => m + 2 * s, { width: 1, dash: [2, 2] }), line((m, s) => m - 2 * s, { width: 1, dash: [2, 2] }), ...laws], [`${o.regressor} [${o.unit || "1"}]`, `force${turned} [${found.unit}]`]);
    }
    const laws = found.over[0].laws;
    if (laws.length) {
      box.append(element("h3", `Simple laws over ${found.over[0].regressor}`));
      grid(box, [["law"], ["x is the regressor"], ["error on blocks left out, of the curve's", 1]], laws.map((l) => [l.name, `${l.formula}, ${Object.entries(l.parameters).map(([n, v]) => `${n} = ${digits(v)}`).join(", ")}`, `${digits(l.error)} ×`]));
    }
  }
  function keep() {
    box.append(element("h3", "Put it into the model"));
    const row = box.appendChild(element("div", undefined, { className: "row" }));
    for (const over of ["position", "speed", "friction", "time"]) {
      const words = over === "friction" ? "a friction level over position" : `a curve over ${over}`;
      row.append(element("button", `Keep it as ${words}`, { className: "add", disabled: wb.isBusy(), onclick: () => wb.act("add_curve", { where: chosen.place, over }) }));
    }
    const tries = wb.candidates.at(chosen.place).slice(0, 6);
    if (tries.length) {
      box.append(element("p", "or try a law of the catalogue at this place; those that the scores favour first:", { className: "note" }));
      const list = box.appendChild(element("div", undefined, { className: "row" }));
      for (const c of tries) list.append(element("button", c.title, { title: c.what, onclick: () => wb.candidates.choose(c.name) }));
    }
  }
  function likely() {
    const best = wb.candidates.first();
    return best && found.places.find((p) => best.where === p);
  }
};
