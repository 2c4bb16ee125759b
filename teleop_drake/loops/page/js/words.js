// What a run did, in words. tasks/sentences.py has the same rules and words.

import { keyOf, make } from "./elements.js";
import { AXES, scaleAndUnit } from "./units.js";

const HARDER = 1.05; // A later force is told if it exceeds the first impact by this factor.

// A value with two significant digits or as a whole number, and its unit, as in "8.7 mN".
export function quantity(value, unit) {
  const [scale, shown] = scaleAndUnit([value, value], unit);
  const x = value * scale;
  return `${Math.abs(x) >= 9.95 ? x.toFixed(0) : x.toPrecision(2)} ${shown}`.trim();
}

// A text that begins with a capital.
export const capital = (text) => text[0].toUpperCase() + text.slice(1);

// The time from the start of a run to its end.
const durationOf = ({ time, startTime }) => quantity(time.at(-1) - startTime, "s");

// The words at the end of a curve of a run that ended early, as in "ran away at 1.8 s".
export function endWords({ reason, hasRunAway, loop, time }) {
  const known = loop.reasons.includes(reason) ? "ended" : "stopped";
  return `${hasRunAway ? "ran away" : known} at ${quantity(time.at(-1), "s")}`;
}

// How a run ended that did not reach its end, as in "ran away after 1.8 s"; "" for any other.
export function endInWords(run) {
  const { reason, hasRunAway, loop } = run;
  if (!reason) return "";
  if (hasRunAway) return `ran away after ${durationOf(run)}`;
  if (loop.reasons.includes(reason)) return `ended after ${durationOf(run)}, where ${reason}`;
  return `cannot be simulated beyond ${durationOf(run)}`;
}

// A metric for each axis of the task, as in "x 63 mm, y 0.11 m".
function perAxis({ metrics, loop }, name) {
  const axes = AXES.filter((axis) => `${name}.${axis}` in metrics);
  const parts = axes.map((axis) => {
    const [, unit] = /\[(.*)\]/.exec(loop.labels[`${name}.${axis}`]);
    const value = quantity(metrics[`${name}.${axis}`], unit);
    return axes.length > 1 ? `${axis} ${value}` : value;
  });
  return parts.join(", ");
}

// The name of the material behind a surface, or as many surfaces before it.
function materialAt({ loop: { surfaces, materials } }, name, before = 0) {
  return materials[surfaces.indexOf(name) - before] || "surface";
}

// The clauses on an insertion.
function insertionInWords(run) {
  const { metrics, loop } = run;
  const first = metrics["collision.initial_impact_force"];
  const largest = metrics["collision.peak_force"];
  const rest = metrics["collision.rest_time"];
  const puncture = metrics["puncture.time"];
  const end = endInWords(run);
  const hasHit = first !== undefined;
  const clauses = [];
  if (hasHit) {
    clauses.push(`hit the ${materialAt(run, "contact")} with ${quantity(first, "N")}`);
    if (largest > HARDER * first) clauses.push(`later with up to ${quantity(largest, "N")}`);
  } else if (puncture !== undefined) {
    const tissue = materialAt(run, "puncture", 1);
    clauses.push(`went through the ${tissue} at ${quantity(puncture, "s")}`);
  }
  if (!loop.surfaces.length) {
    const errors = perAxis(run, "velocity_rms_error");
    clauses.push(`followed the commanded velocity to within ${errors} (rms)`);
  }
  if (end) clauses.push(end);
  else if (rest !== undefined) clauses.push(`came to rest after ${quantity(rest, "s")}`);
  else if (hasHit) clauses.push("did not come to rest");
  else if (loop.surfaces.includes("contact")) {
    clauses.push(`did not reach the ${materialAt(run, "contact")}`);
  }
  return clauses.length ? clauses : [`ran for ${durationOf(run)}`];
}

// The clauses on a tracking.
function trackingInWords(run) {
  const end = endInWords(run);
  const clauses = [`followed the path to within ${perAxis(run, "max_error")}`];
  return end ? [...clauses, end] : clauses;
}

const CLAUSES = { insertion: insertionInWords, tracking: trackingInWords };

// A sentence on a run of a task, whose subject is the controller.
export function sentenceOf(run) {
  const title = run.loop.title.split(":").at(-1);
  const clausesOf = CLAUSES[run.loop.metrics];
  const clauses = clausesOf ? clausesOf(run) : [endInWords(run) || `ran for ${durationOf(run)}`];
  const last = clauses.pop();
  // With three clauses, a comma stands before "and", too.
  const link = clauses.length > 1 ? ", and " : " and ";
  const said = clauses.length ? clauses.join(", ") + link + last : last;
  return `${capital(title)} ${said}.`;
}

// The sentences on runs, each with a line in the colour of its controller.
export function sentencesOn(runs) {
  return runs.map((run) =>
    make("span", {}, keyOf({ ...run.loop, title: "" }), sentenceOf(run), " "),
  );
}
