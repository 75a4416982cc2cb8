/* The candidates: weight, predicted fall of the error, what each is, and the button that adds it. */
wb.candidates = (function () {
  "use strict";
  const FEW = 5, NEGLIGIBLE = 1e-3;
  const { element, $ } = wb;
  let found = null, place = "", all = false, drawn = Promise.resolve(); // once the prediction of the chosen one is drawn

  function forget() {
    found = null;
    place = "";
    all = false;
    wb.chosen.candidate = "";
    $("candidates").replaceChildren();
    $("ask").style.display = "";
    wb.machine.shade({});
    wb.machine.light("");
  }
  async function load() {
    found = await wb.ask("candidates");
    const weights = {};
    for (const c of found.rows) weights[c.where] = (weights[c.where] || 0) + c.weight;
    wb.machine.shade(weights);
    show();
  }
  function show() {
    if (!found) return;
    const box = $("candidates"), rows = found.rows.filter((c) => !place || wb.machine.belongs(place, c.where));
    const likely = rows.filter((c) => c.weight >= NEGLIGIBLE).length, shown = all || place ? rows : rows.slice(0, Math.max(FEW, likely));
    $("ask").style.display = "none";
    box.replaceChildren();
    if (place) {
      const row = box.appendChild(element("div", undefined, { className: "row" }));
      row.append(element("span", rows.length ? `Only at ${place}.` : `No candidate at ${place}.`, { className: "note" }), element("button", "Show all places", { onclick: () => onlyAt("") }));
    }
    const tied = shown.length ? shown.filter((c) => c === shown[0] || shown[0].tied.includes(c.name)) : [];
    let rest = shown;
    if (tied.length > 1) {
      const group = box.appendChild(element("div", undefined, { className: "tied" }));
      const apart = element("details");
      apart.append(element("summary", "What would tell them apart"), ...found.tell_apart.map((t) => element("p", t)));
      group.append(element("p", `Each of these ${tied.length} explains the records as well as the others. Their weights count how many values each needs.`), ...(found.tell_apart.length ? [apart] : []), ...tied.map(card));
      rest = shown.filter((c) => !tied.includes(c));
    }
    box.append(...rest.map(card));
    if (shown.length < rows.length) box.append(element("button", `Show ${rows.length - shown.length} that are unlikely`, { onclick: () => { all = true; show(); } }));
    box.append(element("p", `“Nothing is missing” weighs ${percent(found.nothing)}. Weights compare single effects by linear scores and only give an order; a diagnosis refits before it says how sure it is.`, { className: "note" }));
  }
  const percent = (w) => (w > 0.995 && w < 1 ? "> 99 %" : w < 0.001 ? "< 0.1 %" : `${(100 * w).toFixed(w > 0.1 ? 0 : 1)} %`);

  function card(c) {
    const chosen = c.name === wb.chosen.candidate;
    const box = element("div", undefined, { className: `candidate${chosen ? " chosen" : ""}`, tabIndex: 0 });
    box.dataset.name = c.name;
    const head = element("div", undefined, { className: "head" });
    head.append(element("span", `${c.title} at ${c.where}`), element("span", percent(c.weight), { className: "weight", title: "weight among single effects" }));
    const weighs = element("div", undefined, { className: "weighs" });
    weighs.append(element("i", undefined, { style: `width:${Math.max(0.5, 100 * c.weight)}%` }));
    const falls = element("div", undefined, { className: "falls", title: "predicted change of the error, from a linear step" });
    for (const [name, v] of Object.entries(c.falls)) {
      const one = element("span", `${name} `);
      one.append(element("b", Math.abs(v) < 0.5 ? "0 %" : `${v > 0 ? "−" : "+"}${Math.abs(v).toFixed(0)} %`, { className: v > 0.5 ? "" : "none" }));
      falls.append(one);
    }
    box.append(head, weighs, falls);
    if (chosen) box.append(details(c));
    else {
      head.onmouseenter = () => wb.hover.begin(box, c);
      box.onmouseleave = wb.hover.end;
    }
    box.onclick = (e) => { if (!e.target.closest(".more")) choose(chosen ? "" : c.name); };
    box.onkeydown = (e) => { if (e.key === "Enter" && e.target === box) box.onclick(e); };
    return box;
  }
  function details(c) {
    const more = element("div", undefined, { className: "more" });
    const picture = element("img", undefined, { alt: `the law of ${c.title}`, hidden: true });
    const list = element("dl");
    const law = element("dd", "…");
    list.append(element("dt", "What it is"), element("dd", c.what), element("dt", "Law"), law, element("dt", "Causes"), element("dd", c.causes), element("dt", "Shown by"), element("dd", c.confirm));
    if (c.taken_for.length) list.append(element("dt", "Taken for"), element("dd", c.taken_for.join("; ")));
    drawn.then(() => wb.showLaw(c.kind, law, picture)); // its picture takes the server longer than the prediction
    more.append(element("button", "Add it and fit again", { className: "add main", disabled: wb.isBusy(), onclick: () => wb.act("add", { effect: c.name }) }), picture, list);
    return more;
  }
  async function choose(name) {
    let done;
    drawn = new Promise((resolve) => { done = resolve; });
    wb.hover.end();
    wb.chosen.candidate = name;
    show();
    const card = $("candidates").querySelector(".chosen");
    if (card) {
      card.focus({ preventScroll: true });
      const list = $("candidates"), above = card.getBoundingClientRect().top - list.getBoundingClientRect().top;
      if (above < 0 || above > list.clientHeight / 2) list.scrollTop += above - 8; // the list scrolls, the page does not
    }
    wb.machine.light(name ? name.slice(name.indexOf("@") + 1) : "");
    try { await wb.views.time(); } catch (error) { wb.complain(error); } finally { done(); }
  }
  function onlyAt(name) {
    if (!found) return;
    place = name === place ? "" : name;
    show();
  }
  const at = (where) => (found ? found.rows.filter((c) => c.where === where) : []);
  return { forget, load, onlyAt, at, choose, first: () => found && found.rows[0], get known() { return found !== null; } };
})();
