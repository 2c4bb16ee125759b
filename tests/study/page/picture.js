// The picture of the task, the scopes and the names of values, before and after a dragged slider.
(async () => {
  await teleop.ready;
  const textOf = (selector) => [...document.querySelectorAll(selector)].map((x) => x.textContent);
  const boneAt = () =>
    [...document.querySelectorAll("rect.contact")].at(-1).getAttribute("transform");
  const arrowsAt = (t) => {
    setCursor(t);
    return [...document.querySelectorAll("#scene .force")].map((arrow) => {
      const [, length] = /h([\d.]+)m/.exec(arrow.getAttribute("d"));
      return [Number(length), arrow.getAttribute("transform")];
    });
  };
  const widths = () => [...document.querySelectorAll(".readout")].map((x) => x.offsetWidth);
  const units = () => textOf("#metrics td:first-child");
  const forceAt = (t) => state.runs.map((run) => run.vector(run.signal("environment_force"), t)[0]);
  setCursor(0.5);
  const before = { bone: boneAt(), widths: widths(), units: units(), heads: textOf(".readout") };
  const times = [2.55, 3];
  const arrows = times.map((t) => ({ arrows: arrowsAt(t), forces: forceAt(t) }));
  const names = textOf(".scope:first-child text.name");
  const events = state.runs.flatMap((run) => [...new Set(run.events.map(({ name }) => name))]);
  await teleop.set("delay", 0.02);
  setCursor(2.5);
  const after = { bone: boneAt(), widths: widths(), units: units(), heads: textOf(".readout") };
  const { ports } = state.loops[1];
  const unitOf = (port) => ports[port][2];
  return {
    before,
    after,
    arrows,
    names,
    events,
    psi: componentsOf(state.loops[1], "controller:psi", 4),
    torque: componentsOf(state.loops[1], "robot:joint_torque", 2),
    units: ["controller:psi", "robot:joint_torque", "robot:joint_velocity"].map(unitOf),
    cursors: textOf(".scope .cursor").length,
  };
})();
