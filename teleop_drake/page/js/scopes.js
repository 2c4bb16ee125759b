// The scopes: a picture of each signal over time, for all runs.

import { onCursor, setCursor } from "./clock.js";
import { $, keyOf, make, makeButton, safe } from "./elements.js";
import { clamp, extent, range, show } from "./numbers.js";
import { duration, shownLoop, state } from "./state.js";
import { componentsOf, scaleAndUnit } from "./units.js";

const DASHES = ["", "7 4", "2 3", "9 3 2 3"]; // Of the components of a vector.
const MOST_LINES = 6;
const LEFT = 58; // px, room for the numbers of the vertical axis
const RIGHT = 18;
const TOP = 4;
const BELOW = 18;
const EVENT_LETTER = 6.2; // px, the width of a letter in the name of an event

// The values of a port at the cursor with the names of its components, in a unit.
export function valuesOf(run, port, most, scale = 1) {
  const columns = run.columns(port) ?? [];
  const names = componentsOf(port, columns.length);
  const values = run.vector(columns.slice(0, most), state.cursor);
  const text = values.map((value, i) => `${names[i]} ${show(scale * value, 3)}`.trim()).join(", ");
  return columns.length > most ? `${text} ...` : text;
}

// The size and the unit of a port, of the first loop that has it.
export function placeOf(port) {
  const [, size, unit] = state.loops.map((loop) => loop.ports[port]).find((place) => place);
  return { size, unit };
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
  const whole = duration();
  const low = Math.max(0, around - (around - begin) * factor);
  const high = Math.min(whole, around + (end - around) * factor);
  const isPart = high - low < whole && high > low;
  state.window = isPart ? [low, high] : [0, whole];
  drawScopes();
}

// Ticks of an axis between two values.
function ticks(low, high, most) {
  const least = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(least));
  const step = [1, 2, 5, 10].find((x) => x * power >= least) * power;
  const first = Math.ceil(low / step);
  return range(Math.floor(high / step) - first + 1).map((i) => (first + i) * step);
}

// Points [t, value] of a signal in the window: the ends of steps, and between them where these are
// far from each other.
function curve(run, column, width) {
  const [low, high] = state.window;
  const spacing = ((high - low) / width) * 3;
  const points = [];
  for (let s = run.step(low + 1e-12); s < run.ends.length; ++s) {
    const last = run.ends[s];
    if (run.time[last - 4] > high) break;
    const begin = Math.max(run.time[last - 4], low);
    const end = Math.min(run.time[last], high);
    const count = clamp(Math.ceil((end - begin) / spacing), 1, 60);
    // Where nothing jumps, a step begins with the end of the one before.
    const isKnown = points.length > 0 && last - run.ends[s - 1] === 4;
    for (let j = isKnown ? 1 : 0; j <= count; ++j) {
      const t = begin + (j * (end - begin)) / count;
      points.push([t, run.vector([column], t, s)[0]]);
    }
  }
  return points;
}

// The line of the velocity that the operator commands, for a scope of the tool's velocity.
function commandOf(port, width) {
  const run = state.runs.find((x) => x.loop.signals.tool_velocity === port);
  const columns =
    run?.signal("velocity_command") ?? run?.columns("master/surgeon:velocity_command");
  if (!columns) return [];
  return columns.map((column, component) => ({
    points: curve(run, column, width),
    color: "currentColor",
    dashes: DASHES[component % DASHES.length],
    className: "command",
  }));
}

// The lines of a port: of each run, pinned ones first, and each component.
function linesOf(port, width) {
  const runs = [...state.pinned, ...state.runs].flatMap((run, i) => {
    const columns = (run.columns(port) ?? []).slice(0, MOST_LINES);
    return columns.map((column, component) => ({
      points: curve(run, column, width),
      color: run.loop.color,
      dashes: DASHES[component % DASHES.length],
      className: i < state.pinned.length ? "pale" : "",
    }));
  });
  return [...commandOf(port, width), ...runs];
}

// What maps a time and a value to pixels, with the range of the values, for lines in a picture.
function axesOf(lines, unit, width, height) {
  const [begin, end] = state.window;
  const known = extent(lines.flatMap(({ points }) => points.map(([, value]) => value)));
  const [least, most] = known[0] > known[1] ? [-1, 1] : known;
  const [scale, shownUnit] = scaleAndUnit([least, most], unit);
  const gap = 0.06 * (most - least) || 0.01 * Math.abs(most) || 0.5;
  const low = least - gap;
  const high = most + gap;
  const wide = width - LEFT - RIGHT;
  const tall = height - BELOW - TOP - 2;
  return {
    low,
    high,
    scale,
    unit: shownUnit,
    bottom: height - BELOW,
    x: (t) => (((t - begin) / (end - begin)) * wide).toFixed(1),
    y: (value) => (TOP + ((high - value) / (high - low)) * tall).toFixed(1),
  };
}

