/* The page as a whole: news from the server, the work in hand, and the buttons. */
(function () {
  "use strict";
  const { element, act, complain, digits, $ } = wb;
  let shown = "", stopped = ""; // the stages that stand there, and those whose scoring was stopped by hand
  wb.isBusy = () => !!(wb.state && wb.state.doing && !wb.state.doing.yields);

  async function listen() {
    let since = -1;
    for (;;) {
      try {
        const news = await wb.ask("state", { since });
        $("gone").style.display = "none";
        since = news.version;
        await take(news);
      } catch (error) {
        complain(error);
        await new Promise((done) => setTimeout(done, 1500));
      }
    }
  }
  async function take(news) {
    const before = wb.state;
    wb.state = news;
    $("name").textContent = news.name;
    document.title = `${news.name}: vtsdt workbench`;
    showAnswer();
    showDoing();
    buttons();
    if (!news.stages.length) {
      if (news.error) $("view").replaceChildren(element("p", "The model could not be compared with the records; the reason stands above.", { className: "empty" }));
      return;
    }
    const mark = JSON.stringify([news.stages, news.left_out, news.priors, news.branches]);
    if (mark !== shown && !wb.isBusy()) {
      shown = mark;
      wb.candidates.forget();
      wb.showStages();
      showChanged();
      wb.sliders.show();
      showSteps();
      await wb.views.show();
      if (!wb.machine.known) wb.machine.take(await wb.ask("machine"));
      buttons();
    } else if (wb.isBusy()) wb.showStages(); // a search adds stages while it runs
    if (wb.chosen.view === "force" && before && before.doing && before.doing.what.startsWith("estimate") && !wb.isBusy()) await wb.views.show();
    if (!news.doing && news.scored && !wb.candidates.known) await wb.candidates.load();
    else if (!news.doing && !news.scored && !news.error && stopped !== mark) {
      await wb.send("do", { action: "score", yields: true }).catch(() => {});
    }
  }
  function buttons() {
    const busy = wb.isBusy() || !wb.state.stages.length;
    for (const b of document.querySelectorAll("button[data-export], #score, #search, #conclude, .add, .leave, .again, .switch, .refit, .estimate")) b.disabled = busy;
    $("undo").disabled = busy || !wb.state.can_undo;
    $("redo").disabled = busy || !wb.state.can_redo;
  }
  function showDoing() {
    const { doing, error } = wb.state, box = $("doing");
    if (!doing) {
      box.replaceChildren(...(error ? [element("span", error, { className: "error" })] : []));
      return;
    }
    const bar = element("progress");
    if (doing.share !== null && doing.share !== undefined) bar.value = doing.share;
    box.replaceChildren(bar, element("strong", doing.what), element("button", "Stop", { onclick: () => { if (doing.yields) stopped = shown; wb.send("stop").catch(complain); } }), element("span", doing.text, { className: "text", title: doing.text }));
  }
  function showAnswer() {
    const { verdict, sentence, next_measurement: next } = wb.state.conclusion, box = $("verdict");
    if (box.dataset.said === (sentence || "")) return; // what was opened in it stays open
    box.dataset.said = sentence || "";
    if (!sentence) { box.replaceChildren(); return; }
    box.replaceChildren(element("p", sentence, { title: verdict || "" }));
    if (next && next.length) {
      const more = element("details"), list = element("ul");
      list.append(...next.map((text) => element("li", text)));
      more.append(element("summary", "What to measure next"), list);
      box.append(more);
    }
  }
  /* Stretches that are left out and priors that are changed, each with the way back. */
  function showChanged() {
    const { left_out, priors } = wb.state, entry = (text, word, back) => {
      const line = element("li", text);
      line.append(" ", element("button", word, { className: "again", disabled: wb.isBusy(), title: "Fit every stage again", onclick: back }));
      return line;
    };
    const stated = (p) => [p.value !== null && digits(p.value), p.std !== null && `± ${digits(p.std)}`].filter(Boolean).join(" ");
    $("changed").replaceChildren(
      ...left_out.map((s) => entry(`left out: ${s.words}`, "Use it again", () => wb.act("use_again", { record: s.record, start: s.start, stop: s.stop }))),
      ...priors.map((p) => entry(`stated: ${p.name} ${stated(p)}`, "As in the study file", () => wb.act("set_prior", { name: p.name }))),
    );
  }
  const words = (s) => [s.action.replace("_", " "), s.effect, s.where, s.over && `over ${s.over}`, s.name, s.value != null && digits(s.value), s.std != null && `± ${digits(s.std)}`, s.record, s.branch != null && `to branch ${s.branch + 1}`].filter(Boolean).join(" ") + (s.start != null || s.stop != null ? ` ${digits(s.start)} s to ${digits(s.stop)} s` : "");
  function showSteps() {
    const { steps } = wb.state, done = [], undone = [];
    for (const s of steps) {
      if (s.action === "undo") undone.push(done.pop());
      else if (s.action === "redo") done.push(undone.pop());
      else { done.push(s); undone.length = 0; }
    }
    const next = (list, otherwise) => (list.length && list[list.length - 1] ? words(list[list.length - 1]) : otherwise);
    $("undo").title = `Take the latest step back: ${next(done, "none")}`;
    $("redo").title = `Take it again as it ended: ${next(undone, "none")}`;
    $("count").textContent = steps.length ? `(${steps.length})` : "(none yet)";
    $("steps").replaceChildren(...steps.map((s) => element("li", words(s))));
  }
  for (const action of ["undo", "redo", "search", "conclude", "score"]) $(action).onclick = () => act(action);
  for (const button of document.querySelectorAll("button[data-export]")) button.onclick = async () => {
    $("written").textContent = "writing …";
    try { $("written").textContent = `written: ${(await wb.send("export", { what: button.dataset.export })).written.join(", ")}`; } catch (error) { $("written").textContent = error.message; }
  };
  listen();
})();
