// The page is the model: what it shows is simulated here; see loop.js.

const $ = (id) => document.getElementById(id);
const state = { runs: [], pinned: [], level: "", tab: 0, scopes: [], cursor: 0, window: [0, 1], version: 0,
  hand: [], keys: new Set(), pull: [] };
let data, loops, inputs;

// Returns the data of the page; see page.py's _Bytes().
async function unpack() {
  const text = atob($("model").textContent);
  const packed = new Uint8Array(text.length).map((_, i) => text.charCodeAt(i));
  const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(plain).arrayBuffer();
  const size = Number(new DataView(bytes).getBigUint64(0, true)), base = 8 + size;
  return JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 8, size)), (_, v) =>
    v?.$b ? new Uint8Array(bytes, base + v.$b[0], v.$b[1])
      : v?.$f ? new Float64Array(bytes, base + v.$f[0], v.$f[1]) : v);
}

// Makes an element with properties and children.
const make = (tag, properties, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};
// Returns text that says nothing to HTML.
const safe = (text) => text.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt()};`);
// Returns a number in few digits.
const show = (x) => (x === undefined ? "–"
  : Math.abs(x) >= 1e5 || (x && Math.abs(x) < 1e-4) ? x.toExponential(3) : String(+x.toPrecision(5)));
// The loops of the kinds that the inputs choose, and what belongs to them.
const chosen = () => loops.filter(({ choice }) => Object.keys(choice).every((x) => choice[x] === inputs[x].value));
const shownLoop = () => chosen()[state.tab];
const boxAt = (path) => shownLoop().levels.flatMap((x) => x.boxes).find((box) => box.path === path);
const duration = () => Math.max(0, ...state.runs.map((run) => run.duration));
// The values of the inputs by their names.
const values = () => Object.fromEntries(Object.values(inputs).map(({ name, value }) => [name, value]));
// A short line in a controller's colour, and its name.
const keyOf = ({ color, title }, text = "") =>
  make("span", {}, make("span", { className: "key", style: `border-color: ${color}` }), `${title} ${text}`);
// Says something in the line of the status.
const say = (text, className = "") => Object.assign($("status"), { textContent: text, className });
// Waits for the next picture; a page that is not shown has none.
const nextFrame = () => new Promise((go) => { requestAnimationFrame(go); setTimeout(go, 50); });

// Sets an input, at a stop if it has stops; both delays at once for `delay`.
function setInput(name, value) {
  if (!inputs[name]) throw new RangeError(`input ${name}: must be one of ${Object.keys(inputs)}`);
  const { min, max, stops, choices, parts = [name] } = inputs[name];
  if (choices ? !choices.includes(value) : !(value >= min && value <= max)) {
    throw new RangeError(`${name} = ${value}: must be ${choices ? `one of ${choices}` : `from ${min} to ${max}`}`);
  }
  if (stops) value = stops.reduce((a, b) => (Math.abs(b - value) < Math.abs(a - value) ? b : a));
  for (const part of parts) inputs[part].value = value;
  for (const x of Object.values(inputs)) {
    if (x.parts) x.value = x.parts.reduce((sum, part) => sum + inputs[part].value, 0) / x.parts.length;
    x.show();
  }
  return refresh();
}

// Simulates what the inputs say, again if they change meanwhile, and shows it.
function refresh() {
  ++state.version;
  state.drive = null;
  // What is shown belongs to other values; if this takes long it becomes pale.
  document.body.classList.add("stale");
  return (state.busy ??= simulate().catch((error) => say(error.message, "bad")).finally(() => { state.busy = null; }));
}

// Simulates until no input has changed meanwhile.
async function simulate() {
  for (let mine = -1; mine !== state.version; await nextFrame()) {
    mine = state.version;
    const begin = performance.now(), isStale = () => state.version !== mine, runs = [];
    for (const loop of chosen()) {
      runs.push(await loop.simulate(values(), isStale, state.hand));
      // The first picture of all does not wait for the second run.
      if (!state.runs.length && runs[0]) { state.runs = [...runs]; setCursor(0); await nextFrame(); }
    }
    if (runs.includes(null)) continue;
    state.runs = runs;
    if (data.hand) showLast(duration()); else setCursor(state.cursor);
    showMetrics();
    say(`${runs.length} runs simulated and drawn in ${(performance.now() - begin).toFixed(0)} ms`);
  }
  document.body.classList.remove("stale");
}

// Makes a slider and a number for each input, or what chooses among kinds.
function makeInputs() {
  for (const input of Object.values(inputs)) {
    const { name, label: ariaLabel, stops, choices, min, max } = input, step = "any";
    const set = (value) => { try { setInput(name, value); } catch (error) { say(error.message, "bad"); } };
    const bounds = stops ? { min: 0, max: stops.length - 1, step: 1 } : { min, max, step }, type = "range";
    const first = !choices ? make("input", { type, ariaLabel, ...bounds })
      : make("select", { ariaLabel }, ...choices.map((x) => make("option", {}, x)));
    const number = make("input", { type: "number", ariaLabel, step, hidden: Boolean(choices) });
    first.oninput = () => set(choices ? first.value : stops ? stops[first.value] : +first.value);
    number.onchange = () => set(+number.value);
    input.show = () => {
      first.value = stops ? stops.indexOf(input.value) : input.value;
      if (!choices && document.activeElement !== number) number.value = show(input.value);
    };
    input.row = make("div", { className: "row" }, make("label", {}, ariaLabel), first, number);
    $("inputs").append(input.row);
    input.show();
  }
}

// Keeps the runs of now in the scopes, pale, or forgets them.
function togglePin() {
  state.pinned = state.pinned.length ? [] : state.runs;
  $("pin").textContent = state.pinned.length ? "Unpin" : "Pin these runs";
  drawScopes();
}

// Shows the metrics of each controller, and how it ended.
function showMetrics() {
  const { runs } = state, row = (tag, ...cells) => make("tr", {}, ...cells.map((x) => make(tag, {}, x)));
  const labels = Object.assign({}, ...runs.map((run) => run.loop.labels));
  const rows = Object.keys(labels).filter((name) => runs.some((run) => name in run.metrics))
    .map((name) => row("td", labels[name], ...runs.map((run) => show(run.metrics[name]))));
  const ends = runs.map(({ reason, time }) => (reason ? `${show(time.at(-1))} s: ${reason}` : ""));
  if (ends.some((x) => x)) rows.unshift(row("td", "ended at", ...ends));
  if (rows.length) rows.unshift(row("th", "", ...runs.map((run) => keyOf(run.loop))));
  $("metrics").replaceChildren(...rows.length ? [make("table", {}, ...rows)] : []);
}

// Shows a level of the diagram of the controller that is chosen.
function showLevel(path) {
  const { levels } = shownLoop(), level = levels.find((x) => x.path === path) ?? levels[0];
  state.level = level.path;
  $("diagram").innerHTML = new TextDecoder().decode(level.svg);
  const parts = ["", ...level.path.split("/").filter((x) => x)];
  $("crumbs").replaceChildren(...parts.map((part, i) => make("button", { textContent: part || "loop",
    onclick: () => showLevel(parts.slice(1, i + 1).join("/")), disabled: i === parts.length - 1 })));
  markPorts();
}

// Marks the ports and wires whose signals are in the scopes.
function markPorts() {
  const { ports } = shownLoop(), placeOf = (port) => String(ports[port] ?? port), on = state.scopes.map(placeOf);
  for (const element of $("diagram").querySelectorAll("[data-port]")) {
    element.classList.toggle("on", on.includes(placeOf(element.dataset.port)));
  }
}

// Opens a box: says what it is, and shows its ports and the inputs that it has.
function open(path) {
  const loop = shownLoop(), box = boxAt(path), [first] = path.split("/");
  if (path !== state.level && loop.levels.some((x) => x.path === path)) showLevel(path);
  const ports = [...box.u, ...box.y].map((name) => `${path}:${name}`).filter((x) => loop.ports[x]);
  for (const { row, owners } of Object.values(inputs)) $(owners.includes(first) ? "box" : "inputs").append(row);
  const buttons = ports.map((port) =>
    make("button", { textContent: port.split(":")[1], onclick: () => toggleScope(port) }));
  $("box").replaceChildren(make("h2", {}, `${path || data.title}: ${box.kind}`), box.says,
    ...$("box").querySelectorAll(".row"), ...buttons);
}

// The values of a port at the cursor.
function valuesOf(run, port, most) {
  const columns = run.columns(port) ?? [];
  return run.vector(columns.slice(0, most), state.cursor).map(show).join(", ") + (columns.length > most ? " ..." : "");
}

// Answers to a pointer or the keys in the diagram: says what a port, a wire or a box is, with the
// values at the cursor; a click opens a box, and puts a signal into the scopes.
function answer({ type, target }) {
  const element = target.closest("[tabindex]"), { box, port } = element?.dataset ?? {};
  $("tip").hidden = !element || /out$/.test(type);
  if ($("tip").hidden) return;
  if (type === "click") { if (port) toggleScope(port); else open(box); }
  const place = shownLoop().ports[port], { kind, says } = boxAt(box) ?? {};
  const seen = () => state.runs.map((run) => `${run.loop.title}: ${valuesOf(run, port, 4)}`);
  $("tip").textContent = !port ? `${box || data.title}: ${kind}\n${says}`
    : [port, ...place ? [`[${place[1]}]  ${place[2]}`, ...seen(), `at ${show(state.cursor)} s`] : []].join("\n");
}

// Goes to the block or the port that the search names.
function find() {
  const text = $("search").value, [path] = text.split(":");
  if (!path || !boxAt(path)) return;
  showLevel(path.split("/").slice(0, -1).join("/"));
  open(path);
  if (text in shownLoop().ports && !state.scopes.includes(text)) toggleScope(text);
  $("search").value = "";
}

const DASHES = ["", "7 4", "2 3", "9 3 2 3"], MOST_LINES = 6, MARGIN = 58, RIGHT = 18;

// Puts a signal into the scopes, or takes it out.
function toggleScope(port) {
  if (!loops.some((loop) => loop.ports[port])) return;
  state.scopes = state.scopes.includes(port) ? state.scopes.filter((x) => x !== port) : [port, ...state.scopes];
  makeScopes();
}

// Makes a picture for each signal in the scopes.
function makeScopes() {
  $("scopes").replaceChildren(...state.scopes.map((port) => {
    const scope = make("div", { className: "scope" }, make("div", { className: "head" }));
    scope.insertAdjacentHTML("beforeend", `<svg role="img" aria-label="${safe(port)}"></svg>`);
    const svg = scope.lastElementChild, timeAt = (e) => {
      const [a, b] = state.window, { left, width } = svg.getBoundingClientRect();
      return a + (b - a) * clamp((e.clientX - left - MARGIN) / (width - MARGIN - RIGHT), 0, 1);
    };
    svg.onpointerdown = svg.onpointermove = (e) => { if (e.buttons) setCursor(timeAt(e)); };
    svg.onwheel = (e) => { e.preventDefault(); zoom(1.2 ** Math.sign(e.deltaY), timeAt(e)); };
    svg.ondblclick = () => zoom(Infinity, 0);
    scope.dataset.port = port;
    return scope;
  }));
  markPorts();
  drawScopes();
}

// Shows more or less of the time around an instant.
function zoom(factor, around) {
  const [a, b] = state.window, end = duration();
  const low = Math.max(0, around - (around - a) * factor), high = Math.min(end, around + (b - around) * factor);
  state.window = high - low < end && high > low ? [low, high] : [0, end];
  drawScopes();
}

// Returns ticks of an axis between two values.
function ticks(low, high, most) {
  const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find((x) => x * power >= raw) * power, first = Math.ceil(low / step);
  return range(Math.floor(high / step) - first + 1).map((i) => (first + i) * step);
}

// Returns the points of a line in the window: the ends of steps, and between them where these are far.
function curve(run, column, width) {
  const [a, b] = state.window, fine = (b - a) / width * 3, points = [];
  for (let s = run.step(a + 1e-12); s < run.ends.length && run.time[run.ends[s] - 4] <= b; ++s) {
    const begin = Math.max(run.time[run.ends[s] - 4], a), end = Math.min(run.time[run.ends[s]], b);
    const n = clamp(Math.ceil((end - begin) / fine), 1, 60);
    // Where nothing jumps a step begins with the end of the one before.
    for (let j = points.length && run.ends[s] - run.ends[s - 1] === 4 ? 1 : 0; j <= n; ++j) {
      const t = begin + j * (end - begin) / n;
      points.push([t, run.vector([column], t, s)[0]]);
    }
  }
  return points;
}

// Returns a scope as SVG: a signal of all runs.
function plot(port, width, height) {
  const [a, b] = state.window, lines = [...state.pinned, ...state.runs].flatMap((run, i) =>
    (run.columns(port) ?? []).slice(0, MOST_LINES).map((column, k) => (
      { run, k, points: curve(run, column, width), isPale: i < state.pinned.length })));
  let [low, high] = [Infinity, -Infinity];
  for (const { points } of lines) for (const [, v] of points) [low, high] = [Math.min(low, v), Math.max(high, v)];
  if (low > high) [low, high] = [-1, 1];
  const gap = 0.06 * (high - low) || 0.01 * Math.abs(high) || 0.5, bottom = height - 18;
  const x = (t) => ((t - a) / (b - a) * (width - MARGIN - RIGHT)).toFixed(1);
  const y = (v) => (4 + (high + gap - v) / (high - low + 2 * gap) * (bottom - 6)).toFixed(1);
  const drawn = lines.map(({ run, k, points, isPale }) => `<polyline class="${isPale ? "pale" : ""}"
    points="${points.map(([t, v]) => `${x(t)},${y(v)}`).join(" ")}" stroke="${run.loop.color}"
    stroke-dasharray="${DASHES[k % DASHES.length]}"/>`);
  const events = state.runs.flatMap((run) => run.events.map(({ time }) =>
    `<path class="event" d="M${x(time)} 0v${bottom}" stroke="${run.loop.color}"/>`));
  const marks = ticks(low - gap, high + gap, 5).map((v) => `<text x="${MARGIN - 6}" y="${y(v)}" dy="4"
    text-anchor="end">${show(v)}</text><path class="${v ? "" : "zero"}" d="M${MARGIN} ${y(v)}H${width}"/>`);
  const times = ticks(a, b, width / 90).map((t) =>
    `<text x="${MARGIN + +x(t)}" y="${height - 4}" text-anchor="middle">${show(t)} s</text>`);
  return `${marks.join("")}${times.join("")}
    <svg x="${MARGIN}" width="${width - MARGIN}" height="${bottom}">${events.join("")}${drawn.join("")}
    <path class="cursor" d="M0 0v${bottom}"/></svg>`;
}

// Draws all scopes, their lines only if more than the cursor has moved.
function drawScopes() {
  const [a, b] = state.window;
  for (const scope of state.runs.length ? $("scopes").children : []) {
    const { port } = scope.dataset, [head, svg] = scope.children, { clientWidth: width, clientHeight: height } = svg;
    const basis = [state.runs, state.pinned, state.runs[0].ends.length, a, b, width];
    if (basis.some((value, i) => value !== scope.basis?.[i])) {
      scope.basis = basis;
      svg.innerHTML = plot(port, width, height);
    }
    const x = (state.cursor - a) / (b - a) * (width - MARGIN - RIGHT);
    svg.querySelector(".cursor").setAttribute("transform", `translate(${x})`);
    const [, size, unit] = loops.map((loop) => loop.ports[port]).find((p) => p);
    head.replaceChildren(make("b", {}, port.replace(":", " · ")), unit && `[${unit}]`,
      size > MOST_LINES ? `${MOST_LINES} of ${size}` : "",
      ...state.runs.map((run) => keyOf(run.loop, valuesOf(run, port, 3))),
      make("button", { textContent: "×", ariaLabel: `remove ${port}`, onclick: () => toggleScope(port) }));
  }
}

// Moves the cursor of all that is shown.
function setCursor(t) {
  state.cursor = clamp(t, 0, duration());
  Object.assign($("clock"), { max: duration(), value: state.cursor });
  $("now").textContent = `${state.cursor.toFixed(3)} s`;
  drawScopes();
  drawScene();
}

// Returns where the joints of an arm and its tool are: each joint turns or moves all behind it.
function armAt(run) {
  const q = run.vector(run.signal("joint_position"), state.cursor), place = (i) => run.z.arm.slice(3 * i, 3 * i + 3);
  let all = new DOMMatrix();
  const pointAt = (i) => { const { x, y, z } = all.transformPoint(new DOMPoint(...place(i))); return [x, y, z]; };
  const points = run.loop.joints.map(({ position, turns }, j) => {
    const [at, axis] = [place(2 * j), place(2 * j + 1)], point = pointAt(2 * j);
    all = !turns ? all.translate(...axis.map((x) => x * q[position]))
      : all.translate(...at).rotateAxisAngle(...axis, q[position] * 180 / Math.PI).translate(...at.map((x) => -x));
    return point;
  });
  return [...points, pointAt(2 * points.length)];
}

// Returns what maps a point of the drawing to pixels, with all of the arms, unless the tools' paths
// become too small; without a second axis the runs are in lanes.
function fitScene(paths, arms, width, height, lanes) {
  const span = (points, k) => [-1, 1].map((sign) => sign * Math.max(...points.map((p) => sign * p[k])));
  const own = [0, 1].map((k) => span(paths, k)), most = 4 * Math.max(...own.map(([low, high]) => high - low));
  const [[left, right], [bottom, top]] = own.map(([low, high], k) => {
    const [back, far] = span([...paths, ...arms], k);
    return [Math.max(low - most, back), Math.min(high + most, far)];
  });
  const scale = Math.min(0.85 * width / (right - left || 1e-6), lanes ? Infinity : (height - 40) / (top - bottom));
  return ([x, y], lane) => [width / 2 + (x - (left + right) / 2) * scale, lanes ? (lane + 0.5) * height / lanes
    : height / 2 + 8 - (y - (bottom + top) / 2) * scale].map((v) => v.toFixed(1));
}

// Draws the task at the cursor: surfaces, arms, tools, what is felt and packets under way.
function drawScene() {
  const shown = state.runs.filter((run) => run.signal("tool_position"));
  $("task").hidden = !shown.length;
  if (!shown.length) return;
  const { clientWidth: width, clientHeight: height } = $("scene"), floor = height - 14 * shown.length - 8;
  const see = (q) => data.view.map((axis) => dot(axis.slice(0, q.length), q)), isPlane = data.view[1].some((x) => x);
  const pathOf = (run, end) => run.ends.filter((i) => run.time[i] <= end)
    .map((i) => see(run.row(run.signal("tool_position"), i)));
  const { loop: { surfaces: names }, z: { surfaces: all } } = shown[0], n = all.length / names.length / 2;
  const part = (i) => see(Array.from(all.slice(i * n, (i + 1) * n)));
  const surfaces = names.map((name, i) => ({ name, point: part(2 * i), normal: part(2 * i + 1) }))
    .filter((x) => x.point.every(Number.isFinite));
  const arms = shown.map((run) => (run.loop.joints.length ? armAt(run).map(see) : []));
  const near = [...shown.flatMap((run) => pathOf(run, Infinity)), ...isPlane ? [] : surfaces.map((s) => s.point)];
  const pixels = fitScene(near, arms.flat(), width, floor, isPlane ? 0 : shown.length);
  // When packets are sent, and the half-plane behind each surface.
  const sent = range(Math.floor(state.cursor / data.period) + 1).map((k) => k * data.period);
  const slabs = surfaces.map(({ name, point, normal: [nx, ny] }, i) => {
    const [x, y] = pixels(point, 0), angle = Math.atan2(-ny, nx) * 180 / Math.PI;
    return `<rect class="${safe(name)}" y="-3000" width="3000" height="6000"
      transform="translate(${x} ${y}) rotate(${angle})"/>
      <text x="${clamp(+x + 3, 4, width - 60)}" y="${12 + 13 * (i % 2)}">${safe(name)}</text>`;
  });
  const drawn = shown.map((run, lane) => {
    const felt = run.signal("felt_position") ?? run.columns("master/surgeon:felt_position");
    const [[x, y], [u, v]] = [run.signal("tool_position"), felt ?? run.signal("tool_position")]
      .map((columns) => pixels(see(run.vector(columns, state.cursor)), lane));
    const line = (points, name) => `<polyline class="${name}" points="${points.map((p) => pixels(p, lane))}"/>`;
    const { forward, return: back } = run.z, rail = floor + 10 + 14 * lane, way = width - 125;
    const packets = [[forward, 70, way, rail], [back, width - 55, -way, rail + 6]].flatMap(([lags, from, long, at]) =>
      sent.map((t, k) => (state.cursor - t) / lags?.[Math.min(k, lags.length - 1)]).reverse()
        .filter((x) => x > 0 && x < 1).map((x) => `M${from + x * long} ${at}h5`)).join("");
    return `<g stroke="${run.loop.color}" fill="${run.loop.color}">${line(pathOf(run, state.cursor), "path")}
      ${line(arms[lane], "arm")}<circle class="felt" cx="${u}" cy="${v}" r="${felt ? 9 : 0}"/>
      <circle cx="${x}" cy="${y}" r="5"/><path class="packets" d="${packets}"/>
      <text x="4" y="${+y + 18}">${isPlane ? "" : safe(run.loop.title)}</text></g>`;
  });
  const sides = shown[0].z.forward ? ["operator", "robot"] : ["", ""];
  $("scene").innerHTML = `${slabs.join("")}${drawn.join("")}<text x="4" y="${height - 12}">${sides[0]}</text>
    <text x="${width - 4}" y="${height - 12}" text-anchor="end">${sides[1]}</text>
    <text x="${width - 4}" y="${floor - 2}" text-anchor="end">● tool ◌ as felt</text>`;
}

// Begins to play, ten times slower around events if that is wanted, or ends it.
function togglePlay() {
  state.isPlaying = !state.isPlaying;
  $("play").textContent = state.isPlaying ? "❚❚" : "▶";
  if (state.isPlaying && state.cursor >= duration()) setCursor(0);
  let before = performance.now();
  const play = (now) => {
    if (!state.isPlaying) return;
    const isNear = state.runs.some((run) => run.events.some((e) => Math.abs(e.time - state.cursor) < 0.1));
    const speed = $("speed").value * ($("slow").checked && isNear ? 0.1 : 1);
    setCursor(state.cursor + clamp(now - before, 0, 100) / 1000 * speed);
    before = now;
    if (state.cursor >= duration()) togglePlay(); else requestAnimationFrame(play);
  };
  requestAnimationFrame(play);
}

const KEYS = [["ArrowLeft", "ArrowRight"], ["ArrowDown", "ArrowUp"], ["s", "w"], ["j", "l"], ["k", "i"], ["o", "u"]];
const PICTURE = 1 / 60;

// Returns what the hand commands, m/s: keys, a pointer that pulls, or a gamepad's sticks.
function command() {
  const pad = navigator.getGamepads?.().find((x) => x), { num_axes: n, full_speed: most } = data.hand;
  const sticks = [pad?.axes[0], -pad?.axes[1], -pad?.axes[3]].map((x) => (Math.abs(x) > 0.1 ? x : 0));
  return KEYS.slice(0, n).map(([less, more], k) => most * clamp(
    state.keys.has(more) - state.keys.has(less) + (sticks[k] ?? 0) + (state.pull[k] ?? 0), -1, 1));
}

// Moves the cursor to a time, and shows what was before.
function showLast(t) {
  state.window = [Math.max(0, t - 8), Math.max(8, t)];
  setCursor(t);
}

// Drives the controller that is chosen, in real time, until that is enough.
async function drive() {
  if (state.drive) { state.drive = null; return; }
  const loop = shownLoop(), run = new Run(loop, loop.numbersAt(values()));
  const mine = (state.drive = {}), begin = performance.now();
  $("drive").textContent = "End (Esc)";
  state.hand = [[0, ...command().fill(0)]];
  state.runs = [run];
  $("metrics").replaceChildren();
  while (state.drive === mine && !run.reason && run.duration - state.hand.at(-1)[0] > PICTURE) {
    const late = (performance.now() - begin) / 1000 - state.hand.at(-1)[0];
    // At most a tenth of a second is made up for; then simulated time is slower.
    for (let i = 0; i < Math.min(late / PICTURE, 6) && !run.reason; ++i) {
      const before = state.hand.at(-1);
      state.hand.push([before[0] + PICTURE, ...command()]);
      await run.follow(before, state.hand.at(-1));
    }
    const now = run.time.at(-1) ?? 0;
    showLast(now);
    say(`driving ${loop.title}: ${now.toFixed(1)} s`);
    const felt = run.columns("master/surgeon:haptic_force"), size = felt ? Math.hypot(...run.vector(felt, now)) : 0;
    navigator.getGamepads?.().find((x) => x?.vibrationActuator)?.vibrationActuator.playEffect("dual-rumble", {
      duration: 50, strongMagnitude: Math.min(1, size / (data.hand.newtons || 1)) });
    await nextFrame();
  }
  $("drive").textContent = "Drive again";
  const names = ["time", "v_x", "v_y", "v_z"].slice(0, 1 + data.hand.num_axes);
  $("save").href = URL.createObjectURL(new Blob([[names, ...state.hand].join("\n")], { type: "text/csv" }));
  $("saved").hidden = false;
  state.runs = [];
  await refresh();
}

// Lets a pointer on the scene pull the tool, as far as it is from where it went down.
function makeHand() {
  let from = null;
  const move = ({ clientX: x, clientY: y, type, pointerId }) => {
    if (type === "pointerdown") { from = [x, y]; $("scene").setPointerCapture(pointerId); }
    if (/up|cancel/.test(type)) from = null;
    state.pull = from ? [(x - from[0]) / 80, (from[1] - y) / 80] : [];
  };
  for (const type of ["down", "move", "up", "cancel"]) $("scene").addEventListener(`pointer${type}`, move);
  $("drive").onclick = drive;
  $("repeat").append(...data.hand.command.split(" ").flatMap((x) => [make("nobr", {}, x), " "]));
  $("hand").hidden = false;
}

// Does what a key says.
function press(e) {
  const { key, target } = e, { window: [a, b], cursor } = state, isField = target.matches?.("input, select");
  if (isField && key !== "Escape" || target.matches?.("button") && [" ", "Enter"].includes(key)) return;
  const actions = {
    " ": togglePlay, p: togglePin, d: () => data.hand && drive(), "/": () => $("search").focus(),
    ArrowLeft: () => setCursor(cursor - (b - a) / 200), ArrowRight: () => setCursor(cursor + (b - a) / 200),
    "+": () => zoom(1 / 1.5, cursor), "-": () => zoom(1.5, cursor), 0: () => zoom(Infinity, 0),
    Escape: () => (state.drive ? drive() : showLevel(state.level.split("/").slice(0, -1).join("/"))),
    Enter: () => answer({ type: "click", target }),
  };
  const action = state.drive && KEYS.flat().includes(key) ? () => state.keys.add(key) : actions[key];
  if (!action) return;
  e.preventDefault();
  action();
}

// Makes the page.
async function start() {
  data = await unpack();
  inputs = Object.fromEntries(data.inputs.map((input) => [input.name, { ...input }]));
  loops = data.controllers.map((x) => new Loop(x, data.inputs));
  for (const x of "click mouseover mouseout focusin focusout".split(" ")) $("diagram").addEventListener(x, answer);
  $("notes").textContent = data.notes.join("\n");
  const choose = (i) => {
    state.tab = i;
    tabs.forEach((tab, k) => { tab.ariaPressed = k === i; });
    showLevel(state.level);
  };
  const tabs = chosen().map(({ title }, i) => make("button", { textContent: title, onclick: () => choose(i) }));
  choose(0);
  $("tabs").append(...tabs.length > 1 ? tabs : []);
  const paths = loops.flatMap((loop) => loop.levels.flatMap((x) => x.boxes.map((box) => box.path)));
  const names = new Set([...paths, ...loops.flatMap((loop) => Object.keys(loop.ports))].filter((x) => x));
  $("found").append(...Array.from(names, (value) => make("option", { value })));
  const root = document.documentElement.style;
  root.colorScheme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  $("theme").onclick = () => { root.colorScheme = root.colorScheme === "dark" ? "light" : "dark"; };
  $("search").onchange = find;
  $("play").onclick = togglePlay;
  $("pin").onclick = togglePin;
  $("clock").oninput = () => setCursor(+$("clock").value);
  document.addEventListener("keydown", press);
  document.addEventListener("keyup", (e) => state.keys.delete(e.key));
  addEventListener("resize", () => setCursor(state.cursor));
  if (data.hand) makeHand();
  makeInputs();
  if (!loops[0].module) return document.body.classList.add("still");
  const { signals, ports } = loops[0], first = ["tool_velocity", "environment_force", "tool_position"];
  const usual = signals.tool_velocity ? first : Object.keys(signals).slice(0, 3);
  state.scopes = [data.scopes, usual].find((x) => x.length).map((x) => signals[x]).filter((port) => ports[port]);
  state.window = [0, loops[0].numbers.run[0]];
  makeScopes();
  await refresh();
}

// For scripts.
window.teleop = {
  ready: start().catch((error) => { say(error.message, "bad"); throw error; }),
  // The kinds that are shown.
  get controllers() { return chosen().map((loop) => loop.kind); },
  // What can be set, as it is.
  get inputs() {
    return Object.fromEntries(Object.values(inputs).map(({ name, value, min, max, unit, choices }) =>
      [name, choices ? { value, choices } : { value, min, max, unit }]));
  },
  set: setInput,
  // Runs a controller at the values of the inputs.
  async run(kind) {
    const loop = chosen().find((x) => x.kind === kind);
    if (!loop) throw new RangeError(`controller ${kind}: must be one of ${this.controllers}`);
    await state.busy;
    const run = await loop.simulate(values(), undefined, state.hand), { time, events, metrics, wall } = run;
    const signals = Object.fromEntries(Object.keys(loop.signals).map((name) => [name,
      run.signal(name).map((k) => range(time.length).map((i) => run.rows[i * run.width + k]))]));
    return Object.defineProperty({ time: [...time], events, metrics, signals, wall_time_ms: wall,
      diverged: Boolean(run.reason) }, "run", { value: run });
  },
  // Returns a signal of such a run at times.
  sample({ run }, name, times) {
    const columns = run.signal(name) ?? run.columns(name);
    if (!columns) throw new RangeError(`signal ${name}: must be one of ${Object.keys(run.loop.signals)}`);
    return columns.map((column) => times.map((t) => run.vector([column], t)[0]));
  },
};
