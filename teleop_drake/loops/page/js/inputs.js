// The inputs: sliders, numbers, and choices.

import { $, make, makeButton, say } from "./elements.js";
import { refresh } from "./simulate.js";
import { makeSlider } from "./slider.js";
import { state } from "./state.js";

// Sets an input, to the nearest stop if it has stops. The input `delay` sets both delays.
export function setInput(name, value) {
  const { inputs } = state;
  if (!inputs[name]) {
    throw new RangeError(`input ${name}: must be one of ${Object.keys(inputs)}`);
  }
  checkValue(inputs[name], value);
  const { stops, parts = [name] } = inputs[name];
  const allowed = stops ? nearest(stops, value) : value;
  for (const part of parts) inputs[part].value = allowed;
  for (const input of Object.values(inputs)) {
    if (input.parts) input.value = meanOf(input.parts.map((part) => inputs[part].value));
    input.show();
  }
  return refresh();
}

// Throws a RangeError if a value is not allowed for an input.
function checkValue({ name, min, max, choices }, value) {
  // A text is no number, although "" lies between -1 and 1.
  const isWithin = typeof value === "number" && value >= min && value <= max;
  if (choices ? choices.includes(value) : isWithin) return;
  const given = typeof value === "string" && !choices ? JSON.stringify(value) : value;
  const allowed = choices ? `one of ${choices}` : `from ${min} to ${max}`;
  throw new RangeError(`${name} = ${given}: must be ${allowed}`);
}

const nearest = (stops, value) =>
  stops.reduce((a, b) => (Math.abs(b - value) < Math.abs(a - value) ? b : a));

const meanOf = (numbers) => numbers.reduce((sum, x) => sum + x, 0) / numbers.length;

// Makes a slider and a number for each input, or a list of choices.
export function makeInputs() {
  for (const input of Object.values(state.inputs)) {
    const fields = input.choices
      ? makeChoice(input)
      : makeSlider(input, (value) => setFromField(input.name, value));
    input.row = make("div", { className: "row" }, make("label", {}, input.label), ...fields);
    if (input.isField) offerSlider(input);
    else $("inputs").append(input.row);
    input.show();
  }
}

// Makes the button that makes a slider of a number of a block.
function offerSlider(input) {
  const { row, name, label } = input;
  row.classList.add("number");
  const button = makeButton("slider", () => {
    button.remove();
    row.classList.remove("number");
    row.firstChild.textContent = name + (/ \[.*/.exec(label) ?? "");
    input.isField = false;
    $("inputs").append(row);
    row.querySelector("input").focus();
  });
  row.append(
    Object.assign(button, { title: "Make a slider of it", ariaLabel: `slider of ${label}` }),
  );
}

// Sets an input to the value of one of its fields; reports a value that is not allowed.
function setFromField(name, value) {
  try {
    setInput(name, value);
  } catch (error) {
    say(error.message, "bad");
  }
}

// Makes the list of an input's choices.
function makeChoice(input) {
  const options = input.choices.map((choice) => make("option", {}, choice));
  const list = make("select", { ariaLabel: input.label }, ...options);
  list.oninput = () => setFromField(input.name, list.value);
  input.show = () => {
    list.value = input.value;
  };
  return [list];
}
