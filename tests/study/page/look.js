// Sets inputs, clicks boxes and ports, and looks at what the page shows.
(async () => {
  await teleop.ready;
  const scope = () => document.querySelector(".scope > svg").innerHTML;
  const run = (kind) =>
    teleop.run(kind).then((r) => ({
      ...r,
      sentence: sentenceOf(r.run),
      sampled: teleop.sample(r, "tool_position", [0.5, 7.9, 16.1]),
    }));
  const inputs = teleop.inputs;
  const before = scope();
  const first = await run("direct_force");
  await teleop.set("delay", 0.0731);
  await teleop.set("environment.layers.bone.stiffness", 93.7);
  const second = {};
  for (const kind of teleop.controllers) second[kind] = await run(kind);
  const shown = state.runs.map((r) => r.metrics);
  const click = (which) =>
    document.querySelector(which).dispatchEvent(new MouseEvent("click", { bubbles: true }));
  const scopes = () => [...document.querySelectorAll(".scope")].map((x) => x.dataset.port);
  const after = scope();
  const found = [scopes()];
  click("[data-box='controller']");
  const crumbs = document.getElementById("crumbs").textContent;
  click("[data-port='controller/pack:packet'], .node [data-port^='controller/']");
  found.push(scopes());
  document.querySelector("#crumbs button").click();
  click("[data-box='environment']");
  const rows = [...document.querySelectorAll("#box .row")].map((x) => x.textContent);
  document.querySelector("#box .row input").value = 111;
  document.querySelector("#box .row input").oninput();
  await state.busy;
  setCursor(5);
  const marks = [...document.querySelectorAll(".packets")].map((x) => x.getAttribute("d"));
  const wrong = [];
  for (const [name, value] of [
    ["delay", 9],
    ["stiff", 1],
  ]) {
    try {
      await teleop.set(name, value);
    } catch (e) {
      wrong.push(e.message);
    }
  }
  return {
    errors,
    inputs,
    controllers: teleop.controllers,
    first,
    second,
    shown,
    found,
    crumbs,
    rows,
    marks,
    stiffness: teleop.inputs["environment.layers.bone.stiffness"].value,
    wrong,
    hasChanged: before !== after,
    asked: performance.getEntriesByType("resource").map((x) => x.name),
  };
})();
