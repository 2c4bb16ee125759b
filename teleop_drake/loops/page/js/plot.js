// The picture of a signal over time, for all runs of a view.
//
// A view has `runs`; `pinned` runs, which are drawn pale; the shown `window` of time; the `loops`
// of the runs; `mostLines`, the largest number of drawn components; `isChange`, whether the values
// at the start of a run are subtracted; and `marks`, lines that belong to no run.

import { make, safe } from "./elements.js";
import { clamp, extent, range, show } from "./numbers.js";
import { componentsOf, scaleAndUnit } from "./units.js";
import { endWords } from "./words.js";

const DASHES = ["", "7 4", "2 3", "9 3 2 3"]; // The dashes of the components of a vector.
export const MOST_LINES = 6;
export const LEFT = 58; // px, room for the numbers of the vertical axis
export const RIGHT = 18;
const TOP = 4;
const BELOW = 18;
const READOUT = 7; // letters of a value at the cursor, if it has a prefix that suits it
const NEAR_LINE = 0.1; // px, the distance from a line that is not seen
const EVENT_ROWS = 6; // for the names of events
const EVENT_LETTER = 6.2; // px, the width of a letter in the name of an event

// The first loop that has a port, and the size and the unit of the port there.
export function placeOf({ loops }, port) {
  const loop = loops.find(({ ports }) => ports[port]);
  const [, size, unit] = loop.ports[port];
  return { loop, size, unit };
}

// Ticks of an axis between two values.
function ticks(low, high, most) {
  const least = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(least));
  const step = [1, 2, 5, 10].find((x) => x * power >= least) * power;
  const first = Math.ceil(low / step);
  return range(Math.floor(high / step) - first + 1).map((i) => (first + i) * step);
}

// Points [t, value - offset] of a signal in the window: the ends of steps, and between them where
// these are far from each other.
function curve(run, column, width, [low, high], offset = 0) {
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
      const isRow = t === run.time[last];
      const value = isRow ? run.rows[last * run.width + column] : run.vector([column], t, s)[0];
      points.push([t, value - offset]);
    }
  }
  return points;
}

// The line of the velocity that the operator commands, for a scope of the tool's velocity.
function commandOf({ runs, window }, port, width) {
  const run = runs.find((x) => x.loop.signals.tool_velocity === port);
  const columns =
    run?.signal("velocity_command") ?? run?.columns("master/surgeon:velocity_command");
  if (!columns) return [];
  return columns.map((column, component) => ({
    points: curve(run, column, width, window),
    color: "currentColor",
    dashes: DASHES[component % DASHES.length],
    className: "command",
  }));
}

// The colour of a component's line: the controller's or, with many components, one for each.
function colorOf({ color }, component, count) {
  if (count <= MOST_LINES) return color;
  const hue = (300 * component) / count;
  return `light-dark(hsl(${hue} 70% 35%), hsl(${hue} 70% 65%))`;
}

// The lines of a port: one for each component of each run, the pinned runs first.
function linesOf(view, port, width) {
  const { runs, pinned, window, mostLines = MOST_LINES, isChange, marks = [] } = view;
  const lines = [...pinned, ...runs].flatMap((run, i) => {
    const columns = (run.columns(port) ?? []).slice(0, mostLines);
    return columns.map((column, component) => ({
      points: curve(run, column, width, window, isChange ? run.rows[column] : 0),
      color: colorOf(run.loop, component, columns.length),
      dashes: DASHES[component % DASHES.length],
      className: i < pinned.length ? "pale" : "",
      hasEnded: i >= pinned.length && run.hasEnded(window[1]),
      end: component ? "" : endWords(run),
    }));
  });
  return [...commandOf(view, port, width), ...lines, ...marks];
}

// The places [x, y] of a line in pixels without those that move it by less than a tolerance.
function simplified(places) {
  if (!places.length) return [];
  let from = places[0];
  let before = from;
  const kept = [from];
  // The slopes of the lines from the last kept place that pass near all places since.
  let low = -Infinity;
  let high = Infinity;
  const keep = (place) => {
    if (place !== from) kept.push(place);
    from = place;
    low = -Infinity;
    high = Infinity;
  };
  for (const place of places) {
    const isJump = place[0] === before[0];
    const slope = (place[1] - from[1]) / (place[0] - from[0]);
    if (isJump || slope < low || slope > high) keep(before);
    if (isJump) keep(place);
    const across = place[0] - from[0];
    if (across > 0) {
      low = Math.max(low, (place[1] - NEAR_LINE - from[1]) / across);
      high = Math.min(high, (place[1] + NEAR_LINE - from[1]) / across);
    }
    before = place;
  }
  keep(before);
  return kept;
}

// A place in pixels with one decimal.
const rounded = (x) => Math.round(10 * x) / 10;

