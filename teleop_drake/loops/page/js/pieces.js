// Signals of a run in pieces, and functions of such signals, named as in numerics/pieces.py and
// in model/laws/signal_metrics.py.
//
// A signal in pieces is an array with five values for each piece, at equal distances. Between these
// values the signal is the quartic through them. A vector has one such array for each component.

import { extent } from "./numbers.js";

const NODES = [0, 0.25, 0.5, 0.75, 1];
export const SAME_INSTANT = 5e-12; // s, see numerics/pieces.py
const INWARDS = 2 * SAME_INSTANT;
const LEBESGUE = 2.3;

// Coefficients of ascending powers of the quartic through five values.
export function powersOf(values) {
  const y = values[0];
  const a = values[1] - y;
  const b = values[2] - y;
  const c = values[3] - y;
  const d = values[4] - y;
  return [
    y,
    (48 * a - 36 * b + 16 * c - 3 * d) / 3,
    (-208 * a + 228 * b - 112 * c + 22 * d) / 3,
    (288 * a - 384 * b + 224 * c - 48 * d) / 3,
    (-128 * a + 192 * b - 128 * c + 32 * d) / 3,
  ];
}

// The value of a polynomial at a fraction of its piece.
export function valueAt(powers, x) {
  let value = 0;
  for (let k = powers.length - 1; k >= 0; --k) value = value * x + powers[k];
  return value;
}

// Where a condition that holds at the lower end of an interval ceases to hold.
export function bisect(holds, low, high) {
  let middle = (low + high) / 2;
  while (low < middle && middle < high) {
    if (holds(middle)) low = middle;
    else high = middle;
    middle = (low + high) / 2;
  }
  return high;
}

// The weighted sum of signals in pieces, plus a constant.
export function combine(weights, signals, constant = 0) {
  const sums = [];
  for (let i = 0; i < signals[0].length; ++i) {
    const sum = [constant, constant, constant, constant, constant];
    for (let k = 0; k < signals.length; ++k) {
      const values = signals[k][i];
      for (let node = 0; node < 5; ++node) sum[node] += weights[k] * values[node];
    }
    sums.push(sum);
  }
  return sums;
}
export const minus = (a, b) => combine([1, -1], [a, b]);
const negative = (a) => combine([-1], [a]);

// The steps of a run, cut at instants.
export class Pieces {
  constructor(run, cuts = []) {
    const { time, ends } = run;
    const instants = [...cuts].sort((a, b) => a - b);
    Object.assign(this, { run, list: [] });
    let next = 0;
    ends.forEach((last, step) => {
      let begin = time[last - 4];
      const end = time[last];
      const start = begin;
      // A step between two equal instants is a part of a jump.
      if (end - start <= SAME_INSTANT) return;
      for (; next < instants.length && instants[next] < end - SAME_INSTANT; ++next) {
        if (instants[next] <= Math.max(begin, start) + SAME_INSTANT) continue;
        this.list.push({ begin, end: instants[next], step, isPart: true });
        begin = instants[next];
      }
      this.list.push({ begin, end, step, isPart: begin > start });
    });
    // A run without steps is one piece, whose length is taken as 1.
    const only = { begin: time.at(-1), end: time.at(-1), step: -1, isPart: false };
    if (!this.list.length) this.list.push(only);
    this.lengths = this.list.map(({ begin, end }) => end - begin || 1);
  }

  // A column of the rows in pieces.
  signal(column) {
    const { run, list } = this;
    const { rows, width, ends } = run;
    return list.map(({ begin, end, step, isPart }) => {
      if (step < 0) return NODES.map(() => rows[(run.time.length - 1) * width + column]);
      if (isPart) return NODES.map((x) => run.vector([column], begin + x * (end - begin), step)[0]);
      const values = [0, 0, 0, 0, 0];
      const first = (ends[step] - 4) * width + column;
      for (let node = 0; node < 5; ++node) values[node] = rows[first + node * width];
      return values;
    });
  }

  // Columns of the rows in pieces.
  signals(columns) {
    return columns.map((column) => this.signal(column));
  }

  // Delayed columns, which are 0 before the first value arrives. If there is a jump, a piece begins
  // with the value after it and ends with the value before it.
  delayed(columns, delay) {
    const { run, list } = this;
    const first = run.time[0];
    const values = list.map(({ begin, end }) =>
      NODES.map((x) => {
        const inwards = Math.min(INWARDS, (end - begin) / 8) * ((x === 0) - (x === 1));
        const sent = begin + x * (end - begin) - delay + inwards;
        return sent < first ? columns.map(() => 0) : run.vector(columns, sent);
      }),
    );
    return columns.map((_, k) => values.map((piece) => piece.map((value) => value[k])));
  }

  // The first piece whose middle is not before an instant; without an instant, `otherwise`.
  place(time, otherwise) {
    if (time === undefined) return otherwise;
    const found = this.list.findIndex(({ begin, end }) => (begin + end) / 2 >= time);
    return found < 0 ? this.list.length : found;
  }

  // The range of the pieces between two instants; by default, from the start or to the end of the
  // run.
  between(begin, end) {
    return [this.place(begin, 0), this.place(end, this.list.length)];
  }

