// Clicks a wire, drags its delay, and samples runs.
(async () => {
  await teleop.ready;
  const [kind] = teleop.controllers;
  const runs = [];
  for (const delay of [0, 0.05]) {
    await teleop.set("pid.estimated_state.delay", delay);
    runs.push(teleop.sample(await teleop.run(kind), "state", [0.1, 0.3, 0.9, 3]));
  }
  const wire = document.querySelector('.edge[data-port="pid:estimated_state"] path');
  wire.dispatchEvent(new MouseEvent("click", { bubbles: true }));
  const slider = document.querySelector("#box input[type=range]");
  const { margins } = shownLoop();
  const python = stateAsPython();
  const words = $("box").textContent;
  return {
    runs,
    margins,
    python,
    words,
    isShown: slider.getClientRects().length > 0,
    scopes: state.scopes,
  };
})();
