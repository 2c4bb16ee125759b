// The scopes: a picture of each signal over time, for all runs.

import { onCursor, setCursor } from "./clock.js";
import { $, keyOf, make, makeButton, safe } from "./elements.js";
import { clamp, show } from "./numbers.js";
import { LEFT, MOST_LINES, RIGHT, placeOf, plot, sampleOf, samplesOf } from "./plot.js";
import { shownLoop, state, wholeTime } from "./state.js";
import { componentsOf } from "./units.js";

// The values of a port at the cursor as texts, with the names of its components.
export function valuesOf(run, port, most, textOf = (value) => show(value, 3)) {
  const columns = run.columns(port) ?? [];
  if (run.hasEnded(state.cursor)) return "has ended";
  const names = componentsOf(run.loop, port, columns.length);
  const values = run.vector(columns.slice(0, most), state.cursor);
  const text = values.map((value, i) => `${names[i]} ${textOf(value)}`.trim()).join(", ");
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
  const picture = `<svg role="img" aria-label="${safe(port)}"></svg><div class="cursor"></div>`;
  scope.insertAdjacentHTML("beforeend", picture);
  scope.dataset.port = port;
  const [, svg] = scope.children;
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

// The place for the values of a run at the cursor, of a width that does not depend on them.
function makeReadout(run, port, size, { width }) {
  const names = componentsOf(run.loop, port, size).slice(0, 3);
  const letters = names.reduce((sum, name) => sum + name.length + width + 3, 0);
  const style = `width: ${Math.max(9, letters)}ch`;
  const readout = make("span", { className: "readout", style });
  const element = keyOf(run.loop);
  element.append(readout);
  return element;
}

// The head of a scope: its port, its unit, the legend of its lines, and places for the values at
// the cursor.
function makeHead(head, port, plotted) {
  const { unit, hasCommand } = plotted;
  const { size } = placeOf(state, port);
  head.replaceChildren(
    make("b", {}, port.replace(":", " · ").replace(/^ · /, "").replaceAll("_", " ")),
    [unit && `[${unit}]`, size > MOST_LINES && `${MOST_LINES} of ${size}`]
      .filter(Boolean)
      .join(" "),
    ...samplesOf(state, port),
    hasCommand ? sampleOf("command", "", "command") : "",
    ...state.runs.map((run) => makeReadout(run, port, size, plotted)),
    makeButton("×", () => toggleScope(port), { ariaLabel: `remove ${port}` }),
  );
}

// Draws the lines and the head of a scope.
function drawLines(scope, width, height) {
  const { port } = scope.dataset;
  const [head, svg] = scope.children;
  scope.plotted = plot(state, port, width, height);
  svg.innerHTML = scope.plotted.svg;
  makeHead(head, port, scope.plotted);
}

// Shows the cursor and its values in a scope.
function drawCursor(scope, width) {
  const { port } = scope.dataset;
  const [head, , cursor] = scope.children;
  const [begin, end] = state.window;
  const share = (state.cursor - begin) / (end - begin);
  cursor.hidden = share < 0 || share > 1;
  cursor.style.transform = `translateX(${LEFT + share * (width - LEFT - RIGHT)}px)`;
  const { scale, decimals } = scope.plotted;
  const textOf = (value) => (scale * value).toFixed(decimals);
  [...head.querySelectorAll(".readout")].forEach((readout, i) => {
    readout.textContent = valuesOf(state.runs[i], port, 3, textOf);
  });
}

// Draws all scopes; their lines only if anything but the cursor has changed.
export function drawScopes() {
  if (!state.runs.length) return;
  const scopes = [...$("scopes").children];
  // All sizes are read before anything is written, because writing changes the layout.
  const sizes = scopes.map(({ children: [, svg] }) => [svg.clientWidth, svg.clientHeight]);
  scopes.forEach((scope, i) => {
    const basis = [
      state.runs,
      state.pinned,
      state.runs[0].ends.length,
      ...state.window,
      ...sizes[i],
    ];
    if (basis.some((value, k) => value !== scope.basis?.[k])) {
      scope.basis = basis;
      drawLines(scope, ...sizes[i]);
    }
    drawCursor(scope, sizes[i][0]);
  });
}

// Pins the current runs, which remain in the scopes as pale lines, or unpins them.
export function togglePin() {
  state.pinned = state.pinned.length ? [] : state.runs;
  $("pin").textContent = state.pinned.length ? "Unpin" : "Pin these runs";
  drawScopes();
}

onCursor(drawScopes);
