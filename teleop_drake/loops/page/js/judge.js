// Measures of the thesis's claims on the current runs, by the definitions of thesis/claims.
//
// Each measure has the name of the Python function that measures the claim. It takes the evidence
// and the claim, and returns whether the claim holds and the numbers that decide it. It throws a
// RangeError if the runs cannot decide, because one ended before or lacks an event.

import { measure } from "./metrics.js";
import { dot, range, show } from "./numbers.js";
import { powersOf, valueAt } from "./pieces.js";
import { AXES } from "./units.js";
import { endInWords } from "./words.js";

const CASE_I = "two_dof_puncture";
const WORKSPACE_END = 1.4; // m, the position x at which runs of case I are cut; see thesis/runs.py
const SCALES = { mm: 1e3, "mm/s": 1e3, mN: 1e3, "%": 1e2 };
const BOOLE = [7, 32, 12, 32, 7]; // 90 times the weights of Boole's rule for five values
const SETTLING = "collision.settling_time";

// A number in a unit.
function inUnit(x, unit) {
  return Number.isFinite(x) ? show((SCALES[unit] ?? 1) * x, 4) : "never";
}

// A number in a unit of the thesis, in SI units.
export const inSi = (x, unit) => x / (SCALES[unit] ?? 1);

// Both controllers' numbers as text.
const pairOf = ([direct, adaptive], unit = "") =>
  `direct ${inUnit(direct, unit)}, adaptive ${inUnit(adaptive, unit)} ${unit}`;

// A share in per cent.
const percent = (x) => `${show(100 * x, 3)} %`;

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
  constructor([direct, adaptive], { name, network }) {
    const partOf = name === CASE_I ? inside : (run) => run;
    this.network = network;
    this.whole = direct;
    this.parts = { direct: partOf(direct), adaptive: partOf(adaptive) };
    this.speed = direct.z.command[0];
  }

  // The run with direct force.
  get direct() {
    return this.intact("direct");
  }

  // The run with the adaptive controller.
  get adaptive() {
    return this.intact("adaptive");
  }

  // A run that did not end early, within its part that is judged.
  intact(which) {
    const run = this.parts[which];
    if (run.reason && !run.isPart) throw new RangeError(`${run.loop.title} ${endInWords(run)}`);
    return run;
  }

  // A metric of both runs.
  both(name) {
    return this.each(({ metrics }) => known(metrics[name]));
  }

  // A metric of both runs; infinite if a run does not have it.
  bothOrNever(name) {
    return this.each(({ metrics }) => metrics[name] ?? Infinity);
  }

  // A quantity of both runs.
  each(quantity) {
    return [quantity(this.direct), quantity(this.adaptive)];
  }
}

// The values of a component of a signal between two times.
function valuesOfPart(run, signal, component, begin = 0, end = Infinity) {
  const column = run.signal(signal)[component];
  const isPart = (i) => run.time[i] >= begin && run.time[i] <= end;
  const rows = range(run.time.length).filter(isPart);
  return rows.map((i) => run.rows[i * run.width + column]);
}

// The largest absolute value of some numbers.
const largestOf = (values) => values.reduce((most, x) => Math.max(most, Math.abs(x)), 0);

// The largest jump of the control force.
function largestJump(run) {
  const columns = run.signal("control_force");
  const change = (i, k) => run.rows[i * run.width + k] - run.rows[(i - 1) * run.width + k];
  const jumps = range(run.time.length).filter((i) => i && run.time[i] === run.time[i - 1]);
  return largestOf(jumps.flatMap((i) => columns.map((k) => change(i, k))));
}

// A value; throws a RangeError if it is undefined, as no claim can be judged then.
function known(value) {
  if (value === undefined) throw new RangeError("the tool does not get there");
  return value;
}

// The times of events of a name.
const timesOf = ({ events }, name) => events.filter((x) => x.name === name).map((x) => x.time);

// The time at which the tool first has 90 % of the commanded velocity.
function riseTime(run) {
  const velocity = valuesOfPart(run, "tool_velocity", 0);
  return run.time[velocity.findIndex((v) => v >= 0.9 * run.z.command[0])] ?? Infinity;
}

