// The user's hand as the operator: keys, a pointer or a gamepad command the velocity.

import { showLast } from "./clock.js";
import { chooseTab } from "./diagram.js";
import { LEVELS, PICTURE } from "./contest.js";
import { $, make, nextFrame, say } from "./elements.js";
import { linkOfDrive } from "./link.js";
import { clamp } from "./numbers.js";
import { Run } from "./run.js";
import { hideBanner, showEnd } from "./score.js";
import { onRuns, refresh } from "./simulate.js";
import { chosen, settings, shownLoop, state, values } from "./state.js";
import { AXES } from "./units.js";

// The keys of each axis: backwards and forwards.
const KEYS = [
  ["ArrowLeft", "ArrowRight"],
  ["ArrowDown", "ArrowUp"],
  ["s", "w"],
  ["j", "l"],
  ["k", "i"],
  ["o", "u"],
];
const MOST_PICTURES = 6; // simulated at once to catch up; with more lag, simulated time is slower
const FULL_PULL = 80; // px
const DEAD_ZONE = 0.1; // the largest tilt of a stick at rest
const RUMBLE = 50; // ms
const WATCH = 50; // ms between two checks whether the hand starts a drive
const REST = 500; // ms for which the hand must rest before it can start another drive

export const isDriveKey = (key) => KEYS.flat().includes(key);

// The connected gamepads.
const gamepads = () => (navigator.getGamepads?.() ?? []).filter((pad) => pad);

// The tilts of the sticks of a gamepad along each axis, from -1 to 1.
function sticks() {
  const [pad] = gamepads();
  if (!pad) return [];
  const tilts = [pad.axes[0], -pad.axes[1], -pad.axes[3]];
  return tilts.map((x) => (Math.abs(x) > DEAD_ZONE ? x : 0));
}

// The velocity that the hand commands, m/s, by keys, a pointer that pulls and a gamepad's sticks.
function command() {
  const { num_axes: n, full_speed: full } = state.data.hand;
  // A hand has levels of speed, so that a link has exactly the same one.
  const most = LEVELS * Number($("strength").value);
  const tilts = sticks();
  return KEYS.slice(0, n).map(([less, more], k) => {
    const keys = Number(state.keys.has(more)) - Number(state.keys.has(less));
    const share = clamp(keys + (tilts[k] ?? 0) + (state.pull[k] ?? 0), -1, 1);
    return (full / LEVELS) * Math.round(most * share);
  });
}

// Makes a gamepad rumble in proportion to the haptic force at a time.
function rumble(run, t) {
  const pad = gamepads().find((x) => x.vibrationActuator);
  // Before the first step there is no force.
  if (!pad || !run.ends.length) return;
  const columns = run.columns("master/surgeon:haptic_force");
  const force = columns ? Math.hypot(...run.vector(columns, t)) : 0;
  const strongMagnitude = Math.min(1, force / (state.data.hand.newtons || 1));
  pad.vibrationActuator.playEffect("dual-rumble", { duration: RUMBLE, strongMagnitude });
}

// Simulates the loop with the hand's commands up to the time of the clock.
async function catchUp(run, begin) {
  const late = (performance.now() - begin) / 1000 - state.hand.at(-1)[0];
  for (let i = 0; i < Math.min(late / PICTURE, MOST_PICTURES) && !run.reason; ++i) {
    const before = state.hand.at(-1);
    const after = [before[0] + PICTURE, ...command()];
    state.hand.push(after);
    await run.follow(before, after);
  }
}

// Ends the current drive, or starts one.
export function toggleDrive() {
  if (state.drive) state.drive = null;
  else drive();
}

