// A guess, and where the runs come to rest: a strip under the slider of the delay.
//
// The page asks from which delay on the loop no longer comes to rest, and hides what tells it. The
// guess is in the link. Many such links, one a line, make a histogram above the strip.

import { shownMotions } from "./outcome.js";
import { $, make, makeButton, say } from "./elements.js";
import { Loop } from "./loop.js";
import { clamp, parse, range, show } from "./numbers.js";
import { onRuns } from "./simulate.js";
import { chosen, shownLoop, state, values } from "./state.js";
import { capital } from "./words.js";

const GRID = 13; // delays that are simulated first,
const HALVINGS = 4; // of the intervals in which the verdict changes
const BINS = 20; // of the histogram
const ROW = 12; // px, of a controller in the strip
const TALL = 40; // px, of the histogram

// The verdicts, and how opaque the controller's colour is at them.
const VERDICTS = ["rests", "keeps moving", "runs away"];
const OPACITIES = [0.9, 0.35, 0];

// The input on which the guess is: the delay; undefined without one.
function delayInput() {
  const all = Object.values(state.inputs).filter(({ isField }) => !isField);
  return state.inputs.delay ?? all.find(({ name }) => /(^|[._])delay$/.test(name));
}

// Whether the runs can come to rest: on a bone or, in a Diagram, in any way.
function canRest() {
  const hits = ({ metrics, surfaces }) => metrics === "insertion" && surfaces.includes("contact");
  return !state.data.hand && delayInput() && (state.data.isDiagram || chosen().every(hits));
}

// The index of the verdict on a run at its end.
function verdictOf(run) {
  if (run.reason) return 2;
  if (!state.data.isDiagram) return run.metrics["collision.rest_time"] === undefined ? 1 : 0;
  const words = shownMotions(run).map(([, motion]) => motion);
  if (words.some((text) => /without bound|growing/.test(text))) return 2;
  return words.some((text) => /swings|still/.test(text)) ? 1 : 0;
}

// The index of the first pair [delay, verdict] of a row with at least a verdict; -1 without one.
const firstOf = (row, least) => row.findIndex(([, verdict]) => verdict >= least);

// The delay from which on a pair of a row holds: the middle between it and the one before.
const limitOf = (row, i) => (i ? (row[i][0] + row[i - 1][0]) / 2 : row[0][0]);

// The runs at many delays. They have loops of their own, as a loop's memory holds one run.
class Strip {
  constructor() {
    this.rows = new Map(); // For each kind, pairs [delay, verdict] in ascending order.
    this.known = new Set(); // The kinds whose rows are complete.
    this.loops = new Map();
    this.basis = "";
    this.answers = [];
  }

  // What the runs of the strip depend on: all inputs but the delay.
  others() {
    const { name, parts = [] } = delayInput();
    const kept = Object.entries(values()).filter(([key]) => key !== name && !parts.includes(key));
    return JSON.stringify(kept);
  }

  // Finds all verdicts again if what they depend on has changed.
  async refresh() {
    const basis = this.others();
    if (!this.isWanted || basis === this.basis) return;
    this.basis = basis;
    this.rows.clear();
    this.known.clear();
    const isStale = () => this.basis !== basis;
    const first = shownLoop();
    for (const loop of [first, ...chosen().filter((x) => x !== first)]) {
      if (!(await this.find(loop, isStale))) return;
      this.known.add(loop.kind);
      showQuestion();
    }
    this.draw("");
  }

  // Finds the verdicts of a controller; returns whether they are wanted until the end.
  async find(loop, isStale) {
    const { stops, min, max } = delayInput();
    if (!this.loops.has(loop)) this.loops.set(loop, new Loop(loop.data, state.data.inputs));
    this.loops.get(loop).largest = loop.largest;
    let found = [];
    const look = async (delay) => {
      const verdict = await this.verdictAt(this.loops.get(loop), delay, isStale);
      if (verdict === null) return false;
      found = [...found, [delay, verdict]].sort(([a], [b]) => a - b);
      this.rows.set(loop.kind, found);
      this.draw(`, after ${found.length} runs`);
      await new Promise((go) => setTimeout(go));
      return true;
    };
    for (const delay of stops ?? range(GRID).map((k) => min + (k * (max - min)) / (GRID - 1))) {
      if (!(await look(delay))) return false;
    }
    for (let k = 0; k < HALVINGS && !stops; ++k) {
      const changes = found.slice(1).filter(([, verdict], i) => verdict !== found[i][1]);
      for (const [delay] of changes) {
        const [before] = found[found.findIndex(([x]) => x === delay) - 1];
        if (!(await look((before + delay) / 2))) return false;
      }
    }
    return true;
  }

