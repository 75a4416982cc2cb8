/* Values of parameters by slider or number: the latest model is simulated with them, one simulation at a time. */
wb.sliders = (function () {
  "use strict";
  const { element, digits, $ } = wb;
  let running = false, waiting = false;

  function show() {
    const box = $("sliders"), { parameters } = wb.state;
    wb.chosen.values = null;
    box.replaceChildren(...parameters.map(parameter));
    if (!parameters.length) { box.append(element("p", "The study names no uncertain parameter.", { className: "empty" })); return; }
    box.append(element("button", "Back to the fitted values", { onclick: () => { show(); simulate(); } }));
  }
  function parameter(p) {
    const box = element("div", undefined, { className: "parameter" });
    const slider = element("input", undefined, { type: "range", min: 0, max: 1000 }), number = element("input", undefined, { type: "number", step: "any", value: digits(p.value) });
    slider.setAttribute("aria-label", p.name);
    number.setAttribute("aria-label", `${p.name}, number`);
    const place = (v) => { slider.value = (1000 * (v - p.low)) / (p.high - p.low || 1); };
    const set = (v) => { wb.chosen.values = { ...(wb.chosen.values || {}), [p.name]: v }; simulate(); };
    place(p.value);
    slider.oninput = () => { const v = p.low + ((p.high - p.low) * slider.value) / 1000; number.value = digits(v); set(v); };
    number.onchange = () => { const v = Number(number.value); if (number.value !== "" && Number.isFinite(v)) { place(v); set(v); } };
    box.append(element("span", p.name), number, element("span", p.unit, { className: "unit" }), slider, prior(p));
    return box;
  }
  /* What was known of a parameter beforehand; another value or deviation fits every stage again. */
  function prior(p) {
    const line = element("details"), row = element("div", undefined, { className: "prior" });
    const { value, std } = p.prior, known = std === null ? `${digits(value)}, free` : `${digits(value)} ± ${digits(std)}`;
    const boxes = [value, std].map((v) => element("input", undefined, { type: "number", step: "any", value: v === null ? "" : String(+v.toPrecision(6)) }));
    boxes[0].setAttribute("aria-label", `stated value of ${p.name}`);
    boxes[1].setAttribute("aria-label", `standard deviation of ${p.name}`);
    const numbers = () => boxes.map((b) => (b.value === "" ? null : Number(b.value)));
    const fit = element("button", "Fit again", { className: "refit", disabled: wb.isBusy(), onclick: () => { const [v, s] = numbers(); wb.act("set_prior", { name: p.name, value: v, std: s }); } });
    row.append(boxes[0], "±", boxes[1], p.unit, fit);
    line.append(element("summary", `fitted ${digits(p.value)} ± ${digits(p.std)}; stated ${known}`), row);
    line.className = "known";
    return line;
  }
  async function simulate() {
    // Only the latest position of a slider counts.
    waiting = true;
    if (running) return;
    running = true;
    try {
      while (waiting) { waiting = false; await wb.views.time(); }
    } catch (error) { wb.complain(error); } finally { running = false; }
  }
  return { show };
})();
