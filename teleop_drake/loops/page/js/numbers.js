// Small functions of numbers and vectors.

// Whole numbers from 0 on.
export const range = (n) => Array.from({ length: n }, (_, i) => i);

// A number within bounds.
export const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

// The number that a text stands for; NaN if it is no number, as a blank text.
export const parse = (text) => (text.trim() === "" ? NaN : Number(text));

// The sum of products.
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);

// The least and the largest of some numbers, or of numbers of some things.
export function extent(things, numberOf = (x) => x) {
  let low = Infinity;
  let high = -Infinity;
  for (const thing of things) {
    const value = numberOf(thing);
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  return [low, high];
}

// A number as text with few digits; a dash for undefined.
export function show(x, digits = 5) {
  if (x === undefined) return "–";
  const isLong = Math.abs(x) >= 1e5 || (x !== 0 && Math.abs(x) < 1e-4);
  return isLong ? x.toExponential(3) : String(+x.toPrecision(digits));
}
