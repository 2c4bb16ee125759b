// The picture of the task: surfaces, arms, tools, felt positions, and packets under way.

import { onCursor } from "./clock.js";
import { $, safe } from "./elements.js";
import { clamp, dot, extent, range } from "./numbers.js";
import { drawPlants, jointsAt } from "./plants.js";
import { state } from "./state.js";

const RAIL = 14; // px, for the packets of a run
const LONGEST_ARROW = 60; // px, for the largest force of the first runs,
const MOST_ARROW = 90; // and for any force
const ENDS = [70, 55]; // px, from the picture's sides to the ends of the rails

// Projects a point of the task onto the plane of the picture.
const see = (q) => state.data.view.map((axis) => dot(axis.slice(0, q.length), q));

// The positions of the joints of the robot's arm and of its tool. The array is empty if the robot
// is not a MultibodyPlant, and before the first step.
export function armAt(run, time = state.cursor) {
  const isRobot = ({ state: port }) => port.startsWith("robot/") && run.columns(port);
  const plant = run.loop.plants.find(isRobot);
  if (!plant || run.ends.length === 0 || run.hasEnded(time)) return [];
  const tool = run.vector(run.signal("tool_position"), time);
  return [...jointsAt(run, plant, time), tool];
}

// The path of a run's tool, in the plane of the picture.
function pathOf(run) {
  const columns = run.signal("tool_position");
  return run.ends.map((i) => see(run.row(columns, i)));
}

const drawnPaths = new WeakMap(); // The paths of runs in pixels.

// The path of a run's tool until the cursor, in pixels: one point for each pixel. The points up to
// the latest cursor are kept.
function drawnPath(run, lane, toPixels) {
  const known = drawnPaths.get(run);
  const path = known?.toPixels === toPixels ? known : { toPixels, points: [], next: 0 };
  drawnPaths.set(run, path);
  const { points } = path;
  const columns = run.signal("tool_position");
  for (; run.time[run.ends[path.next]] <= state.cursor; ++path.next) {
    const row = run.ends[path.next];
    const [x, y] = toPixels(see(run.row(columns, row)), lane);
    const last = points.at(-1);
    const isNear = last && Math.abs(x - last.x) < 1 && Math.abs(y - last.y) < 1;
    if (!isNear) points.push({ x, y, time: run.time[row] });
  }
  return points.filter(({ time }) => time <= state.cursor).map(({ x, y }) => `${x},${y}`);
}

// The surfaces of a run, in the plane of the picture. The first one may be at infinity.
function surfacesOf({ loop, z }) {
  const size = z.surfaces.length / loop.surfaces.length / 2;
  const part = (i) => see(Array.from(z.surfaces.slice(i * size, (i + 1) * size)));
  return loop.surfaces.map((name, i) => ({
    name,
    label: (loop.materials[i] || name).replaceAll("_", " "),
    point: part(2 * i),
    normal: part(2 * i + 1),
  }));
}

const isNear = ({ point }) => point.every(Number.isFinite);

// The map from points of the plane to pixels. The picture contains the arms, but only as far as the
// paths of the tools do not become too small. Without a second axis (`lanes` is not 0) each run has
// a lane.
function fitScene(paths, arms, width, height, lanes) {
  const along = (points, axis) => extent(points.map((p) => p[axis]));
  const own = [0, 1].map((axis) => along(paths, axis));
  const most = 4 * Math.max(...own.map(([low, high]) => high - low));
  const [[left, right], [bottom, top]] = own.map(([low, high], axis) => {
    const [back, far] = along([...paths, ...arms], axis);
    return [Math.max(low - most, back), Math.min(high + most, far)];
  });
  const wide = (0.85 * width) / (right - left || 1e-6);
  const tall = lanes ? Infinity : (height - 40) / (top - bottom);
  const scale = Math.min(wide, tall);
  return ([x, y], lane) => {
    const across = width / 2 + (x - (left + right) / 2) * scale;
    const down = lanes
      ? ((lane + 0.5) * height) / lanes
      : height / 2 + 8 - (y - (bottom + top) / 2) * scale;
    return [across.toFixed(1), down.toFixed(1)];
  };
}

// What the picture contains. It belongs to the task: a slider does not rescale the picture.
let frame = {};

