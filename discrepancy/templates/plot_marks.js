/* What every figure over uPlot shares: the look of its lines, and what lies below them. */
window.vtsdtMarks = (function () {
  "use strict";
  const STYLE = {
    measured: { stroke: "#000000", width: 2 },
    before: { stroke: "#D55E00", width: 1.2, dash: [6, 3] },
    after: { stroke: "#0072B2", width: 1.2 },
    predicted: { stroke: "#009E73", width: 1.4, dash: [2, 2] },
    each: { stroke: "#c3cad2", width: 1 },
    limit: { stroke: "#a11111", width: 1.4, dash: [4, 4] },
  };
  const STRETCH = "rgba(240, 228, 66, 0.35)", NOISE = "rgba(160, 160, 160, 0.35)", RULE = "#c3cad2", WORD = "#57606a";

  /* A plugin that draws what marks() returns: stretches of the abscissa ([[from, to]]), the band of a noise (its
     standard deviation), and vertical rules ([{at, name}]). */
  function below(marks) {
    function drawClear(u) {
      const { stretches, noise, rules } = marks();
      const { ctx, bbox } = u;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      ctx.fillStyle = STRETCH;
      for (const [from, to] of stretches || []) {
        const a = u.valToPos(from, "x", true);
        ctx.fillRect(a, bbox.top, u.valToPos(to, "x", true) - a, bbox.height);
      }
      if (noise) {
        const a = u.valToPos(2 * noise, "y", true);
        ctx.fillStyle = NOISE;
        ctx.fillRect(bbox.left, a, bbox.width, u.valToPos(-2 * noise, "y", true) - a);
      }
      ctx.strokeStyle = RULE;
      ctx.fillStyle = WORD;
      ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
      for (const { at, name } of rules || []) {
        const x = u.valToPos(at, "x", true);
        ctx.beginPath();
        ctx.moveTo(x, bbox.top);
        ctx.lineTo(x, bbox.top + bbox.height);
        ctx.stroke();
        if (name) ctx.fillText(name, x + 3, bbox.top + 11 * devicePixelRatio);
      }
      ctx.restore();
    }
    return { hooks: { drawClear } };
  }
  return { STYLE, below };
})();
