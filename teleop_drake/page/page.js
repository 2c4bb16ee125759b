// The page is the model: what it shows is simulated here; see loop.js.

const $ = (id) => document.getElementById(id);
const state = { values: {}, runs: [], pinned: [], level: "", tab: 0, scopes: [], cursor: 0, window: [0, 1],
  isPlaying: false, isBusy: false, version: 0, hand: [], keys: new Set(), pull: null };
let data, loops, inputs;

// Returns the data of the page; see page.py's _Bytes().
async function unpack() {
  const packed = Uint8Array.from(atob($("model").textContent), (c) => c.charCodeAt(0));
  const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(plain).arrayBuffer();
  const size = Number(new DataView(bytes).getBigUint64(0, true)), base = 8 + size;
  return JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 8, size)), (_, v) =>
    v?.$b ? new Uint8Array(bytes, base + v.$b[0], v.$b[1])
      : v?.$f ? new Float64Array(bytes, base + v.$f[0], v.$f[1]) : v);
}

// Makes an element with attributes and children.
function make(tag, attributes = {}, ...children) {
  const element = Object.assign(document.createElement(tag), attributes);
  element.append(...children);
  return element;
}

// Returns a number in few digits.
function show(x) {
  if (x === null || x === undefined) return "–";
  return Math.abs(x) >= 1e5 || (x && Math.abs(x) < 1e-4) ? x.toExponential(3) : String(+x.toPrecision(5));
}

const titled = (loop) => loop.kind.replaceAll("_", " ");
const duration = () => Math.max(...state.runs.map((run) => run.duration));

// The colour of a controller; black is the page's ink.
const inkOf = (loop, ink) => (loop.color === "#000000" ? ink : loop.color);

// A short line in a controller's colour, and its name.
function keyOf(loop, text = "") {
  const key = make("span", { className: "key" });
  key.style.borderColor = inkOf(loop, "currentColor");
  return make("span", {}, key, `${titled(loop)} ${text}`);
}

// Says something in the line of the status.
function say(text, isBad = false) {
  $("status").textContent = text;
  $("status").classList.toggle("bad", isBad);
}

// Waits for the next picture; a page that is not shown has none.
const nextFrame = () => new Promise((go) => { requestAnimationFrame(go); setTimeout(go, 50); });

// ---- Inputs and runs.

// Sets an input, at a stop if it has stops; both delays at once for `delay`.
function setInput(name, value) {
  const input = inputs[name];
  if (!input) throw new RangeError(`input ${name}: must be one of ${Object.keys(inputs)}`);
  if (!(value >= input.min && value <= input.max)) {
    throw new RangeError(`${name} = ${value}: must be from ${input.min} to ${input.max}`);
  }
  if (input.stops) value = input.stops.reduce((a, b) => (Math.abs(b - value) < Math.abs(a - value) ? b : a));
  for (const part of name === "delay" ? ["forward_delay", "return_delay"] : [name]) {
    state.values[part] = inputs[part].value = value;
  }
  if (inputs.delay) inputs.delay.value = (state.values.forward_delay + state.values.return_delay) / 2;
  for (const x of Object.values(inputs)) x.show();
  return refresh();
}

// Simulates what the inputs say, again if they change meanwhile, and shows it.
async function refresh() {
  ++state.version;
  state.drive = null;
  // What is shown belongs to other values; if this takes long it becomes pale.
  document.body.classList.add("stale");
  if (state.isBusy) return;
  state.isBusy = true;
  try {
    for (let mine = -1; mine !== state.version;) {
      mine = state.version;
      const begin = performance.now(), runs = [];
      for (const loop of loops) {
        runs.push(await loop.simulate(state.values, () => state.version !== mine, state.hand));
      }
      if (runs.includes(null)) continue;
      state.runs = runs;
      await nextFrame();
      draw();
      say(`${runs.length} runs simulated and drawn in ${(performance.now() - begin).toFixed(0)} ms`);
    }
    document.body.classList.remove("stale");
  } catch (error) {
    say(error.message, true);
  } finally {
    state.isBusy = false;
  }
}

// Shows all that depends on the runs.
function draw() {
  if (data.hand) state.window = [Math.max(0, duration() - 8), Math.max(8, duration())];
  $("clock").max = duration();
  setCursor(data.hand ? duration() : state.cursor);
  showMetrics();
}