  // Where a signal changes its sign; 0 counts as positive.
  crossings(y) {
    const found = [];
    y.forEach((values, i) => {
      for (let j = 0; j < 4; ++j) {
        const isIn = values[j] >= 0;
        if (values[j + 1] >= 0 === isIn) continue;
        const powers = powersOf(values);
        const { begin, end } = this.list[i];
        const share = bisect((x) => valueAt(powers, x) >= 0 === isIn, j / 4, (j + 1) / 4);
        found.push({ time: begin + share * (end - begin), isUpwards: !isIn });
      }
    });
    return found;
  }
}

// The time at which a signal first becomes positive, and the first of some instants after another.
export const firstUpwards = (crossings) => crossings.find((x) => x.isUpwards)?.time;
export const firstAfter = (time, times) =>
  time === undefined ? undefined : times.find((t) => t > time);

// The value of a signal just before a piece.
export const valueBefore = (y, place) => (place ? y[place - 1][4] : y[0][0]);

// Successive values of a piece between which it is monotonic.
function extremes(values) {
  const powers = powersOf(values);
  const [, b, c, d, e] = powers;
  const slope = [b, 2 * c, 3 * d, 4 * e];
  const found = [values[0]];
  let isUp = b >= 0;
  for (let j = 0; j < 4; ++j) {
    const wasUp = isUp;
    isUp = valueAt(slope, (j + 1) / 4) >= 0;
    if (isUp !== wasUp) {
      const share = bisect((x) => valueAt(slope, x) >= 0 === wasUp, j / 4, (j + 1) / 4);
      found.push(valueAt(powers, share));
    }
    found.push(values[j + 1]);
  }
  return found;
}

// The largest value of a signal in some pieces; without a piece, the value before them.
export function maximum(y, [first, last]) {
  if (first >= last) return valueBefore(y, first);
  let most = -Infinity;
  for (let i = first; i < last; ++i) {
    const [low, high] = extent(y[i]);
    // A quartic deviates from the middle of its five values by at most this factor times half of
    // their range.
    if ((high + low) / 2 + (LEBESGUE * (high - low)) / 2 < most) continue;
    most = Math.max(most, ...extremes(y[i]));
  }
  return most;
}
export const minimum = (y, span) => -maximum(negative(y), span);
export const largest = (y, span) => Math.max(maximum(y, span), -minimum(y, span));

// The total variation of a signal, jumps included.
export function variation(y) {
  let sum = 0;
  let [[before]] = y;
  for (const values of y) {
    for (const value of extremes(values)) {
      sum += Math.abs(value - before);
      before = value;
    }
  }
  return sum;
}

// The integral of the product of two polynomials over a piece of length 1, from their powers.
function productOf(c, d) {
  let sum = 0;
  for (let a = 0; a < 5; ++a) {
    for (let b = 0; b < 5; ++b) sum += (c[a] * d[b]) / (a + b + 1);
  }
  return sum;
}

// These integrals for polynomials that are 1 at one of the five values, and 0 at the others.
const BASIS = NODES.map((node) => powersOf(NODES.map((x) => Number(x === node))));
const PRODUCTS = BASIS.map((c) => BASIS.map((d) => productOf(c, d)));

// The root of the mean square of a signal over time.
export function rms(y, lengths) {
  let total = 0;
  let duration = 0;
  y.forEach((values, i) => {
    let square = 0;
    for (let a = 0; a < 5; ++a) {
      for (let b = 0; b < 5; ++b) square += values[a] * values[b] * PRODUCTS[a][b];
    }
    total += lengths[i] * square;
    duration += lengths[i];
  });
  return Math.sqrt(Math.max(0, total) / duration);
}

// The integral of a signal over time, as a signal in pieces.
export function integral(y, lengths, start) {
  let at = start;
  return y.map((values, i) => {
    const c = powersOf(values).map((p, a) => p / (a + 1));
    const begin = at;
    const within = NODES.map((x) => begin + lengths[i] * x * valueAt(c, x));
    at = within[4];
    return within;
  });
}

// Whether a vector is outside of its band in a piece, at the place where a function takes a value.
function isOutside({ y, centre, radius }, i, valueIn) {
  let square = 0;
  for (let k = 0; k < y.length; ++k) square += (valueIn(y[k][i]) - centre[k]) ** 2;
  return !(Math.sqrt(square) < radius);
}

// The time from the begin of a piece until all vectors stay in their bands. It is null if they do
// not, or if they stayed there as long before. A band has the components of a vector, a centre and
// a radius.
export function settlingTime(pieces, first, bands) {
  const { list } = pieces;
  if (first >= list.length) return null;
  const start = list[first].begin;
  let since = start;
  let longest = 0;
  let wasMoving = false;
  for (let i = first; i < list.length; ++i) {
    const { begin, end } = list[i];
    for (let j = 0; j < 5; ++j) {
      if (bands.some((band) => isOutside(band, i, (values) => values[j])) === wasMoving) continue;
      const known = wasMoving;
      const isMoving = (x) =>
        bands.some((band) => isOutside(band, i, (values) => valueAt(powersOf(values), x)));
      const share = bisect((x) => isMoving(x) === known, Math.max(j - 1, 0) / 4, j / 4);
      const time = begin + share * (end - begin);
      if (!wasMoving) longest = Math.max(longest, time - since);
      since = time;
      wasMoving = !wasMoving;
    }
  }
  return wasMoving || list.at(-1).end - since <= longest ? null : since - start;
}
