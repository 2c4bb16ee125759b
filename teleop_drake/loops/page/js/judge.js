// The thesis's claims on the current runs. A claim is data: relations between metrics of both
// controllers, by the rules of thesis/claims/relation.py. A claim without relations is judged in
// Python, at the thesis's settings.

import { measure } from "./metrics.js";
import { show } from "./numbers.js";
import { AXES } from "./units.js";
import { endInWords } from "./words.js";

const CASE_I = "two_dof_puncture";
const WORKSPACE_END = 1.4; // m, the position x at which runs of case I are cut; see thesis/runs.py
const SCALES = { mm: 1e3, "mm/s": 1e3, mN: 1e3, "%": 1e2 };
const SETTLING = "collision.settling_time"; // infinite for a run that does not have it

const HOLDS = {
  "<": (x, y) => x < y,
  ">": (x, y) => x > y,
  "=": (x, y, tolerance) => Math.abs(x / y - 1) < tolerance,
};

// A number in a unit.
function inUnit(x, unit) {
  return Number.isFinite(x) ? show((SCALES[unit] ?? 1) * x, 4) : "not in the run";
}

// A number in a unit of the thesis, in SI units.
export const inSi = (x, unit) => x / (SCALES[unit] ?? 1);

// A run up to the end of the workspace of case I.
function inside(run) {
  const [x] = run.signal("tool_position");
  const first = run.ends.findIndex((row) => run.rows[row * run.width + x] >= WORKSPACE_END);
  if (first < 0) return run;
  const ends = run.ends.slice(0, first + 1);
  const time = run.time.slice(0, ends.at(-1) + 1);
  const part = Object.assign(Object.create(run), { ends, time, isPart: true });
  return Object.assign(part, measure(part));
}

// The runs of both controllers, from which the claims of their task are judged.
export class Evidence {
  constructor([direct, adaptive], task) {
    const partOf = task === CASE_I ? inside : (run) => run;
    this.parts = { direct: partOf(direct), adaptive: partOf(adaptive) };
    this.speed = direct.z.command[0];
  }

  // A metric of a run on each axis, or the commanded speed. Throws a RangeError if the run lacks
  // the metric or ended before.
  valuesOf(which, metric) {
    if (which === "speed") return [this.speed];
    const run = this.parts[which];
    if (run.reason && !run.isPart) throw new RangeError(`${run.loop.title} ${endInWords(run)}`);
    const names = [metric, ...AXES.map((axis) => `${metric}.${axis}`)];
    const values = names.map((name) => run.metrics[name]).filter((x) => x !== undefined);
    if (values.length) return values;
    if (metric === SETTLING) return [Infinity];
    throw new RangeError("the tool does not get there");
  }

  // Whether a relation holds, on every axis.
  holds({ metric, run, relation, factor, of, of_metric: ofMetric, tolerance }) {
    const others = this.valuesOf(of, ofMetric || metric);
    const values = this.valuesOf(run, metric);
    return values.every((x, k) => HOLDS[relation](x, factor * others[k], tolerance));
  }

  // The numbers that decide whether a relation holds, as text.
  text({ metric, unit, run, of }) {
    if (of === "speed") return `${show((100 * this.valuesOf(run, metric)[0]) / this.speed, 3)} %`;
    const [direct, adaptive] = ["direct", "adaptive"].map((which) => this.valuesOf(which, metric));
    const pairs = direct.map(
      (x, k) => `direct ${inUnit(x, unit)}, adaptive ${inUnit(adaptive[k], unit)} ${unit}`,
    );
    return pairs.length === 1 ? pairs[0] : pairs.map((x, k) => `${AXES[k]}: ${x}`).join("; ");
  }
}

// What stands for a number that the thesis prints.
function shownNumber(evidence, { shown, relations: [{ metric }] }) {
  const [direct] = evidence.valuesOf("direct", metric);
  const [adaptive] = evidence.valuesOf("adaptive", metric);
  return { direct, adaptive, reduction: 1 - adaptive / direct }[shown];
}

// The numbers that decide whether relations hold, as text.
function numbersOf(evidence, relations) {
  const texts = new Map();
  for (const relation of relations) {
    const metrics = [relation.metric, relation.of_metric].filter(Boolean);
    metrics.forEach((metric) => texts.set(metric, evidence.text({ ...relation, metric })));
  }
  if (texts.size === 1) return [...texts.values()][0];
  const words = (metric) => metric.split(".").at(-1).replaceAll("_", " ");
  return [...texts].map(([metric, text]) => `${words(metric)}: ${text}`).join("; ");
}

// Whether a claim holds in the current runs, and the numbers that decide it. If the runs cannot
// decide, `holds` is null and `why` tells the reason.
export function measureClaim(evidence, claim) {
  const { relations, printed } = claim;
  if (!relations.length) return { holds: null, why: "" };
  try {
    const holds = relations.map((relation) => evidence.holds(relation)).every(Boolean);
    if (printed !== null) return { holds, ours: shownNumber(evidence, claim) };
    return { holds, ours: numbersOf(evidence, relations) };
  } catch (error) {
    if (!(error instanceof RangeError)) throw error;
    return { holds: null, why: error.message };
  }
}

// The words on a claim, by whether it held at the thesis's settings and holds now.
const WORDS = {
  "true true": "still holds",
  "true false": "no longer holds",
  "false true": "holds here",
  "false false": "does not hold here either",
};

// What to say about a claim at other settings than the thesis's: words on its order, and the text
// before and after them. A number of the thesis is for its settings only: it is not judged.
export function judge(claim, now, published, settings) {
  const words = WORDS[`${published.holds} ${now.holds}`] ?? "";
  if (!claim.relations.length) {
    return { before: `judged in Python, at ${settings} only`, words: "", after: "" };
  }
  if (now.holds === null) return { before: `cannot be judged: ${now.why}`, words, after: "" };
  if (claim.printed === null) return { before: "", words, after: ` (${now.ours})` };
  const { unit, in_kind: order } = claim;
  const [here, there] = [now, published].map(({ ours }) => `${inUnit(ours, unit)} ${unit}`);
  return { before: `${here} here, ${there} at ${settings}; ${order}: `, words, after: "" };
}
