// A slider with a number beside it.

import { make } from "./elements.js";
import { clamp, parse, show } from "./numbers.js";

// Makes the slider and the number field of an input, which call `set` with a value. If the input
// has stops, the slider has their indices.
export function makeSlider(input, set) {
  const { label: ariaLabel, stops, min, max } = input;
  // A drag has round values: at most 500 of them, in steps of 1, 2 or 5.
  const power = 10 ** Math.floor(Math.log10((max - min) / 200));
  const step = [5, 2, 1].find((x) => x * power <= (max - min) / 200) * power;
  const bounds = stops ? { min: 0, max: stops.length - 1, step: 1 } : { min, max, step: "any" };
  const slider = make("input", { type: "range", ariaLabel, ...bounds });
  const number = make("input", { type: "number", ariaLabel, step: "any" });
  const snap = (x) => clamp(Number((Math.round(x / step) * step).toPrecision(9)), min, max);
  slider.oninput = () => set(stops ? stops[slider.value] : snap(Number(slider.value)));
  number.onchange = () => set(parse(number.value));
  // A value that is not allowed gives way to the present one.
  number.onblur = () => input.show();
  input.show = () => {
    slider.value = stops ? stops.indexOf(input.value) : input.value;
    if (document.activeElement !== number) number.value = show(input.value);
  };
  return [slider, number];
}
