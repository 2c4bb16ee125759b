// The table of metrics.

import { $, keyOf, make } from "./elements.js";
import { show } from "./numbers.js";
import { state } from "./state.js";

const rowOf = (tag, ...cells) => make("tr", {}, ...cells.map((cell) => make(tag, {}, cell)));

// Shows the metrics of each controller, and how it ended.
export function showMetrics() {
  const { runs } = state;
  const labels = Object.assign({}, ...runs.map((run) => run.loop.labels));
  const names = Object.keys(labels).filter((name) => runs.some((run) => name in run.metrics));
  const rows = names.map((name) =>
    rowOf("td", labels[name], ...runs.map((run) => show(run.metrics[name]))),
  );
  if (runs.some((run) => run.reason)) {
    const ends = runs.map(({ reason, time }) => reason && `${show(time.at(-1))} s: ${reason}`);
    rows.unshift(rowOf("td", "ended at", ...ends));
  }
  if (rows.length) rows.unshift(rowOf("th", "", ...runs.map((run) => keyOf(run.loop))));
  $("metrics").replaceChildren(...(rows.length ? [make("table", {}, ...rows)] : []));
}
