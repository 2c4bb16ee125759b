// The block diagram: levels that open, ports and wires that are plotted.

import { $, make, makeButton } from "./elements.js";
import { show } from "./numbers.js";
import { markPorts, toggleScope, valuesOf } from "./scopes.js";
import { shownLoop, state } from "./state.js";

// The box of a path in the diagram that is shown.
function boxAt(path) {
  const boxes = shownLoop().levels.flatMap((level) => level.boxes);
  return boxes.find((box) => box.path === path);
}

// Shows a level of the diagram of the controller that is chosen.
export function showLevel(path) {
  const { levels } = shownLoop();
  const level = levels.find((x) => x.path === path) ?? levels[0];
  state.level = level.path;
  $("diagram").innerHTML = new TextDecoder().decode(level.svg);
  const parts = ["", ...level.path.split("/").filter((x) => x)];
  const crumbs = parts.map((part, i) => {
    const goTo = () => showLevel(parts.slice(1, i + 1).join("/"));
    return makeButton(part || "loop", goTo, { disabled: i === parts.length - 1 });
  });
  $("crumbs").replaceChildren(...crumbs);
  markPorts();
}

// Shows the level around the one that is shown.
export function goUp() {
  showLevel(state.level.split("/").slice(0, -1).join("/"));
}

// Opens a box: shows what it is, its ports and its inputs.
function open(path) {
  const loop = shownLoop();
  const box = boxAt(path);
  const [block] = path.split("/");
  if (path !== state.level && loop.levels.some((x) => x.path === path)) showLevel(path);
  for (const { row, owners } of Object.values(state.inputs)) {
    $(owners.includes(block) ? "box" : "inputs").append(row);
  }
  const ports = [...box.u, ...box.y].filter((name) => loop.ports[`${path}:${name}`]);
  const buttons = ports.map((name) => makeButton(name, () => toggleScope(`${path}:${name}`)));
  $("box").replaceChildren(
    make("h2", {}, `${path || state.data.title}: ${box.kind}`),
    box.says,
    ...$("box").querySelectorAll(".row"),
    ...buttons,
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
  const seen = state.runs.map((run) => `${run.loop.title}: ${valuesOf(run, port, 4)}`);
  return [port, `[${size}]  ${unit}`, ...seen, `at ${show(state.cursor)} s`].join("\n");
}

// Answers to a pointer or the keys in the diagram: a click opens a box or plots a port; all else
// shows or hides the tip.
export function answer({ type, target }) {
  const element = target.closest("[tabindex]");
  $("tip").hidden = !element || /out$/.test(type);
  if ($("tip").hidden) return;
  const { box, port } = element.dataset;
  if (type === "click" && port) toggleScope(port);
  if (type === "click" && !port) open(box);
  $("tip").textContent = port ? describePort(port) : describeBox(box);
}

// Goes to the block or the port that the search names.
export function find() {
  const text = $("search").value;
  const [path] = text.split(":");
  if (!path || !boxAt(path)) return;
  showLevel(path.split("/").slice(0, -1).join("/"));
  open(path);
  if (text in shownLoop().ports && !state.scopes.includes(text)) toggleScope(text);
  $("search").value = "";
}
