// A link to a state of the page: inputs, the controller of the diagram, the cursor and the scopes.
//
// An example is page.html#delay=0.2&controller=direct_force&t=2.4&show=tool_velocity. With
// `guess=0.14` the strip with this guess is shown; with `guess=` the page asks for one.

import { setCursor } from "./clock.js";
import { chooseTab } from "./diagram.js";
import { $, say } from "./elements.js";
import { challenge, packHand } from "./contest.js";
import { takeGuess } from "./guess.js";
import { setInput } from "./inputs.js";
import { parse } from "./numbers.js";
import { scoreOf } from "./score.js";
import { makeScopes } from "./scopes.js";
import { chosen, isChanged, shownLoop, state } from "./state.js";

// The name of the signal at a port; for other ports, the name of the port.
function nameOf(port) {
  const found = Object.entries(shownLoop().signals).find(([, place]) => place === port);
  return found ? found[0] : port;
}

// The link to the current state.
export function linkOfState() {
  const link = new URLSearchParams();
  for (const input of Object.values(state.inputs)) {
    const { name, value, parts, isNumber } = input;
    if (!parts && (!isNumber || isChanged(input))) link.set(name, value);
  }
  link.set("controller", shownLoop().kind);
  link.set("t", state.cursor.toFixed(4));
  link.set("show", state.scopes.map(nameOf).join(","));
  if (state.guess !== null) link.set("guess", state.guess);
  return `${location.href.split("#")[0]}#${link}`;
}

// The link to the drive of a run: its settings, the hand and the score.
export async function linkOfDrive(run) {
  const [page, values] = linkOfState().split("#");
  const link = new URLSearchParams(values);
  link.set("controller", run.loop.kind);
  link.set("strength", $("strength").value);
  link.set("score", scoreOf(run).points?.toFixed(3) ?? "none");
  link.set("hand", await packHand(state.hand));
  link.delete("t");
  return `${page}#${link}`;
}

// Shows the state in the address of the page. Invalid parts of it are reported and ignored.
export async function showLinkedState() {
  const { controller, t, show, guess, hand, strength, score, ...values } = Object.fromEntries(
    new URLSearchParams(location.hash.slice(1)),
  );
  const wrong = [];
  for (const [name, text] of Object.entries(values)) {
    try {
      await setInput(name, state.inputs[name]?.choices ? text : parse(text));
    } catch (error) {
      wrong.push(error.message);
    }
  }
  if (controller !== undefined) {
    const kinds = chosen().map((loop) => loop.kind);
    if (kinds.includes(controller)) chooseTab(kinds.indexOf(controller));
    else wrong.push(`controller ${controller}: must be one of ${kinds}`);
  }
  if (show !== undefined) wrong.push(...showSignals(show.split(",").filter((name) => name)));
  if (t !== undefined) {
    if (Number.isFinite(parse(t))) setCursor(parse(t));
    else wrong.push("t: must be a number");
  }
  try {
    if (hand !== undefined && state.data.hand) await challenge({ hand, strength, score });
    if (guess !== undefined) takeGuess(guess === "" ? null : parse(guess));
  } catch (error) {
    wrong.push(error.message);
  }
  if (wrong.length) say(`the link is not understood: ${wrong.join("; ")}`, "bad");
}

// Shows signals or ports in the scopes; returns a message for each unknown name.
function showSignals(names) {
  const { signals, ports } = shownLoop();
  const places = names.map((name) => signals[name] ?? name);
  const isKnown = (port) => port in ports;
  state.scopes = places.filter(isKnown);
  makeScopes();
  return names.filter((_, i) => !isKnown(places[i])).map((name) => `there is no signal ${name}`);
}

// Makes the button that copies the link; shows the state of a link that is entered later.
export function makeLink() {
  $("copy-link").onclick = async () => {
    const link = linkOfState();
    try {
      await navigator.clipboard.writeText(link);
      say("the link is copied; open it in a second window to compare side by side");
    } catch {
      history.replaceState(null, "", link);
      say("the link stands in the address bar");
    }
  };
  addEventListener("hashchange", showLinkedState);
}
