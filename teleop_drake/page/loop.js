"use strict";
// Loops, runs of them, and what is measured of a run. See model.py for the numbers, integrator/ for
// run() of a module, step_polynomials.py for the steps of a run, measures.py for what is measured.

const [DONE, FULL, STUCK] = [0, 1, 2];
const [ROWS, TRIES] = [4, 6];
const MOST_TRIES = 4e6, MOST_ROOM = 1 << 19;

// C's mathematics that Math does not have.
const FUNCTIONS = { fmod: (x, y) => x % y };

// Whole numbers from 0 on.
const range = (n) => Array.from({ length: n }, (_, i) => i);
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

// The sum of products.
function dot(a, b) {
  let sum = 0;
  for (let i = 0; i < a.length; ++i) sum += a[i] * b[i];
  return sum;
}

// Returns where a condition becomes true between two numbers.
function bisect(low, high, isBeyond) {
  for (let middle = (low + high) / 2; low < middle && middle < high; middle = (low + high) / 2) {
    if (isBeyond(middle)) high = middle; else low = middle;
  }
  return high;
}

// The module of a controller, and its memory.
class Loop {
  constructor(data, inputs) {
    Object.assign(this, data, { inputs });
    this.room = { row_times: 4096, row_ends: 4096, rows: 4096, steps: 4096, values: 4096, breaks: 1024 };
  }

  // Compiles the module, once.
  compile() { return (this.compiled ??= this.instantiate()); }

  // Makes the module's functions, which work on its memory.
  async instantiate() {
    const name = "__linear_memory", code = this.module;
    // The import says how many pages the module's own constants take.
    const pages = code[new TextDecoder("latin1").decode(code).indexOf(name) + name.length + 2];
    this.start = 65536 * pages;
    this.memory = new WebAssembly.Memory({ initial: pages + 16 });
    const module = await WebAssembly.compile(code), env = {};
    for (const { name, kind } of WebAssembly.Module.imports(module)) {
      env[name] = kind === "memory" ? this.memory : Math[name] ?? FUNCTIONS[name];
    }
    this.exports = (await WebAssembly.instantiate(module, { env })).exports;
  }

