// Makes the page. All runs that it shows are simulated here, by modules of WebAssembly.

import { setCursor, togglePlay } from "./clock.js";
import { answer, goUp, makeSearch, makeTabs } from "./diagram.js";
import { isDriveKey, makeHand, toggleDrive } from "./drive.js";
import { $, say } from "./elements.js";
import { makeGuess } from "./guess.js";
import { makeInputs, setInput } from "./inputs.js";
import { range } from "./numbers.js";
import "./scene.js";
import { makeScopes, togglePin, zoom } from "./scopes.js";
import { makeLink, showLinkedState } from "./link.js";
import { makeOutcome } from "./outcome.js";
import { makePrint } from "./print.js";
import { makeSaving } from "./save.js";
import { makeTries } from "./tries.js";
import { refresh } from "./simulate.js";
import { chosen, state, unpack, values } from "./state.js";

const FIRST_SCOPES = ["tool_velocity", "environment_force", "tool_position"];

// Moves the cursor by a fraction of the window.
function moveCursor(share) {
  const [begin, end] = state.window;
  setCursor(state.cursor + (end - begin) * share);
}

// The action of each key outside of a field.
const ACTIONS = {
  " ": togglePlay,
  p: togglePin,
  d: () => state.data.hand && toggleDrive(),
  "/": () => $("search").focus(),
  "?": explain,
  ArrowLeft: () => moveCursor(-1 / 200),
  ArrowRight: () => moveCursor(1 / 200),
  "+": () => zoom(1 / 1.5, state.cursor),
  "-": () => zoom(1.5, state.cursor),
  0: () => zoom(Infinity, 0),
  Escape: () => (state.drive ? toggleDrive() : goUp()),
  Enter: (event) => answer({ type: "click", target: event.target }),
};

// Whether a key belongs to the field or button that has the focus.
function isOfField({ key, target }) {
  if (target.matches?.("input, select")) return key !== "Escape";
  return target.matches?.("button") && [" ", "Enter"].includes(key);
}

// Performs the action of a key.
function press(event) {
  if (isOfField(event)) return;
  const isArrow = event.key.startsWith("Arrow");
  if (state.data.hand && isDriveKey(event.key) && (state.drive || isArrow)) {
    state.keys.add(event.key);
  } else if (ACTIONS[event.key]) {
    ACTIONS[event.key](event);
  } else {
    return;
  }
  event.preventDefault();
}

// Makes the page dark or light as the system is, and the button that switches between both.
function makeTheme() {
  const { style } = document.documentElement;
  style.colorScheme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  $("theme").onclick = () => {
    style.colorScheme = style.colorScheme === "dark" ? "light" : "dark";
  };
  $("explain").onclick = explain;
}

// Shows the explanation of each part of the page, or hides it.
function explain() {
  const isExplained = document.body.classList.toggle("explained");
  $("explain").ariaPressed = isExplained;
}

// Handles the events of pointers and keys.
function listen() {
  for (const type of ["click", "mouseover", "mouseout", "focusin", "focusout"]) {
    $("level").addEventListener(type, answer);
  }
  $("play").onclick = togglePlay;
  $("pin").onclick = togglePin;
  $("clock").oninput = () => setCursor(Number($("clock").value));
  document.addEventListener("keydown", press);
  document.addEventListener("keyup", (event) => state.keys.delete(event.key));
  // A window without focus receives no event when a key is released.
  addEventListener("blur", () => state.keys.clear());
  addEventListener("resize", () => setCursor(state.cursor));
}

// Chooses the signals that are plotted at first.
function chooseScopes() {
  const { signals, ports, numbers } = state.loops[0];
  const usual = signals.tool_velocity ? FIRST_SCOPES : Object.keys(signals).slice(0, 3);
  const names = state.data.scopes.length ? state.data.scopes : usual;
  state.scopes = names.map((name) => signals[name]).filter((port) => ports[port]);
  state.window = [numbers["memory.clock"][0], numbers.run[0]];
}

// Makes the page.
async function start() {
  await unpack();
  $("notes").textContent = state.data.notes.join("\n");
  makeTabs();
  makeSearch();
  makeTheme();
  listen();
  if (state.data.hand) makeHand();
  makeInputs();
  makeSaving();
  makeLink();
  makePrint();
  if (!state.loops[0].module) {
    document.body.classList.add("still");
    return;
  }
  makeTries();
  makeOutcome();
  makeGuess();
  chooseScopes();
  makeScopes();
  await refresh();
  if (location.hash) await showLinkedState();
  fitFrame();
}

// Gives the frame of a notebook the height of the page.
function fitFrame() {
  const frame = window.frameElement;
  if (!frame) return;
  const fit = () => {
    frame.style.height = `${document.documentElement.offsetHeight + 4}px`;
  };
  new ResizeObserver(fit).observe(document.body);
}

// All values of a signal: an array for each of its components.
function signalOf(run, name) {
  const rows = range(run.time.length);
  return run.signal(name).map((column) => rows.map((i) => run.rows[i * run.width + column]));
}

// The interface for scripts.
window.teleop = {
  ready: start().catch((error) => {
    say(error.message, "bad");
    throw error;
  }),
  // The kinds that are shown.
  get controllers() {
    return chosen().map((loop) => loop.kind);
  },
  // The inputs with their current values and their ranges or choices.
  get inputs() {
    const describe = ({ value, min, max, unit, choices }) =>
      choices ? { value, choices } : { value, min, max, unit };
    const all = Object.values(state.inputs);
    return Object.fromEntries(all.map((input) => [input.name, describe(input)]));
  },
  set: setInput,
  // Runs a controller at the values of the inputs.
  async run(kind) {
    const loop = chosen().find((x) => x.kind === kind);
    if (!loop) throw new RangeError(`controller ${kind}: must be one of ${this.controllers}`);
    await state.busy;
    const run = await loop.simulate(values(), undefined, state.hand);
    const names = Object.keys(loop.signals);
    const result = {
      time: [...run.time],
      signals: Object.fromEntries(names.map((name) => [name, signalOf(run, name)])),
      events: run.events,
      metrics: run.metrics,
      wall_time_ms: run.wall,
      diverged: Boolean(run.reason),
    };
    // The run itself is not enumerable, so that it is neither printed nor copied.
    return Object.defineProperty(result, "run", { value: run });
  },
  // The values at some times of a signal of a result of run().
  sample({ run }, name, times) {
    const columns = run.signal(name) ?? run.columns(name);
    if (!columns) {
      throw new RangeError(`signal ${name}: must be one of ${Object.keys(run.loop.signals)}`);
    }
    return columns.map((column) => times.map((t) => run.vector([column], t)[0]));
  },
};