// Makes a slider and a number for each input.
function makeInputs() {
  for (const [name, input] of Object.entries(inputs)) {
    const bounds = input.stops ? { min: 0, max: input.stops.length - 1, step: 1 }
      : { min: input.min, max: input.max, step: "any" };
    const slider = make("input", { type: "range", ariaLabel: input.label, ...bounds });
    const number = make("input", { type: "number", step: "any", ariaLabel: input.label });
    slider.oninput = () => setInput(name, input.stops ? input.stops[slider.value] : +slider.value);
    number.onchange = () => {
      try { setInput(name, +number.value); } catch (error) { say(error.message, true); }
    };
    input.show = () => {
      slider.value = input.stops ? input.stops.indexOf(input.value) : input.value;
      if (document.activeElement !== number) number.value = show(input.value);
    };
    input.row = make("div", { className: "row" }, make("label", { textContent: input.label }), slider, number);
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
  const names = [...new Set(state.runs.flatMap((run) => Object.keys(run.metrics)))];
  const cell = (textContent) => make("td", { textContent });
  const rows = names.map((name) => make("tr", {}, cell(name.replaceAll("_", " ").replace(".", ": ")),
    ...state.runs.map((run) => cell(show(run.metrics[name])))));
  const ends = state.runs.filter((run) => run.reason).map((run) => make("div", {
    textContent: `${titled(run.loop)} diverged at ${show(run.time.at(-1))} s: ${run.reason}` }));
  $("metrics").replaceChildren(make("table", {}, make("tr", {}, make("th", { textContent: "SI units" }),
    ...state.runs.map((run) => make("th", {}, keyOf(run.loop)))), ...rows), ...ends);
}

// ---- The diagram.

// Shows a level of the diagram of the controller that is chosen.
function showLevel(path) {
  const loop = loops[state.tab], level = loop.levels.find((x) => x.path === path) ?? loop.levels[0];
  state.level = level.path;
  $("diagram").innerHTML = new TextDecoder().decode(level.svg);
  for (const element of $("diagram").querySelectorAll("[data-at]")) {
    const [number, port] = element.dataset.at.split(":"), box = level.boxes[number];
    if (element.classList.contains("edge")) {
      const hit = element.querySelector("path").cloneNode();
      hit.classList.add("hit");
      element.append(hit);
    } else element.setAttribute("tabindex", "0");
    if (port) element.dataset.port = `${box.path}:${box[port[0]][port.slice(1)]}`;
    else element.dataset.box = box.path;
    element.classList.toggle("inner", !port && loop.levels.some((x) => x.path === box.path));
    element.onclick = () => (port ? toggleScope(element.dataset.port) : open(box));
    element.onkeydown = (e) => { if (e.key === "Enter") element.onclick(); };
    element.onmouseenter = element.onfocus = () => hover(element, box);
    element.onmouseleave = element.onblur = () => { $("tip").hidden = true; };
  }
  const parts = ["", ...level.path.split("/").filter((x) => x)];
  $("crumbs").replaceChildren(...parts.map((part, i) => make("button", { textContent: part || "loop",
    onclick: () => showLevel(parts.slice(1, i + 1).join("/")), disabled: i === parts.length - 1 })));
  markPorts();
}

// Marks the ports and wires whose signals are in the scopes.
function markPorts() {
  const { ports } = loops[state.tab], places = state.scopes.map((port) => String(ports[port]));
  for (const element of $("diagram").querySelectorAll("[data-port]")) {
    const place = ports[element.dataset.port];
    element.classList.toggle("on", Boolean(place) && places.includes(String(place)));
  }
}

// Opens a box, and shows what it is, its ports and which inputs it has.
function open(box) {
  const loop = loops[state.tab], [root] = box.path.split("/");
  if (box.path !== state.level && loop.levels.some((x) => x.path === box.path)) showLevel(box.path);
  const ports = [...box.u, ...box.y].map((name) => `${box.path}:${name}`).filter((x) => loop.ports[x]);
  $("box").replaceChildren(make("h2", { textContent: `${box.path || data.title}: ${box.kind}` }),
    make("div", { textContent: box.says }), ...ports.map((port) => make("button", {
      textContent: port.split(":")[1], onclick: () => toggleScope(port) })));
  for (const [name, input] of Object.entries(inputs)) {
    const owner = name.replace("_delay", "_channel").split(".")[0].replace("surgeon", "master");
    input.row.classList.toggle("hint", owner === root);
  }
}

// The values of a port at the cursor, for each controller.
function valuesOf(run, port, most) {
  const place = run.place(port), n = place && Math.min(place[1], most);
  return place ? run.vector([place[0], n], state.cursor).map(show).join(", ") + (n < place[1] ? " ..." : "") : "";
}

// Says what a port, a wire or a box is, with the values at the cursor.
function hover(element, box) {
  const { port } = element.dataset, place = port && loops[state.tab].ports[port];
  let text = port ?? `${box.path || data.title}: ${box.kind}\n${box.says}`;
  if (place) {
    text += `  [${place[1]}]  ${place[2]}\n`;
    text += state.runs.map((run) => `${titled(run.loop)}: ${valuesOf(run, port, 4)}\n`).join("");
    text += `at ${show(state.cursor)} s`;
  }
  $("tip").textContent = text;
  $("tip").hidden = false;
  const around = element.getBoundingClientRect(), tip = $("tip").getBoundingClientRect();
  const isBelow = around.bottom + tip.height + 12 < innerHeight;
  $("tip").style.top = `${isBelow ? around.bottom + 6 : Math.max(4, around.top - tip.height - 6)}px`;
  $("tip").style.left = `${Math.max(4, Math.min(around.left, innerWidth - tip.width - 8))}px`;
}

// Goes to the block or the port that the search names.
function find() {
  const text = $("search").value, loop = loops[state.tab], [path] = text.split(":");
  const box = loop.levels.flatMap((x) => x.boxes).find((x) => x.path === path && path);
  if (!box) return;
  showLevel(path.split("/").slice(0, -1).join("/"));
  open(box);
  if (text in loop.ports && !state.scopes.includes(text)) toggleScope(text);
  $("search").value = "";
}

// ---- The scopes.

const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];
const MOST_LINES = 6, MARGIN = 58;

