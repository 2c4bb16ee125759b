// The export of curves and signals as files.

import { $, make } from "./elements.js";
import { range } from "./numbers.js";
import { placeOf } from "./plot.js";
import { changedFields, isChanged, settings, shownLoop, state } from "./state.js";
import { componentsOf } from "./units.js";

const HEAD = 22; // px above each scope, for its name

// Offers a text as a file.
function download(name, type, text) {
  const link = make("a", { download: name, href: URL.createObjectURL(new Blob([text], { type })) });
  link.click();
  URL.revokeObjectURL(link.href);
}

// Copies the computed style of an element and of its descendants into a copy of the element.
function inlineStyle(source, copy) {
  const style = getComputedStyle(source);
  for (const name of ["fill", "stroke", "stroke-width", "opacity", "font-family", "font-size"]) {
    copy.style.setProperty(name, style.getPropertyValue(name));
  }
  range(source.children.length).forEach((i) => inlineStyle(source.children[i], copy.children[i]));
}

// All scopes as one picture, one below the other.
export function scopesAsSvg() {
  const scopes = [...$("scopes").children];
  const svgs = scopes.map((scope) => scope.querySelector(":scope > svg"));
  const width = Math.max(...svgs.map((svg) => svg.clientWidth));
  let top = 0;
  const parts = svgs.map((svg, i) => {
    const copy = svg.cloneNode(true);
    inlineStyle(svg, copy);
    copy.setAttribute("y", top + HEAD);
    copy.setAttribute("width", width);
    copy.setAttribute("height", svg.clientHeight);
    const name = `<text x="4" y="${top + 15}" fill="${copy.style.color || "#808080"}"
      font-family="Helvetica, Arial, sans-serif" font-size="13">${titleOf(scopes[i])}</text>`;
    top += HEAD + svg.clientHeight;
    return name + new XMLSerializer().serializeToString(copy);
  });
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${top}"
    viewBox="0 0 ${width} ${top}">${parts.join("")}</svg>`;
}

// The title of a scope: its port and its unit.
function titleOf({ dataset: { port }, plotted: { unit } }) {
  return unit ? `${port} [${unit}]` : port;
}

// The signals in the scopes, in SI units: a row for each instant of each run.
export function signalsAsCsv() {
  const names = state.scopes.flatMap((port) => {
    const { loop, size } = placeOf(state, port);
    return componentsOf(loop, port, size).map(
      (component) => `${port}${component && ` ${component}`}`,
    );
  });
  const lines = [["controller", "time", ...names].join(",")];
  for (const run of state.runs) {
    const columns = state.scopes.flatMap((port) => run.columns(port) ?? []);
    run.time.forEach((t, i) => lines.push([run.loop.kind, t, ...run.row(columns, i)].join(",")));
  }
  return lines.join("\n");
}

// The Python lines that simulate the shown diagram in its current state.
export function stateAsPython() {
  const { isDiagram, python } = state.data;
  const { kind, changes, wires = {} } = shownLoop();
  const late = Object.values(wires).flat();
  const itemOf = ([name, value]) => `${JSON.stringify(name)}: ${JSON.stringify(value)}`;
  const dictionary = (items) => `{${items.map((item) => `\n    ${item},`).join("")}\n}`;
  const isOwn = ({ name }) => Object.keys(changes[name]?.slopes ?? {}).length > 0;
  const changed = changedFields().filter(isOwn);
  const fields = changed.filter(({ name }) => !late.includes(name));
  const notes = changed
    .filter(({ name }) => late.includes(name))
    .map(
      ({ name, value }) => `# Left out, as the Diagram has no block for it: ${name} = ${value} s\n`,
    );
  const moved = isDiagram ? settings().filter(isChanged) : settings();
  const sliders = moved.filter(({ isNumber }) => !isNumber).map((x) => [x.name, x.value]);
  const numbers = fields.map(({ name, value }) => [name, value]).map(itemOf);
  if (isDiagram) {
    const items = [...python.given, ...sliders.map(itemOf), ...numbers];
    return `from teleop_drake import Compile
${python.imports}
${notes.join("")}diagram = ${python.source}
loop = Compile(diagram, duration=${python.duration})
recording = loop.Run(**${dictionary(items)})
`;
  }
  const items = [...python.given, ...sliders.map(itemOf), itemOf(["controller.kind", kind])];
  const load = `scenario = LoadScenario(${python.source}, ${dictionary(items)})`;
  if (!numbers.length) {
    return `from teleop_drake import Compile, LoadScenario

${notes.join("")}${load}
recording = Compile(scenario).Run()
`;
  }
  return `from teleop_drake import Compile, LoadScenario, MakeDiagram

${notes.join("")}${load}
diagram = MakeDiagram(scenario)
loop = Compile(diagram, duration=scenario.duration, simulator=scenario.simulator)
recording = loop.Run(**${dictionary(numbers)})
`;
}

// Makes the buttons that save.
export function makeSaving() {
  $("save-python").onclick = () => download("run.py", "text/x-python", stateAsPython());
  $("save-python").hidden = Boolean(state.data.hand);
  $("save-svg").onclick = () => download("curves.svg", "image/svg+xml", scopesAsSvg());
  $("save-csv").onclick = () => download("signals.csv", "text/csv", signalsAsCsv());
}
