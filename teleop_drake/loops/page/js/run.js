// A run of a loop: its rows in the module's memory, and its signals at any time. See
// engine/advance.py for the module's run(), numerics/step_polynomials.py for the polynomials of
// steps, and bounds.js for where it ends early.

import { NODES_OF_STEP, UNKNOWN, boundsOf, crossingOf, largestOf } from "./bounds.js";
import { measure } from "./metrics.js";
import { clamp, range } from "./numbers.js";
import { powersOf, valueAt } from "./pieces.js";

// The status codes of a module's run(), and indices into the counts of engine/problem.py. Integers
// have 64 bits in memory and are read as pairs of 32-bit numbers.
const FULL = 1;
const STUCK = 2;
const SAME = 1e-12; // s
const ROWS = 2 * 4;
const TRIES = 2 * 5;

const MOST_TRIES = 4e6;
const MOST_ROOM = 1 << 19;
const FIRST_PAUSE = 300; // ms of simulating before the browser may draw,
const PAUSE = 100; // and between later pauses

// The Lagrange weights of five values at 0 to 4 for a place between them.
function weightsAt(x) {
  const a = x - 1;
  const b = x - 2;
  const c = x - 3;
  const d = x - 4;
  return [
    (a * b * c * d) / 24,
    -(x * b * c * d) / 6,
    (x * a * c * d) / 4,
    -(x * a * b * d) / 6,
    (x * a * b * c) / 24,
  ];
}

// A run: rows at five instants of each step, including its ends. At a jump, two rows have the same
// time.
export class Run {
  constructor(loop, z) {
    this.loop = loop;
    this.z = z;
    this.width = loop.width;
    this.reason = ""; // The reason why it ended early, if it did,
    this.hasRunAway = false; // and whether a signal has grown too large.
    this.events = [];
    this.metrics = {};
    [this.endTime, this.accuracy, this.longest] = z.run;
    [this.headers, this.places] = loop.layOut(z);
    [this.startTime] = this.array("clock");
    // The first row of the run, after those of signals that are under way in delays.
    this.first = this.array("counts", Int32Array)[ROWS];
    // The end of the rows that are known to be within the bounds.
    this.checked = this.first;
    this.draws = [...loop.draws]; // For each: the time, the place in y and the new values.
    this.take();
  }

  // A view of the current contents of an array in memory.
  array(name, kind = Float64Array, count = this.sizeOf(name, kind)) {
    return new kind(this.loop.memory.buffer, this.places[name].at, count);
  }

  // The number of elements of an array, viewed as a kind of typed array.
  sizeOf(name, kind) {
    return (this.places[name].count * 8) / kind.BYTES_PER_ELEMENT;
  }

  // Doubles the room of the arrays that can be full, in this run and later ones.
  grow() {
    const names = Object.keys(this.places);
    const old = names.map((name) => this.array(name, Uint8Array).slice());
    this.loop.room *= 2;
    [this.headers, this.places] = this.loop.layOut(this.z);
    names.forEach((name, i) => this.array(name, Uint8Array).set(old[i]));
  }

  // Simulates until a time. Returns false if `isStale` has reported that the run is not needed.
  async advance(end, isStale = () => false) {
    this.takeDraws();
    while (this.draws.length > 0 && this.draws[0][0] < end - SAME && !this.reason) {
      if (!(await this.integrate(this.draws[0][0], isStale))) return false;
      this.takeDraws();
    }
    if (!(await this.integrate(end, isStale))) return false;
    this.take(end >= this.endTime || this.reason);
    return true;
  }

  // Writes the outputs of random sources that change now, before their updates execute.
  takeDraws() {
    const [now] = this.array("clock");
    while (this.draws.length > 0 && this.draws[0][0] < now + SAME) {
      const [, place, ...value] = this.draws.shift();
      this.array("y").set(value, place);
    }
  }

  // Integrates between two draws of random sources; see advance().
  async integrate(end, isStale) {
    const { run } = this.loop;
    let pause = performance.now() + FIRST_PAUSE;
    let status = FULL;
    let before = -1;
    while (status === FULL && !this.reason) {
      let unsolved = "";
      status = run(...this.headers, end, this.accuracy, this.longest);
      if (status < 0) throw new Error("an index is outside of its array");
      if (status === STUCK) unsolved = "the step would have to be too small";
      this.endAtBound();
      const counts = this.array("counts", Int32Array);
      if (counts[TRIES] > MOST_TRIES) unsolved ||= "the loop is too stiff";
      if (status === FULL && counts[ROWS] === before && !unsolved && !this.reason) {
        if (this.loop.room < MOST_ROOM) this.grow();
        else unsolved = "the run needs too many steps";
      }
      before = counts[ROWS];
      if (unsolved && !this.reason) this.endUnsolved(unsolved);
      if (performance.now() > pause) {
        await new Promise((go) => setTimeout(go));
        if (isStale()) return false;
        pause = performance.now() + PAUSE;
      }
    }
    return true;
  }