  // The verdict on the run at a delay; null if it is no longer wanted.
  async verdictAt(loop, delay, isStale) {
    const { name, parts = [name] } = delayInput();
    const set = Object.fromEntries([name, ...parts].map((part) => [part, delay]));
    const run = await loop.simulate({ ...values(), ...set }, isStale);
    return run && !isStale() ? verdictOf(run) : null;
  }

  // The verdicts on a controller in words: up to which delay it comes to rest.
  sentenceOn({ kind, title }) {
    const row = this.rows.get(kind);
    if (!row) return "";
    const { max } = delayInput();
    const failed = firstOf(row, 1);
    const away = firstOf(row, 2);
    const parts = [];
    if (failed < 0) parts.push(`comes to rest at each delay up to ${show(max)} s`);
    else if (failed === 0) parts.push(`does not come to rest even at ${show(row[0][0])} s`);
    else {
      const again = row.slice(failed).some(([, verdict]) => verdict === 0);
      const more = again ? ", and at some later ones" : "";
      parts.push(`comes to rest at delays up to ${show(limitOf(row, failed), 3)} s${more}`);
    }
    if (away >= 0) {
      const isAlways = row.slice(away).every(([, verdict]) => verdict === 2);
      const when = isAlways ? "from" : "at some delays from";
      parts.push(`runs away ${when} ${show(limitOf(row, away), 3)} s on`);
    }
    return `${capital(title)} ${parts.join(" and ")}. `;
  }

  // The strip in words.
  inWords() {
    const guess = state.guess === null ? "" : `The guess is ${show(state.guess, 3)} s.`;
    return chosen()
      .map((loop) => this.sentenceOn(loop))
      .concat(guess)
      .join("");
  }

  // The least verdict whose first delay is the question: the first one that is not at the start of
  // the strip of the shown controller; undefined while the runs are not known.
  leastAsked() {
    const { kind } = shownLoop();
    if (!this.known.has(kind)) return undefined;
    return [1, 2].find((least) => firstOf(this.rows.get(kind), least) > 0) ?? 1;
  }

  // Draws the strip; `progress` tells that there is more to come.
  draw(progress) {
    const { min, max } = delayInput();
    const at = (delay) => (100 * clamp((delay - min) / (max - min), 0, 1)).toFixed(2);
    const top = this.answers.length ? TALL : 0;
    const bands = chosen().flatMap(({ kind, color }, i) => {
      const row = this.rows.get(kind) ?? [];
      // Neighbours with the same verdict are one band.
      const starts = range(row.length).filter((k) => !k || row[k][1] !== row[k - 1][1]);
      return starts.map((k, j) => {
        const begin = at(k ? limitOf(row, k) : min);
        const end = at(j < starts.length - 1 ? limitOf(row, starts[j + 1]) : max);
        return `<rect x="${begin}%" width="${end - begin}%" y="${top + i * ROW}" height="${ROW - 3}"
          fill="${color}" opacity="${OPACITIES[row[k][1]]}"/>`;
      });
    });
    const frames = chosen().map(
      ({ color }, i) => `<rect class="frame" width="100%" y="${top + i * ROW}"
        height="${ROW - 3}" stroke="${color}"/>`,
    );
    const tall = top + chosen().length * ROW;
    const place = state.guess === null ? null : at(state.guess);
    const mark = place && `<path class="guess" d="M0 0v${tall}"/>`;
    const guess = place ? `<svg x="${place}%" overflow="visible">${mark}</svg>` : "";
    const words = this.inWords();
    this.svg.innerHTML = `${this.bars(at)}${bands.join("")}${frames.join("")}${guess}`;
    this.svg.style.height = `${tall}px`;
    this.svg.ariaLabel = words;
    const samples = VERDICTS.map((verdict, i) => {
      const sample = make("span", { className: "sample" });
      sample.style.setProperty("--opacity", `${100 * OPACITIES[i]}%`);
      return make("span", {}, sample, ` ${verdict} `);
    });
    this.legend.replaceChildren(...samples, progress);
    this.words.textContent = progress ? "" : words;
  }

