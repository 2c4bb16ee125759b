// A slider with a number beside it.

import { make } from "./elements.js";
import { parse, show } from "./numbers.js";

// Makes the slider and the number field of an input, which call `set` with a value. If the input
// has stops, the slider has their indices.
export function makeSlider(input, set) {
  const { label: ariaLabel, stops, min, max } = input;
  const bounds = stops ? { min: 0, max: stops.length - 1, step: 1 } : { min, max, step: "any" };
  const slider = make("input", { type: "range", ariaLabel, ...bounds });
  const number = make("input", { type: "number", ariaLabel, step: "any" });
  slider.oninput = () => set(stops ? stops[slider.value] : Number(slider.value));
  number.onchange = () => set(parse(number.value));
  // A value that is not allowed gives way to the present one.
  number.onblur = () => input.show();
  input.show = () => {
    slider.value = stops ? stops.indexOf(input.value) : input.value;
    if (document.activeElement !== number) number.value = show(input.value);
  };
  return [slider, number];
}
