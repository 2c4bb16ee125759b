// The subtitle of the page, and buttons with settings to try.

import { $, makeButton } from "./elements.js";
import { setInput } from "./inputs.js";
import { show } from "./numbers.js";
import { onRuns } from "./simulate.js";
import { chosen, state } from "./state.js";

const NUMBERS = ["no controller", "one controller", "two controllers", "three controllers"];

// The delays of packets in words.
export function latenessOf({ forward_delay: forward, return_delay: back, delay }) {
  if (!forward || !back) return delay ? `${show(delay.value)} s late` : "";
  if (forward.value === back.value) return `${show(forward.value)} s late`;
  return `${show(forward.value)} s late there and ${show(back.value)} s back`;
}

// Shows the number of controllers, except for a page of a Diagram, and the delays of packets.
function showSubtitle() {
  const count = chosen().length;
  const controllers = state.data.isDiagram ? "" : (NUMBERS[count] ?? `${count} controllers`);
  const task = state.data.hand ? "push the tool to the bone, and let it rest there" : "";
  const words = [task, controllers, latenessOf(state.inputs)].filter((text) => text);
  $("subtitle").textContent = words.length ? `: ${words.join(", ")}` : "";
}

// A longer delay to try: three times the present one.
const longer = ({ value, max }) => (value ? Math.min(max, 3 * value) : max / 5);

// The texts of buttons for a delay, and the values that they set. Its name is left out if all that
// is late has this delay.
function triesOfDelay({ name, min, ...delay }) {
  const late = longer(delay);
  const block = name === "delay" ? "" : `${name.replace(/[._]delay$/, "").replaceAll("_", " ")} `;
  return [min, late].map((time) => [`${block}${show(time)} s late`, { [name]: time }]);
}

// The text of a button for the largest value of a slider or the next choice, and what it sets.
function tryOf({ name, label, max, choices, value }) {
  const [title, unit = ""] = label.split(/ \[|\]/);
  const other = choices?.find((choice) => choice !== value);
  const text = choices ? `${title}: ${other}` : `${title} = ${show(max)} ${unit}`;
  return [text.trim(), { [name]: other ?? max }];
}

// Three settings to try: the text of a button, and the values that it sets, keyed by input.
function triesOf(inputs) {
  const { forward_delay: forward, return_delay: back, delay } = inputs;
  const isOffered = ({ isField, isTried = true }) => !isField && isTried;
  const sliders = Object.values(inputs).filter(isOffered);
  const ways = delay ? [delay] : sliders.filter(({ isDelay }) => isDelay);
  const tries = ways.length === 1 ? triesOfDelay(ways[0]) : ways.map((way) => triesOfDelay(way)[1]);
  if (forward && back) {
    const way = { forward_delay: forward.min, return_delay: Math.min(back.max, 2 * back.value) };
    tries.push(["late on the way back only", way]);
  }
  tries.push(...sliders.filter(({ isDelay }) => !isDelay).map(tryOf));
  const isNew = ([, values]) =>
    Object.entries(values).some(([name, value]) => value !== inputs[name].value);
  return tries.filter(isNew).slice(0, 3);
}

// Makes the buttons of the settings to try, and one that restores the first values.
export function makeTries() {
  const set = async (values) => {
    for (const [name, value] of Object.entries(values)) {
      if (state.inputs[name].value !== value) await setInput(name, value);
    }
  };
  const first = Object.entries(state.inputs).map(([name, { value }]) => [name, value]);
  const tries = triesOf(state.inputs);
  onRuns(showSubtitle);
  if (!tries.length) return;
  const buttons = tries.map(([text, values]) => makeButton(text, () => set(values)));
  const back = makeButton("As it was", () => set(Object.fromEntries(first)));
  $("tries").append("Try: ", ...buttons, back);
}