  // The bars of the histogram of answers.
  bars(at) {
    const { min, max } = delayInput();
    const wide = (max - min) / BINS;
    const counts = Array(BINS).fill(0);
    for (const answer of this.answers) {
      counts[clamp(Math.floor((answer - min) / wide), 0, BINS - 1)] += 1;
    }
    const most = Math.max(...counts);
    const bars = counts.map((count, i) => {
      const height = (count / most) * (TALL - 4) || 0;
      return `<rect class="answers" x="${at(min + i * wide)}%" width="${90 / BINS}%"
        y="${TALL - 3 - height}" height="${height}"><title>${count}</title></rect>`;
    });
    return this.answers.length ? bars.join("") : "";
  }

  // Takes answers: lines with links or with numbers. Answers on another controller do not count.
  take(text) {
    const lines = text.split("\n").filter((line) => line.trim());
    const { kind } = shownLoop();
    const isOnAnother = (line) => (/[#&]controller=([^&\s]+)/.exec(line)?.[1] ?? kind) !== kind;
    const others = lines.filter(isOnAnother).length;
    const numbers = lines
      .filter((line) => !isOnAnother(line))
      .map((line) => parse((/[#&]guess=([^&\s]*)/.exec(line)?.[1] ?? line).replace(",", ".")));
    this.answers = numbers.filter(Number.isFinite);
    const unclear = numbers.length - this.answers.length;
    const notes = [`${this.answers.length} drawn`];
    if (unclear) notes.push(`${unclear} not understood`);
    if (others) notes.push(`${others} on another controller`);
    this.count.textContent = notes.join(", ");
    this.draw("");
  }

  // Makes the elements of the strip, in the row of the delay's slider.
  make() {
    this.legend = make("p", { className: "legend" });
    this.words = make("p", { ariaLive: "polite" });
    this.count = make("p", { role: "status" });
    const ariaLabel = "Answers: links or numbers, one a line";
    const text = make("textarea", { rows: 3, placeholder: ariaLabel, ariaLabel });
    text.oninput = () => this.take(text.value);
    const summary = make("summary", {}, "Answers of a class");
    this.element = make("div", { className: "strip", hidden: true });
    this.element.insertAdjacentHTML("beforeend", '<svg role="img"></svg>');
    this.svg = this.element.firstChild;
    this.element.append(this.legend, this.words, make("details", {}, summary, text, this.count));
    const { row } = delayInput();
    row.classList.add("tall");
    row.append(this.element);
  }

  // Computes the strip, and shows it unless that would tell the answer.
  show(isAnswer) {
    this.isWanted = true;
    this.element.hidden = !isAnswer;
    if (isAnswer && this.basis) {
      this.draw(this.known.size < chosen().length ? ", more follows" : "");
    }
    return this.refresh();
  }
}

const strip = new Strip();

// Shows the question, as soon as the runs are known from which it follows.
function showQuestion() {
  const least = strip.leastAsked();
  const { title } = shownLoop();
  const end = least === 2 ? "run away" : "no longer come to rest";
  $("question").textContent = least
    ? `From which delay on does ${title} ${end}?`
    : "The runs at many delays are simulated ...";
  $("done").disabled = !least;
}

// Asks for a guess, or ends the question.
function ask(isAsking) {
  document.body.classList.toggle("guessing", isAsking);
  $("guess").hidden = !isAsking;
  showQuestion();
  if (isAsking) $("mark").focus();
}

// Takes a guess, and shows the strip with it; asks for one if it is null.
export function takeGuess(guess) {
  if (!canRest()) throw new RangeError("guess: there is no delay to guess in this page");
  const { name, min, max } = delayInput();
  if (guess !== null && !(guess >= min && guess <= max)) {
    throw new RangeError(`guess = ${guess}: must be a ${name} from ${min} to ${max}`);
  }
  state.guess = guess;
  ask(guess === null);
  strip.show(guess !== null);
}

// Makes the button that asks, the mark that is dragged, and the strip.
export function makeGuess() {
  if (!canRest()) return;
  const { min, max } = delayInput();
  const mark = $("mark");
  Object.assign(mark, { min, max, step: (max - min) / 100, value: (min + max) / 2 });
  mark.oninput = () => {
    $("marked").textContent = `${show(Number(mark.value), 3)} s`;
  };
  mark.oninput();
  $("done").onclick = () => {
    takeGuess(Number(mark.value));
    say("the guess is in the link to this state");
  };
  $("tries").append(makeButton("Guess first", () => takeGuess(null)));
  strip.make();
  onRuns(() => strip.refresh());
}
