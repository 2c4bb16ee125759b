// Runs of all controllers at the values of the inputs.

import { setCursor, showWhole } from "./clock.js";
import { nextFrame, say } from "./elements.js";
import { chosen, state, values } from "./state.js";
import { showMetrics } from "./table.js";

// Simulates with the current values and shows the runs; repeats it if values change meanwhile.
export function refresh() {
  ++state.version;
  state.drive = null;
  // The shown runs belong to other values; if the simulation takes long, they become pale.
  document.body.classList.add("stale");
  state.busy ??= simulate()
    .catch((error) => say(error.message, "bad"))
    .finally(() => {
      state.busy = null;
    });
  return state.busy;
}

// Simulates until no input has changed meanwhile.
async function simulate() {
  let version;
  do {
    version = state.version;
    const begin = performance.now();
    const runs = await simulateAll(version);
    if (runs) showRuns(runs, performance.now() - begin);
    await nextFrame();
  } while (version !== state.version);
  document.body.classList.remove("stale");
}

// The runs of all controllers; null if the inputs have changed meanwhile.
async function simulateAll(version) {
  const isStale = () => state.version !== version;
  const runs = [];
  for (const loop of chosen()) {
    const run = await loop.simulate(values(), isStale, state.hand);
    if (!run) return null;
    runs.push(run);
    // The first picture of the page is drawn before the second run.
    if (!state.runs.length) {
      state.runs = [run];
      setCursor(run.startTime);
      await nextFrame();
    }
  }
  return runs;
}

const listeners = [];

// Calls a function whenever new runs are shown.
export function onRuns(listen) {
  listeners.push(listen);
}

// Shows runs that took some milliseconds.
function showRuns(runs, wall) {
  state.runs = runs;
  if (state.data.hand) showWhole();
  else setCursor(state.cursor);
  showMetrics();
  for (const listen of listeners) listen();
  const what = runs.length === 1 ? "1 run" : `${runs.length} runs`;
  say(`${what} simulated and drawn in ${wall.toFixed(0)} ms`);
}