// The largest force of each contact with the bone.
function impactForces(run) {
  const contacts = timesOf(run, "contact");
  known(contacts[0]);
  const forces = (time, i) => valuesOfPart(run, "environment_force", 0, time, contacts[i + 1]);
  return contacts.map((time, i) => largestOf(forces(time, i)));
}

// The largest |v - v_d| along an axis between two times.
function amplitude(run, axis, begin, end) {
  const velocity = valuesOfPart(run, "tool_velocity", axis, begin, end);
  return largestOf(velocity.map((v) => v - run.z.command[axis]));
}

// The largest position error before the contact on each axis, as a share of the way to the bone.
function pathError(run) {
  const [contact = Infinity] = timesOf(run, "contact");
  const time = run.time.filter((t) => t <= contact);
  const bone = run.loop.surfaces.indexOf("contact");
  const n = run.z.command.length;
  return range(n).map((axis) => {
    const position = valuesOfPart(run, "tool_position", axis, 0, contact);
    const asked = (t) => Math.max(t - run.z.command_delay[0], 0) * run.z.command[axis];
    const errors = position.map((p, i) => p - position[0] - asked(time[i]));
    const [start] = valuesOfPart(run, "tool_position", 0);
    return largestOf(errors) / (run.z.surfaces[2 * n * bone] - start);
  });
}

// The share of dF_e/dt along x (rms) that the third network leaves unlearned.
function unlearnedShare(run, { centres, widths }) {
  const column = run.signal("environment_force")[0];
  const weights = run.signal("weights_3").slice(0, centres.length);
  const position = run.signal("tool_position");
  let all = 0;
  let left = 0;
  for (const last of run.ends) {
    const nodes = range(5).map((node) => last - 4 + node);
    const length = run.time[last] - run.time[last - 4];
    if (length <= 0) continue;
    const powers = powersOf(nodes.map((row) => run.rows[row * run.width + column]));
    const slope = powers.slice(1).map((c, k) => ((k + 1) * c) / length);
    nodes.forEach((row, node) => {
      const rate = valueAt(slope, node / 4);
      const place = run.row(position, row);
      const distance = (centre) => place.map((x, k) => (x - centre[k]) / widths[k]);
      const Phi = centres.map((centre) => Math.exp(-(Math.hypot(...distance(centre)) ** 2)));
      all += length * BOOLE[node] * rate ** 2;
      left += length * BOOLE[node] * (rate - dot(run.row(weights, row), Phi)) ** 2;
    });
  }
  return Math.sqrt(left / all);
}

// Quantities that are no metrics.
const QUANTITIES = {
  "largest jump": largestJump,
  contacts: (run) => impactForces(run).length,
};

// The values of a quantity or a metric of a run, one for each of its axes.
function valuesOnAxes(run, of) {
  if (QUANTITIES[of]) return [QUANTITIES[of](run)];
  return AXES.map((axis) => run.metrics[`${of}.${axis}`]).filter((x) => x !== undefined);
}

// Whether both numbers are less than 1 % apart.
const isSame = ([direct, adaptive]) => Math.abs(direct / adaptive - 1) < 0.01;

// The relations between both controllers' numbers for which a printed number stands.
const RELATIONS = {
  "larger with direct force": ([direct, adaptive]) => direct > adaptive,
  "smaller with direct force": ([direct, adaptive]) => direct < adaptive,
  "more negative with direct force": ([direct, adaptive]) => direct < adaptive && adaptive < 0,
  "the same in both": isSame,
};

// Whether the adaptive controller stays below 1 % of the commanded velocity before the puncture.
function noStartOvershoot({ adaptive, speed }) {
  const share = adaptive.metrics.start_velocity_overshoot / speed;
  return { holds: share < 0.01, ours: percent(share) };
}

