// The loop of a controller: its WebAssembly module, the memory of the module, and the numbers of a
// run. See Model.numbers in model.py.

import { Run } from "./run.js";

const PAGE = 65536; // bytes
const FIRST_ROOM = 4096; // rows
const SHORTEST_HAND = 8; // s, of a run without commands

// The module of a controller, and its memory.
export class Loop {
  constructor(data, inputs) {
    Object.assign(this, data, { data, inputs, room: FIRST_ROOM });
  }

  // Compiles the module, once.
  compile() {
    this.compiled ??= this.instantiate();
    return this.compiled;
  }

  // Instantiates the module with its memory. Its run() is at place 1 of a table; see wasm.py.
  async instantiate() {
    this.memory = new WebAssembly.Memory({ initial: this.start / PAGE + 16 });
    const module = await WebAssembly.compile(this.module);
    const table = new WebAssembly.Table({ initial: 2, element: "anyfunc" });
    const env = { __linear_memory: this.memory, __indirect_function_table: table };
    for (const { name, kind } of WebAssembly.Module.imports(module)) {
      if (kind === "function") env[name] = Math[name] ?? ((a, b) => a % b); // fmod
    }
    await WebAssembly.instantiate(module, { env });
    this.run = table.get(1);
  }

  // The numbers of a run at values of the inputs; see Change.Added() in inputs.py.
  numbersAt(values) {
    const names = Object.keys(this.numbers);
    const z = Object.fromEntries(names.map((name) => [name, this.numbers[name].slice()]));
    for (const input of this.inputs) {
      const change = this.changes[input.name];
      if (change) this.addChange(z, input, change, values[input.name]);
    }
    return z;
  }

  // Adds the changes by an input's value to the numbers of a run.
  addChange(z, input, { slopes, stops }, value) {
    for (const [name, [places, rates]] of Object.entries(slopes)) {
      places.forEach((place, i) => {
        z[name][place] += (value - input.value) * rates[i];
      });
    }
    for (const [name, tables] of Object.entries(stops)) {
      const stop = tables[input.stops.indexOf(value)];
      const base = this.numbers[name];
      const isSum = stop.length === base.length && base.every(Number.isFinite);
      z[name] = isSum ? z[name].map((x, i) => x + stop[i] - base[i]) : stop.slice();
    }
  }

  // Writes numbers into memory; returns the addresses of the headers and the places of all arrays.
  layOut(z) {
    let end = this.start;
    const take = (count) => {
      const place = { at: end, count };
      end += 8 * count;
      return place;
    };
    const places = {};
    const headers = [];
    const writes = [];
    for (const [group, fields] of Object.entries(this.headers)) {
      const header = [];
      for (const [field, shape, isWhole, grows] of fields) {
        const values = z[`${group}.${field}`];
        const [first, width] = this.shapeOf(shape, values, grows);
        places[field] = take(first * width);
        header.push(places[field].at, first, ...shape.slice(1));
        // What a run has not written into its rows, it does not read.
        writes.push({ place: places[field], values, isWhole, isKept: field.startsWith("row") });
      }
      const place = take(header.length);
      writes.push({ place, values: header, isWhole: true });
      headers.push(place.at);
    }
    this.memory.grow(Math.max(0, Math.ceil((end - this.memory.buffer.byteLength) / PAGE)));
    for (const write of writes) this.write(write);
    return [headers, places];
  }

  // The number of rows of an array, and the number of elements in each.
  shapeOf([size, ...rest], values, grows) {
    const width = rest.reduce((a, b) => a * b, 1);
    const given = values && width ? values.length / width : 0;
    if (grows) return [given + this.room, width];
    return [values && width ? given : size, width];
  }

  // Writes values to a place in memory, and zeros behind them if nothing is kept there.
  write({ place: { at, count }, values, isWhole, isKept }) {
    const kind = isWhole ? BigInt64Array : Float64Array;
    const array = new kind(this.memory.buffer, at, count);
    if (!isKept) array.fill(isWhole ? 0n : 0);
    if (values) array.set(isWhole ? Array.from(values, BigInt) : values);
  }

  // Simulates at values of the inputs, with the commands of a hand if the loop takes them. Returns
  // null if `isStale` meanwhile reports that the run is not needed.
  async simulate(values, isStale, hand = []) {
    await this.compile();
    const begin = performance.now();
    const run = new Run(this, this.numbersAt(values));
    if (this.feed) run.endTime = hand.at(-1)?.[0] ?? SHORTEST_HAND;
    for (let i = 1; i < hand.length; ++i) {
      if (!(await run.follow(hand[i - 1], hand[i], isStale))) return null;
    }
    if (!(await run.advance(run.endTime, isStale))) return null;
    run.wall = performance.now() - begin;
    return run;
  }
}
