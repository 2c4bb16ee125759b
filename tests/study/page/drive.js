// Drives with keys and a gamepad, and repeats the drive with every controller.
(async () => {
  await teleop.ready;
  const press = (type, key) =>
    document.dispatchEvent(new KeyboardEvent(type, { key, bubbles: true }));
  const wait = (ms) => new Promise((go) => setTimeout(go, ms));
  const rumbles = [];
  const vibrationActuator = { playEffect: (...x) => rumbles.push(x) };
  const pad = { axes: [0, 0, 0, 0], vibrationActuator };
  navigator.getGamepads = () => [null, pad];
  press("keydown", "d");
  await wait(200);
  press("keydown", "ArrowRight");
  while (state.drive && state.cursor < 0.6) await wait(20);
  press("keyup", "ArrowRight");
  pad.axes = [0.05, -0.5, 0, 0];
  while (state.drive && state.cursor < 0.8) await wait(20);
  press("keydown", "Escape");
  while (document.getElementById("saved").hidden || state.isBusy) await wait(20);
  const csv = await (await fetch(document.getElementById("save").href)).text();
  const end = state.hand.at(-1)[0];
  const ends = {};
  for (const kind of teleop.controllers) {
    const run = await teleop.run(kind);
    ends[kind] = teleop.sample(run, "tool_position", [end]);
  }
  const last = state.hand.at(-1);
  const most = state.data.hand.full_speed;
  return {
    csv,
    end,
    ends,
    rumbles,
    sticks: last.slice(1).map((v) => v / most),
    command: document.getElementById("repeat").textContent,
  };
})();
