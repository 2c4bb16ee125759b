// The block diagram: levels that open, ports and wires that are plotted.

import { $, make, makeButton, say } from "./elements.js";
import { show } from "./numbers.js";
import { markPorts, toggleScope, valuesOf } from "./scopes.js";
import { chosen, shownLoop, state } from "./state.js";

// The box of a path in the diagram that is shown.
function boxAt(path) {
  const boxes = shownLoop().levels.flatMap((level) => level.boxes);
  return boxes.find((box) => box.path === path);
}

// Shows a level of the diagram of the chosen controller.
export function showLevel(path) {
  const { levels } = shownLoop();
  const level = levels.find((x) => x.path === path) ?? levels[0];
  state.level = level.path;
  $("level").innerHTML = new TextDecoder().decode(level.svg);
  fitPicture($("level").querySelector("svg"));
  const parts = ["", ...level.path.split("/").filter((x) => x)];
  const crumbs = parts.map((part, i) => {
    const goTo = () => showLevel(parts.slice(1, i + 1).join("/"));
    return makeButton(part || state.data.title, goTo, { disabled: i === parts.length - 1 });
  });
  $("crumbs").replaceChildren(...crumbs);
  markPorts();
}

// Crops a picture to its drawn contents.
function fitPicture(svg) {
  const { x, y, width, height } = svg.getBBox();
  if (width > 0) svg.setAttribute("viewBox", `${x - 4} ${y - 4} ${width + 8} ${height + 8}`);
}

// Shows the level that contains the shown one.
export function goUp() {
  showLevel(state.level.split("/").slice(0, -1).join("/"));
}

// Opens a box: shows its class, description, ports and inputs.
function open(path) {
  const loop = shownLoop();
  const box = boxAt(path);
  const [block] = path.split("/");
  if (path !== state.level && loop.levels.some((x) => x.path === path)) showLevel(path);
  for (const { row, owners, isField } of Object.values(state.inputs)) {
    const isOwn = owners.includes(path) || (!isField && owners.includes(block));
    if (isOwn || !isField) $(isOwn ? "box" : "inputs").append(row);
    else row.remove();
  }
  $("box").className = "";
  const isPlotted = (name) => loop.ports[`${path}:${name}`]?.[1];
  const ports = [...box.u, ...box.y].filter(isPlotted);
  const others = [...box.u, ...box.y].filter((name) => !isPlotted(name));
  const buttons = ports.map((name) => makeButton(name, () => toggleScope(`${path}:${name}`)));
  $("box").replaceChildren(
    make("h2", {}, `${path || state.data.title}: ${box.kind}`),
    box.says,
    ...$("box").querySelectorAll(".row"),
    ...fixedNumbers(path),
    ...buttons,
    others.length ? make("p", { className: "ports" }, `Other ports: ${others.join(", ")}`) : "",
  );
}

// Opens a wire that leads to a port: shows how much later its signal may come, and its delay.
function openWire(port) {
  const { wires = {}, margins = {} } = shownLoop();
  const names = (wires[port] ?? []).filter((name) => name in state.inputs);
  const isKnown = port in margins;
  if (!names.length && !isKnown) return;
  const margin = margins[port];
  const words = {
    null: "However late its signal comes, the diagram remains stable.",
    0: "The diagram is unstable as it is.",
  };
  const limit = `Its signal may come up to ${show(margin ?? 0, 3)} s later; then it is unstable.`;
  const basis = " (Linearised where the run begins, with the first numbers.)";
  $("box").className = "wire";
  $("box").replaceChildren(
    make("h2", {}, `wire to ${port.replace(":", " · ")}`),
    isKnown ? (words[margin] ?? limit) + basis : "",
    ...names.map((name) => state.inputs[name].row),
  );
}

