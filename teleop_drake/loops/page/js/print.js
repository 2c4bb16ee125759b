// The page for paper: its current state in another layout.

import { $ } from "./elements.js";
import { show } from "./numbers.js";
import { drawScopes } from "./scopes.js";
import { isChanged, state } from "./state.js";

// The values of the inputs in one line.
function valuesInWords() {
  const isShown = (input) => !input.parts && (!input.isField || isChanged(input));
  const inputs = Object.values(state.inputs).filter(isShown);
  const isNumber = (value) => typeof value === "number";
  return inputs
    .map(({ label, value }) => `${label}: ${isNumber(value) ? show(value) : value}`)
    .join(" · ");
}

// Lays out the page for paper, or again for the screen.
function layOut(isPaper) {
  $("printed").textContent = valuesInWords();
  $("metrics").before($("printed"));
  // On paper the sentences are the caption of the curves.
  $(isPaper ? "scopes" : "story").after($("outcome"));
  document.body.classList.toggle("printing", isPaper);
  const { style } = document.documentElement;
  if (isPaper) {
    state.screenScheme = style.colorScheme;
    style.colorScheme = "light";
  } else {
    style.colorScheme = state.screenScheme;
  }
  drawScopes();
}

// Handles the browser's events of printing.
export function makePrint() {
  addEventListener("beforeprint", () => layOut(true));
  addEventListener("afterprint", () => layOut(false));
}
