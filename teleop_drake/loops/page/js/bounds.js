// Where a run ends early: the bounds of its task, and the ends of the scopes.
//
// The scopes show a signal until it is OFF_SCALE times as large as it was anywhere in the first run
// of its loop: then that run would be less than a hundredth of a pixel. Signals below 1 in their SI
// unit count as 1. If the first run has ended early, the size of the signals is not known, and only
// UNKNOWN bounds them or, in a run that the solver cannot finish, OFF_SCALE times their start. For
// the bounds of a task, see model/run/ending.py.

import { range, show } from "./numbers.js";
import { bisect, powersOf, valueAt } from "./pieces.js";

const OFF_SCALE = 1e4;
export const UNKNOWN = 1e9;

export const NODES_OF_STEP = range(5);

// The norm of some columns of a row that begin at a place.
function normAt(rows, begin, size) {
  if (size === 1) return Math.abs(rows[begin]);
  let square = 0;
  for (let k = begin; k < begin + size; ++k) square += rows[k] ** 2;
  return Math.sqrt(square);
}

// The largest norm of each recorded signal of a run that is over, by name.
export function largestOf({ loop, rows, width, time }) {
  const largest = {};
  for (const [name, port] of Object.entries(loop.signals)) {
    const [begin, size] = loop.ports[port] ?? [0, 0];
    let most = 0;
    for (let row = 0; row < time.length; ++row) {
      most = Math.max(most, normAt(rows, row * width + begin, size));
    }
    largest[name] = most;
  }
  return largest;
}

// The bounds of a run whose first row begins at a place in the rows: those of its task, those of
// the scopes, and for each column the magnitude below which all bounds of the scopes are kept.
// Signals of unknown size have the given bound, if it is larger than OFF_SCALE times their start.
export function boundsOf({ loop, z, width }, rows, first, unknown) {
  const { reasons, signals, ports, largest = {} } = loop;
  const ofTask = reasons.map((reason, i) => {
    const [begin, size, lower, upper] = z.bounds.slice(4 * i, 4 * i + 4);
    return { begin, size, lower, upper, reason, isGrowth: i === 0 };
  });
  const ofScopes = [];
  const safe = new Float64Array(width).fill(Infinity);
  for (const [name, port] of Object.entries(signals)) {
    if (!ports[port]?.[1]) continue;
    const [begin, size, unit] = ports[port];
    const least = OFF_SCALE * Math.max(1, normAt(rows, first + begin, size));
    const upper = Math.max(least, name in largest ? OFF_SCALE * largest[name] : unknown);
    const reason = `${name.replaceAll("_", " ")} exceeds ${show(upper, 3)} ${unit}`.trim();
    ofScopes.push({ begin, size, lower: -upper, upper, reason, isGrowth: true });
    safe.fill(upper / Math.sqrt(size), begin, begin + size);
  }
  return { ofTask, all: [...ofTask, ...ofScopes], safe };
}

// Whether the row that begins at a place may be beyond a bound of the scopes.
function mayBeOff(safe, rows, place) {
  for (let k = 0; k < safe.length; ++k) {
    if (!(Math.abs(rows[place + k]) < safe[k])) return true;
  }
  return false;
}

// The excess of the row that begins at a place over a bound; see Bound.Excess() of
// model/run/ending.py.
function excess(rows, place, { begin, size, lower, upper }) {
  const first = place + begin;
  if (size === 1) return Math.max(lower - rows[first], rows[first] - upper);
  let square = 0;
  for (let k = first; k < first + size; ++k) square += (rows[k] / upper) ** 2;
  return Math.sqrt(square) - 1;
}

// The quarter of the step that ends with a row in which a bound is left; -1 if it is not.
function quarterOf(bound, rows, last, width) {
  let isIn = excess(rows, (last - 4) * width, bound) < 0;
  for (let node = 1; node < 5; ++node) {
    const wasIn = isIn;
    isIn = excess(rows, (last - 4 + node) * width, bound) < 0;
    if (wasIn && !isIn) return node - 1;
  }
  return -1;
}

// The first bound that is left in the step that ends with a row, and the share of the step at which
// it is left, which is NaN if the step is not finite; null if all are kept.
export function crossingOf({ ofTask, all, safe }, rows, last, width) {
  let first = null;
  for (const bound of mayBeOff(safe, rows, last * width) ? all : ofTask) {
    const quarter = quarterOf(bound, rows, last, width);
    if (quarter < 0) continue;
    const values = NODES_OF_STEP.map((k) => excess(rows, (last - 4 + k) * width, bound));
    const powers = powersOf(values);
    const crossing = bisect((x) => valueAt(powers, x) < 0, quarter / 4, (quarter + 1) / 4);
    const share = values.every(Number.isFinite) ? crossing : NaN;
    if (!first || share < first.share) first = { bound, share };
  }
  return first;
}
