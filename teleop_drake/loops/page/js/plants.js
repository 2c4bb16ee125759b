// The MultibodyPlants of a diagram: their frames, links and shapes, walls, and their forces.
// See plants.py.

import { $, safe } from "./elements.js";
import { dot, extent, range } from "./numbers.js";
import { state } from "./state.js";

const NUM_TIMES = 60; // The number of instants whose lines the picture must contain.
const MARGIN = 20; // px
const AXIS = 0.12; // The length of a frame's axes, as a fraction of the picture,
const ARROW = 0.3; // and of the arrow of the largest force.

// The head of an arrow.
const ARROW_HEAD = `<defs><marker id="head" orient="auto" viewBox="0 -3 6 6" refX="5"
  markerWidth="4" markerHeight="4"><path class="head" d="M0 -3L6 0L0 3z"/></marker></defs>`;

// The matrix of a pose [R, p].
function matrixOf([[a, b, c, x], [d, e, f, y], [g, h, i, z]]) {
  return new DOMMatrix([a, d, g, 0, b, e, h, 0, c, f, i, 0, x, y, z, 1]);
}

// The motion of a link by its joint.
function motionOf({ turns, axis }, q) {
  const still = new DOMMatrix();
  if (turns) return still.rotateAxisAngle(...axis, (q * 180) / Math.PI);
  return still.translate(...axis.map((x) => x * q));
}

// The projection of a point of a frame onto the plane of the picture.
function seen(frame, point) {
  const { x, y, z } = frame.transformPoint(new DOMPoint(...point));
  return state.data.view.map((axis) => dot(axis, [x, y, z]));
}

// The frames of the world and of a plant's links at a time.
function framesAt(run, { state: port, links }, time) {
  const q = run.vector(run.columns(port), time);
  const frames = [new DOMMatrix()];
  links.forEach((link, i) => {
    const joint = frames[link.parent + 1].multiply(matrixOf(link.frame));
    frames.push(joint.multiply(motionOf(link, q[i])));
  });
  return frames;
}

// The positions of a plant's joints at a time, in the world frame.
export function jointsAt(run, plant, time) {
  const frames = framesAt(run, plant, time);
  return plant.links.map(({ parent, frame }) => {
    const { m41, m42, m43 } = frames[parent + 1].multiply(matrixOf(frame));
    return [m41, m42, m43];
  });
}

// Lines of a plant at a time: from each joint to the next one, to the centre of mass, and to the
// frames of its link.
function linesAt(run, plant, time) {
  const frames = framesAt(run, plant, time);
  const joints = frames.slice(1).map((frame) => seen(frame, [0, 0, 0]));
  const bones = plant.links.flatMap(({ parent, centre }, i) => [
    [seen(frames[parent + 1], [0, 0, 0]), joints[i]],
    [joints[i], seen(frames[i + 1], centre)],
  ]);
  const tips = plant.links.flatMap((link, i) =>
    link.tips.map((point) => [joints[i], seen(frames[i + 1], point)]),
  );
  return [...bones, ...tips];
}

// The points of a plant's shapes at a time.
function shapesAt(run, { shapes, ...plant }, time) {
  const frames = framesAt(run, plant, time);
  return shapes.map(({ link, points }) => points.map((point) => seen(frames[link + 1], point)));
}

