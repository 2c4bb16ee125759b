// Moves a slider of the executable thesis and back, and filters its claims.
(async () => {
  await teleop.ready;
  const [lab] = teleop.labs;
  const count = (which) => document.querySelectorAll(which).length;
  const scopes = [...document.querySelectorAll(".scope")];
  scopes[0].scrollIntoView();
  lab.draw(true);
  const draw = () => scopes.map((scope) => scope.querySelector("svg").innerHTML).join();
  const first = draw();
  const curves = scopes.map((scope) => {
    const [line] = [...scope.querySelectorAll("polyline")].slice(-1);
    return line.getAttribute("points").split(" ").length;
  });
  await lab.set({ delay: 0.2 });
  lab.draw(true);
  const moved = draw();
  await lab.set({ delay: 0.1 });
  lab.draw(true);
  const back = draw();
  const all = count("tr[data-verdict]:not([hidden])");
  document.querySelector("#filter button[value=refuted]").click();
  const shown = count("tr[data-verdict]:not([hidden])");
  const refuted = count("tr[data-verdict=refuted]");
  document.querySelector("#filter button[value='']").click();
  const controls = [...document.querySelectorAll("button, input")];
  return {
    inputs: lab.inputs.map(({ name }) => name),
    scopes: scopes.map((scope) => scope.dataset.signal),
    curves,
    isMoved: moved !== first,
    isBack: back === first,
    all,
    shown,
    refuted,
    width: document.documentElement.scrollWidth,
    targets: controls.map((control) => control.getBoundingClientRect().height),
  };
})();
