/* The graph of the model: rows by distance from the ground, the chosen place lit, shaded by the candidates' weight. */
wb.machine = (function () {
  "use strict";
  const WIDE = 104, HIGH = 26, ROW = 58, MOST = 5;
  let graph = null, lit = "", weights = {};

  function rows(names) {
    const layer = Object.fromEntries(names.map((n) => [n, null])), found = [];
    let front = names.includes("ground") ? ["ground"] : names.slice(0, 1);
    for (const n of front) layer[n] = 0;
    while (front.length) {
      found.push(front);
      const next = [];
      for (const [a, b] of graph.edges) for (const [from, to] of [[a, b], [b, a]]) {
        if (front.includes(from) && layer[to] === null) { layer[to] = found.length; next.push(to); }
      }
      front = [...new Set(next)];
    }
    const loose = names.filter((n) => layer[n] === null);
    if (loose.length) found.push(loose);
    return found;
  }
  /* Each row in the order of the mean place of its neighbours above, so that lines cross less. */
  function ordered(found) {
    const place = {};
    found.forEach((row) => {
      const mean = (n) => {
        const above = graph.edges.filter((e) => e.includes(n)).map(([a, b]) => place[a === n ? b : a]).filter((v) => v !== undefined);
        return above.length ? above.reduce((s, v) => s + v, 0) / above.length : 0.5;
      };
      const key = Object.fromEntries(row.map((n) => [n, mean(n)]));
      row.sort((a, b) => key[a] - key[b]);
      row.forEach((n, k) => { place[n] = (k + 0.5) / row.length; });
    });
    return found.flatMap((row) => {
      const pieces = [], count = Math.ceil(row.length / MOST), size = Math.ceil(row.length / count);
      for (let k = 0; k < row.length; k += size) pieces.push(row.slice(k, k + size));
      return pieces;
    });
  }
  const belongs = (name, where) => where === name || where.startsWith(`${name}.`) || where.split(/[.~ -]/)[0] === name;

  function draw() {
    if (!graph) return;
    const { svg, $ } = wb;
    const named = graph.nodes.map((n) => n.name), type = Object.fromEntries(graph.nodes.map((n) => [n.name, n.type]));
    const grounded = graph.edges.some((e) => e.includes("ground"));
    const names = grounded && !named.includes("ground") ? ["ground", ...named] : named;
    const layout = ordered(rows(names)), most = Math.max(...layout.map((r) => r.length), 3), width = most * (WIDE + 14);
    const at = {}, picture = svg("svg", { viewBox: `0 0 ${width} ${layout.length * ROW - ROW + HIGH + 12}`, role: "img", "aria-label": "components and connections of the model" });
    layout.forEach((row, k) => row.forEach((n, i) => { at[n] = [((i + 0.5) * width) / row.length, k * ROW + HIGH / 2 + 6]; }));
    for (const [a, b] of graph.edges) if (at[a] && at[b]) {
      const [x1, y1] = at[a], [x2, y2] = at[b], bend = y1 === y2 ? 30 : 0, middle = (y1 + y2) / 2 + bend;
      picture.append(svg("path", { d: `M${x1},${y1} C${x1},${middle} ${x2},${middle} ${x2},${y2}`, fill: "none", stroke: "#b3bcc5", "stroke-width": 1.4 }));
    }
    for (const n of names) {
      const here = lit && belongs(n, lit), share = Object.entries(weights).reduce((s, [where, w]) => s + (belongs(n, where) ? w : 0), 0);
      const group = svg("g", {});
      group.append(svg("title", {}, n === "ground" ? "the ground" : `${n}: ${type[n]}${share > 0.005 ? `, ${(100 * share).toFixed(0)} % of the weight` : ""}`));
      const fill = here ? "#f0e442" : n === "ground" ? "#e5e9ed" : share > 0.005 ? `rgba(0, 114, 178, ${0.08 + 0.4 * Math.min(1, share)})` : "#fff";
      group.append(svg("rect", { x: at[n][0] - WIDE / 2, y: at[n][1] - HIGH / 2, width: WIDE, height: HIGH, rx: 6, fill, stroke: here ? "#a8470a" : "#8b96a1", "stroke-width": here ? 2.2 : 1 }));
      group.append(svg("text", { x: at[n][0], y: at[n][1] + 4, "text-anchor": "middle", fill: "#1b1f24" }, n.length > 16 ? n.slice(0, 15) + "…" : n));
      group.onclick = () => wb.candidates.onlyAt(n);
      picture.append(group);
    }
    $("machine").replaceChildren(picture);
  }
  return {
    take(found) { graph = found; draw(); },
    light(where) { lit = where; draw(); },
    shade(found) { weights = found; draw(); },
    belongs,
    get known() { return graph !== null; },
  };
})();