// The map to pixels, and the pixels for each newton. They are those of the first runs with these
// controllers and surfaces that reach their end; in a drive they are those of the current runs.
function frameOf(shown, surfaces, width, floor, lanes) {
  const key = JSON.stringify([shown.map(({ loop }) => state.loops.indexOf(loop)), surfaces]);
  if (frame.key !== key || state.data.hand) frame = { key, ...contentsOf(shown, surfaces, lanes) };
  const size = `${width} ${floor}`;
  if (frame.size !== size) {
    const { paths, arms } = frame;
    Object.assign(frame, { size, toPixels: fitScene(paths, arms, width, floor, lanes) });
  }
  return frame;
}

// The points that a picture of runs contains, and its pixels for each newton.
function contentsOf(shown, surfaces, lanes) {
  const whole = shown.filter(({ reason }) => !reason);
  const runs = whole.length ? whole : shown;
  const arms = runs.flatMap((run) => armAt(run, run.startTime).map(see));
  const paths = runs.flatMap(pathOf);
  if (lanes) paths.push(...surfaces.map(({ point }) => point));
  // In a drive the whole arm and the surfaces ahead are visible from the start.
  if (state.data.hand) paths.push(...arms, ...ahead(surfaces, paths[0]));
  const forces = runs.flatMap((run) => {
    const columns = run.signal("environment_force") ?? [];
    return run.ends.map((i) => Math.hypot(...see(run.row(columns, i))));
  });
  const [, largest] = extent(forces);
  return { paths, arms, pixelsPerNewton: largest > 0 ? LONGEST_ARROW / largest : 0 };
}

// The half-plane behind each surface, with the name of what is there. Free space is the lightest.
function drawSurfaces(surfaces, toPixels, width) {
  const names = [];
  const rects = surfaces.map((surface, i) => {
    const { name, label, point, normal } = surface;
    const [x, y] = isNear(surface) ? toPixels(point, 0) : [-3000, 0];
    const angle = (Math.atan2(-normal[1], normal[0]) * 180) / Math.PI;
    const isAtEdge = x > width - 60;
    const left = isAtEdge ? width - 4 : clamp(Number(x) + 3, 4, width);
    const rect = (className) => `<rect class="${className}" y="-3000" width="9000" height="6000"
      transform="translate(${x} ${y}) rotate(${angle})"/>`;
    const tint = /^(free|empty)/.test(label) ? "" : rect(safe(name));
    names.push(`<text x="${left}" y="${12 + 13 * (i % 2)}"
      text-anchor="${isAtEdge ? "end" : "start"}">${safe(label)}</text>`);
    return rect("clear") + tint;
  });
  return rects.concat(names).join("");
}

// The positions of the packets under way at a time, as fractions of their way. `lags` has the time
// that each packet is under way, s, or one element if it is constant.
export function packetsUnderWay(lags, t) {
  if (!lags) return [];
  const { period } = state.data;
  const sent = range(Math.floor(t / period) + 1);
  const shares = sent.map((k) => (t - k * period) / lags[Math.min(k, lags.length - 1)]);
  return shares.filter((share) => share > 0 && share < 1).reverse();
}

// The packets of a run: packets to the robot are above packets from it.
function drawPackets({ forward, return: back }, width, rail) {
  const [from, to] = [ENDS[0], width - ENDS[1]];
  const there = packetsUnderWay(forward, state.cursor).map(
    (share) => `M${from + share * (to - from)} ${rail}h5`,
  );
  const home = packetsUnderWay(back, state.cursor).map(
    (share) => `M${to + share * (from - to)} ${rail + 6}h5`,
  );
  return `<path class="packets" d="${there.join("")}${home.join("")}"/>`;
}

// The force of the environment on a run's tool, as an arrow from the tool.
function drawForce(run, [x, y], pixelsPerNewton) {
  const columns = run.signal("environment_force");
  if (!columns) return "";
  // The signal is the force of the tool on the environment.
  const [across, up] = see(run.vector(columns, state.cursor)).map((F) => -F * pixelsPerNewton);
  const length = Math.hypot(across, up);
  if (length < 2) return "";
  const scale = Math.min(1, MOST_ARROW / length);
  const angle = (Math.atan2(-up, across) * 180) / Math.PI;
  return `<path class="force" d="M0 0h${length * scale}m-6 -4l6 4l-6 4"
    transform="translate(${x} ${y}) rotate(${angle})"/>`;
}