// Puts a signal into the scopes, or takes it out.
function toggleScope(port) {
  if (!loops.some((loop) => loop.ports[port])) return;
  const i = state.scopes.indexOf(port);
  if (i >= 0) state.scopes.splice(i, 1); else state.scopes.unshift(port);
  makeScopes();
}

// Makes a canvas for each signal in the scopes.
function makeScopes() {
  $("scopes").replaceChildren(...state.scopes.map((port) => {
    const canvas = make("canvas", { ariaLabel: port }), head = make("div", { className: "head" });
    const timeAt = (e) => {
      const [a, b] = state.window, share = (e.offsetX - MARGIN) / (canvas.clientWidth - MARGIN);
      return a + (b - a) * Math.min(Math.max(share, 0), 1);
    };
    canvas.onpointerdown = canvas.onpointermove = (e) => { if (e.buttons) setCursor(timeAt(e)); };
    canvas.onwheel = (e) => { e.preventDefault(); zoom(1.2 ** Math.sign(e.deltaY), timeAt(e)); };
    canvas.ondblclick = () => zoom(Infinity, 0);
    const scope = make("div", { className: "scope" }, head, canvas);
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
  state.window = low >= 0 && high - low < end && high > low ? [low, high] : [0, end];
  drawScopes();
}

// Returns ticks of an axis between two values.
function ticks(low, high, most) {
  const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find((x) => x * power >= raw) * power, first = Math.ceil(low / step);
  return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, i) => (first + i) * step);
}

// Returns a canvas's context in CSS pixels, cleared, and the colours of the page.
function pen(canvas) {
  const ratio = devicePixelRatio || 1, { clientWidth: width, clientHeight: height } = canvas;
  [canvas.width, canvas.height] = [width * ratio, height * ratio];
  const context = canvas.getContext("2d"), style = getComputedStyle(document.documentElement);
  context.scale(ratio, ratio);
  context.font = "12px Helvetica, Arial, sans-serif";
  const [ink, faint, line] = ["ink", "faint", "line"].map((x) => style.getPropertyValue(`--${x}`).trim());
  return { context, width, height, ink, faint, line };
}

// Returns the points of a line in the window: rows, and between them where they are far.
function curve(run, place, k, width) {
  const [a, b] = state.window, fine = (b - a) / width * 3, points = [];
  for (let s = run.step(a + 1e-12); s < run.ends.length; ++s) {
    const last = run.ends[s], begin = Math.max(run.time[last - 4], a), end = Math.min(run.time[last], b);
    if (begin > b) break;
    const n = Math.min(Math.ceil((end - begin) / fine), 60);
    for (let j = 0; j <= n; ++j) points.push([begin + j * (end - begin) / (n || 1), 0]);
    for (let j = points.length - n - 1; j < points.length; ++j) points[j][1] = run.at(place, k, points[j][0], s);
  }
  return points;
}

// Returns the lines of a scope, and the values between which they are.
function curvesOf(port, width) {
  const curves = [...state.pinned, ...state.runs].flatMap((run, i) => {
    const place = run.place(port), n = place ? Math.min(place[1], MOST_LINES) : 0;
    return Array.from({ length: n }, (_, k) => (
      { run, k, points: curve(run, place, k, width), isPale: i < state.pinned.length }));
  });
  let [low, high] = [Infinity, -Infinity];
  for (const { points } of curves) for (const [, v] of points) [low, high] = [Math.min(low, v), Math.max(high, v)];
  const gap = 0.06 * (high - low) || 0.01 * Math.abs(high) || 0.5;
  return low <= high ? { curves, low: low - gap, high: high + gap } : { curves, low: -1, high: 1 };
}

// Draws all scopes.
function drawScopes() { if (state.runs.length) for (const scope of $("scopes").children) drawScope(scope); }

// Draws a signal of all runs.
function drawScope(scope) {
  const { port } = scope.dataset, [head, canvas] = scope.children, [a, b] = state.window;
  const { context: c, width, height, ink, faint, line } = pen(canvas);
  // They are the same as long as only the cursor moves.
  const basis = [state.runs, state.pinned, state.runs[0].ends.length, a, b, width];
  if (!scope.basis || basis.some((value, i) => value !== scope.basis[i])) {
    Object.assign(scope, { basis, ...curvesOf(port, width - MARGIN) });
  }
  const { curves, low, high } = scope;
  const x = (t) => MARGIN + (t - a) / (b - a) * (width - MARGIN - 4);
  const y = (v) => 4 + (high - v) / (high - low) * (height - 24);
  const write = (text, align, px, py) => { c.textAlign = align; c.fillText(text, px, py); };
  c.textBaseline = "middle";
  for (const tick of ticks(low, high, 5)) {
    c.fillStyle = tick === 0 ? faint : line;
    c.fillRect(MARGIN, y(tick), width, tick === 0 ? 1 : 0.6);
    c.fillStyle = faint;
    write(show(tick), "right", MARGIN - 6, y(tick));
  }
  for (const tick of ticks(a, b, width / 90)) write(`${show(tick)} s`, "center", x(tick), height - 8);
  c.save();
  c.beginPath();
  c.rect(MARGIN, 0, width - MARGIN, height - 18);
  c.clip();
  for (const run of state.runs) {
    c.fillStyle = inkOf(run.loop, ink);
    c.globalAlpha = 0.35;
    for (const event of run.events) c.fillRect(x(event.time), 0, 1.2, height);
  }
  for (const { run, k, points, isPale } of curves) {
    c.strokeStyle = inkOf(run.loop, ink);
    c.globalAlpha = isPale ? 0.35 : 1;
    c.lineWidth = 1.8;
    c.setLineDash(DASHES[k % DASHES.length]);
    c.beginPath();
    for (const [t, v] of points) c.lineTo(x(t), y(v));
    c.stroke();
  }
  c.restore();
  c.fillStyle = ink;
  c.fillRect(x(state.cursor), 0, 1, height - 18);
  const [, size, unit] = loops.map((loop) => loop.ports[port]).find((p) => p);
  head.replaceChildren(make("b", { textContent: port.replace(":", " · ") }), unit && `[${unit}]`,
    ...size > MOST_LINES ? [`${MOST_LINES} of ${size}`] : [],
    ...state.runs.map((run) => keyOf(run.loop, valuesOf(run, port, 3))),
    make("button", { textContent: "×", ariaLabel: `remove ${port}`, onclick: () => toggleScope(port) }));
}

// ---- The task.

// Moves the cursor of all that is shown.
function setCursor(t) {
  state.cursor = Math.min(Math.max(t, 0), duration());
  $("clock").value = state.cursor;
  $("now").textContent = `${state.cursor.toFixed(3)} s`;
  drawScopes();
  drawScene();
}

// Draws tool, ghost, packets and surfaces at the cursor: in lanes along x, or in the plane.
function drawScene() {
  const { context: c, width, height, ink, faint } = pen($("scene"));
  const shown = state.runs.filter((run) => run.signal("tool_position"));
  $("task").hidden = !shown.length;
  if (!shown.length) return;
  const isPlane = shown[0].signal("tool_position")[1] > 1, axes = isPlane ? [0, 1] : [0];
  // A layer that reaches to where nothing is begins at infinity.
  const surfaces = shown[0].loop.surfaces.map((name) => shown[0].surface(name))
    .filter((s) => s.point.every(Number.isFinite));
  const all = axes.map((k) => shown.flatMap((run) => {
    const [begin] = run.signal("tool_position");
    return run.rows.filter((_, i) => i % 16 === 0).map((row) => row[begin + k]);
  }));
  all[0].push(...surfaces.map((s) => s.point[0]));
  const box = all.map((x) => [Math.min(...x), Math.max(...x)]);
  const sizes = box.map(([low, high]) => high - low), middle = box.map(([low, high]) => (low + high) / 2);
  const scale = Math.min(0.8 * width / (sizes[0] || 1e-6), isPlane && sizes[1] ? 0.7 * height / sizes[1] : Infinity);
  const X = (q) => width / 2 + (q[0] - middle[0]) * scale;
  const Y = (q, lane) => (isPlane ? height / 2 - (q[1] - middle[1]) * scale : (lane + 0.5) * height / shown.length);
  const ring = (q, lane, radius, how) => {
    c.beginPath();
    c.arc(X(q), Y(q, lane), radius, 0, 7);
    c[how]();
  };
  surfaces.forEach((s, i) => {
    // The half-plane behind the surface.
    c.save();
    c.translate(X(s.point), isPlane ? Y(s.point) : height / 2);
    c.rotate(Math.atan2(isPlane ? -s.normal[1] : 0, s.normal[0]));
    c.globalAlpha = s.name === "contact" ? 0.4 : 0.16;
    c.fillStyle = faint;
    c.fillRect(0, -3000, 3000, 6000);
    c.restore();
    c.fillStyle = faint;
    const isRight = X(s.point) > width - 60;
    c.textAlign = isRight ? "right" : "left";
    c.fillText(s.name, isRight ? width - 4 : Math.max(X(s.point) + 3, 4), 12 + 13 * (i % 2));
  });
  shown.forEach((run, lane) => {
    const place = run.signal("tool_position"), felt = run.signal("felt_position") ?? run.place("master/surgeon:felt_position");
    const q = run.vector(place, state.cursor);
    c.strokeStyle = c.fillStyle = inkOf(run.loop, ink);
    c.lineWidth = 1.5;
    c.globalAlpha = 0.6;
    c.beginPath();
    for (let i = 0; i < run.rows.length && run.time[i] <= state.cursor; ++i) {
      const r = run.rows[i].subarray(place[0], place[0] + 2);
      c.lineTo(X(r), Y(r, lane));
    }
    c.stroke();
    c.globalAlpha = 1;
    if (felt) {
      c.setLineDash([3, 2]);
      ring(run.vector(felt, state.cursor), lane, 9, "stroke");
      c.setLineDash([]);
    }
    ring(q, lane, 6, "fill");
    if (!isPlane) c.fillText(titled(run.loop), 4, Y(q, lane) + 18);
  });
  c.fillStyle = faint;
  c.textAlign = "right";
  c.fillText("● tool   ◌ as the operator feels it", width - 4, height - 6);
}

// Plays on, ten times slower around events if that is wanted.
function play(now, before = now) {
  if (!state.isPlaying) return;
  const near = state.runs.some((run) => run.events.some((e) => Math.abs(e.time - state.cursor) < 0.1));
  const speed = $("speed").value * ($("slow").checked && near ? 0.1 : 1);
  setCursor(state.cursor + Math.min(now - before, 100) / 1000 * speed);
  if (state.cursor >= duration()) togglePlay();
  else requestAnimationFrame((next) => play(next, now));
}

// Begins to play, or ends it.
function togglePlay() {
  state.isPlaying = !state.isPlaying;
  $("play").textContent = state.isPlaying ? "❚❚" : "▶";
  if (state.isPlaying && state.cursor >= duration()) setCursor(0);
  if (state.isPlaying) requestAnimationFrame((now) => play(now));
}

// ---- One's own hand.

const KEYS = [["ArrowLeft", "ArrowRight"], ["ArrowDown", "ArrowUp"], ["s", "w"]];
const PICTURE = 1 / 60;

// Returns what the hand commands, m/s: keys, a pointer that pulls, or a gamepad's sticks.
function command() {
  const pad = navigator.getGamepads?.().find((x) => x), { num_axes: n, full_speed: most } = data.hand;
  const sticks = pad ? [pad.axes[0], -pad.axes[1], -pad.axes[3]].map((x) => (Math.abs(x) < 0.1 ? 0 : x)) : [0, 0, 0];
  return Array.from({ length: n }, (_, k) => {
    const pressed = KEYS[k].map((key) => state.keys.has(key)), pull = state.pull?.[k] ?? 0;
    return most * Math.min(Math.max(pressed[1] - pressed[0] + sticks[k] + pull, -1), 1);
  });
}

// Drives the controller that is chosen, in real time, until that is enough.
async function drive() {
  if (state.drive) { state.drive = null; return; }
  const loop = loops[state.tab], run = new Run(loop, loop.numbersAt(state.values));
  const mine = (state.drive = {}), begin = performance.now();
  $("drive").textContent = "End (Esc)";
  state.hand = [[0, ...command().fill(0)]];
  state.runs = [run];
  while (state.drive === mine && !run.reason && run.duration - state.hand.at(-1)[0] > PICTURE) {
    const late = (performance.now() - begin) / 1000 - state.hand.at(-1)[0];
    // At most a tenth of a second is made up for; then simulated time is slower.
    for (let i = 0; i < Math.min(late / PICTURE, 6) && !run.reason; ++i) {
      const before = state.hand.at(-1), after = [before[0] + PICTURE, ...command()];
      await run.follow(before, after);
      state.hand.push(after);
    }
    state.window = [Math.max(0, run.time.at(-1) - 8), Math.max(8, run.time.at(-1))];
    state.cursor = run.time.at(-1);
    drawScopes();
    drawScene();
    say(`driving ${titled(loop)}: ${run.time.at(-1).toFixed(1)} s`);
    const felt = run.signal("force_command"), size = felt && Math.hypot(...run.vector(felt, state.cursor));
    const pad = navigator.getGamepads?.().find((x) => x?.vibrationActuator);
    if (pad && felt) pad.vibrationActuator.playEffect("dual-rumble", { duration: 50,
      strongMagnitude: Math.min(1, size / (data.hand.newtons || 1)) });
    await nextFrame();
  }
  state.drive = null;
  $("drive").textContent = "Drive again";
  $("save").href = URL.createObjectURL(new Blob([["time,v_x,v_y,v_z".split(",").slice(0, 1 + data.hand.num_axes),
    ...state.hand].map((row) => row.join(",")).join("\n")], { type: "text/csv" }));
  $("saved").hidden = false;
  await refresh();
}

// ---- The page.

// Does what a key says.
function press(e) {
  if (e.target.matches?.("input, select") && e.key !== "Escape") return;
  if (state.drive && KEYS.flat().includes(e.key)) { e.preventDefault(); state.keys.add(e.key); return; }
  const step = (state.window[1] - state.window[0]) / 200;
  const actions = {
    " ": togglePlay, p: togglePin, d: () => data.hand && drive(), "/": () => $("search").focus(),
    ArrowLeft: () => setCursor(state.cursor - step), ArrowRight: () => setCursor(state.cursor + step),
    "+": () => zoom(1 / 1.5, state.cursor), "-": () => zoom(1.5, state.cursor), 0: () => zoom(Infinity, 0),
    Escape: () => (state.drive ? drive() : showLevel(state.level.split("/").slice(0, -1).join("/"))),
  };
  if (!actions[e.key] || (e.key === " " && e.target.matches?.("button"))) return;
  e.preventDefault();
  actions[e.key]();
}

// Lets a pointer on the scene pull the tool, as far as it is from where it went down.
function makeHand() {
  let from = null;
  $("scene").onpointerdown = (e) => { from = [e.offsetX, e.offsetY]; $("scene").setPointerCapture(e.pointerId); };
  $("scene").onpointermove = (e) => { if (from) state.pull = [(e.offsetX - from[0]) / 80, (from[1] - e.offsetY) / 80]; };
  $("scene").onpointerup = $("scene").onpointercancel = () => { from = state.pull = null; };
  $("drive").onclick = drive;
  $("repeat").textContent = data.hand.command;
  $("hand").hidden = false;
}

// Makes the page.
async function start() {
  data = await unpack();
  inputs = Object.fromEntries(data.inputs.map((input) => [input.name, { ...input }]));
  const { forward_delay: there, return_delay: back } = inputs;
  if (there && back && !there.stops && !back.stops) {
    inputs = { delay: { ...there, name: "delay", label: "delay each way [s]", value: (there.value + back.value) / 2,
      min: Math.max(there.min, back.min), max: Math.min(there.max, back.max) }, ...inputs };
  }
  for (const input of data.inputs) state.values[input.name] = input.value;
  loops = data.controllers.map((x) => new Loop(x, data.inputs));
  $("notes").textContent = data.notes.join("\n");
  $("tabs").append(...(loops.length < 2 ? [] : loops.map((loop, i) => make("button", {
    textContent: titled(loop), ariaPressed: i === 0, onclick: () => {
      state.tab = i;
      [...$("tabs").children].forEach((tab, k) => { tab.ariaPressed = k === i; });
      showLevel(state.level);
    } }))));
  const names = new Set(loops.flatMap((loop) => [...Object.keys(loop.ports),
    ...loop.levels.flatMap((x) => x.boxes.map((box) => box.path))]));
  $("found").append(...[...names].filter((x) => x).map((value) => make("option", { value })));
  $("search").onchange = find;
  $("theme").onclick = () => { document.documentElement.classList.toggle("dark"); draw(); };
  document.documentElement.classList.toggle("dark", matchMedia("(prefers-color-scheme: dark)").matches);
  $("play").onclick = togglePlay;
  $("pin").onclick = togglePin;
  $("clock").oninput = () => setCursor(+$("clock").value);
  document.addEventListener("keydown", press);
  document.addEventListener("keyup", (e) => state.keys.delete(e.key));
  addEventListener("resize", () => { if (state.runs.length) setCursor(state.cursor); });
  if (data.hand) makeHand();
  makeInputs();
  showLevel("");
  if (!loops[0].module) {
    document.body.classList.add("still");
    return say("");
  }
  await Promise.all(loops.map((loop) => loop.compile()));
  const { signals, ports } = loops[0], first = ["tool_velocity", "environment_force", "tool_position"];
  const usual = signals.tool_velocity ? first : Object.keys(signals).slice(0, 3);
  state.scopes = (data.scopes.length ? data.scopes : usual).map((name) => signals[name])
    .filter((port) => ports[port]);
  state.window = [0, loops[0].numbers.run[0]];
  makeScopes();
  await refresh();
}

// Runs a controller at the values of the inputs, for scripts.
async function runForScripts(kind) {
  const loop = loops.find((x) => x.kind === kind);
  if (!loop) throw new RangeError(`controller ${kind}: must be one of ${loops.map((x) => x.kind)}`);
  while (state.isBusy) await new Promise((go) => setTimeout(go, 5));
  const run = await loop.simulate({ ...state.values }, undefined, state.hand);
  const column = (name) => {
    const [begin, size] = loop.ports[loop.signals[name]];
    return Array.from({ length: size }, (_, k) => run.rows.map((row) => row[begin + k]));
  };
  const result = { time: run.time, events: run.events, wall_time_ms: run.wall, diverged: Boolean(run.reason),
    metrics: run.metrics, signals: Object.fromEntries(Object.keys(loop.signals).map((x) => [x, column(x)])) };
  return Object.defineProperty(result, "run", { value: run });
}

window.teleop = {
  ready: start().catch((error) => { say(error.message, true); throw error; }),
  get controllers() { return loops.map((loop) => loop.kind); },
  get inputs() {
    return Object.fromEntries(Object.entries(inputs).map(([name, { value, min, max, unit }]) =>
      [name, { value, min, max, unit }]));
  },
  set: setInput,
  run: runForScripts,
  sample: ({ run }, name, times) => {
    const place = run.signal(name) ?? run.place(name);
    if (!place) throw new RangeError(`signal ${name}: must be one of ${Object.keys(run.loop.signals)}`);
    const rows = times.map((t) => run.vector(place, t));
    return Array.from({ length: place[1] }, (_, k) => rows.map((row) => row[k]));
  },
};
