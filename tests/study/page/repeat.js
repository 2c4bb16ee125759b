// Ends a drive of nine seconds with moved sliders, and looks at what is offered to repeat it.
(async () => {
  await teleop.ready;
  await teleop.set("forward_delay", 0.05);
  await teleop.set("return_delay", 0.07);
  await teleop.set("environment.layers.bone.stiffness", 111);
  const { full_speed: full } = state.data.hand;
  const speedAt = (t) => (t < 0.2 ? 0 : full * (t < 8 ? 1 : 0.1));
  state.hand = range(541).map((i) => [i / 60, speedAt(i / 60)]);
  endDrive("direct_force");
  while (document.getElementById("banner").hidden) await new Promise((go) => setTimeout(go, 20));
  const csv = await (await fetch(document.getElementById("save").href)).text();
  const metrics = state.runs.map((run) => run.metrics);
  const score = document.querySelector("#banner code").textContent;
  const command = document.getElementById("repeat").textContent;
  const { window: shown, cursor } = state;
  await teleop.set("delay", 0.1);
  const later = document.getElementById("repeat").textContent;
  return { csv, metrics, score, command, shown, cursor, later };
})();