// The marks of the vertical axis with their lines, and those of time.
function drawAxes({ low, high, scale, x, y }, width, height) {
  const values = ticks(low, high, 5).map(
    (v) =>
      `<text x="${LEFT - 6}" y="${y(v)}" dy="4" text-anchor="end">${show(scale * v)}</text>
      <path class="${v ? "" : "zero"}" d="M${LEFT} ${y(v)}H${width}"/>`,
  );
  const times = ticks(...state.window, width / 90).map(
    (t) =>
      `<text x="${LEFT + Number(x(t))}" y="${height - 4}" text-anchor="middle">
      ${show(t)} s</text>`,
  );
  return values.join("") + times.join("");
}

// The lines of events, each with its name at the first of that name.
function drawEvents({ x, bottom }, width) {
  const all = state.runs.flatMap(({ events, loop }) =>
    events.map((event) => ({ ...event, color: loop.color })),
  );
  const isShown = ({ time }) => time >= state.window[0] && time <= state.window[1];
  const firsts = new Map();
  for (const event of all.filter(isShown)) {
    if (!firsts.has(event.name)) firsts.set(event.name, event);
  }
  const lines = all.map(
    ({ time, color }) => `<path class="event" d="M${x(time)} 0v${bottom}" stroke="${color}"/>`,
  );
  // Names that would overlap are left out.
  let right = -Infinity;
  const names = [...firsts.values()].sort((a, b) => a.time - b.time);
  for (const { name, time } of names) {
    const text = name.replaceAll("_", " ");
    const wide = EVENT_LETTER * text.length;
    const left = Math.min(Number(x(time)) + 3, width - LEFT - RIGHT - wide);
    if (left < right) continue;
    lines.push(`<text class="name" x="${left}" y="11">${safe(text)}</text>`);
    right = left + wide + 6;
  }
  return lines.join("");
}

// The scope of a port: its SVG, the scale and the unit of its axis, and whether it has a command.
function plot(port, width, height) {
  const lines = linesOf(port, width);
  const axes = axesOf(lines, placeOf(port).unit, width, height);
  const { x, y, bottom } = axes;
  const curves = lines.map(({ points, color, dashes, className }) => {
    const places = points.map(([t, value]) => `${x(t)},${y(value)}`).join(" ");
    return `<polyline class="${className}" points="${places}" stroke="${color}"
      stroke-dasharray="${dashes}"/>`;
  });
  const svg = `${drawAxes(axes, width, height)}
    <svg x="${LEFT}" width="${width - LEFT}" height="${bottom}">
    ${drawEvents(axes, width)}${curves.join("")}<path class="cursor" d="M0 0v${bottom}"/></svg>`;
  const hasCommand = lines.some(({ className }) => className === "command");
  return { svg, scale: axes.scale, unit: axes.unit, hasCommand };
}

// A sample of a line with the name of what it shows.
function sampleOf(name, dashes, className = "") {
  const sample = make("span", {}, `${name} `);
  const line = `<line class="${className}" x2="26" y1="3" y2="3" stroke-dasharray="${dashes}"/>`;
  sample.insertAdjacentHTML("beforeend", `<svg aria-hidden="true">${line}</svg>`);
  return sample;
}

// The head of a scope: its port, its unit, what its lines are, and the values at the cursor.
function drawHead(head, port, { scale, unit, hasCommand }) {
  const { size } = placeOf(port);
  const components = size > 1 ? componentsOf(port, size).slice(0, MOST_LINES) : [];
  head.replaceChildren(
    make("b", {}, port.replace(":", " · ").replaceAll("_", " ")),
    unit ? `[${unit}]` : "",
    size > MOST_LINES ? `${MOST_LINES} of ${size}` : "",
    ...components.map((name, i) => sampleOf(name, DASHES[i % DASHES.length])),
    hasCommand ? sampleOf("command", "", "command") : "",
    ...state.runs.map((run) => keyOf(run.loop, valuesOf(run, port, 3, scale))),
    makeButton("×", () => toggleScope(port), { ariaLabel: `remove ${port}` }),
  );
}

// Draws all scopes, their lines only if more than the cursor has moved.
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
      scope.plotted = plot(port, width, height);
      svg.innerHTML = scope.plotted.svg;
    }
    const x = ((state.cursor - begin) / (end - begin)) * (width - LEFT - RIGHT);
    svg.querySelector(".cursor").setAttribute("transform", `translate(${x})`);
    drawHead(head, port, scope.plotted);
  }
}

// Retains the runs of now in the scopes, pale, or removes them.
export function togglePin() {
  state.pinned = state.pinned.length ? [] : state.runs;
  $("pin").textContent = state.pinned.length ? "Unpin" : "Pin these runs";
  drawScopes();
}

onCursor(drawScopes);
