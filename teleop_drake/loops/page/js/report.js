// The executable thesis: each figure simulates its runs here, and their claims are judged again.

import { $ } from "./elements.js";
import { Lab } from "./lab.js";
import { unpackData } from "./state.js";

const labs = [];

// Shows only the claims with a verdict and their figures; "" shows all.
function filter(verdict) {
  for (const element of document.querySelectorAll("[data-verdict]")) {
    element.hidden = verdict !== "" && element.dataset.verdict !== verdict;
  }
  for (const figure of document.querySelectorAll("figure")) {
    figure.hidden = verdict !== "" && !figure.querySelector("[data-verdict]:not([hidden])");
  }
  for (const button of $("filter").children) button.ariaPressed = button.value === verdict;
  labs.forEach((lab) => lab.draw());
}

// Handles the buttons; draws the figures that come into view.
function makeButtons() {
  $("filter").onclick = ({ target }) => target.value !== undefined && filter(target.value);
  const { style } = document.documentElement;
  style.colorScheme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  $("theme").onclick = () => {
    style.colorScheme = style.colorScheme === "dark" ? "light" : "dark";
  };
  document.addEventListener("scroll", () => labs.forEach((lab) => lab.draw()), { passive: true });
  addEventListener("resize", () => labs.forEach((lab) => lab.look(lab.shown)));
  addEventListener("beforeprint", () => labs.forEach((lab) => lab.draw(true)));
}

// Makes the laboratories and simulates them one after another, the one in view first.
async function makeReport() {
  const { labs: all } = await unpackData();
  labs.push(...all.map((data) => new Lab(data)));
  makeButtons();
  const distance = ({ section }) => Math.abs(section.getBoundingClientRect().top);
  for (const lab of [...labs].sort((a, b) => distance(a) - distance(b))) await lab.refresh();
}

// The interface for scripts.
window.teleop = { labs, ready: makeReport() };
