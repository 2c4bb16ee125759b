// Drives a loop without delay.
(async () => {
  await teleop.ready;
  const wait = (ms) => new Promise((go) => setTimeout(go, ms));
  state.keys.add("ArrowRight");
  for (let i = 0; i < 500 && !(state.hand.at(-1)?.[0] > 0.5); ++i) await wait(20);
  toggleDrive();
  for (let i = 0; i < 500 && $("banner").hidden; ++i) await wait(20);
  const score = document.querySelector("#banner code").textContent;
  return { score, inputs: teleop.inputs, moved: state.runs.map((run) => run.time.at(-1)) };
})();