  // Returns all numbers of a run at values of the inputs; see inputs.py's Added().
  numbersAt(values) {
    const z = {};
    for (const key in this.numbers) z[key] = this.numbers[key].slice();
    for (const input of this.inputs.filter((x) => !x.choices)) {
      const { slopes, stops } = this.changes[input.name], value = values[input.name];
      for (const [key, [places, rates]] of Object.entries(slopes)) {
        places.forEach((p, i) => { z[key][p] += (value - input.value) * rates[i]; });
      }
      for (const [key, tables] of Object.entries(stops)) {
        const stop = tables[input.stops.indexOf(value)], base = this.numbers[key];
        const adds = stop.length === base.length && base.every(Number.isFinite);
        if (!adds) z[key] = stop.slice();
        else stop.forEach((x, i) => { if (x !== base[i]) z[key][i] += x - base[i]; });
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
      for (const [field, [size, ...rest], isWhole] of fields) {
        const x = z[`${group}.${field}`], width = rest.reduce((a, b) => a * b, 1);
        const first = group === "memory" && this.room[field] || (x && width ? x.length / width : size);
        places[field] = take(first * width);
        header.push(places[field].at, first, ...rest);
        writes.push([places[field], x, isWhole]);
      }
      writes.push([take(header.length), header, true]);
      headers.push(writes.at(-1)[0].at);
    }
    const missing = end - this.memory.buffer.byteLength;
    if (missing > 0) this.memory.grow(Math.ceil(missing / 65536));
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
    for (let i = 1; this.feed && i < hand.length; ++i) {
      if (!await run.follow(hand[i - 1], hand[i], isStale)) return null;
    }
    if (!await run.advance(run.duration, isStale)) return null;
    run.wall = performance.now() - begin;
    return run;
  }
}

// A polynomial in [0, 1] is its coefficients, from five values at equal distances.
const TO_POWERS = [[3, 0, 0, 0, 0], [-25, 48, -36, 16, -3], [70, -208, 228, -112, 22],
  [-80, 288, -384, 224, -48], [32, -128, 192, -128, 32]];
const NODES = [0, 0.25, 0.5, 0.75, 1];
const polynomial = (y) => TO_POWERS.map((row) => dot(row, y) / 3);

// Its value at a place.
function valueAt(c, x) {
  let sum = 0;
  for (let i = c.length - 1; i >= 0; --i) sum = sum * x + c[i];
  return sum;
}

// Where a polynomial changes its sign between its five points: [x, whether upwards].
function signChanges(c) {
  const isAbove = (x) => valueAt(c, x) >= 0, above = NODES.map(isAbove);
  return [0, 1, 2, 3].filter((j) => above[j] !== above[j + 1])
    .map((j) => [bisect(j / 4, (j + 1) / 4, (x) => isAbove(x) !== above[j]), above[j + 1]]);
}

// Values between which a polynomial is monotonic, from its five values.
function trace(y) {
  const c = polynomial(y), slope = c.slice(1).map((a, i) => (i + 1) * a);
  return [y[0], ...signChanges(slope).map(([x]) => valueAt(c, x)), y[4]];
}

// The mean of the square of such a polynomial is y . MASS y / 5670.
const MASS = [[292, 296, -174, 56, -29], [296, 1792, -384, 256, 56], [-174, -384, 1872, -384, -174],
  [56, 256, -384, 1792, 296], [-29, 56, -174, 296, 292]];

// What can be measured of a form from one piece of time to another; see measures.py.
const OPERATIONS = {
  time: (run, form, i) => run.pieces[i]?.[0] ?? run.time.at(-1),
  before: (run, [y], i) => (i ? y[i - 1][4] : y[0][0]),
  maximum: (run, [y], i, j) => (i < j ? y.slice(i, j).reduce((most, x) => Math.max(most, ...trace(x)), -Infinity)
    : OPERATIONS.before(run, [y], i)),
  rise: (...x) => Math.max(OPERATIONS.maximum(...x), 0),
  minimum: (run, [y], ...x) => -OPERATIONS.maximum(run, [y.map((v) => v.map((a) => -a))], ...x),
  rms: ({ pieces }, [y]) => Math.sqrt(y.reduce((sum, x, i) =>
    sum + (pieces[i][1] - pieces[i][0]) * dot(x, MASS.map((row) => dot(row, x))) / 5670, 0) / pieces.at(-1)[1]),
  peak: (run, [y]) => y.reduce((most, x) => Math.max(most, ...trace(x).map(Math.abs)), 0),
  variation: (run, [y]) => y.flatMap(trace).reduce((sum, x, i, all) => sum + (i && Math.abs(x - all[i - 1])), 0),
  // The rms of how far what is felt, integrated, is from the tool; see _CoordinationError().
  distance: (run, [felt, p]) => {
    let at = p[0][0];
    return OPERATIONS.rms(run, [felt.map((values, i) => {
      const [a, b] = run.pieces[i], c = polynomial(values).map((x, k) => x / (k + 1)), begin = at;
      at += (b - a) * valueAt(c, 1);
      return NODES.map((x, k) => begin + (b - a) * x * valueAt(c, x) - p[i][k]);
    })]);
  },
  // The same as settling, of velocity and force in all directions; see Insertion.Metrics().
  rest: (run, forms, i, j) => {
    const [[[slow]], [[share]]] = forms.slice(-2), n = forms.length / 2 - 1;
    // The coefficients of |y - end|^2 - limit^2.
    const beyond = (axes, ends, limit) => run.pieces.map((_, m) => axes.reduce((sum, y, k) => {
      const [first, ...others] = polynomial(y[m]), c = [first - ends[k], ...others];
      c.forEach((a, p) => c.forEach((b, q) => { sum[p + q] += a * b; }));
      return sum;
    }, [-(limit ** 2), 0, 0, 0, 0, 0, 0, 0, 0]));
    return OPERATIONS.settling(run, range(Math.ceil(n / 3)).flatMap((k) => {
      const [v, F] = [0, n].map((at) => forms.slice(at + 3 * k, at + Math.min(3 * k + 3, n)));
      const ends = F.map((y) => y.at(-1)[4]), isPushed = F.flat(2).some((x) => x);
      return [beyond(v, [0, 0, 0], slow), ...isPushed ? [beyond(F, ends, share * Math.hypot(...ends))] : []];
    }), i, j, true);
  },
  // How long after an instant all forms stay below 0; see _SettlingTime().
  settling: (run, forms, i, _, arePowers) => {
    if (run.reason || i === run.pieces.length) return null;
    const begin = run.pieces[i][0], areFast = forms.map((y) => y[i][0] >= 0);
    let since = areFast.includes(true) ? null : begin, longest = 0;
    const changes = forms.flatMap((y, k) => run.crossings(y, arePowers).map(([t, isUp]) => [t, isUp, k]));
    for (const [t, isUp, k] of changes.filter(([t]) => t > begin).sort((a, b) => a[0] - b[0])) {
      areFast[k] = isUp;
      if (since !== null && isUp) longest = Math.max(longest, t - since);
      if (since === null || isUp) since = areFast.includes(true) ? null : t;
    }
    return since === null || run.pieces.at(-1)[1] - since <= longest ? null : since - begin;
  },
};

// A run: rows at five instants of each step, its ends among them. A time that stands twice is a jump.
class Run {
  constructor(loop, z) {
    Object.assign(this, { loop, z, width: loop.width, reason: "", time: [], rows: [], ends: [] });
    [this.duration, this.accuracy, this.longest, this.speed, this.delay] = z.run;
    [this.headers, this.places] = loop.layOut(z);
  }

