// The end of a drive: a report, a score to compare, and buttons for the next step.

import { $, make, makeButton, say } from "./elements.js";
import { setInput } from "./inputs.js";
import { show } from "./numbers.js";
import { chosen, settings, state } from "./state.js";
import { capital } from "./words.js";

// The time of the first command that is not zero, s.
function firstPush() {
  const found = state.hand.find(([, ...v]) => v.some((x) => x !== 0));
  return found ? found[0] : 0;
}

// A time in words, or another text if it is undefined.
const after = (t, otherwise = "") => (t === undefined ? otherwise : `after ${t.toFixed(2)} s`);

// The score of a run with the hand's commands: time to the bone, largest force, time to rest, and
// one number to rank by. Without rest on the bone, there is no such number.
export function scoreOf(run) {
  const contact = run.metrics["collision.time"];
  const bone = contact === undefined ? undefined : contact - firstPush();
  const force = run.metrics["collision.peak_force"];
  const rest = run.metrics["collision.rest_time"];
  return { bone, force, rest, points: rest === undefined ? undefined : force * (bone + rest) };
}

export const RULE =
  "The score is the largest force times the time from push to rest: less is better.";

// A score in words.
export function wordsOfScore(run) {
  const { bone, force, rest, points } = scoreOf(run);
  if (points === undefined) return "no rest on the bone";
  return `${show(force, 3)} N, ${(bone + rest).toFixed(2)} s (${points.toFixed(2)} N s)`;
}

// An input's value in words, as in "bone stiffness 300 N/m".
function valueInWords({ label, value, unit, choices }) {
  if (choices) return `${label} ${value}`;
  return `${label.replace(/ \[.*/, "")} ${show(value)} ${unit}`.trim();
}

// The strength of the hand in words.
export function strengthInWords() {
  return `${$("strength").selectedOptions[0].textContent} hand`;
}

// The score in a line with all settings that are needed to repeat the drive.
export function scoreLine(run) {
  const { scenario, seed, settings: given } = state.data.hand;
  const { bone, force, rest, points } = scoreOf(run);
  const inputs = settings().map(valueInWords);
  const parts = [
    [scenario, run.loop.title, ...inputs, ...given, strengthInWords()].join(", "),
    seed === null ? "" : `seed ${seed}`,
    `bone ${after(bone, "not reached")}`,
    force === undefined ? "" : `largest force ${show(force)} N`,
    bone === undefined ? "" : rest === undefined ? "not at rest" : `at rest ${after(rest)}`,
    points === undefined ? "" : `score ${points.toFixed(2)} N s`,
  ];
  return parts.filter((part) => part).join("; ");
}

// A sentence on the driven run.
function storyOf(run) {
  const title = capital(run.loop.title);
  const last = run.time.at(-1);
  if (!run.reason) return `You drove ${run.loop.title} for ${last.toFixed(1)} s.`;
  const late = Math.max(0, last - firstPush()).toFixed(1);
  return `${title} ran away ${late} s after you pushed: ${run.reason}.`;
}

// Whether a run beats the drive of the link.
function verdictOnChallenge(run) {
  if (!state.challenge) return RULE;
  const { points = Infinity } = scoreOf(run);
  const { points: theirs = Infinity } = state.challenge;
  return `${points < theirs ? "You beat the link" : "The link is not beaten"}. ${RULE}`;
}

// Hides the banner.
export function hideBanner() {
  $("banner").hidden = true;
}

// Shows the banner at the end of a drive: `again` and `withController` start another one.
export function showEnd(kind, actions) {
  const { again, withController, linkOf } = actions;
  const run = state.runs.find((x) => x.loop.kind === kind);
  if (!run) return;
  const line = scoreLine(run);
  const buttons = [makeButton("Again", again)];
  for (const { kind: other, title } of chosen()) {
    if (other !== kind) buttons.push(makeButton(`With ${title}`, () => withController(other)));
  }
  const { delay } = state.inputs;
  if (delay && delay.value > delay.min) {
    const repeat = () => setInput("delay", delay.min).then(() => showEnd(kind, actions));
    buttons.push(makeButton(`This drive again, ${show(delay.min)} s late`, repeat));
  }
  const copy = (text, what) =>
    navigator.clipboard.writeText(text).then(
      () => say(`${what} is copied`),
      () => $("banner").append(make("code", {}, text)),
    );
  buttons.push(
    makeButton("Copy the score", () => copy(line, "the score")),
    makeButton("Copy a link to beat", async () => copy(await linkOf(run), "the link")),
    makeButton("Close", hideBanner),
  );
  const curves = "The curves show this drive with every controller.";
  $("banner").replaceChildren(
    make("p", {}, `${storyOf(run)} ${curves}`),
    make("code", {}, line),
    make("p", {}, verdictOnChallenge(run)),
    ...buttons,
  );
  $("banner").hidden = false;
}
