/* The error of every output from stage to stage, and the stages. */
wb.showStages = function () {
  "use strict";
  const { state, element, svg, digits, $ } = wb;
  const width = 240, height = 54, floor = 46, top = 8;
  const LINES = [["identify", "#0072B2", "", "fitted"], ["validate", "#D55E00", "4 3", "held out"]];
  $("errors").replaceChildren(...state.outputs.map(card));
  $("stages").replaceChildren(...state.stages.map((s) => element("li", s.title)));

  function card({ name, unit, noise }) {
    const box = element("div", undefined, { className: "panel" });
    const part = state.stages[0].rmse.validate[name] === undefined ? "identify" : "validate";
    const errors = state.stages.map((s) => s.rmse[part][name]), now = errors[errors.length - 1];
    box.append(element("h3", name, { title: `root mean square error of ${name}, ${part === "identify" ? "fitted" : "held-out"} records` }));
    box.append(element("span", `${digits(now)} ${unit}`, { className: "now" }));
    if (errors.length > 1) {
      const share = (100 * (now - errors[0])) / errors[0];
      const text = Math.abs(share) < 0.5 ? "unchanged" : `${share < 0 ? "−" : "+"}${Math.abs(share).toFixed(0)} % since as given`;
      box.append(element("span", text, { className: `change ${share < -0.5 ? "better" : share > 0.5 ? "worse" : ""}` }));
    }
    box.append(picture(name, noise));
    const key = box.appendChild(element("div", undefined, { className: "key" }));
    for (const [word, style] of [["fitted", "in"], ["held out", "out"], ...(noise ? [[`noise ${digits(noise)}`, "noise"]] : [])]) {
      const one = key.appendChild(element("span", undefined, { className: style }));
      one.append(element("i"), word);
    }
    return box;
  }
  function picture(name, noise) {
    const n = state.stages.length, drawing = svg("svg", { viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", role: "img" });
    drawing.setAttribute("aria-label", `error of ${name} over the stages`);
    const most = Math.max(...LINES.flatMap(([p]) => state.stages.map((s) => s.rmse[p][name] || 0)), noise || 0, 1e-300);
    const x = (k) => 6 + (n > 1 ? (k * (width - 12)) / (n - 1) : 0), y = (v) => top + (floor - top) * (1 - v / most);
    if (noise) drawing.append(svg("rect", { x: 0, y: y(noise), width, height: floor - y(noise), fill: "#e8ebee" }));
    drawing.append(svg("line", { x1: 0, x2: width, y1: floor, y2: floor, stroke: "#c3cad2", "stroke-width": 1 }));
    for (const [part, colour, dash, word] of LINES) {
      const values = state.stages.map((s) => s.rmse[part][name]);
      if (values[0] === undefined) continue;
      drawing.append(svg("polyline", { points: values.map((v, k) => `${x(k)},${y(v)}`).join(" "), fill: "none", stroke: colour, "stroke-width": 2, "stroke-dasharray": dash, "vector-effect": "non-scaling-stroke" }));
      values.forEach((v, k) => {
        const dot = svg("line", { x1: x(k), x2: x(k), y1: y(v), y2: y(v), stroke: colour, "stroke-width": 7, "stroke-linecap": "round", "vector-effect": "non-scaling-stroke" });
        dot.append(svg("title", {}, `${state.stages[k].title}: ${digits(v)} ${word}`));
        drawing.append(dot);
      });
    }
    return drawing;
  }
};