// The numbers of a box that cannot be changed here, with the reasons in words.
function fixedNumbers(path) {
  const reasons = {};
  for (const [label, value, why] of state.data.fixed?.[path] ?? []) {
    (reasons[why] ??= []).push(`${label.replace(/ \[.*/, "")} = ${show(value)}`);
  }
  return Object.entries(reasons).map(([why, numbers]) =>
    make("p", { className: "ports" }, `${numbers.join(", ")}: fixed here, as ${why}`),
  );
}

// The tip of a box: its class and its first sentence.
function describeBox(path) {
  const { kind, says } = boxAt(path) ?? {};
  return `${path || state.data.title}: ${kind}\n${says}`;
}

// The tip of a port: its size, its unit and its values at the cursor.
function describePort(port) {
  const place = shownLoop().ports[port];
  if (!place) return port;
  const [, size, unit] = place;
  const margin = shownLoop().margins?.[port];
  const late = margin ? `may come ${show(margin, 3)} s later` : "";
  const seen = state.runs.map((run) => `${run.loop.title}: ${valuesOf(run, port, 4)}`);
  return [port, `[${size}]  ${unit}`, late, ...seen, `at ${show(state.cursor)} s`]
    .filter((line) => line)
    .join("\n");
}

// Handles an event of a pointer or a key in the diagram. A click opens a box or plots a port; other
// events show or hide the tip.
export function answer({ type, target }) {
  const element = target.closest("[data-box], [data-port]");
  $("tip").hidden = !element || /out$/.test(type);
  if ($("tip").hidden) return;
  const { box, port } = element.dataset;
  if (type === "click" && port) {
    toggleScope(port);
    openWire(port);
  }
  if (type === "click" && !port) open(box);
  $("tip").textContent = port ? describePort(port) : describeBox(box);
}

// The paths of all blocks and the names of all ports of a loop.
function namesOf(loop) {
  const boxes = loop.levels.flatMap((level) => level.boxes);
  return [...boxes.map((box) => box.path), ...Object.keys(loop.ports)].filter((name) => name);
}

// The index of a loop and the name in it that a text finds; null if there is none. The name equals
// the text or, if none does in any loop, contains it. The shown loop is searched first.
function search(text) {
  const loops = chosen();
  const places = [state.tab, ...loops.keys()];
  const wanted = text.toLowerCase();
  for (const isFound of [
    (name) => name === text,
    (name) => name.replaceAll("_", " ").toLowerCase().includes(wanted.replaceAll("_", " ")),
  ]) {
    for (const place of places) {
      const name = namesOf(loops[place]).find(isFound);
      if (name) return { place, name };
    }
  }
  return null;
}

// Shows the block or the port that the search finds, in the diagram that contains it.
export function find() {
  const text = $("search").value.trim();
  if (!text) return;
  const found = search(text);
  if (!found) {
    say(`no block or port has \u201c${text}\u201d in its name`, "bad");
    return;
  }
  const [path] = found.name.split(":");
  if (found.place !== state.tab) chooseTab(found.place);
  showLevel(path.split("/").slice(0, -1).join("/"));
  open(path);
  const isPort = found.name in shownLoop().ports;
  if (isPort && !state.scopes.includes(found.name)) toggleScope(found.name);
  say(`found ${found.name} in ${shownLoop().title}`);
  $("search").value = "";
}

// Makes the list of all blocks and ports that the search suggests.
export function makeSearch() {
  const names = new Set(state.loops.flatMap(namesOf));
  $("found").append(...Array.from(names, (value) => make("option", { value })));
  $("search").onchange = find;
}

// Shows the diagram of a controller.
export function chooseTab(place) {
  state.tab = place;
  [...$("tabs").querySelectorAll("button")].forEach((tab, i) => {
    tab.ariaPressed = i === place;
  });
  showLevel(state.level);
}

// Makes the buttons that choose the controller whose diagram is shown.
export function makeTabs() {
  const loops = chosen();
  const tabs = loops.map(({ title }, i) => makeButton(title, () => chooseTab(i)));
  if (loops.length > 1) $("tabs").append("Diagram of ", ...tabs);
  chooseTab(0);
}
