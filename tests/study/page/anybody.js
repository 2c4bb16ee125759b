// Runs of a diagram's page with other numbers, and the inputs of an opened box.
(async () => {
  await teleop.ready;
  const [kind] = teleop.controllers;
  const times = [0.5, 1, 2, 4];
  const samples = [];
  for (const [name, value] of [
    ["delay", 0.12],
    ["delay", 0],
    ["plant.length", 0.8],
    ["plant/theta(0)", 0.4],
    ["plant.damping", 0.3],
  ]) {
    await teleop.set(name, value);
    samples.push(teleop.sample(await teleop.run(kind), "state", times));
  }
  const rows = () => [...document.querySelectorAll("#inputs .row label")].map((x) => x.textContent);
  const shown = rows();
  document.querySelector('[data-box="plant"]').dispatchEvent(new Event("click", { bubbles: true }));
  const box = [...document.querySelectorAll("#box .row label")].map((x) => x.textContent);
  document.querySelector('[data-box="pid"]').dispatchEvent(new Event("click", { bubbles: true }));
  return {
    samples,
    shown,
    head: document.querySelector(".scope .head").textContent,
    tries: [...document.querySelectorAll("#tries button")].slice(0, 3).map((x) => x.textContent),
    box,
    after: rows(),
    inputs: teleop.inputs,
    title: document.querySelector("h1").textContent,
    story: $("story").textContent,
    notes: $("notes").textContent,
  };
})();