  // An array in memory, as it is now.
  array(name, kind, count) { return new kind(this.loop.memory.buffer, this.places[name].at, count); }

  // Gives the arrays that can be full twice the room, in this run and later ones.
  grow() {
    const { room, memory } = this.loop, names = Object.keys(this.places);
    const old = names.map((x) => this.array(x, Uint8Array, 8 * this.places[x].count).slice());
    for (const name of ["steps", "values", "breaks"]) room[name] *= 2;
    if (room.steps > MOST_ROOM) throw new Error("the run needs too many steps");
    [this.headers, this.places] = this.loop.layOut(this.z);
    names.forEach((x, i) => new Uint8Array(memory.buffer, this.places[x].at).set(old[i]));
  }

  // Simulates until a time. Returns whether it did: `isStale` may say that nobody waits for it.
  async advance(end, isStale = () => false) {
    let status = FULL, pause = performance.now() + 300;
    while (status === FULL && !this.reason) {
      status = this.loop.exports.run(...this.headers, end, this.accuracy, this.longest);
      const counts = this.array("counts", Int32Array, 14), n = counts[2 * ROWS], first = this.time.length;
      const ends = this.array("row_ends", Int32Array, 2 * n);
      const rows = this.array("rows", Float64Array, n * this.width).slice();
      this.time.push(...this.array("row_times", Float64Array, n));
      for (let i = 0; i < n; ++i) {
        this.rows.push(rows.subarray(i * this.width, (i + 1) * this.width));
        if (ends[2 * i]) this.ends.push(first + i);
      }
      counts[2 * ROWS] = 0;
      this.limit(first);
      if (status < 0) throw new Error("an index is outside of its array");
      if (status === STUCK) this.reason ||= "the step would have to be too small";
      if (counts[2 * TRIES] > MOST_TRIES) throw new Error("the loop is too stiff");
      if (status === FULL && !n) this.grow();
      if (performance.now() > pause) {
        await new Promise((go) => setTimeout(go));
        if (isStale()) return false;
        pause = performance.now() + 100;
      }
    }
    return true;
  }

