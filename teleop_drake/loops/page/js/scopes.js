// The scopes: a picture of each signal over time, for all runs.

import { onCursor, setCursor } from "./clock.js";
import { $, keyOf, make, makeButton, safe } from "./elements.js";
import { clamp, show } from "./numbers.js";
import { LEFT, MOST_LINES, RIGHT, placeOf, plot, sampleOf, samplesOf } from "./plot.js";
import { shownLoop, state, wholeTime } from "./state.js";
import { componentsOf } from "./units.js";

// The scaled values of a port at the cursor, with the names of its components.
export function valuesOf(run, port, most, scale = 1) {
  const columns = run.columns(port) ?? [];
  if (run.hasEnded(state.cursor)) return "has ended";
  const names = componentsOf(port, columns.length);
  const values = run.vector(columns.slice(0, most), state.cursor);
  const text = values.map((value, i) => `${names[i]} ${show(scale * value, 3)}`.trim()).join(", ");
  return columns.length > most ? `${text} ...` : text;
}

// Puts a signal into the scopes, or takes it out.
export function toggleScope(port) {
  if (!state.loops.some((loop) => loop.ports[port])) return;
  const isShown = state.scopes.includes(port);
  state.scopes = isShown ? state.scopes.filter((x) => x !== port) : [port, ...state.scopes];
  makeScopes();
}

// Makes a picture for each signal in the scopes.
export function makeScopes() {
  $("scopes").replaceChildren(...state.scopes.map(makeScope));
  markPorts();
  drawScopes();
}

// Makes the picture of a port, in which a pointer moves the cursor and a wheel zooms.
function makeScope(port) {
  const scope = make("div", { className: "scope" }, make("div", { className: "head" }));
  scope.insertAdjacentHTML("beforeend", `<svg role="img" aria-label="${safe(port)}"></svg>`);
  scope.dataset.port = port;
  const svg = scope.lastElementChild;
  const timeAt = (event) => {
    const [begin, end] = state.window;
    const { left, width } = svg.getBoundingClientRect();
    const share = (event.clientX - left - LEFT) / (width - LEFT - RIGHT);
    return begin + (end - begin) * clamp(share, 0, 1);
  };
  svg.onpointerdown = svg.onpointermove = (event) => {
    if (event.buttons) setCursor(timeAt(event));
  };
  svg.onwheel = (event) => {
    event.preventDefault();
    zoom(1.2 ** Math.sign(event.deltaY), timeAt(event));
  };
  svg.ondblclick = () => zoom(Infinity, 0);
  return scope;
}

// Marks the ports and wires of the diagram whose signals are in the scopes.
export function markPorts() {
  const { ports } = shownLoop();
  const columnsOf = (port) => String(ports[port] ?? port);
  const shown = state.scopes.map(columnsOf);
  for (const element of $("level").querySelectorAll("[data-port]")) {
    element.classList.toggle("on", shown.includes(columnsOf(element.dataset.port)));
  }
}

// Shows more or less of the time around an instant.
export function zoom(factor, around) {
  const [begin, end] = state.window;
  const [first, last] = wholeTime();
  const low = Math.max(first, around - (around - begin) * factor);
  const high = Math.min(last, around + (end - around) * factor);
  const isPart = high - low < last - first && high > low;
  state.window = isPart ? [low, high] : [first, last];
  drawScopes();
}

// The values of a run at the cursor, of a width that does not depend on them.
function readoutOf(run, port, size, scale) {
  const element = keyOf(run.loop, valuesOf(run, port, 3, scale));
  const width = run.loop.title.length + 3 + 9 * Math.min(size, 3);
  return Object.assign(element, { style: `display: inline-block; min-width: ${width}ch` });
}

// The head of a scope: its port, its unit, the legend of its lines, and the values at the cursor.
function drawHead(head, port, { scale, unit, hasCommand }) {
  const { size } = placeOf(state, port);
  head.replaceChildren(
    make("b", {}, port.replace(":", " · ").replace(/^ · /, "").replaceAll("_", " ")),
    unit ? `[${unit}]` : "",
    size > MOST_LINES ? `${MOST_LINES} of ${size}` : "",
    ...samplesOf(port, size),
    hasCommand ? sampleOf("command", "", "command") : "",
    ...state.runs.map((run) => readoutOf(run, port, size, scale)),
    makeButton("×", () => toggleScope(port), { ariaLabel: `remove ${port}` }),
  );
}

// Draws all scopes; their lines only if anything but the cursor has changed.
export function drawScopes() {
  if (!state.runs.length) return;
  const [begin, end] = state.window;
  for (const scope of $("scopes").children) {
    const { port } = scope.dataset;
    const [head, svg] = scope.children;
    const { clientWidth: width, clientHeight: height } = svg;
    const basis = [state.runs, state.pinned, state.runs[0].ends.length, begin, end, width];
    if (basis.some((value, i) => value !== scope.basis?.[i])) {
      scope.basis = basis;
      scope.plotted = plot(state, port, width, height);
      svg.innerHTML = scope.plotted.svg;
    }
    const x = ((state.cursor - begin) / (end - begin)) * (width - LEFT - RIGHT);
    svg.querySelector(".cursor").setAttribute("transform", `translate(${x})`);
    drawHead(head, port, scope.plotted);
  }
}

// Pins the current runs, which remain in the scopes as pale lines, or unpins them.
export function togglePin() {
  state.pinned = state.pinned.length ? [] : state.runs;
  $("pin").textContent = state.pinned.length ? "Unpin" : "Pin these runs";
  drawScopes();
}

onCursor(drawScopes);
