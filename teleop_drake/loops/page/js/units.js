// Readable units, and names of components.

import { range } from "./numbers.js";

const PREFIXES = { [-3]: "n", [-2]: "µ", [-1]: "m", 0: "", 1: "k", 2: "M" };
export const AXES = ["x", "y", "z", "rx", "ry", "rz"];

// The factor and the unit with an SI prefix for a range, whose largest value is then 0.1 to 100;
// see ScaleAndUnit() of figures/style.py.
export function scaleAndUnit([low, high], unit) {
  const largest = Math.max(Math.abs(low), Math.abs(high));
  if (!["m", "m/s", "N"].includes(unit) || !(largest > 0 && largest < Infinity)) return [1, unit];
  const power = Math.floor(Math.log10(10 * largest) / 3);
  const exponent = Math.min(Math.max(power, -3), 2);
  return [10 ** (-3 * exponent), PREFIXES[exponent] + unit];
}

// The names of a signal's components in a loop: those of its plant; axes of the task, the row and
// the column in a matrix, or numbers; a scalar has no name.
export function componentsOf({ components }, port, size) {
  if (size === 1) return [""];
  const named = components[port];
  if (named) return named;
  const name = port.split(":").at(-1);
  if (name === "psi") {
    const order = Math.sqrt(size);
    return range(size).map((i) => `${1 + Math.floor(i / order)}${1 + (i % order)}`);
  }
  const isOfTask =
    /tool|environment|felt|haptic|control|command|desired|position|velocity|force|error/;
  const isOther = /joint|packet|weights|generalized/;
  const areAxes = size <= AXES.length && isOfTask.test(name) && !isOther.test(name);
  return range(size).map((i) => (areAxes ? AXES[i] : String(i + 1)));
}

// The unit of one of the components of a signal, half of which may have another unit than the rest,
// as in "rad, rad/s".
export function unitOfComponent(unit, i, size) {
  const units = unit.split(", ");
  return units[Math.floor((i * units.length) / size)];
}
