// The laboratory of a task: its sliders, its runs, and the figures and claims of these runs.

import { $, keyOf, make, makeButton } from "./elements.js";
import { Evidence, inSi, judge, measureClaim } from "./judge.js";
import { Loop } from "./loop.js";
import { MOST_LINES, placeOf, plot, sampleOf, samplesOf } from "./plot.js";
import { show } from "./numbers.js";
import { makeSlider } from "./slider.js";
import { sentencesOn } from "./words.js";

const BEFORE = 0.6; // s, shown before an event
const AFTER = 2.4; // s, and after it

const CHANGE = /^change of /; // of a signal since its start

// The signal, the event and the offset from the commanded velocity of numbers that the thesis
// prints, by metric. A number is marked from its event on.
const MARKS = {
  "puncture.velocity_overshoot": { signal: "tool_velocity", event: "puncture", offset: 1 },
  "puncture.force": { signal: "environment_force", event: "puncture", offset: 0 },
  "collision.rebound_velocity": { signal: "tool_velocity", event: "contact", offset: 0 },
  "collision.initial_impact_force": { signal: "environment_force", event: "contact", offset: 0 },
  "collision.peak_force": { signal: "environment_force", event: "contact", offset: 0 },
};
const MARK = 0.05; // The length of a mark, as a share of the shown time.

// Gives the browser time to draw and to handle events, such as a moved slider.
const rest = () => new Promise((go) => setTimeout(go));

// A task's sliders, with the runs, figures and claims that depend on them.
export class Lab {
  constructor(data) {
    const { name, inputs, controllers, claims } = data;
    const parts = inputs.flatMap((input) => input.parts ?? []);
    Object.assign(this, { name, claims, runs: [], pinned: [], window: [0, 1] });
    this.all = inputs;
    this.inputs = inputs.filter((input) => !parts.includes(input.name)).map((x) => ({ ...x }));
    this.loops = controllers.map((x) => new Loop(x, inputs));
    this.section = $(`lab-${name}`);
    this.figures = [...this.section.querySelectorAll("figure[data-signals]")];
    this.shown = "whole";
    this.version = 0;
    this.makeControls();
    this.figures.forEach((figure) => this.makeScopes(figure));
  }

  // The values of all inputs. A slider that is for both delays gives the values of both.
  values() {
    const pairs = this.all.map(({ name, value }) => [name, value]);
    const set = this.inputs.flatMap(({ name, value, parts = [name] }) =>
      [name, ...parts].map((part) => [part, value]),
    );
    return Object.fromEntries([...pairs, ...set]);
  }

  // Whether all sliders have the values of the thesis.
  isAsPublished() {
    const first = Object.fromEntries(this.all.map(({ name, value }) => [name, value]));
    return this.inputs.every(({ name, value }) => value === first[name]);
  }

  // Makes the sliders and buttons.
  makeControls() {
    const controls = this.section.querySelector(".controls");
    // The first runs are those at the thesis's numbers.
    controls.inert = true;
    const rows = this.inputs.map((input) => {
      const fields = makeSlider(input, (value) => this.set({ [input.name]: value }));
      return make("div", { className: "row" }, make("label", {}, input.label), ...fields);
    });
    const first = Object.fromEntries(this.inputs.map(({ name, value }) => [name, value]));
    this.back = makeButton("The thesis's numbers", () => this.set(first), { disabled: true });
    this.windows = ["whole", "puncture", "contact"].map((shown) =>
      makeButton(shown === "whole" ? "whole run" : shown, () => this.look(shown), { value: shown }),
    );
    this.status = make("span", { className: "status", role: "status" });
    const bar = make("div", { className: "bar" }, this.back, "Show", ...this.windows, this.status);
    this.outcome = make("p", { className: "outcome", ariaLive: "polite" });
    controls.append(...rows, bar, this.outcome);
    this.inputs.forEach((input) => input.show());
  }

  // Makes the pictures of a figure's signals.
  makeScopes(figure) {
    const live = figure.querySelector(".live");
    for (const signal of figure.dataset.signals.split(",")) {
      const scope = make("div", { className: "scope" }, make("div", { className: "head" }));
      const label = `${signal.replaceAll("_", " ")} over time`;
      scope.insertAdjacentHTML("beforeend", `<svg role="img" aria-label="${label}"></svg>`);
      scope.dataset.signal = signal;
      live.append(scope);
    }
  }

  // Sets inputs, and simulates.
  set(values) {
    for (const input of this.inputs) {
      if (!(input.name in values)) continue;
      const { min, max } = input;
      const wanted = values[input.name];
      if (wanted >= min && wanted <= max) input.value = wanted;
      input.show();
    }
    return this.refresh();
  }

  // Simulates with the current values; simulates again if they change meanwhile.
  refresh() {
    ++this.version;
    this.busy ??= this.simulate().finally(() => {
      this.busy = null;
    });
    return this.busy;
  }

  // Simulates until no input has changed meanwhile.
  async simulate() {
    let version;
    do {
      version = this.version;
      const isStale = () => this.version !== version;
      const begin = performance.now();
      const runs = [];
      for (const loop of this.loops) {
        const run = await loop.simulate(this.values(), isStale);
        if (!run) break;
        runs.push(run);
        await rest();
      }
      if (runs.length === this.loops.length) this.show(runs, performance.now() - begin);
      await rest();
    } while (version !== this.version);
  }

