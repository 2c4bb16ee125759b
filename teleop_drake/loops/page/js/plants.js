// The MultibodyPlants of a diagram: their frames and links. See plants.py.

import { $ } from "./elements.js";
import { dot, extent, range } from "./numbers.js";
import { state } from "./state.js";

const NUM_TIMES = 60; // The number of instants whose lines the picture must contain.
const MARGIN = 20; // px
const AXIS = 0.12; // The length of a frame's axes, as a fraction of the picture.

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

// Lines of a plant at a time: from each joint to the next one, and to the centre of mass.
function linesAt(run, plant, time) {
  const frames = framesAt(run, plant, time);
  return plant.links.flatMap(({ parent, centre }, i) => {
    const begin = seen(frames[parent + 1], [0, 0, 0]);
    const joint = seen(frames[i + 1], [0, 0, 0]);
    return [
      [begin, joint],
      [joint, seen(frames[i + 1], centre)],
    ];
  });
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
  const lines = linesAt(run, plant, state.cursor);
  const path = lines.map(([a, b]) => `M${picture.toPixels(a)}L${picture.toPixels(b)}`);
  const joints = lines.filter((_, i) => i % 2 === 0).map(([, joint]) => picture.toPixels(joint));
  const dots = joints.map(([x, y]) => `<circle cx="${x}" cy="${y}" r="3"/>`);
  return `${drawFrames(run, plant, picture).join("")}<g stroke="${run.loop.color}"
    fill="${run.loop.color}"><path class="link" d="${path.join("")}"/>${dots.join("")}</g>`;
}

// Instants over the whole run.
function instantsOf({ startTime, endTime }) {
  return range(NUM_TIMES + 1).map((k) => startTime + ((endTime - startTime) * k) / NUM_TIMES);
}

// Draws the plants of all runs at the cursor.
export function drawPlants() {
  const shown = state.runs.flatMap((run) =>
    run.loop.plants.filter(({ state: port }) => run.columns(port)).map((plant) => [run, plant]),
  );
  $("task").hidden = !shown.length;
  if (!shown.length) return;
  const { clientWidth: width, clientHeight: height } = $("scene");
  const everywhere = shown.flatMap(([run, plant]) =>
    instantsOf(run).flatMap((time) => linesAt(run, plant, time)),
  );
  const picture = fit(everywhere, width, height);
  const current = shown.filter(([run]) => !run.hasEnded(state.cursor));
  $("scene").innerHTML = current.map(([run, plant]) => drawPlant(run, plant, picture)).join("");
}
