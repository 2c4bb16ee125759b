// The sentences under the title: what each run did.

import { $ } from "./elements.js";
import { motionInWords } from "./motion.js";
import { onRuns } from "./simulate.js";
import { state } from "./state.js";
import { componentsOf, unitOfComponent } from "./units.js";
import { capital, endInWords, sentencesOn } from "./words.js";

const MOST_SENTENCES = 3; // on the signals of a Diagram

// The signals that a Diagram's page shows at first, and what each does in words.
export function shownMotions(run) {
  const { ports, references, signals } = run.loop;
  const names = state.data.scopes.length ? state.data.scopes : Object.keys(signals);
  const motions = [];
  for (const name of names) {
    const port = signals[name];
    const columns = run.columns(port) ?? [];
    const components = componentsOf(run.loop, port, columns.length);
    columns.forEach((column, i) => {
      const found = references.find(([begin, , n]) => column >= begin && column < begin + n);
      const reference = found && found[1] + column - found[0];
      const unit = unitOfComponent(ports[port][2], i, columns.length);
      const words = motionInWords(run, column, unit, reference, columns);
      const title = `${name.replaceAll(/[_:/.]/g, " ")} ${components[i]}`.trim();
      motions.push([title, words]);
    });
  }
  return motions;
}

// The sentences on how a run has ended early, and on the first of these signals.
function sentencesOnSignals(run) {
  const end = endInWords(run);
  const sentences = shownMotions(run).map(([title, words]) => `${title} ${words}.`);
  if (end) sentences.unshift(`${capital(run.loop.title)} ${end}: ${run.reason}.`);
  return sentences.slice(0, MOST_SENTENCES).join(" ");
}

// Shows what each run did, in the colour of its controller.
function showOutcome() {
  const { runs, data } = state;
  const parts = data.isDiagram ? [sentencesOnSignals(runs[0])] : sentencesOn(runs);
  $("outcome").replaceChildren(...parts);
}

// Shows the sentences whenever there are new runs.
export function makeOutcome() {
  onRuns(showOutcome);
}
