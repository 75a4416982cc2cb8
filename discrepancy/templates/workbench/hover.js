/* The law of a kind and its picture, in a card or, under the pointer, beside it. */
wb.showLaw = function (kind, law, picture) {
  "use strict";
  return wb.ask("kind", { name: kind }).then((k) => {
    law.textContent = k.law;
    if (!k.picture) return;
    picture.src = `data:image/svg+xml;utf8,${encodeURIComponent(k.picture)}`;
    picture.hidden = false;
  }).catch(() => { law.textContent = "–"; });
};
wb.hover = (function () {
  "use strict";
  const WAIT = 350, GAP = 12; // ms before it opens; px to the card
  const { element } = wb;
  let later = 0, box = null;

  function begin(card, c) {
    end();
    later = setTimeout(() => open(card, c), WAIT);
  }
  async function open(card, c) {
    const law = element("p"), picture = element("img", undefined, { alt: `the law of ${c.title}`, hidden: true });
    const shown = box = element("div", undefined, { className: "hover" });
    shown.append(element("strong", c.title), element("p", c.what), picture, law, element("p", `Usual causes: ${c.causes}`));
    await wb.showLaw(c.kind, law, picture);
    if (box !== shown) return; // the pointer has left
    document.body.append(shown);
    const at = card.getBoundingClientRect(), left = at.left - shown.offsetWidth - GAP;
    shown.style.left = `${left >= GAP ? left : Math.max(GAP, Math.min(at.left, innerWidth - shown.offsetWidth - GAP))}px`;
    shown.style.top = `${left >= GAP ? Math.max(GAP, Math.min(at.top, innerHeight - shown.offsetHeight - GAP)) : at.bottom + GAP}px`;
  }
  function end() {
    clearTimeout(later);
    if (box) box.remove();
    box = null;
  }
  return { begin, end };
})();
