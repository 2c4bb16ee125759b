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

// Three settings to try: the text of a button, and the values that it sets, keyed by input.
function triesOf({ delay, forward_delay: forward, return_delay: back, ...others }) {
  const tries = [];
  if (delay) {
    const late = Math.min(delay.max, 3 * delay.value);
    tries.push([`${show(delay.min)} s late`, { delay: delay.min }]);
    tries.push([`${show(late)} s late`, { delay: late }]);
  }
  if (forward && back) {
    const way = { forward_delay: forward.min, return_delay: Math.min(back.max, 2 * back.value) };
    tries.push(["late on the way back only", way]);
  }
  const sliders = Object.values(others).filter(({ isField }) => !isField);
  for (const { name, label, max, choices, value } of sliders) {
    const other = choices?.find((choice) => choice !== value);
    tries.push(
      choices ? [`${label}: ${other}`, { [name]: other }] : [`largest ${label}`, { [name]: max }],
    );
  }
  return tries.slice(0, 3);
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
