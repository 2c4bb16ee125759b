// Starts drives in three ways, and ends one at a controller that runs away.
(async () => {
  await teleop.ready;
  const wait = (ms) => new Promise((go) => setTimeout(go, ms));
  const press = (type, key) =>
    document.dispatchEvent(new KeyboardEvent(type, { key, bubbles: true }));
  const until = async (isTrue) => {
    const begin = performance.now();
    while (!isTrue()) {
      if (performance.now() - begin > 30000) throw new Error(`waited for ${isTrue}`);
      await wait(20);
    }
  };
  const end = async () => {
    press("keydown", "Escape");
    await until(() => !$("banner").hidden);
    await wait(700);
  };
  const scene = $("scene");
  const drawn = scene.getBoundingClientRect();
  const arm = scene.querySelector(".arm").getBoundingClientRect();
  const bone = [...scene.querySelectorAll("rect.contact")].at(-1);
  const seen = {
    first: state.runs.length && shownLoop().kind,
    isArmIn: arm.left >= drawn.left && arm.right <= drawn.right,
    boneAt: Number(/translate\(([-\d.]+)/.exec(bone.getAttribute("transform"))[1]),
    width: drawn.width,
    strength: $("strength").value,
  };
  await wait(700);
  press("keydown", "ArrowRight");
  await until(() => state.drive && state.hand.at(-1)[0] > 0.2);
  press("keyup", "ArrowRight");
  await end();
  seen.key = state.hand.some(([, x]) => x > 0);
  const point = (type, clientX) =>
    scene.dispatchEvent(new PointerEvent(type, { clientX, clientY: 0, pointerId: 1 }));
  scene.setPointerCapture = () => {};
  point("pointerdown", 0);
  point("pointermove", 60);
  await until(() => state.drive && state.hand.at(-1)[0] > 0.2);
  point("pointerup", 60);
  await end();
  seen.pointer = Math.max(...state.hand.map(([, x]) => x)) / state.data.hand.full_speed;
  const pad = { axes: [0, -1, 0, 0] };
  navigator.getGamepads = () => [pad];
  await until(() => state.drive && state.hand.at(-1)[0] > 0.2);
  pad.axes = [0, 0, 0, 0];
  await end();
  seen.pad = state.hand.some(([, , y]) => y > 0);
  // Direct force, until it runs away.
  [...document.querySelectorAll("#banner button")]
    .find((x) => x.textContent === "With direct force")
    .click();
  await until(() => state.drive);
  press("keydown", "ArrowRight");
  await until(() => !state.drive && !$("banner").hidden && !state.busy);
  press("keyup", "ArrowRight");
  seen.banner = document.querySelector("#banner p").textContent;
  seen.score = document.querySelector("#banner code").textContent;
  seen.next = [...document.querySelectorAll("#banner button")].map((x) => x.textContent);
  const run = state.runs.find((x) => x.loop.kind === "direct_force");
  seen.end = run.time.at(-1);
  seen.push = state.hand.find(([, ...v]) => v.some((x) => x !== 0))[0];
  const metrics = {
    "collision.time": seen.push + 1.25,
    "collision.peak_force": 0.83,
    "collision.rest_time": 2,
  };
  seen.whole = scoreLine({ loop: run.loop, metrics });
  const hand = String(state.hand);
  [...document.querySelectorAll("#banner button")]
    .find((x) => x.textContent.startsWith("This drive again"))
    .click();
  const score = () => document.querySelector("#banner code").textContent;
  await until(() => score().includes("delay each way 0 s") && !state.busy);
  seen.again = {
    isSame: hand === String(state.hand),
    delay: teleop.inputs.delay?.value,
    isShown: !$("banner").hidden,
  };
  return seen;
})();
