// The current state of the page, and the model in its file.

import { $ } from "./elements.js";
import { Loop } from "./loop.js";

export const state = {
  data: null, // The data by _Data() of page.py.
  inputs: {}, // The inputs by name, with their current values.
  loops: [], // The loops of all controllers and choices.
  tab: 0, // The index of the chosen loop whose diagram is shown,
  level: "", // and the path of the level that is open.
  scopes: [], // Ports whose signals are plotted.
  runs: [], // The plotted runs,
  pinned: [], // and earlier ones that are plotted pale.
  cursor: 0, // s
  window: [0, 1], // The time that scopes show, s.
  isPlaying: false,
  screenScheme: "", // The colour scheme to restore after printing.
  version: 0, // Counts changes of the inputs.
  busy: null, // The promise of the current simulation.
  drive: null, // The current drive,
  hand: [], // its commands, [time, ...v_d],
  keys: new Set(), // the pressed keys,
  pull: [], // and the pull of a pointer along each axis.
  challenge: null, // The score to beat.
  guess: null, // The guessed delay, s.
};

// Returns the data that are packed in the page; see PackedData() of document.py.
export async function unpackData() {
  const text = atob($("model").textContent);
  const packed = Uint8Array.from(text, (c) => c.charCodeAt());
  const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(plain).arrayBuffer();
  const size = Number(new DataView(bytes).getBigUint64(0, true));
  const base = 8 + size;
  // Bytes and arrays of numbers follow the JSON, which has their places.
  const revive = (_, value) => {
    if (value?.$b) return new Uint8Array(bytes, base + value.$b[0], value.$b[1]);
    if (value?.$f) return new Float64Array(bytes, base + value.$f[0], value.$f[1]);
    return value;
  };
  return JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 8, size)), revive);
}

// Reads the model of the page.
export async function unpack() {
  state.data = await unpackData();
  state.inputs = Object.fromEntries(
    state.data.inputs.map((input) => {
      // A number of a block is in its box; a slider can be made of it.
      const { name, value: first, isField: isNumber } = input;
      return [name, { ...input, first, isNumber }];
    }),
  );
  state.loops = state.data.controllers.map((x) => new Loop(x, state.data.inputs));
}

// The loops that belong to the choices of the inputs.
export function chosen() {
  const isChosen = ({ choice }) =>
    Object.keys(choice).every((name) => choice[name] === state.inputs[name].value);
  return state.loops.filter(isChosen);
}

// The loop whose diagram is shown.
export const shownLoop = () => chosen()[state.tab];

// The earliest start and the latest end of the shown runs, s.
export function wholeTime() {
  if (!state.runs.length) return [0, 0];
  const starts = state.runs.map((run) => run.startTime);
  const ends = state.runs.map((run) => run.endTime);
  return [Math.min(...starts), Math.max(...ends)];
}

// The values of the inputs, keyed by name.
export function values() {
  return Object.fromEntries(Object.values(state.inputs).map(({ name, value }) => [name, value]));
}

// Whether an input has another value than at first.
export const isChanged = ({ value, first }) => value !== first;

// The numbers of blocks that have other values than at first.
export const changedFields = () =>
  Object.values(state.inputs).filter((input) => input.isNumber && isChanged(input));

// The sliders that set the current state: one for both delays where they are equal.
export function settings() {
  const inputs = Object.values(state.inputs).filter(({ isNumber }) => !isNumber);
  const isCommon = ({ parts }) =>
    parts?.every((part) => state.inputs[part].value === state.inputs[parts[0]].value);
  const common = inputs.filter(isCommon);
  const replaced = common.flatMap(({ parts }) => parts);
  return inputs.filter((input) =>
    input.parts ? common.includes(input) : !replaced.includes(input.name),
  );
}