  // Shows runs that took some milliseconds.
  show(runs, wall) {
    this.runs = runs;
    this.published ??= runs;
    this.pinned = this.isAsPublished() ? [] : this.published;
    this.back.disabled = this.isAsPublished();
    this.section.querySelector(".controls").inert = false;
    this.status.textContent = `${runs.length} runs simulated in ${wall.toFixed(0)} ms`;
    this.outcome.replaceChildren(...sentencesOn(runs));
    this.look(this.shown);
    this.judge();
  }

  // Shows the whole run or the time around an event.
  look(shown) {
    this.shown = shown;
    for (const button of this.windows) button.ariaPressed = button.value === shown;
    const times = this.runs.flatMap(({ events }) => events.filter(({ name }) => name === shown));
    const [first] = times.map(({ time }) => time).sort((a, b) => a - b);
    const { startTime, endTime } = this.runs[0];
    this.window =
      first === undefined ? [startTime, endTime] : [Math.max(0, first - BEFORE), first + AFTER];
    this.figures.forEach((figure) => figure.classList.add("stale"));
    this.draw();
  }

  // Draws the figures that are in view, or all.
  draw(isAll = false) {
    if (!this.runs.length) return;
    for (const figure of this.figures) {
      const { top, bottom } = figure.getBoundingClientRect();
      const isInView = bottom > -100 && top < innerHeight + 100;
      if (!figure.classList.contains("stale") || !(isInView || isAll)) continue;
      figure.querySelectorAll(".scope").forEach((scope) => this.drawScope(scope));
      figure.classList.remove("stale");
    }
  }

  // The marks of the numbers that the thesis prints for a signal, in the colours of the runs.
  marksOf(signal) {
    const [begin, end] = this.window;
    return this.claims.flatMap(({ shown, printed, unit, relations: [first] }) => {
      const place = ["direct", "adaptive"].indexOf(shown);
      const mark = place < 0 ? undefined : MARKS[first.metric];
      if (mark?.signal !== signal) return [];
      const run = this.published[place];
      const event = run.events.find(({ name }) => name === mark.event);
      if (!event) return [];
      const level = inSi(printed, unit) + mark.offset * run.z.command[0];
      const points = [event.time, event.time + MARK * (end - begin)].map((t) => [t, level]);
      return { points, color: run.loop.color, dashes: "", className: "printed" };
    });
  }

  // Draws a signal of all runs.
  drawScope(scope) {
    const { signal } = scope.dataset;
    const name = signal.replace(CHANGE, "");
    const port = this.loops.map(({ signals }) => signals[name]).find((x) => x);
    const [head, svg] = scope.children;
    const { size } = placeOf(this, port);
    const width = svg.clientWidth;
    const height = svg.clientHeight;
    const marks = this.marksOf(signal);
    const view = { ...this, mostLines: size, isChange: CHANGE.test(signal), marks };
    const { svg: content, unit } = plot(view, port, width, height);
    svg.innerHTML = content;
    // On paper the picture is scaled to the available width.
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const keys = this.runs.filter((run) => run.columns(port)).map(({ loop }) => keyOf(loop));
    const components = size <= MOST_LINES ? samplesOf(this, port) : [];
    const title = signal.replaceAll("_", " ");
    const pale = this.pinned.length ? "pale: our run at the thesis's numbers" : "";
    head.replaceChildren(make("b", {}, unit ? `${title} [${unit}]` : title));
    head.append(...components, ...keys, pale);
    if (marks.length) head.append(sampleOf("printed in the thesis", "", "printed"));
  }

  // What has other settings than the thesis's, as in "0.1 s" for the delay alone.
  settingsOfThesis() {
    const first = Object.fromEntries(this.all.map(({ name, value }) => [name, value]));
    const moved = this.inputs.filter(({ name, value }) => value !== first[name]);
    const isDelay = moved.length === 1 && moved[0].name === "delay";
    return isDelay ? `${show(first.delay)} s` : "the thesis's settings";
  }

  // Measures the claims on the current runs; shows what has changed if a slider has moved.
  judge() {
    const evidence = new Evidence(this.runs, this.name);
    const found = this.claims.map((claim) => [claim.key, measureClaim(evidence, claim)]);
    this.found = Object.fromEntries(found);
    this.foundFirst ??= this.found;
    const isMoved = !this.isAsPublished();
    for (const claim of this.claims) {
      const now = this.found[claim.key];
      const published = this.foundFirst[claim.key];
      const said = judge(claim, now, published, this.settingsOfThesis());
      const item = $(`claim-${claim.key}`);
      const line = item.querySelector(".now");
      line.hidden = !isMoved;
      const words = make("b", {}, said.words);
      line.replaceChildren(`With these sliders: ${said.before}`, words, said.after);
      const hasTurned = now.holds !== null && now.holds !== published.holds;
      item.classList.toggle("turned", isMoved && hasTurned);
    }
  }
}
