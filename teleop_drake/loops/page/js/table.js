// The table of metrics.

import { $, keyOf, make } from "./elements.js";
import { extent, show } from "./numbers.js";
import { state } from "./state.js";
import { scaleAndUnit } from "./units.js";

// The metrics at the top, as far as a task has them. Other metrics take the place of missing ones.
const MAIN = [
  "start_velocity_overshoot",
  "puncture.velocity_overshoot",
  "collision.velocity",
  "collision.peak_force",
  "collision.rebound_velocity",
  "collision.rest_time",
];

const rowOf = (tag, ...cells) => make("tr", {}, ...cells.map((cell) => make(tag, {}, cell)));

const units = {}; // The scale and the unit of each metric.

// The row of a metric, in a unit that suits its first values.
function rowOfMetric(name, label) {
  const values = state.runs.map((run) => run.metrics[name]);
  const [, title, unit = ""] = /^(.*?)(?: \[(.*)\])?$/.exec(label);
  units[name] ??= scaleAndUnit(extent(values.filter(Number.isFinite)), unit);
  const [scale, shownUnit] = units[name];
  const missing = name.endsWith("time") ? "never" : "–";
  const texts = values.map((value) => (value === undefined ? missing : show(scale * value)));
  return rowOf("td", shownUnit ? `${title} [${shownUnit}]` : title, ...texts);
}

// The rows of some metrics.
function rowsOf(names, labels) {
  return names.map((name) => rowOfMetric(name, labels[name]));
}

// The row with the times and reasons of early ends.
function endsOf(runs) {
  if (!runs.some((run) => run.reason)) return [];
  const ends = runs.map(({ reason, time }) => reason && `${show(time.at(-1))} s: ${reason}`);
  return [rowOf("td", "ended at", ...ends)];
}

// Shows the early ends and the metrics of all runs: six metrics, the rest in a folded table.
export function showMetrics() {
  const { runs } = state;
  const labels = Object.assign({}, ...runs.map((run) => run.loop.labels));
  const names = Object.keys(labels).filter((name) => runs.some((run) => name in run.metrics));
  const main = MAIN.filter((name) => names.includes(name));
  const others = names.filter((name) => !main.includes(name));
  main.push(...others.splice(0, MAIN.length - main.length));
  const tableOf = (rows) =>
    make("table", {}, rowOf("th", "metric", ...runs.map((run) => keyOf(run.loop))), ...rows);
  const isOpen = $("metrics").querySelector("details")?.open ?? false;
  const parts = [];
  const first = [...endsOf(runs), ...rowsOf(main, labels)];
  if (first.length) parts.push(tableOf(first));
  if (others.length) {
    const summary = make("summary", {}, `${others.length} more metrics`);
    parts.push(make("details", { open: isOpen }, summary, tableOf(rowsOf(others, labels))));
  }
  $("metrics").replaceChildren(...parts);
}