// Drives the chosen controller in real time until the drive ends.
export async function drive() {
  const mine = {};
  state.drive = mine;
  hideBanner();
  // The memory of a loop holds one run at a time.
  await state.busy;
  const loop = shownLoop();
  await loop.compile();
  const run = new Run(loop, loop.numbersAt(values()));
  state.hand = [[0, ...command().fill(0)]];
  state.runs = [run];
  document.body.classList.remove("fresh");
  $("drive").textContent = "End (Esc)";
  $("strength").disabled = true;
  $("metrics").replaceChildren();
  const begin = performance.now();
  const hasTime = () => run.endTime - state.hand.at(-1)[0] > PICTURE;
  while (state.drive === mine && !run.reason && hasTime()) {
    await catchUp(run, begin);
    const now = run.time.at(-1) ?? 0;
    showLast(now);
    say(`driving ${loop.title}: ${now.toFixed(1)} s`);
    rumble(run, now);
    await nextFrame();
  }
  await endDrive(loop.kind);
}

// Repeats the drive with every controller, and shows how the drive of one of them ended.
async function endDrive(kind) {
  offerHand();
  state.runs = [];
  await refresh();
  showEnd(kind, { again: drive, withController, linkOf: linkOfDrive });
}

// Drives another controller.
function withController(kind) {
  chooseTab(chosen().findIndex((loop) => loop.kind === kind));
  drive();
}

// Starts a drive when the hand moves: keys, a pointer on the picture, or a stick. After a drive the
// hand must rest first.
function watchHand() {
  let restSince = -Infinity;
  setInterval(() => {
    const now = performance.now();
    const isMoving = command().some((v) => v !== 0);
    if (state.drive) restSince = Infinity;
    else if (state.busy) return;
    else if (!isMoving) restSince = Math.min(restSince, now);
    else if (now - restSince > REST) drive();
    else restSince = Infinity;
  }, WATCH);
}

// Offers a text as a file.
function offer(id, type, text) {
  $(id).href = URL.createObjectURL(new Blob([text], { type }));
}

// Offers the commands of the drive as a file.
function offerHand() {
  const { num_axes: n, yaml } = state.data.hand;
  $("drive").textContent = "Drive again";
  $("strength").disabled = false;
  const head = ["time", ...AXES.slice(0, n).map((axis) => `v_${axis}`)];
  offer("save", "text/csv", [head, ...state.hand].join("\n"));
  if (yaml) offer("save-scenario", "application/yaml", yaml);
  $("saved").hidden = false;
}

// The command that repeats the drive with the current values of the inputs.
export function commandOfDrive() {
  const { command: first, options, surgeon } = state.data.hand;
  const set = settings().map(({ name, value }) => options[name] + value);
  return [first, ...set, `--duration ${state.hand.at(-1)[0]}`, surgeon].join(" ");
}

// Shows the command that repeats the drive. It breaks between words, never within one.
function showCommand() {
  if (!state.hand.length) return;
  const words = commandOfDrive().split(" ");
  $("repeat").replaceChildren(...words.flatMap((word) => [make("nobr", {}, word), " "]));
}

// Makes the hand's part of the page. A pointer on the picture commands a velocity in proportion to
// its distance from the place where it went down.
export function makeHand() {
  const scene = $("scene");
  let from = null;
  scene.addEventListener("pointerdown", ({ clientX, clientY, pointerId }) => {
    from = [clientX, clientY];
    scene.setPointerCapture(pointerId);
  });
  scene.addEventListener("pointermove", ({ clientX, clientY }) => {
    if (!from) return;
    state.pull = [(clientX - from[0]) / FULL_PULL, (from[1] - clientY) / FULL_PULL];
  });
  const release = () => {
    from = null;
    state.pull = [];
  };
  scene.addEventListener("pointerup", release);
  scene.addEventListener("pointercancel", release);
  $("drive").onclick = toggleDrive;
  const first = chosen().findIndex((loop) => loop.kind === state.data.hand.first);
  chooseTab(Math.max(0, first));
  document.body.classList.add("driven", "fresh");
  watchHand();
  onRuns(showCommand);
  $("save-scenario").hidden = !state.data.hand.yaml;
  $("save-scenario").download = `${state.data.hand.scenario}.yaml`;
  $("hand").hidden = false;
}
