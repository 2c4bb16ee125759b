// The cursor: the instant that all pictures of the page show.

import { $ } from "./elements.js";
import { clamp } from "./numbers.js";
import { state, wholeTime } from "./state.js";

// The shortest time window of a drive, s, and the time around an event that plays slowly, s.
const SHOWN = 8;
const NEAR = 0.1;

const drawers = [];

// Calls a function whenever the cursor has moved.
export function onCursor(draw) {
  drawers.push(draw);
}

// Moves the cursor of all pictures.
export function setCursor(t) {
  const [min, max] = wholeTime();
  state.cursor = clamp(t, min, max);
  for (const draw of drawers) draw();
  Object.assign($("clock"), { min, max, value: state.cursor });
  $("now").textContent = `${state.cursor.toFixed(3)} s`;
}

// Moves the cursor to a time at the end of the window that is shown.
export function showLast(t) {
  state.window = [Math.max(0, t - SHOWN), Math.max(SHOWN, t)];
  setCursor(t);
}

// Shows the whole of the runs, and moves the cursor to their end.
export function showWhole() {
  const [first, last] = wholeTime();
  state.window = [first, Math.max(first + SHOWN, last)];
  setCursor(last);
}

// Whether one of the runs has an event at the cursor.
function isAtEvent() {
  return state.runs.some(({ events }) =>
    events.some(({ time }) => Math.abs(time - state.cursor) < NEAR),
  );
}

// Begins to play, or ends it.
export function togglePlay() {
  state.isPlaying = !state.isPlaying;
  $("play").textContent = state.isPlaying ? "❚❚" : "▶";
  if (!state.isPlaying) return;
  const [first, last] = wholeTime();
  if (state.cursor >= last) setCursor(first);
  let before = performance.now();
  const play = (now) => {
    if (!state.isPlaying) return;
    const speed = $("speed").value * ($("slow").checked && isAtEvent() ? 0.1 : 1);
    setCursor(state.cursor + (clamp(now - before, 0, 100) / 1000) * speed);
    before = now;
    if (state.cursor >= wholeTime()[1]) togglePlay();
    else requestAnimationFrame(play);
  };
  requestAnimationFrame(play);
}
