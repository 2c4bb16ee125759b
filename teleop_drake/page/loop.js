"use strict";
// Loops, runs of them, and what is measured of a run. See model.py for the numbers, integrator/ for
// what run() of a module does, and step_polynomials.py for the steps of a run.

const [DONE, FULL, STUCK] = [0, 1, 2];
const [ROWS, TRIES] = [4, 6];
const MOST_TRIES = 4e6, MOST_ROOM = 1 << 19;

// C's mathematics that Math does not have.
const FUNCTIONS = { fmod: (x, y) => x % y };

// The module of a controller, and its memory.
class Loop {
  constructor(data, inputs) {
    Object.assign(this, data, { inputs });
    this.room = { row_times: 4096, row_ends: 4096, rows: 4096, steps: 4096, values: 4096, breaks: 1024 };
  }

  async compile() {
    const { module: code } = this, name = "__linear_memory";
    // The import says how many pages the module's own constants take.
    const place = new TextDecoder("latin1").decode(code).indexOf(name) + name.length;
    this.start = 65536 * code[place + 2];
    this.memory = new WebAssembly.Memory({ initial: code[place + 2] + 16 });
    const module = await WebAssembly.compile(code), env = {};
    for (const { name, kind } of WebAssembly.Module.imports(module)) {
      env[name] = kind === "memory" ? this.memory : Math[name] ?? FUNCTIONS[name];
    }
    this.module = await WebAssembly.instantiate(module, { env });
  }