// The axes of a picture: the range of its values, and the maps of a time and a value to pixels.
function axesOf(lines, [begin, end], unit, width, height) {
  const ranges = lines.map(({ points }) => extent(points, ([, value]) => value));
  const known = extent(ranges.flat());
  const [least, most] = known[0] > known[1] ? [-1, 1] : known;
  const [scale, shownUnit] = scaleAndUnit([least, most], unit);
  const gap = 0.06 * (most - least) || 0.01 * Math.abs(most) || 0.5;
  const low = least - gap;
  const high = most + gap;
  // Readouts at the cursor have four digits of the largest value.
  const largest = scale * Math.max(Math.abs(least), Math.abs(most));
  const decimals = clamp(3 - Math.floor(Math.log10(largest || 1)), 0, 9);
  const wide = width - LEFT - RIGHT;
  const tall = height - BELOW - TOP - 2;
  return {
    low,
    high,
    scale,
    unit: shownUnit,
    decimals,
    width: Math.max(READOUT, 1 + largest.toFixed(decimals).length),
    bottom: height - BELOW,
    x: (t) => rounded(((t - begin) / (end - begin)) * wide),
    y: (value) => rounded(TOP + ((high - value) / (high - low)) * tall),
  };
}

// The marks of the vertical axis with their lines, and the marks of time.
function drawAxes({ low, high, scale, x, y }, window, width, height) {
  const values = ticks(low, high, 5).map(
    (v) =>
      `<text x="${LEFT - 6}" y="${y(v)}" dy="4" text-anchor="end">${show(scale * v)}</text>
      <path class="${v ? "" : "zero"}" d="M${LEFT} ${y(v)}H${width}"/>`,
  );
  const times = ticks(...window, width / 90).map(
    (t) =>
      `<text x="${LEFT + x(t)}" y="${height - 4}" text-anchor="middle">
      ${show(t)} s</text>`,
  );
  return values.join("") + times.join("");
}

// The names of events in words.
const EVENT_WORDS = { surgeon_force: "operator holds a force", surgeon_stop: "operator stops" };

// The lines of events, and their names: the first event of each name and controller has one.
function drawEvents({ runs, window }, { x, bottom }, width) {
  const all = runs.flatMap(({ events, loop }) =>
    events.map((event) => ({ ...event, color: loop.color })),
  );
  const isShown = ({ time }) => time >= window[0] && time <= window[1];
  const firsts = new Map();
  for (const event of all.filter(isShown)) {
    const key = `${event.name} ${event.color}`;
    if (!firsts.has(key)) firsts.set(key, event);
  }
  const lines = all.map(
    ({ time, color }) => `<path class="event" d="M${x(time)} 0v${bottom}" stroke="${color}"/>`,
  );
  // A name that would overlap another one is below it; it is left out if there is no room.
  const labels = [];
  const ends = Array(EVENT_ROWS).fill(-Infinity);
  const names = [...firsts.values()].sort((a, b) => a.time - b.time);
  for (const { name, time, color } of names) {
    const text = EVENT_WORDS[name] ?? name.replaceAll("_", " ");
    const wide = EVENT_LETTER * text.length;
    const left = Math.min(x(time) + 3, width - LEFT - RIGHT - wide);
    const row = ends.findIndex((end) => end <= left);
    if (row < 0) continue;
    labels.push(`<text class="name" x="${left}" y="${11 + 12 * row}"
      style="fill: ${color}">${safe(text)}</text>`);
    ends[row] = left + wide + 6;
  }
  return [lines.join(""), labels.join("")];
}

// A cross at the end of each line of a run that ended early, and how it ended at its first one.
function drawEnds(lines, { x, y }, width) {
  return lines.flatMap(({ points, color, hasEnded, end }) => {
    if (!hasEnded || !points.length) return [];
    const [t, value] = points.at(-1);
    const across = x(t);
    const down = y(value);
    const wide = EVENT_LETTER * end.length;
    const left = Math.min(across + 8, width - LEFT - RIGHT - wide);
    const cross = `M${across - 5} ${down - 5}l10 10m-10 0l10 -10`;
    return `<path class="end" d="${cross}" stroke="${color}"/>
      <text class="name" x="${left}" y="${clamp(down - 6, 25, Infinity)}">${end}</text>`;
  });
}

// The scope of a port: its axes, its SVG, and whether it has a command.
export function plot(view, port, width, height) {
  const { window } = view;
  const lines = linesOf(view, port, width);
  const axes = axesOf(lines, window, placeOf(view, port).unit, width, height);
  const { x, y, bottom } = axes;
  const curves = lines.map(({ points, color, dashes, className }) => {
    const places = simplified(points.map(([t, value]) => [x(t), y(value)]));
    return `<polyline class="${className}" points="${places.join(" ")}" stroke="${color}"
      stroke-dasharray="${dashes}"/>`;
  });
  const [events, names] = drawEvents(view, axes, width);
  const svg = `${drawAxes(axes, window, width, height)}
    <svg x="${LEFT}" width="${width - LEFT}" height="${bottom}">
    ${events}${curves.join("")}${names}
    ${drawEnds(lines, axes, width).join("")}</svg>`;
  const hasCommand = lines.some(({ className }) => className === "command");
  return { ...axes, svg, hasCommand };
}

// A legend entry: a sample of a line with a name.
export function sampleOf(name, dashes, className = "") {
  const sample = make("span", {}, `${name} `);
  const line = `<line class="${className}" x2="26" y1="3" y2="3" stroke-dasharray="${dashes}"/>`;
  sample.insertAdjacentHTML("beforeend", `<svg aria-hidden="true">${line}</svg>`);
  return sample;
}

// The legend entries of a port's components; a scalar has none.
export function samplesOf(view, port) {
  const { loop, size } = placeOf(view, port);
  if (size === 1) return [];
  const names = componentsOf(loop, port, size).slice(0, MOST_LINES);
  return names.map((name, i) => sampleOf(name, DASHES[i % DASHES.length]));
}