const MEASURES = {
  // The number that the thesis prints for one controller.
  _Number(evidence, { metric, which, in_kind: relation }) {
    const both = evidence.both(metric);
    return { holds: RELATIONS[relation](both), ours: both[which === "direct" ? 0 : 1] };
  },
  // The share by which the adaptive controller reduces a number.
  _Reduction(evidence, { metric }) {
    const [direct, adaptive] = evidence.both(metric);
    return { holds: Math.abs(adaptive) < Math.abs(direct), ours: 1 - adaptive / direct };
  },
  // A quantity is less with the adaptive controller on each axis.
  IsLess(evidence, { of, than = 1, unit }) {
    const [direct, adaptive] = evidence.each((run) => valuesOnAxes(run, of));
    const holds = direct.every((x, k) => adaptive[k] < than * x);
    const pairs = direct.map((x, k) => pairOf([x, adaptive[k]], unit));
    if (pairs.length === 1) return { holds, ours: pairs[0] };
    return { holds, ours: pairs.map((pair, k) => `${AXES[k]}: ${pair}`).join("; ") };
  },
  // Speed and force at the puncture are the same with both controllers.
  _SameAtPuncture(evidence) {
    const speeds = evidence.both("puncture.velocity");
    const forces = evidence.both("puncture.force");
    const ours = `${pairOf(speeds, "mm/s")}; ${pairOf(forces, "mN")}`;
    return { holds: isSame(speeds) && isSame(forces), ours };
  },
  // The adaptive controller's first impact is its largest force. This force is between the first
  // impact and the largest force of direct force.
  _ImpactOrder(evidence) {
    const first = evidence.both("collision.initial_impact_force");
    const largest = evidence.both("collision.peak_force");
    const isFirst = Math.abs(first[1] / largest[1] - 1) < 1e-9;
    const holds = first[0] < first[1] && first[1] < largest[0] && isFirst;
    return { holds, ours: `first: ${pairOf(first, "mN")}; largest: ${pairOf(largest, "mN")}` };
  },
  // Direct force exceeds the commanded velocity before the puncture.
  _DirectStartOvershoot({ direct, speed }) {
    const share = direct.metrics.start_velocity_overshoot / speed;
    return { holds: share > 0.05, ours: percent(share) };
  },
  _NoStartOvershoot: noStartOvershoot,
  _NoOvershoot: noStartOvershoot,
  // The adaptive controller settles in half the time.
  _Settling(evidence) {
    const [direct, adaptive] = evidence.bothOrNever(SETTLING);
    const holds = Number.isFinite(adaptive) && adaptive <= direct / 2;
    return { holds, ours: pairOf([direct, adaptive], "s") };
  },
  // The adaptive controller's force does not jump.
  _Smooth(evidence) {
    const [direct, adaptive] = evidence.each(largestJump);
    return { holds: adaptive < 0.01 * direct, ours: pairOf([direct, adaptive], "mN") };
  },
  // The adaptive controller has the commanded velocity before the puncture.
  _SmoothStart({ adaptive, speed }) {
    const puncture = known(adaptive.metrics["puncture.time"]);
    const share = amplitude(adaptive, 0, puncture - 1, puncture) / speed;
    return { holds: share < 0.05, ours: percent(share) };
  },
  // Direct force crosses the commanded velocity several times, and still swings at the puncture.
  _DirectOscillates({ direct, speed }) {
    const puncture = known(direct.metrics["puncture.time"]);
    const isAbove = valuesOfPart(direct, "tool_velocity", 0, 0, puncture).map((v) => v > speed);
    const crossings = isAbove.filter((x, i) => i && x !== isAbove[i - 1]).length;
    const late = valuesOfPart(direct, "tool_velocity", 0, puncture - 1, puncture);
    const swing = (Math.max(...late) - Math.min(...late)) / speed;
    const ours = `${crossings} crossings, ${percent(swing)} of v_d`;
    return { holds: crossings >= 3 && swing > 0.2, ours };
  },
  // Direct force is faster at the puncture.
  _DirectFaster(evidence) {
    const both = evidence.both("puncture.velocity");
    return { holds: both[0] > both[1] + 0.05 * evidence.speed, ours: pairOf(both, "m/s") };
  },
  // Direct force diverges, and its velocity along y already grows inside the workspace.
  _DirectDiverges({ parts: { direct }, whole }) {
    const puncture = known(direct.metrics["puncture.time"]);
    const end = direct.time.at(-1);
    const early = amplitude(direct, 1, puncture, puncture + 1);
    const late = amplitude(direct, 1, end - 1, end);
    const ours = `amplitude of v_y ${show(early, 3)} to ${show(late, 3)} m/s`;
    return { holds: Boolean(whole.reason) && late > 2 * early, ours };
  },
  // The adaptive controller settles, and direct force does not.
  _NeverConverges(evidence) {
    const both = evidence.bothOrNever(SETTLING);
    return { holds: both[0] === Infinity && both[1] < Infinity, ours: pairOf(both, "s") };
  },
  // The adaptive controller's first impact is weaker by a quarter.
  _LowerFirstImpact(evidence) {
    const both = evidence.both("collision.initial_impact_force");
    return { holds: both[1] <= 0.75 * both[0], ours: pairOf(both, "N") };
  },
  // Direct force follows the commanded position.
  _DirectPosition({ direct }) {
    const errors = pathError(direct);
    const texts = errors.map((x, k) => `${AXES[k]} ${percent(x)}`);
    return { holds: errors.every((x) => x < 0.15), ours: texts.join(", ") };
  },
  // With direct force the distance from the first contact grows.
  _DirectUnstable({ direct }, { axis }) {
    const k = AXES.indexOf(axis);
    const contact = known(timesOf(direct, "contact")[0]);
    const end = direct.time.at(-1);
    const [touched] = valuesOfPart(direct, "tool_position", k, contact);
    const farthest = (begin, last) =>
      largestOf(valuesOfPart(direct, "tool_position", k, begin, last).map((p) => p - touched));
    const early = farthest(contact, contact + 2);
    const late = farthest(end - 2, end);
    return { holds: late >= 1.1 * early, ours: `first ${show(early, 3)}, last ${show(late, 3)} m` };
  },
  // The adaptive controller takes longer to reach 90 % of the commanded velocity.
  _Sluggish(evidence) {
    const both = evidence.each(riseTime);
    return { holds: both[1] > both[0], ours: pairOf(both, "s") };
  },
  // The adaptive controller ends at rest with the commanded force.
  _StableOnBone({ adaptive, speed }) {
    const last = (signal, axis) => valuesOfPart(adaptive, signal, axis).at(-1);
    const asked = last("forward_packet_received", 0);
    const force = last("environment_force", 0);
    const velocity = range(adaptive.z.command.length).map((k) => last("tool_velocity", k));
    const v = Math.hypot(...velocity);
    const holds = Math.abs(force / asked - 1) < 0.01 && v < 0.01 * speed;
    return { holds, ours: `${show(force, 4)} N of ${show(asked, 3)} N, ${show(v, 2)} m/s` };
  },
  // The third network learns more than half of dF_e/dt.
  NetworksLearn({ adaptive, network }) {
    const share = unlearnedShare(adaptive, network);
    return { holds: share < 0.5, ours: `${percent(share)} unlearned` };
  },
  // The adaptive controller's impacts become weaker, and it settles.
  _DampsOut({ adaptive }) {
    const hits = impactForces(adaptive);
    const isFalling = hits.every((x, i) => !i || x < hits[i - 1]);
    const ours = `${hits.map((x) => show(x, 3)).join(", ")} N`;
    return { holds: isFalling && SETTLING in adaptive.metrics, ours };
  },
  // All later impacts of direct force are stronger than the first.
  _DirectImpactsGrow({ direct }) {
    const [first, ...later] = impactForces(direct);
    const ours = `${[first, ...later].map((x) => show(x, 3)).join(", ")} N`;
    return { holds: later.length > 0 && Math.min(...later) > first, ours };
  },
};

// Whether a claim has a measure here. Others take more than the runs of the sliders.
const hasMeasure = ({ measure: name }) => name in MEASURES;

// Whether a claim holds in the current runs, and the numbers that decide it. If the runs cannot
// decide, `holds` is null and `why` tells the reason.
export function measureClaim(evidence, claim) {
  if (!hasMeasure(claim)) return { holds: null, why: "" };
  try {
    return MEASURES[claim.measure](evidence, claim);
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
  if (!hasMeasure(claim)) return { before: `judged at ${settings} only`, words: "", after: "" };
  if (now.holds === null) return { before: `cannot be judged: ${now.why}`, words, after: "" };
  if (claim.printed === null) return { before: "", words, after: ` (${now.ours})` };
  const { unit, in_kind: order } = claim;
  const [here, there] = [now, published].map(({ ours }) => `${inUnit(ours, unit)} ${unit}`);
  return { before: `${here} here, ${there} at ${settings}; ${order}: `, words, after: "" };
}
