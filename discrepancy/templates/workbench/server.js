/* What every part of the workbench's page uses: questions to the server, and pieces of the page.
   Nothing is computed here: the page shows what the server says of the study, and sends what is clicked. */
const wb = (function () {
  "use strict";
  const token = new URLSearchParams(location.search).get("token") || "";
  const $ = (id) => document.getElementById(id);

  async function ask(path, given) {
    return answer(await fetch(`/${path}?${new URLSearchParams({ token, ...(given || {}) })}`));
  }
  async function send(path, given) {
    const body = JSON.stringify(given || {});
    return answer(await fetch(`/${path}?token=${encodeURIComponent(token)}`, { method: "POST", body }));
  }
  /* For paper: what is printed has to stand there before the printing begins.  Null where the server does not answer. */
  function sendAndWait(path, given) {
    const request = new XMLHttpRequest();
    try {
      request.open("POST", `/${path}?token=${encodeURIComponent(token)}`, false);
      request.send(JSON.stringify(given));
      return request.status === 200 ? JSON.parse(request.responseText) : null;
    } catch { return null; }
  }
  async function answer(response) {
    const found = await response.json();
    if (!response.ok) throw new Error(found.error || response.statusText);
    return found;
  }
  async function act(action, given) {
    try { await send("do", { action, ...(given || {}) }); } catch (error) { complain(error); }
  }
  function complain(error) {
    if (error instanceof TypeError && /fetch/i.test(error.message)) $("gone").style.display = "block";
    else $("doing").replaceChildren(element("span", error.message, { className: "error" }));
  }
  function element(tag, text, options) {
    const e = document.createElement(tag);
    if (text !== undefined) e.textContent = text;
    return Object.assign(e, options || {});
  }
  function svg(tag, attributes, text) {
    const e = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [k, v] of Object.entries(attributes || {})) e.setAttribute(k, v);
    if (text !== undefined) e.textContent = text;
    return e;
  }
  function select(label, options, value, change) {
    const box = element("select", undefined, { title: label });
    box.setAttribute("aria-label", label);
    for (const [key, text] of options) box.appendChild(element("option", text, { value: key }));
    box.value = value;
    box.onchange = () => change(box.value);
    return box;
  }
  function digits(v) {
    if (v === null || v === undefined) return "–";
    if (v === 0 || (Math.abs(v) >= 1e-3 && Math.abs(v) < 1e5)) return String(+Number(v).toPrecision(3));
    return Number(v).toExponential(2).replace(/\.?0*e\+?/, "e");
  }
  return {
    ask, send, sendAndWait, act, complain, element, svg, select, digits, $,
    state: null, // what the server said last
    chosen: { view: "time", record: "", against: 1, candidate: "", output: "", values: null, span: null, place: "", ends: [0, 1], branchSpan: null },
    times: {}, // ms: first picture since the page was opened, the latest figure since it was asked for
  };
})();