  // Simulates while a hand's command goes along a line, from [time, ...v_d] to another.
  follow([begin, ...before], [end, ...after], isStale) {
    const [place, size] = this.loop.feed;
    const line = [begin, end, ...before, ...after];
    this.array("y")
      .subarray(place, place + size)
      .set(line);
    return this.advance(end, isStale);
  }

  // Makes views of the rows in memory; if the run is over, copies and measures them.
  take(isOver) {
    const end = this.array("counts", Int32Array)[ROWS];
    const flags = this.array("row_ends", Int32Array);
    this.time = this.array("row_times").subarray(this.first, end);
    this.rows = this.array("rows").subarray(this.first * this.width, end * this.width);
    this.ends = [];
    for (let row = this.first; row < end; ++row) {
      if (flags[2 * row]) this.ends.push(row - this.first);
    }
    if (!isOver) return;
    this.time = this.time.slice();
    this.rows = this.rows.slice();
    this.loop.largest ??= this.reason ? {} : largestOf(this);
    ({ events: this.events, metrics: this.metrics } = measure(this));
  }

  // Ends a run that the solver cannot finish, for a reason. If a signal has grown far beyond its
  // start, the run ends there.
  endUnsolved(reason) {
    this.reason = reason;
    this.bounds = boundsOf(this, this.array("rows"), this.first * this.width, 0);
    this.checked = this.first;
    this.endAtBound();
  }

  // Truncates the rows in memory where a signal first leaves its bounds, and stores the reason.
  endAtBound() {
    const counts = this.array("counts", Int32Array);
    const flags = this.array("row_ends", Int32Array);
    const rows = this.array("rows");
    if (counts[ROWS] > this.first) {
      this.bounds ??= boundsOf(this, rows, this.first * this.width, UNKNOWN);
    }
    for (let last = this.checked; last < counts[ROWS]; ++last) {
      if (!flags[2 * last]) continue;
      const found = crossingOf(this.bounds, rows, last, this.width);
      if (!found) continue;
      ({ reason: this.reason, isGrowth: this.hasRunAway } = found.bound);
      const isKnown = Number.isFinite(found.share);
      if (isKnown) this.cutStep(last, found.share);
      // A step that is not finite is cut to its begin.
      counts[ROWS] = isKnown ? last + 1 : last - 3;
      return;
    }
    this.checked = counts[ROWS];
  }

  // Shortens the step that ends with a row to a fraction of it.
  cutStep(last, share) {
    const times = this.array("row_times");
    const rows = this.array("rows");
    const first = last - 4;
    for (let column = 0; column < this.width; ++column) {
      const placeOf = (node) => (first + node) * this.width + column;
      const powers = powersOf(NODES_OF_STEP.map((node) => rows[placeOf(node)]));
      for (const node of NODES_OF_STEP) rows[placeOf(node)] = valueAt(powers, (share * node) / 4);
    }
    const length = share * (times[last] - times[first]);
    for (const node of NODES_OF_STEP) times[first + node] = times[first] + (length * node) / 4;
  }

  // Whether the run ended early, before a time.
  hasEnded(t) {
    return Boolean(this.reason) && t > this.time.at(-1) + SAME;
  }

  // The columns of a port; undefined if the loop does not have this port.
  columns(port) {
    const place = this.loop.ports[port];
    return place && range(place[1]).map((k) => place[0] + k);
  }

  // The columns of a signal, which has the same name as in recordings.
  signal(name) {
    return this.columns(this.loop.signals[name]);
  }

  // The values of columns in a row.
  row(columns, i) {
    return columns.map((k) => this.rows[i * this.width + k]);
  }

  // The index of the step that contains a time; at a jump, of the step before it.
  step(t) {
    let low = 0;
    let high = this.ends.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[this.ends[middle]] < t) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  // The values of columns at a time, within the step s if it is given.
  vector(columns, t, s = this.step(t)) {
    const last = this.ends[s];
    if (last === undefined) return this.row(columns, 0);
    const first = last - 4;
    const share = (t - this.time[first]) / (this.time[last] - this.time[first]);
    const weights = weightsAt(4 * clamp(share, 0, 1));
    return columns.map((column) => {
      let sum = 0;
      for (let a = 0; a < 5; ++a) sum += weights[a] * this.rows[(first + a) * this.width + column];
      return sum;
    });
  }
}
