// What a signal of a Diagram does, in words. A Diagram has no task: its words are on the
// shape of a curve.

import { extent, range, show } from "./numbers.js";

const PARTS = 8; // of a step of the solver, at whose ends a curve is read
const STEEP = 4; // Growth from one quarter of a run to the next that has no bound.
const IN_SIGHT = 0.01; // The share of the last value from which on a growing curve is seen.
const CALM = 0.02; // The share of a curve's range within which it has settled.
const LEAST_SWING = 1e-3; // The share of a curve's range that counts as a turn.
const ROUNDING = 1e-9; // The share of the largest value that is no number of its own.
const FEWEST_TURNS = 4;
const LAST_TURNS = 9; // Turns from which the frequency is taken.
const UNEVEN = 1.6; // The largest ratio of the times between turns of a swing.
const TREND = 1.1; // The ratio of amplitudes from which on a swing grows or decays.

// Points [t, value] of a column of a run.
function pointsOf(run, column) {
  const points = [];
  run.ends.forEach((last, s) => {
    const [begin, end] = [run.time[last - 4], run.time[last]];
    for (const part of range(PARTS + 1)) {
      const t = begin + (part * (end - begin)) / PARTS;
      points.push([t, run.vector([column], t, s)[0]]);
    }
  });
  return points;
}

// The points at which a curve turns, of which neighbours differ by at least a distance.
function turnsOf(points, least) {
  const turns = [];
  let heading = 0;
  let turn = points[0];
  for (const point of points) {
    const change = point[1] - turn[1];
    if (heading * change > 0 || (heading === 0 && Math.abs(change) >= least)) {
      heading = Math.sign(change);
      turn = point;
    } else if (heading && Math.abs(change) >= least) {
      turns.push(turn);
      heading = -heading;
      turn = point;
    }
  }
  return turns;
}

// The middle one of some numbers.
const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];

// The frequency in Hz of a curve that swings, and the growth of its amplitude; null if it does not.
function swingOf(points, size) {
  const turns = turnsOf(points, LEAST_SWING * size);
  if (turns.length < FEWEST_TURNS) return null;
  const last = turns.slice(-LAST_TURNS);
  const halves = last.slice(1).map(([t], i) => t - last[i][0]);
  if (Math.max(...halves) > UNEVEN * Math.min(...halves)) return null;
  const swings = turns.slice(1).map(([, y], i) => Math.abs(y - turns[i][1]));
  return { frequency: 1 / (2 * median(halves)), growth: swings.at(-1) / swings[0] };
}

// The largest distance from the first value in each quarter of the time.
function reachOf(points) {
  const [[begin, first]] = points;
  const length = points.at(-1)[0] - begin;
  const reach = [0, 0, 0, 0];
  for (const [t, y] of points) {
    const quarter = Math.min(3, Math.floor((4 * (t - begin)) / length));
    reach[quarter] = Math.max(reach[quarter], Math.abs(y - first));
  }
  return reach;
}

// The words on a growth without bound: from when on it is seen.
function growthInWords(points, reach) {
  const [, first] = points[0];
  const isHidden = ([, y]) => Math.abs(y - first) <= IN_SIGHT * reach;
  const [t] = points.findLast(isHidden) ?? points[0];
  const verb = points.at(-1)[1] < first ? "falls" : "grows";
  return `${verb} without bound from ${show(t, 2)} s on`;
}

// The words on a swing.
function swingInWords({ frequency, growth }) {
  const trend = growth > TREND ? ", growing" : growth < 1 / TREND ? ", decaying" : "";
  return `swings with ${show(frequency, 2)} Hz${trend}`;
}

// What a column of a run does, as in "swings with 1.4 Hz, decaying". If the curve settles and has a
// reference column that is constant, both are compared. Of a vector with much larger values, what
// remains after rounding is no motion.
export function motionInWords(run, column, unit, reference, vector = [column]) {
  const points = pointsOf(run, column);
  if (points.length < 2) return "has no rows";
  const [low, high] = extent(points.map(([, y]) => y));
  const [end, last] = points.at(-1);
  const size = high - low;
  const [least, most] = extent(run.ends.flatMap((row) => run.row(vector, row)));
  const largest = Math.max(Math.abs(low), Math.abs(high), Math.abs(least), Math.abs(most));
  const valueOf = (x) => `${show(Math.abs(x) < ROUNDING * largest ? 0 : x, 2)} ${unit}`.trim();
  if (size <= ROUNDING * largest) return `stays at ${valueOf(last)}`;
  const reach = reachOf(points);
  const swing = swingOf(points, size);
  if (reach[3] >= STEEP * reach[2] && reach[2] >= STEEP * reach[1]) {
    return swing
      ? `swings with ${show(swing.frequency, 2)} Hz, growing`
      : growthInWords(points, reach[3]);
  }
  const late = points.filter(([t]) => t >= end - 0.1 * (end - points[0][0])).map(([, y]) => y);
  const [lowest, highest] = extent(late);
  if (highest - lowest > CALM * size) {
    if (swing) return swingInWords(swing);
    const verb = last > late[0] ? "rises" : "falls";
    return `is at ${valueOf(last)} in the end, and still ${verb}`;
  }
  const target = reference === undefined ? 0 : constantOf(run, reference);
  return target ? `reached ${show(last, 2)} of ${valueOf(target)}` : `settles at ${valueOf(last)}`;
}

// The value of a column that is constant; 0 for any other.
function constantOf(run, column) {
  const [low, high] = extent(run.ends.map((row) => run.rows[row * run.width + column]));
  return low === high ? low : 0;
}