  // Returns all numbers of a run at values of the inputs; see inputs.py's Added().
  numbersAt(values) {
    const z = {};
    for (const key in this.numbers) z[key] = this.numbers[key].slice();
    for (const input of this.inputs) {
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
    const take = (count) => { const at = end; end += 8 * count; return at; };
    for (const [group, fields] of Object.entries(this.headers)) {
      const header = [];
      for (const [field, shape, isWhole] of fields) {
        const x = z[`${group}.${field}`], rest = shape.slice(1);
        const width = rest.reduce((a, b) => a * b, 1);
        const own = x && width ? x.length / width : shape[0];
        const first = group === "memory" && this.room[field] || own;
        places[field] = { at: take(first * width), count: first * width, first, group };
        header.push(places[field].at, first, ...rest);
        writes.push([places[field], x, isWhole]);
      }
      const place = { at: take(header.length), count: header.length };
      headers.push(place.at);
      writes.push([place, header, true]);
    }
    const missing = end - this.memory.buffer.byteLength;
    if (missing > 0) this.memory.grow(Math.ceil(missing / 65536));
    const { buffer } = this.memory;
    for (const [{ at, count }, x, isWhole] of writes) {
      new Uint8Array(buffer, at, 8 * count).fill(0);
      if (isWhole) x?.forEach((v, i) => { new BigInt64Array(buffer, at, count)[i] = BigInt(v); });
      else if (x) new Float64Array(buffer, at, count).set(x);
    }
    return [headers, places];
  }

  // Simulates at values of the inputs, with a hand where there is a place for one. Returns null if
  // `isStale` says so meanwhile.
  async simulate(values, isStale, hand = []) {
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

// A polynomial in [0, 1] is its coefficients, from five values at equal distances.
const TO_POWERS = [[3, 0, 0, 0, 0], [-25, 48, -36, 16, -3], [70, -208, 228, -112, 22],
  [-80, 288, -384, 224, -48], [32, -128, 192, -128, 32]];
const polynomial = (y) => TO_POWERS.map((row) => dot(row, y) / 3);
function valueAt(c, x) {
  let sum = 0;
  for (let i = c.length - 1; i >= 0; --i) sum = sum * x + c[i];
  return sum;
}
const slopeOf = (c) => c.slice(1).map((a, i) => (i + 1) * a);

// Where it changes its sign: [x, whether upwards].
function signChanges(c) {
  const found = [], isAbove = (x) => valueAt(c, x) >= 0;
  let most = 0;
  for (let i = 1; i < c.length; ++i) most += Math.abs(c[i]);
  if (Math.abs(c[0]) > most) return found;
  for (let j = 0; j < 16; ++j) {
    const [a, b] = [j / 16, (j + 1) / 16], after = isAbove(b);
    if (isAbove(a) !== after) found.push([bisect(a, b, (x) => isAbove(x) === after), after]);
  }
  return found;
}

// Values between which it is monotonic.
const trace = (c) => [0, ...signChanges(slopeOf(c)).map(([x]) => x), 1].map((x) => valueAt(c, x));

// Gauss's rule in [0, 1], exact for the square of a polynomial of degree four.
const GAUSS = [[0.5, 0.28444444444444444], [0.23076534494715845, 0.23931433524968324],
  [0.7692346550528415, 0.23931433524968324], [0.04691007703066802, 0.11846344252809454],
  [0.953089922969332, 0.11846344252809454]];

// A run: rows at five instants of each step, its ends among them. A time that stands twice is a jump.
class Run {
  constructor(loop, z) {
    Object.assign(this, { loop, z, width: loop.width, reason: "", time: [], rows: [], ends: [] });
    [this.duration, this.accuracy, this.longest, this.speed, this.delay] = z.run;
    [this.headers, this.places] = loop.layOut(z);
  }

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
      status = this.loop.module.exports.run(...this.headers, end, this.accuracy, this.longest);
      const counts = this.array("counts", Int32Array, 14), n = counts[2 * ROWS];
      const ends = this.array("row_ends", Int32Array, 2 * n), first = this.time.length;
      this.time.push(...this.array("row_times", Float64Array, n));
      this.rows.push(...Array.from({ length: n }, (_, i) => this.array("rows", Float64Array,
        n * this.width).slice(i * this.width, (i + 1) * this.width)));
      for (let i = 0; i < n; ++i) if (ends[2 * i]) this.ends.push(first + i);
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
    const v = this.signal("tool_velocity");
    const speedOf = (row) => Math.hypot(...(v ? row.subarray(v[0], v[0] + v[1]) : row));
    let i = first;
    while (i < this.rows.length && speedOf(this.rows[i]) <= (v ? this.speed : Infinity)) ++i;
    if (i === this.rows.length) return;
    this.reason = "the tool exceeds its speed limit";
    const s = this.ends.findIndex((end) => end >= i), end = this.ends[s];
    let t = this.time[i];
    const isWhole = s >= 0 && this.rows.slice(end - 4, end + 1).every((x) => x.every(Number.isFinite));
    if (isWhole && v) {
      t = bisect(this.time[end - 4], t, (x) => Math.hypot(...this.vector(v, x, s)) >= this.speed);
      const begin = this.time[end - 4], all = [0, this.width];
      const times = [0, 1, 2, 3, 4].map((k) => begin + k / 4 * (t - begin));
      const rows = times.map((x) => Float64Array.from(this.vector(all, x, s)));
      times.forEach((x, k) => { [this.time[end - 4 + k], this.rows[end - 4 + k]] = [x, rows[k]]; });
    }
    this.ends.length = Math.max(s < 0 ? this.ends.length : s + isWhole, 0);
    this.time.length = this.rows.length = (this.ends.at(-1) ?? 0) + 1;
  }

  // Where a port is in a row, undefined if this loop has none of that name.
  place(port) { return this.loop.ports[port]; }

  // The place of a signal by the name that a recording has for it.
  signal(name) { return this.place(this.loop.signals[name]); }

  // The number of the step with a time; of a jump the one before it.
  step(t) {
    let low = 0, high = this.ends.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[this.ends[middle]] < t) low = middle + 1; else high = middle;
    }
    return low;
  }

  // Component k of a port at a time, in the step s if that is given.
  at(place, k, t, s = this.step(t)) {
    const last = this.ends[s], column = place[0] + k, i = last - 4;
    if (last === undefined) return this.rows[0][column];
    const x = 4 * Math.min(Math.max((t - this.time[i]) / (this.time[last] - this.time[i]), 0), 1);
    const row = Math.round(x);
    if (Math.abs(x - row) < 1e-12) return this.rows[i + row][column];
    let sum = 0;
    for (let a = 0; a < 5; ++a) {
      let weight = this.rows[i + a][column];
      for (let b = 0; b < 5; ++b) if (a !== b) weight *= (x - b) / (a - b);
      sum += weight;
    }
    return sum;
  }

  // All components of a port at a time.
  vector(place, t, s) { return Array.from({ length: place[1] }, (_, k) => this.at(place, k, t, s)); }

