/* Zoomable figures of measurement and model over time; the horizontal axes of one group are linked.
   A figure is {title, from, x, measured, models: [{name, style, y}], noise, label, marks: [[from, to]]}, with its numbers as
   base64 of little-endian 32-bit floats, and x counted from ``from``.  Needs uPlot and plot_marks.js. */
window.vtsdtZoom = (function () {
  "use strict";
  const { STYLE, below } = vtsdtMarks;

  function numbers(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
    return Array.from(new Float32Array(bytes.buffer), (v) => (Number.isNaN(v) ? null : v));
  }

  function tick(v) { // no longer than the space beside the axis
    const short = v === 0 || (Math.abs(v) >= 1e-3 && Math.abs(v) < 1e5);
    return short ? +v.toPrecision(5) : v.toExponential().replace("e+", "e");
  }
  const known = new WeakMap();
  /* The numbers of a figure, read once, for the signal and its residual alike. */
  function read(figure) {
    if (!known.has(figure)) {
      const x = numbers(figure.x).map((t) => t + figure.from), measured = numbers(figure.measured);
      known.set(figure, { x, measured, models: figure.models.map((m) => numbers(m.y)) });
    }
    return known.get(figure);
  }

  /* Draws figures into an element.  options.onZoom(from, to) is called when the visible stretch was changed by hand,
     options.onMark(figure, mark) when a marked stretch is clicked, options.onSight() when a figure without numbers comes
     into sight, options.onPrint() before printing where there are such figures: it returns all of them with their numbers,
     or null, and what is without numbers then is not printed.  Returns {show(from, to), update(figures), inSight()}. */
  function draw(element, figures, options) {
    options = options || {};
    const plots = [];
    let whole = null, shown = null, busy = false;

    const isEmpty = (p) => !p.figure.x;
    const inSight = () => [...new Set(plots.filter((p) => p.visible).map((p) => p.figure.output))];

    /* What changes in a panel that is out of sight is drawn when it comes into sight. */
    function refresh(p) {
      if (!p.visible || !(p.stale || p.moved)) return;
      if (p.stale && isEmpty(p)) return; // the old lines stay until the new ones are there
      if (p.stale) p.plot.setData(data(p.figure, p.residual), !shown);
      if (shown) p.plot.setScale("x", { min: shown[0], max: shown[1] });
      p.stale = false;
      p.moved = false;
    }
    const watch = new IntersectionObserver((entries) => {
      for (const e of entries) {
        const p = plots.find((q) => q.box === e.target);
        if (!p) continue;
        p.visible = e.isIntersecting;
        refresh(p);
      }
      if (options.onSight && plots.some((p) => p.visible && isEmpty(p))) options.onSight();
    });
    let seen = []; // the panels in sight when printing began
    window.addEventListener("beforeprint", () => {
      if (!element.isConnected) return; // other figures have taken its place
      seen = plots.filter((p) => p.visible);
      const all = options.onPrint && plots.some(isEmpty) ? options.onPrint() : null;
      if (all) update(all);
      for (const p of plots) {
        p.visible = true;
        refresh(p);
        p.box.classList.toggle("unread", isEmpty(p));
      }
    });
    window.addEventListener("afterprint", () => { for (const p of plots) p.visible = seen.includes(p); });

    function show(from, to, byHand) {
      if (busy || !(to > from)) return;
      busy = true;
      shown = [from, to];
      for (const p of plots) { p.moved = true; refresh(p); }
      busy = false;
      if (byHand && options.onZoom) options.onZoom(from, to);
    }

    function zoom(factor, centre) {
      const [a, b] = shown, c = centre === undefined ? 0.5 * (a + b) : centre;
      const from = Math.max(whole[0], c - (c - a) * factor), to = Math.min(whole[1], c + (b - c) * factor);
      show(from, to, true);
    }

    function pan(share) {
      const [a, b] = shown, step = share * (b - a);
      const moved = step > 0 ? Math.min(step, whole[1] - b) : Math.max(step, whole[0] - a);
      show(a + moved, b + moved, true);
    }

    function data(figure, residual) {
      const { x, measured, models } = read(figure);
      if (!residual) return [x, measured, ...models];
      return [x, ...models.map((y) => y.map((v, k) => (v === null || measured[k] === null ? null : measured[k] - v)))];
    }

    function panel(figure, residual) {
      const box = document.createElement("div"), own = { figure, residual, box, visible: !!figure.x, stale: false, moved: false };
      box.className = "zoom-panel";
      element.appendChild(box);
      const series = [{ label: "time", value: (u, v) => (v === null ? "" : v.toPrecision(6) + " s") }];
      const value = (u, v) => (v === null || v === undefined ? "" : v.toPrecision(4));
      if (!residual) series.push({ label: "measured", value, ...STYLE.measured });
      for (const m of figure.models) series.push({ label: m.name, value, ...STYLE[m.style] });
      const narrow = element.clientWidth < 480, font = "12px system-ui, sans-serif";
      const look = { font, labelFont: font, grid: { stroke: "#e5e9ed", width: 1 }, ticks: { stroke: "#c3cad2", width: 1 } };
      const axis = { ...look, size: narrow ? 48 : 62, values: (u, ticks) => ticks.map(tick) };
      const plot = new uPlot(
        {
          title: residual ? "" : narrow ? `${figure.title}, ${figure.label}` : figure.title,
          width: Math.max(240, box.clientWidth || element.clientWidth),
          height: residual ? 120 : 200,
          scales: { x: { time: false } },
          axes: [
            { ...look, label: residual ? "time [s]" : undefined, labelSize: residual ? 20 : 0, size: residual ? 30 : 26 },
            { ...axis, ...(residual ? { space: 18 } : {}), label: narrow ? undefined : residual ? "residual" : figure.label, labelSize: narrow ? 0 : 20 },
          ],
          series,
          legend: { show: !residual, markers: { width: 0, fill: (u, i) => u.series[i].stroke(u, i) } },
          cursor: { drag: { x: true, y: false, uni: 20 }, sync: { key: options.key || "vtsdt", scales: ["x", null] } },
          hooks: {
            setSelect: [
              (u) => {
                if (u.select.width > 4) {
                  const from = u.posToVal(u.select.left, "x"), to = u.posToVal(u.select.left + u.select.width, "x");
                  show(from, to, true);
                }
                u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
              },
            ],
            ready: [
              (u) => {
                u.over.addEventListener("dblclick", () => show(whole[0], whole[1], true));
                u.over.addEventListener("wheel", (e) => {
                  if (!e.ctrlKey && !e.shiftKey) return; // plain turning scrolls the page
                  e.preventDefault();
                  zoom(e.deltaY < 0 ? 0.75 : 1 / 0.75, u.posToVal(e.offsetX, "x"));
                }, { passive: false });
                u.over.addEventListener("click", () => {
                  if (!options.onMark || u.cursor.left < 0) return;
                  const t = u.posToVal(u.cursor.left, "x");
                  const mark = (own.figure.marks || []).find(([a, b]) => t >= a && t <= b);
                  if (mark) options.onMark(own.figure, mark);
                });
              },
            ],
          },
          plugins: [below(() => ({ stretches: own.figure.marks, noise: residual ? own.figure.noise : 0 }))],
        },
        data(figure, residual),
        box,
      );
      watch.observe(box);
      plots.push(Object.assign(own, { plot, lines: lines(figure) }));
    }

    const lines = (f) => [f.title, ...f.models.map((m) => m.name + m.style)].join("\n");

    function toolbar() {
      const bar = document.createElement("div");
      bar.className = "zoom-bar";
      const entries = [
        ["+", "closer", () => zoom(0.5)], ["−", "farther", () => zoom(2)], ["◀", "earlier", () => pan(-0.5)],
        ["▶", "later", () => pan(0.5)], ["whole record", "show the whole record", () => show(whole[0], whole[1], true)],
      ];
      for (const [text, title, action] of entries) {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = text;
        button.title = title;
        button.addEventListener("click", action);
        bar.appendChild(button);
      }
      element.appendChild(bar);
    }

    function build(list) {
      watch.disconnect();
      for (const p of plots) p.plot.destroy();
      plots.length = 0;
      element.textContent = "";
      toolbar();
      for (const figure of list) for (const residual of [false, true]) panel(figure, residual);
    }

    function update(list) {
      // A finer drawing of the visible stretch, or other models: the panels stay where their lines are the same.
      const same = plots.length === 2 * list.length && list.every((f, k) => plots[2 * k].lines === lines(f));
      busy = true;
      if (!same) build(list);
      else plots.forEach((p, k) => { p.figure = list[Math.floor(k / 2)]; p.stale = true; });
      busy = false;
      if (shown) show(shown[0], shown[1], false);
    }

    build(figures);
    const first = read(figures[0]).x;
    whole = shown = figures[0].whole || [first[0], first[first.length - 1]];
    show(whole[0], whole[1], false);
    new ResizeObserver(() => {
      for (const p of plots) {
        const width = Math.max(240, p.box.clientWidth);
        if (Math.abs(width - p.plot.width) > 1) p.plot.setSize({ width, height: p.plot.height });
      }
    }).observe(element);
    return { show, update, inSight, plots };
  }
  return { draw };
})();
