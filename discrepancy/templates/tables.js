/* Tables that do not fit: on a narrow screen each row stands as a card, with the head of its column beside each value.
   Closed parts of a page are opened for printing. */
const vtsdtTables = (function () {
  "use strict";
  function label(table) {
    if (!table.tHead) return;
    const heads = [...table.tHead.rows[0].cells].flatMap((c) => [c.textContent.trim(), ...Array(c.colSpan - 1).fill("")]);
    for (const body of table.tBodies) for (const row of body.rows) {
      if (row.cells.length === heads.length) [...row.cells].forEach((c, k) => { c.dataset.head = heads[k]; });
    }
  }
  function fit(box) {
    const table = box.querySelector("table");
    if (!table) return;
    label(table);
    table.classList.remove("cards");
    if (box.scrollWidth > box.clientWidth + 1) table.classList.add("cards");
  }
  const all = () => document.querySelectorAll(".scroll").forEach(fit);
  addEventListener("resize", all);
  document.addEventListener("toggle", all, true); // a closed part has no width
  addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
  all();
  return { fit };
})();