  // Simulates as long as a hand's command goes along a line, from [time, ...v_d] to another.
  follow([begin, ...before], [end, ...after], isStale) {
    const [place, size] = this.loop.feed;
    this.array("y", Float64Array, place + size).set([begin, end, ...before, ...after], place);
    return this.advance(end, isStale);
  }

  // Ends a run whose tool has become too fast, or that is not finite, where that is.
  limit(first) {
    const v = this.signal("tool_velocity"), all = range(this.width);
    const isGood = (row) => (v ? Math.hypot(...v.map((k) => row[k])) <= this.speed : row.every(Number.isFinite));
    const bad = this.rows.findIndex((row, i) => i >= first && !isGood(row));
    if (bad < 0) return;
    this.reason = "the tool exceeds its speed limit";
    const s = this.ends.findIndex((end) => end >= bad), begin = this.ends[s] - 4;
    this.ends.length = s < 0 ? this.ends.length : s + 1;
    if (s >= 0 && v && this.rows.slice(begin, begin + 5).every((row) => row.every(Number.isFinite))) {
      // The step is cut where the speed is reached.
      const t = bisect(this.time[begin], this.time[bad], (x) => Math.hypot(...this.vector(v, x, s)) >= this.speed);
      const times = range(5).map((k) => this.time[begin] + k / 4 * (t - this.time[begin]));
      const rows = times.map((x) => Float64Array.from(this.vector(all, x, s)));
      this.time.splice(begin, 5, ...times);
      this.rows.splice(begin, 5, ...rows);
    } else if (s >= 0) this.ends.pop();
    this.time.length = this.rows.length = (this.ends.at(-1) ?? 0) + 1;
  }

  // The columns of a port, undefined if this loop has none of that name.
  columns(port) {
    const place = this.loop.ports[port];
    return place && range(place[1]).map((k) => place[0] + k);
  }

  // Those of a signal by the name that a recording has for it.
  signal(name) { return this.columns(this.loop.signals[name]); }

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
    if (last === undefined) return columns.map((k) => this.rows[0][k]);
    const x = 4 * clamp((t - this.time[i]) / (this.time[last] - this.time[i]), 0, 1), near = Math.round(x);
    if (Math.abs(x - near) < 1e-12) return columns.map((k) => this.rows[i + near][k]);
    const weights = [1, 1, 1, 1, 1], rows = this.rows.slice(i, i + 5);
    for (let a = 0; a < 5; ++a) for (let b = 0; b < 5; ++b) if (a !== b) weights[a] *= (x - b) / (a - b);
    return columns.map((k) => dot(weights, rows.map((row) => row[k])));
  }

  // Cuts the steps at instants: [begin, end, number of the step].
  split(instants) {
    const cuts = [...instants].sort((a, b) => a - b);
    return this.ends.flatMap((last, s) => {
      const all = [this.time[last - 4], this.time[last]];
      while (cuts.length && cuts[0] <= all[0]) cuts.shift();
      while (cuts[0] < all.at(-1)) all.splice(-1, 0, cuts.shift());
      return all.slice(1).map((end, i) => [all[i], end, s]);
    });
  }

  // The values of a form at five instants of each piece.
  form(name) {
    const { forms, columns, late } = this.loop.measures, all = [...columns, ...late], n = all.length + 1;
    const weights = this.z.forms.slice(n * forms.indexOf(name)), isUsed = (_, k) => weights[k];
    const now = columns.filter(isUsed), old = late.filter((_, k) => weights[columns.length + k]);
    const used = weights.slice(0, n - 1).filter(isUsed), [w, w_old] = [used.slice(0, now.length), used.slice(now.length)];
    return this.pieces.map(([a, b, s]) => NODES.map((share, k) => {
      // Just within the piece, so that a jump at its end has happened or has not.
      const t = a + share * (b - a), sent = t - this.delay + [1, 0, 0, 0, -1][k] * Math.min(1e-11, (b - a) / 8);
      const past = old.length && sent >= 0 ? dot(w_old, this.vector(old, sent)) : 0;
      return weights[n - 1] + dot(w, this.vector(now, t, s)) + past;
    }));
  }

