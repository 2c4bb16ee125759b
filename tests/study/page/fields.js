// The numbers in the box of a block, one of them as a slider, and the state as Python.
async (path, changes, signal, times) => {
  await teleop.ready;
  const open = () => {
    const parts = path.split("/").slice(0, -1);
    showLevel(parts.join("/"));
    const box = document.querySelector(`[data-box="${path}"]`);
    box.dispatchEvent(new MouseEvent("click", { bubbles: true }));
  };
  open();
  const isShown = (x) => x.getClientRects().length > 0;
  const rows = [...document.querySelectorAll("#box .row")];
  const labels = rows.map((row) => row.querySelector("label").textContent);
  const hasSlider = () => isShown(rows[0].querySelector("input[type=range]"));
  const before = hasSlider();
  const link = linkOfState();
  rows[0].querySelector("button").click();
  const made = { before, after: hasSlider(), label: rows[0].querySelector("label").textContent };
  const fixed = [...document.querySelectorAll("#box .ports")].map((x) => x.textContent);
  for (const [name, value] of Object.entries(changes)) await teleop.set(name, value);
  const run = await teleop.run(shownLoop().kind);
  return {
    labels,
    made,
    fixed,
    link,
    samples: teleop.sample(run, signal, times),
    metrics: run.metrics,
    python: stateAsPython(),
    moved: linkOfState(),
  };
};
