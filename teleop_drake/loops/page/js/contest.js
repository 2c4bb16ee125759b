// A contest by link: a link has the settings, the hand and its score. Whoever opens it sees this
// drive as a ghost, and the page simulates the hand again to verify the score.

import { chooseTab } from "./diagram.js";
import { $ } from "./elements.js";
import { range } from "./numbers.js";
import { scoreOf, strengthInWords, wordsOfScore } from "./score.js";
import { refresh } from "./simulate.js";
import { chosen, shownLoop, state } from "./state.js";
import { latenessOf } from "./tries.js";

export const PICTURE = 1 / 60; // s, the time between two commands
export const LEVELS = 200; // of the speed of a hand, up to its full speed
const SAME_SCORE = 0.005; // the largest relative difference between equal scores

// The bytes that a stream makes of some bytes.
async function through(stream, bytes) {
  const piped = new Blob([bytes]).stream().pipeThrough(stream);
  return new Uint8Array(await new Response(piped).arrayBuffer());
}

// A hand as text: the levels of its commands, deflated.
export async function packHand(hand) {
  const unit = state.data.hand.full_speed / LEVELS;
  const levels = hand.flatMap(([, ...v]) => v.map((x) => Math.round(x / unit)));
  const bytes = new Uint8Array(Int16Array.from(levels).buffer);
  const packed = await through(new CompressionStream("deflate-raw"), bytes);
  const text = btoa(Array.from(packed, (x) => String.fromCharCode(x)).join(""));
  return text.replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
}

// The hand of a text.
export async function unpackHand(text) {
  const { full_speed: full, num_axes: n } = state.data.hand;
  let bytes;
  try {
    const plain = atob(text.replaceAll("-", "+").replaceAll("_", "/"));
    const packed = Uint8Array.from(plain, (c) => c.charCodeAt());
    bytes = await through(new DecompressionStream("deflate-raw"), packed);
  } catch {
    bytes = [];
  }
  if (!bytes.length || bytes.length % (2 * n)) throw new RangeError("hand: must be a whole one");
  const levels = new Int16Array(bytes.buffer);
  return range(levels.length / n).map((k) => {
    const v = levels.slice(k * n, (k + 1) * n);
    return [k * PICTURE, ...Array.from(v, (x) => (x * full) / LEVELS)];
  });
}

// Shows the drive of a link as a ghost, and asks to beat it, or reports that its score is wrong.
export async function challenge({ hand, strength, score }) {
  state.hand = await unpackHand(hand);
  $("strength").value = strength === "0.5" ? strength : "1";
  document.body.classList.remove("fresh");
  await refresh();
  const ghost = state.runs.find((run) => run.loop === shownLoop());
  state.pinned = [ghost];
  $("pin").textContent = "Unpin";
  const found = scoreOf(ghost).points;
  const claimed = Number(score);
  const isSame = Math.abs(found - claimed) <= SAME_SCORE * claimed;
  const settings = `${latenessOf(state.inputs)}, ${strengthInWords()}`;
  state.challenge = { points: found };
  $("challenge").textContent = isSame
    ? `Beat ${wordsOfScore(ghost)}, ${settings}, with ${ghost.loop.title}. Its drive is pale.`
    : `The link claims ${score} N s, but its hand gives ${wordsOfScore(ghost)} here.`;
  chooseTab(chosen().indexOf(ghost.loop));
}