  // When values in pieces change their sign, and whether upwards.
  crossings(y, arePowers = false) {
    return y.flatMap((values, i) => {
      const above = values[0] >= 0;
      if (!arePowers && values.every((v) => v >= 0 === above)) return [];
      const [a, b] = this.pieces[i];
      return signChanges(arePowers ? values : polynomial(values)).map(([x, isUp]) => [a + x * (b - a), isUp]);
    });
  }

  // When columns jump, the beginning among these.
  jumps(columns) {
    return this.time.filter((t, i) => !i || t === this.time[i - 1]
      && columns.some((k) => this.rows[i][k] !== this.rows[i - 1][k]));
  }

  // What happened, in the order of time, and the pieces that it cuts.
  get events() {
    if (this.found) return this.found;
    const { events, mode, late } = this.loop.measures, found = (this.found = []), cuts = [];
    if (!this.ends.length || !this.loop.measures.forms.length) return found;
    this.pieces = this.split(late.length ? this.jumps(late).map((t) => t + this.delay) : []);
    for (const [form, into, out] of events) {
      for (const [time, isInto] of this.crossings(this.form(form))) {
        cuts.push(time);
        if (into) found.push({ name: isInto ? into : out, time });
      }
    }
    for (let i = 1; mode !== null && i < this.time.length; ++i) {
      const [a, b] = [this.rows[i - 1][mode], this.rows[i][mode]];
      if (a !== b) found.push({ name: b === 1 ? "surgeon_force" : "surgeon_stop", time: this.time[i] });
    }
    this.pieces = this.split([...this.pieces.map(([a]) => a), ...cuts]);
    return found.sort((a, b) => a.time - b.time);
  }

  // The first piece after the first of some instants; undefined if none of them was.
  instant(names) {
    for (const name of names.split("|")) {
      if (name === "begin") return 0;
      if (name === "end") return this.pieces.length;
      const [event, before] = name.split(" after "), first = this.events.findIndex((e) => e.name === before);
      const found = this.events.find((e, i) => e.name === event && i > first);
      if (found) return this.pieces.filter(([a, b]) => a + b < 2 * found.time).length;
    }
  }

  // The numbers of `teleop-drake run --json`.
  get metrics() {
    if (this.measured || !this.events || !this.pieces) return this.measured ?? {};
    const forms = {};
    for (const name of this.loop.measures.forms) forms[name] = this.form(name);
    if (forms.excess) {
      // An overshoot is one in the direction of the command, which reverses where a piece ends.
      const isBack = forms.command.map((y) => y.reduce((a, b) => a + b) < 0);
      forms.excess = forms.excess.map((y, i) => (isBack[i] ? y.map((v) => -v) : y));
    }
    this.measured = {};
    for (const [name, operation, used, from, until] of this.loop.measures.rows) {
      const begin = this.instant(from), end = this.instant(until);
      if (begin === undefined) continue;
      this.measured[name] = OPERATIONS[operation](this, used.map((x) => forms[x]), begin, end);
    }
    return this.measured;
  }

  // The surfaces that are somewhere: {name, point, normal}.
  get surfaces() {
    const { surfaces: names } = this.loop, n = this.z.surfaces.length / names.length / 2;
    const part = (i) => Array.from(this.z.surfaces.slice(i * n, (i + 1) * n));
    return names.map((name, i) => ({ name, point: part(2 * i), normal: part(2 * i + 1) }))
      .filter((s) => s.point.every(Number.isFinite));
  }
}
