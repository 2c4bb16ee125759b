// Holds a key until after a controller has run away, and looks at the table.
(async () => {
  await teleop.ready;
  const press = (type, key) =>
    document.dispatchEvent(new KeyboardEvent(type, { key, bubbles: true }));
  const wait = (ms) => new Promise((go) => setTimeout(go, ms));
  document.querySelectorAll("#tabs button")[1].click();
  press("keydown", "d");
  await wait(100);
  press("keydown", "ArrowRight");
  while (state.drive && state.hand.at(-1)[0] < 2.5) await wait(20);
  press("keyup", "ArrowRight");
  press("keydown", "Escape");
  while (document.getElementById("saved").hidden || state.isBusy) await wait(20);
  while (state.runs.length < 2) await wait(20);
  const csv = await (await fetch(document.getElementById("save").href)).text();
  const columns = state.runs.map((run) => ({
    kind: run.loop.kind,
    end: run.time.at(-1),
    reason: run.reason,
    metrics: run.metrics,
    labels: run.loop.labels,
  }));
  const table = [...document.querySelectorAll("#metrics tr")].map((row) =>
    [...row.children].map((x) => x.textContent),
  );
  const command = document.getElementById("repeat").textContent;
  return { csv, end: state.hand.at(-1)[0], columns, table, command };
})();
