"use strict";
// Loops and runs of them. See model.py for the numbers, integrator/advance.py for run() of a
// module, step_polynomials.py for the steps of a run, simulation/ending.py for bounds.

// How run() ends, and places in the counts of integrator/problem.py.
const [FULL, STUCK] = [1, 2], [ROWS, TRIES] = [4, 6];
const MOST_TRIES = 4e6, MOST_ROOM = 1 << 19;

// Whole numbers from 0 on, a number within bounds, and the sum of products.
const range = (n) => Array.from({ length: n }, (_, i) => i);
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);

// The module of a controller, and its memory.
class Loop {
  constructor(data, inputs) { Object.assign(this, data, { inputs, room: 4096 }); }

  // Compiles the module, once.
  compile() { return (this.compiled ??= this.instantiate()); }

  // Makes the module's function, which works on its memory.
  async instantiate() {
    this.memory = new WebAssembly.Memory({ initial: this.start / 65536 + 16 });
    const module = await WebAssembly.compile(this.module), env = {};
    for (const { name, kind } of WebAssembly.Module.imports(module)) {
      // Of C's mathematics Math lacks fmod() alone.
      env[name] = kind === "memory" ? this.memory : Math[name] ?? ((x, y) => x % y);
    }
    this.exports = (await WebAssembly.instantiate(module, { env })).exports;
  }

  // Returns all numbers of a run at values of the inputs; see inputs.py's Added().
  numbersAt(values) {
    const z = Object.fromEntries(Object.entries(this.numbers).map(([key, x]) => [key, x.slice()]));
    for (const input of this.inputs.filter((x) => this.changes[x.name])) {
      const { slopes, stops } = this.changes[input.name], value = values[input.name];
      for (const [key, [places, rates]] of Object.entries(slopes)) {
        places.forEach((p, i) => { z[key][p] += (value - input.value) * rates[i]; });
      }
      for (const [key, tables] of Object.entries(stops)) {
        const stop = tables[input.stops.indexOf(value)], base = this.numbers[key];
        const adds = stop.length === base.length && base.every(Number.isFinite);
        z[key] = adds ? z[key].map((x, i) => x + stop[i] - base[i]) : stop.slice();
      }
    }
    return z;
  }

  // Puts numbers into memory; returns the addresses of the headers and all places.
  layOut(z) {
    let end = this.start;
    const places = {}, headers = [], writes = [];
    const take = (count) => { const at = end; end += 8 * count; return { at, count }; };
    for (const [group, fields] of Object.entries(this.headers)) {
      const header = [];
      for (const [field, [size, ...rest], isWhole, grows] of fields) {
        const x = z[`${group}.${field}`], width = rest.reduce((a, b) => a * b, 1);
        const first = grows ? this.room : x && width ? x.length / width : size;
        places[field] = take(first * width);
        header.push(places[field].at, first, ...rest);
        writes.push([places[field], x, isWhole]);
      }
      writes.push([take(header.length), header, true]);
      headers.push(writes.at(-1)[0].at);
    }
    this.memory.grow(Math.max(0, Math.ceil((end - this.memory.buffer.byteLength) / 65536)));
    for (const [{ at, count }, x, isWhole] of writes) {
      const array = new (isWhole ? BigInt64Array : Float64Array)(this.memory.buffer, at, count);
      array.fill(isWhole ? 0n : 0);
      if (x) array.set(isWhole ? Array.from(x, BigInt) : x);
    }
    return [headers, places];
  }

  // Simulates at values of the inputs, with a hand where there is a place for one. Returns null if
  // `isStale` says so meanwhile.
  async simulate(values, isStale, hand = []) {
    await this.compile();
    const begin = performance.now(), run = new Run(this, this.numbersAt(values));
    if (this.feed) run.duration = hand.at(-1)?.[0] ?? 8;
    for (let i = 1; i < hand.length; ++i) if (!await run.follow(hand[i - 1], hand[i], isStale)) return null;
    if (!await run.advance(run.duration, isStale)) return null;
    run.wall = performance.now() - begin;
    return run;
  }
}

// A run: rows at five instants of each step, its ends among them. A time that stands twice is a jump.
class Run {
  constructor(loop, z) {
    Object.assign(this, { loop, z, width: loop.width, reason: "", events: [], metrics: {}, checked: 0 });
    [this.duration, this.accuracy, this.longest] = z.run;
    [this.headers, this.places] = loop.layOut(z);
    this.take();
  }

  // An array in memory as it is now, of 32 bits for whole numbers, which are every second one.
  array(name, kind = Float64Array, count = this.places[name].count * 8 / kind.BYTES_PER_ELEMENT) {
    return new kind(this.loop.memory.buffer, this.places[name].at, count);
  }

  // Gives the arrays that can be full twice the room, in this run and later ones.
  grow() {
    const old = Object.keys(this.places).map((x) => [x, this.array(x, Uint8Array).slice()]);
    if ((this.loop.room *= 2) > MOST_ROOM) throw new Error("the run needs too many steps");
    [this.headers, this.places] = this.loop.layOut(this.z);
    for (const [name, bytes] of old) this.array(name, Uint8Array).set(bytes);
  }

