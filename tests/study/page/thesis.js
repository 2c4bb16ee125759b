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
    const [line] = [...scope.querySelectorAll("polyline:not(.printed)")].slice(-1);
    return line.getAttribute("points").split(" ").length;
  });
  const said = lab.outcome.textContent.replaceAll(/\s+/g, " ").trim();
  const marks = lab.marksOf("tool_velocity").map(({ points }) => points[0]);
  const drawn = scopes[0].querySelectorAll("polyline.printed").length;
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
    said,
    marks,
    drawn,
    kinds: lab.loops.map(({ kind }) => kind),
    isMoved: moved !== first,
    isBack: back === first,
    all,
    shown,
    refuted,
    width: document.documentElement.scrollWidth,
    targets: controls.map((control) => control.getBoundingClientRect().height),
  };
})();