  // The polynomials of f(t, step) from one time to another: [begin, end, coefficients].
  * pieces(f, from = 0, to = Infinity) {
    for (let s = this.step(from + 1e-12); s < this.ends.length; ++s) {
      const a = Math.max(this.time[this.ends[s] - 4], from), b = Math.min(this.time[this.ends[s]], to);
      if (a >= to) return;
      if (a < b) yield [a, b, polynomial([0, 1, 2, 3, 4].map((k) => f(a + k / 4 * (b - a), s)))];
    }
  }

  // When f changes its sign, and whether upwards.
  crossings(f) {
    return [...this.pieces(f)].flatMap(([a, b, c]) =>
      signChanges(c).map(([x, isUp]) => [a + x * (b - a), isUp]));
  }

  // The largest value of f from one time to another.
  maximum(f, from, to) {
    let best = -Infinity;
    for (const [, , c] of this.pieces(f, from, to)) {
      // It is below the sum of its coefficients' sizes.
      if (c[0] + dot([1, 1, 1, 1], c.slice(1).map(Math.abs)) > best) best = Math.max(best, ...trace(c));
    }
    return best > -Infinity ? best : f(from);
  }

  // The rms of f over the run; between two of the cuts it is smooth in each step.
  rms(f, cuts) {
    const end = this.time.at(-1), all = [0, ...cuts.filter((t) => t > 0 && t < end), end];
    let sum = 0;
    for (let i = 1; i < all.length; ++i) {
      for (const [a, b, c] of this.pieces(f, all[i - 1], all[i])) {
        for (const [x, weight] of GAUSS) sum += (b - a) * weight * valueAt(c, x) ** 2;
      }
    }
    return Math.sqrt(sum / (end || 1));
  }

  // When ports jump, the beginning among these.
  jumps(places) {
    return this.time.filter((t, i) => !i || t === this.time[i - 1] && places.some(([begin, size]) =>
      this.rows[i].some((x, k) => k >= begin && k < begin + size && x !== this.rows[i - 1][k])));
  }

  // The surface of a name as {point, normal}, undefined without.
  surface(name) {
    const i = this.loop.surfaces.indexOf(name), n = this.z.surfaces.length / this.loop.surfaces.length / 2;
    const part = (k) => Array.from(this.z.surfaces.slice((2 * i + k) * n, (2 * i + k + 1) * n));
    return i < 0 ? undefined : { name, point: part(0), normal: part(1) };
  }

  // What happened, in the order of time; as Insertion.FindEvents() finds it.
  get events() {
    if (this.found) return this.found;
    const events = [], p = this.signal("tool_position"), mode = this.signal("surgeon_mode");
    const names = { puncture: ["puncture", "heal"], contact: ["contact", "release"] };
    for (const [name, [into, out]] of Object.entries(names)) {
      const surface = p && this.surface(name);
      if (!surface) continue;
      const offset = dot(surface.point, surface.normal);
      const depth = (t, s) => dot(this.vector(p, t, s), surface.normal) - offset;
      for (const [time, isInto] of this.crossings(depth)) events.push({ name: isInto ? into : out, time });
    }
    for (let i = 1; mode && i < this.time.length; ++i) {
      const [a, b] = [this.rows[i - 1][mode[0]], this.rows[i][mode[0]]];
      if (a !== b) events.push({ name: b === 1 ? "surgeon_force" : "surgeon_stop", time: this.time[i] });
    }
    return (this.found = events.sort((a, b) => a.time - b.time));
  }