  // Simulates until a time. Returns whether it did: `isStale` may say that nobody waits for it.
  async advance(end, isStale = () => false) {
    const { exports } = this.loop;
    let pause = performance.now() + 300;
    for (let status = FULL, before = -1; status === FULL && !this.reason;) {
      status = exports.run(...this.headers, end, this.accuracy, this.longest);
      if (status < 0) throw new Error("an index is outside of its array");
      if (status === STUCK) this.reason = "the step would have to be too small";
      this.endAtBound();
      const counts = this.array("counts", Int32Array);
      if (counts[2 * TRIES] > MOST_TRIES) throw new Error("the loop is too stiff");
      if (status === FULL && counts[2 * ROWS] === before) this.grow();
      before = counts[2 * ROWS];
      if (performance.now() > pause) {
        await new Promise((go) => setTimeout(go));
        if (isStale()) return false;
        pause = performance.now() + 100;
      }
    }
    this.take(end >= this.duration || this.reason);
    return true;
  }

  // Simulates as long as a hand's command goes along a line, from [time, ...v_d] to another.
  follow([begin, ...before], [end, ...after], isStale) {
    const [place, size] = this.loop.feed;
    this.array("y").subarray(place, place + size).set([begin, end, ...before, ...after]);
    return this.advance(end, isStale);
  }

  // Looks at the rows in memory; of a run that is over takes them and what was measured from there.
  take(isOver) {
    const n = this.array("counts", Int32Array)[2 * ROWS], flags = this.array("row_ends", Int32Array);
    const get = (name, count, x = this.array(name, Float64Array, count)) => (isOver ? x.slice() : x);
    [this.time, this.rows] = [get("row_times", n), get("rows", n * this.width)];
    this.ends = range(n).filter((i) => flags[2 * i]);
    if (!isOver) return;
    ({ events: this.events, metrics: this.metrics } = measure(this));
  }

  // Ends the rows in memory where a signal first leaves one of its bounds, and tells why.
  endAtBound() {
    const counts = this.array("counts", Int32Array), ends = this.array("row_ends", Int32Array);
    for (let last = this.checked; last < counts[2 * ROWS]; ++last) {
      const found = ends[2 * last] ? this.firstBound(last) : null;
      if (!found) continue;
      this.reason = this.loop.reasons[found.bound];
      const isKnown = Number.isFinite(found.share);
      if (isKnown) this.cutStep(last, found.share);
      // Of a step that is not finite nothing is known but its begin.
      counts[2 * ROWS] = isKnown ? last + 1 : last - 3;
      return;
    }
    this.checked = counts[2 * ROWS];
  }

  // The first bound that is left in the step with a last row: which, and at what share of the step.
  firstBound(last) {
    const rows = this.array("rows"), { bounds } = this.z;
    let first = null;
    for (let bound = 0; bound < bounds.length / 4; ++bound) {
      const excess = range(5).map((k) => this.excess(rows, last - 4 + k, bound));
      const j = range(4).find((k) => excess[k] < 0 && !(excess[k + 1] < 0));
      if (j === undefined) continue;
      const c = powersOf(excess);
      const share = bisect((x) => valueAt(c, x) < 0, j / 4, (j + 1) / 4);
      const place = excess.every(Number.isFinite) ? share : NaN;
      if (!first || place < first.share) first = { bound, share: place };
    }
    return first;
  }

  // How far a row is out of a bound; see Bound.Excess() of simulation/ending.py.
  excess(rows, row, bound) {
    const at = 4 * bound, { bounds } = this.z, begin = row * this.width + bounds[at];
    const size = bounds[at + 1], lower = bounds[at + 2], upper = bounds[at + 3];
    if (size === 1) return Math.max(lower - rows[begin], rows[begin] - upper);
    let square = 0;
    for (let k = 0; k < size; ++k) square += (rows[begin + k] / upper) ** 2;
    return Math.sqrt(square) - 1;
  }

  // Puts the first share of a step in place of the step with a last row.
  cutStep(last, share) {
    const times = this.array("row_times"), rows = this.array("rows"), first = last - 4;
    for (let k = 0; k < this.width; ++k) {
      const at = (node) => (first + node) * this.width + k;
      const c = powersOf(range(5).map((node) => rows[at(node)]));
      range(5).forEach((node) => { rows[at(node)] = valueAt(c, share * node / 4); });
    }
    const length = share * (times[last] - times[first]);
    range(5).forEach((node) => { times[first + node] = times[first] + length * node / 4; });
  }

  // The columns of a port, undefined if this loop has none of that name.
  columns(port) {
    const place = this.loop.ports[port];
    return place && range(place[1]).map((k) => place[0] + k);
  }

  // Those of a signal by the name that a recording has for it.
  signal(name) { return this.columns(this.loop.signals[name]); }

  // Columns in a row.
  row(columns, i) { return columns.map((k) => this.rows[i * this.width + k]); }

  // The number of the step with a time; of a jump the one before it.
  step(t) {
    let low = 0, high = this.ends.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[this.ends[middle]] < t) low = middle + 1; else high = middle;
    }
    return low;
  }

  // Columns at a time, in the step s if that is given.
  vector(columns, t, s = this.step(t)) {
    const last = this.ends[s], i = last - 4;
    if (last === undefined) return this.row(columns, 0);
    const x = 4 * clamp((t - this.time[i]) / (this.time[last] - this.time[i]), 0, 1), weights = [1, 1, 1, 1, 1];
    for (let a = 0; a < 5; ++a) for (let b = 0; b < 5; ++b) if (a !== b) weights[a] *= (x - b) / (a - b);
    return columns.map((k) => weights.reduce((sum, w, a) => sum + w * this.rows[(i + a) * this.width + k], 0));
  }
}