// A run at the cursor: the path of the tool, the arm, the tool, the force on it, and where it is
// felt.
function drawRun(run, lane, { toPixels, pixelsPerNewton, isPlane, width, floor }) {
  const { color, title } = run.loop;
  const hasEnded = run.hasEnded(state.cursor);
  const at = (columns) => toPixels(see(run.vector(columns, state.cursor)), lane);
  const polyline = (places, name) => `<polyline class="${name}" points="${places.join(" ")}"/>`;
  const arm = armAt(run).map((point) => toPixels(see(point), lane));
  const [x, y] = at(run.signal("tool_position"));
  const felt = run.signal("felt_position") ?? run.columns("master/surgeon:felt_position");
  const [u, v] = felt ? at(felt) : [x, y];
  const rail = floor + 10 + RAIL * lane;
  const tool = `<circle class="felt" cx="${u}" cy="${v}" r="${felt ? 9 : 0}"/>
    <circle cx="${x}" cy="${y}" r="5"/>${drawForce(run, [x, y], pixelsPerNewton)}
    ${drawPackets(run.z, width, rail)}`;
  const cross = `<path class="end" d="M${x} ${y}m-5 -5l10 10m-10 0l10 -10"/>`;
  return `<g stroke="${color}" fill="${color}">
    ${polyline(drawnPath(run, lane, toPixels), "path")}${polyline(arm, "arm")}
    ${hasEnded ? cross : tool}
    <text x="4" y="${Number(y) + 18}">${isPlane ? "" : safe(title)}</text></g>`;
}

// The tools of pinned runs at the cursor, pale.
function drawGhosts(lanes, toPixels) {
  const ghosts = state.pinned.filter((run) => run.signal("tool_position") && run.ends.length);
  return ghosts.map((run) => {
    const place = see(run.vector(run.signal("tool_position"), state.cursor));
    const lane = lanes ? state.runs.findIndex(({ loop }) => loop === run.loop) : 0;
    const [x, y] = toPixels(place, Math.max(0, lane));
    return `<circle class="ghost" cx="${x}" cy="${y}" r="7" fill="${run.loop.color}"/>`;
  });
}

// The names of both sides, and the legend of the marks.
function drawLegend(hasChannels, width, height, floor) {
  const [left, right] = hasChannels ? ["operator", "robot"] : ["", ""];
  const marks = "● tool ◌ as felt → force on it";
  return `<text x="4" y="${height - 12}">${left}</text>
    <text x="${width - 4}" y="${height - 12}" text-anchor="end">${right}</text>
    <text x="${width - 4}" y="${floor - 2}" text-anchor="end">${marks}</text>`;
}

// The point of each surface that is nearest to a place.
function ahead(surfaces, place) {
  if (!place) return [];
  return surfaces.map(({ point, normal }) => {
    const distance = dot(normal, point) - dot(normal, place);
    return place.map((x, k) => x + distance * normal[k]);
  });
}

// Draws the task at the cursor.
function drawScene() {
  const shown = state.runs.filter((run) => run.signal("tool_position"));
  $("task").hidden = !shown.length;
  if (!shown.length) {
    drawPlants();
    return;
  }
  const { clientWidth: width, clientHeight: height } = $("scene");
  const floor = height - RAIL * shown.length - 8;
  const isPlane = state.data.view[1].some((x) => x);
  const all = surfacesOf(shown[0]);
  const surfaces = all.filter(isNear);
  const lanes = isPlane ? 0 : shown.length;
  const { toPixels, pixelsPerNewton } = frameOf(shown, surfaces, width, floor, lanes);
  const picture = { toPixels, pixelsPerNewton, isPlane, width, floor };
  const runs = shown.map((run, lane) => drawRun(run, lane, picture));
  $("scene").innerHTML =
    drawSurfaces(all, toPixels, width) +
    drawGhosts(lanes, toPixels).join("") +
    runs.join("") +
    drawLegend(shown[0].z.forward, width, height, floor);
}

onCursor(drawScene);