// The convex hull of points of a plane, in order.
function hullOf(points) {
  const sorted = points.toSorted((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (all) => {
    const hull = [];
    for (const point of all) {
      while (hull.length > 1 && !isLeftTurn(hull.at(-2), hull.at(-1), point)) hull.pop();
      hull.push(point);
    }
    return hull.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.toReversed())];
}

// Whether the way over three points turns left at the second one.
function isLeftTurn(a, b, c) {
  return (b[0] - a[0]) * (c[1] - a[1]) > (b[1] - a[1]) * (c[0] - a[0]);
}

// The map from the plane to pixels for which all lines are in the picture, and their extent.
function fit(lines, width, height) {
  const [[left, right], [bottom, top]] = [0, 1].map((k) => extent(lines.flat().map((p) => p[k])));
  const size = Math.max(right - left, top - bottom) || 1;
  const wide = (width - 2 * MARGIN) / Math.max(right - left, 0.2 * size);
  const tall = (height - 2 * MARGIN) / Math.max(top - bottom, 0.2 * size);
  const scale = Math.min(wide, tall);
  const toPixels = ([x, y]) => [
    (width / 2 + (x - (left + right) / 2) * scale).toFixed(1),
    (height / 2 - (y - (bottom + top) / 2) * scale).toFixed(1),
  ];
  return { toPixels, size };
}

// The axes of each link's frame: x, y and z.
function drawFrames(run, plant, { toPixels, size }) {
  const frames = framesAt(run, plant, state.cursor).slice(1);
  return frames.flatMap((frame) => {
    const origin = toPixels(seen(frame, [0, 0, 0]));
    return ["x", "y", "z"].map((name, k) => {
      const point = range(3).map((i) => (i === k ? AXIS * size : 0));
      return `<path class="axis ${name}" d="M${origin}L${toPixels(seen(frame, point))}"/>`;
    });
  });
}

// A plant of a run at the cursor.
function drawPlant(run, plant, picture) {
  const { toPixels } = picture;
  const shapes = shapesAt(run, plant, state.cursor).map(
    (points) => `<polygon class="shape" points="${hullOf(points).map(toPixels).join(" ")}"/>`,
  );
  const lines = linesAt(run, plant, state.cursor);
  const path = lines.map(([a, b]) => `M${toPixels(a)}L${toPixels(b)}`);
  const joints = framesAt(run, plant, state.cursor).slice(1);
  const dots = joints.map((frame) => {
    const [x, y] = toPixels(seen(frame, [0, 0, 0]));
    return `<circle cx="${x}" cy="${y}" r="3"/>`;
  });
  return `<g stroke="${run.loop.color}" fill="${run.loop.color}">${shapes.join("")}</g>
    ${drawFrames(run, plant, picture).join("")}<g stroke="${run.loop.color}"
    fill="${run.loop.color}"><path class="link" d="${path.join("")}"/>${dots.join("")}</g>
    ${drawForceInSpace(run, picture)}`;
}

// A vector along the axes of a task as a vector in space.
const inSpace = (vector) => [...vector, 0, 0].slice(0, 3);

// The walls of a run: the half-plane behind each surface.
function drawWalls({ loop, z }, { toPixels }) {
  const size = z.surfaces.length / loop.surfaces.length / 2;
  return loop.surfaces.map((name, i) => {
    const numbers = Array.from(z.surfaces.slice(2 * i * size, 2 * (i + 1) * size));
    const still = new DOMMatrix();
    const [x, y] = toPixels(seen(still, inSpace(numbers.slice(0, size))));
    const [right, up] = seen(still, inSpace(numbers.slice(size)));
    if (!Number.isFinite(Number(x)) || Math.hypot(right, up) < 0.1) return "";
    const angle = (Math.atan2(-up, right) * 180) / Math.PI;
    return `<rect class="${safe(name)}" y="-3000" width="9000" height="6000"
      transform="translate(${x} ${y}) rotate(${angle})"><title>${safe(name)}</title></rect>`;
  });
}

// The columns of the first port of a run with a name, in any block.
function columnsNamed(run, name) {
  const port = Object.keys(run.loop.ports).find((key) => key.endsWith(`:${name}`));
  return port && run.columns(port).slice(0, 3);
}

// The arrow of the force of the environment on the tool, as long as it is large.
function drawForceInSpace(run, { toPixels, size, largest }) {
  const force = columnsNamed(run, "environment_force");
  const place = columnsNamed(run, "tool_position");
  if (!force || !place || !largest) return "";
  const from = inSpace(run.vector(place, state.cursor));
  const push = inSpace(run.vector(force, state.cursor)).map((x) => (-x * ARROW * size) / largest);
  const still = new DOMMatrix();
  const to = seen(
    still,
    from.map((x, k) => x + push[k]),
  );
  return `<path class="force" marker-end="url(#head)" d="M${toPixels(seen(still, from))}
    L${toPixels(to)}"/>`;
}

// The largest force of the environment in runs.
function largestForce(runs) {
  return Math.max(
    0,
    ...runs.flatMap((run) => {
      const columns = columnsNamed(run, "environment_force");
      if (!columns) return [];
      return instantsOf(run).map((time) => Math.hypot(...run.vector(columns, time)));
    }),
  );
}

// Instants over the whole run.
function instantsOf({ startTime, time }) {
  const last = time.at(-1);
  return range(NUM_TIMES + 1).map((k) => startTime + ((last - startTime) * k) / NUM_TIMES);
}

// The map to pixels for which everything that is drawn is in the picture over the whole runs.
function pictureOf(shown, width, height) {
  const everywhere = shown.flatMap(([run, plant]) =>
    instantsOf(run).flatMap((time, i) => [
      ...linesAt(run, plant, time),
      ...(i % 6 ? [] : shapesAt(run, plant, time)),
    ]),
  );
  return { ...fit(everywhere, width, height), largest: largestForce(state.runs) };
}

// The last picture, and what it was made of.
let lastPicture = { basis: [] };

// Draws the plants of all runs at the cursor.
export function drawPlants() {
  const shown = state.runs.flatMap((run) =>
    run.loop.plants.filter(({ state: port }) => run.columns(port)).map((plant) => [run, plant]),
  );
  $("task").hidden = !shown.length;
  if (!shown.length) return;
  const { clientWidth: width, clientHeight: height } = $("scene");
  const basis = [state.runs, state.runs[0].ends.length, width, height];
  if (basis.some((value, i) => value !== lastPicture.basis[i])) {
    lastPicture = { basis, picture: pictureOf(shown, width, height) };
  }
  const current = shown.filter(([run]) => !run.hasEnded(state.cursor));
  const walls = drawWalls(shown[0][0], lastPicture.picture);
  const plants = current.map(([run, plant]) => drawPlant(run, plant, lastPicture.picture));
  $("scene").innerHTML = ARROW_HEAD + walls.join("") + plants.join("");
}