  // The numbers of `teleop-drake run --json`; see InsertionMetrics().
  get metrics() {
    if (this.measured) return this.measured;
    const { v_d } = this.z, end = this.time.at(-1), n = v_d.length, result = (this.measured = {});
    const [v, F, F_c] = ["tool_velocity", "environment_force", "control_force"].map((x) => this.signal(x));
    if (!n || !v || !F || !F_c) return result;
    const along = (place, d) => (t, s) => dot(this.vector(place, t, s), d);
    const first = (name, after = -1) => this.events.find((e) => e.name === name && e.time > after)?.time;
    // What the slave is asked for: of its packets, or what was commanded before the delay.
    const packet = this.signal("forward_packet_received");
    const late = ["force_command", "velocity_command"].map((x) => this.signal(x));
    const asked = (k, t, s) => {
      if (!late[1]) return this.at(packet, k, t, s);
      // Just within the step, so that a jump at its end has happened or has not.
      const last = this.ends[s], isEarly = 2 * t < this.time[last - 4] + this.time[last];
      const sent = t - this.delay + (isEarly ? 1e-11 : -1e-11);
      return sent < 0 ? 0 : this.at(late[k < n ? 0 : 1], k % n, sent);
    };
    const echoes = late[1] ? this.jumps(late).map((t) => t + this.delay) : [];
    const surfaces = ["puncture", "contact", ...this.loop.surfaces].map((x) => this.surface(x));
    const speed = Math.hypot(...v_d), axes = [...v_d.keys()];
    const normal = surfaces.find((x) => x)?.normal ?? Array.from(v_d, (x) => x / speed);
    const command = this.loop.constant_command ? () => dot(v_d, normal)
      : (t, s) => axes.reduce((sum, k) => sum + normal[k] * asked(n + k, t, s), 0);
    const reversals = this.loop.constant_command ? []
      : this.crossings((t, s) => command(t, s) + 1e-6 * speed).map(([t]) => t);
    // In the direction of the command, which reverses between two intervals.
    const overshoot = (from, to) => {
      const cuts = [from, ...reversals.filter((t) => t > from && t < to), to];
      return Math.max(...cuts.slice(1).map((b, i) => {
        const isBack = command((cuts[i] + b) / 2) < -1e-6 * speed, v_n = along(v, normal);
        return this.maximum((t, s) => (isBack ? -1 : 1) * (v_n(t, s) - command(t, s)), cuts[i], b);
      }));
    };
    const t_p = first("puncture"), t_c = first("contact");
    result.start_velocity_overshoot = Math.max(0, overshoot(0, t_p ?? t_c ?? end));
    for (const [name, t] of [["puncture", t_p], ["collision", t_c]]) {
      if (t === undefined) continue;
      const d = this.surface(name === "puncture" ? name : "contact").normal;
      const [v_n, F_n] = [along(v, d), along(F, d)], put = (key, x) => { result[`${name}.${key}`] = x; };
      put("time", t);
      put("velocity", v_n(t));
      if (name === "puncture") {
        put("force", F_n(t));
        put("velocity_overshoot", overshoot(t, first("contact", t) ?? end));
        continue;
      }
      put("initial_impact_force", this.maximum(F_n, t, first("release", t) ?? end));
      put("peak_force", this.maximum(F_n, t, end));
      put("rebound_velocity", -this.maximum((x, s) => -v_n(x, s), t, end));
      put("settling_time", this.reason ? null : this.settling(v_n, t, 0.05 * speed));
    }
    for (const k of axes) {
      result[`velocity_rms_error.${"xyz"[k]}`] = this.rms((t, s) => this.at(v, k, t, s) - asked(n + k, t, s), echoes);
      result[`force_rms_error.${"xyz"[k]}`] = this.rms((t, s) => this.at(F, k, t, s) - asked(k, t, s), echoes);
      const values = [...this.pieces((t, s) => this.at(F_c, k, t, s))].flatMap(([, , c]) => trace(c));
      result[`control_force_peak.${"xyz"[k]}`] = values.reduce((a, x) => Math.max(a, Math.abs(x)), 0);
      result[`control_force_variation.${"xyz"[k]}`] =
        values.reduce((sum, x, i) => sum + (i ? Math.abs(x - values[i - 1]) : 0), 0);
    }
    return result;
  }

  // How long after a contact |v| stays under a threshold; see _SettlingTime().
  settling(v, contact, threshold) {
    const changes = [1, -1].flatMap((sign) => this.crossings((t, s) => sign * v(t, s) - threshold))
      .filter(([t]) => t > contact).sort(([a], [b]) => a - b);
    let since = Math.abs(v(contact + 1e-9)) < threshold ? contact : null, longest = 0;
    for (const [t, isFast] of changes) {
      if (since !== null) longest = Math.max(longest, t - since);
      since = isFast ? null : t;
    }
    return since === null || this.time.at(-1) - since <= longest ? null : since - contact;
  }
}
