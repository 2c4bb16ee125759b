// Events and metrics of a run, by the definitions of tasks/insertion_metrics.py and
// tasks/tracking.py.

import { dot, range } from "./numbers.js";
import {
  Pieces,
  SAME_INSTANT,
  combine,
  firstAfter,
  firstUpwards,
  integral,
  largest,
  maximum,
  minimum,
  minus,
  rms,
  settlingTime,
  valueBefore,
  variation,
} from "./pieces.js";
import { AXES } from "./units.js";

const AT_REST = 1e-6; // Shares of the commanded speed.
const SETTLING_RATIO = 0.05;
const CROSSINGS = { puncture: ["puncture", "heal"], contact: ["contact", "release"] };

// An insertion: its signals in pieces, and the times of its events.
class InsertionRun {
  constructor(run) {
    const { command, surfaces } = run.z;
    const n = command.length;
    const part = (i) => Array.from(surfaces.slice(i * n, (i + 1) * n));
    Object.assign(this, { run, n, v_d: Array.from(command), speed: Math.hypot(...command) });
    this.surfaces = run.loop.surfaces.map((name, i) => ({
      name,
      point: part(2 * i),
      normal: part(2 * i + 1),
    }));
    const named = (name) => this.surfaces.find((surface) => surface.name === name);
    this.puncture = named("puncture");
    this.contact = named("contact");
    const first = this.puncture ?? this.contact ?? this.surfaces[0];
    this.normal = first?.normal ?? this.v_d.map((v) => v / this.speed);
    // When the tool crosses surfaces.
    const raw = new Pieces(run);
    const position = raw.signals(run.signal("tool_position"));
    for (const surface of this.surfaces) {
      surface.crossings = raw.crossings(this.depth(surface, position));
    }
    // The instants at which the command reverses are found from the command in pieces. Then the
    // pieces are cut at these instants, too.
    const echoes = this.echoes();
    this.pieces = new Pieces(run, echoes);
    const heading = combine([1], [this.along(this.received())], AT_REST * this.speed);
    const crossings = [
      ...this.surfaces.flatMap((x) => x.crossings),
      ...this.pieces.crossings(heading),
    ];
    this.pieces = new Pieces(run, [...echoes, ...crossings.map((x) => x.time)]);
    this.takeSignals();
    this.takeTimes();
  }

  // Makes the signals that metrics take.
  takeSignals() {
    const { run, n, pieces, normal, speed } = this;
    const get = (name) => pieces.signals(run.signal(name));
    this.position = get("tool_position");
    this.velocity = get("tool_velocity");
    this.force = get("environment_force");
    this.controlForce = get("control_force");
    const received = this.received();
    this.hapticForce = received.slice(0, n);
    this.command = received.slice(n, 2 * n);
    const packet = run.signal("return_packet_received")?.slice(n, 2 * n);
    const felt = run.signal("felt_velocity") ?? packet;
    this.feltVelocity = felt && pieces.signals(felt);
    const along = this.along(received);
    const excess = minus(combine(normal, this.velocity), along);
    this.overshoot = excess.map((values, i) => {
      const mean = along[i].reduce((sum, x) => sum + x, 0) / 5;
      return mean < -AT_REST * speed ? values.map((x) => -x) : values;
    });
  }

  // Finds the times of puncture, contact and release.
  takeTimes() {
    const { puncture, contact } = this;
    const crossings = contact?.crossings ?? [];
    const times = (isUpwards) =>
      crossings.filter((x) => x.isUpwards === isUpwards).map((x) => x.time);
    this.punctureTime = firstUpwards(puncture?.crossings ?? []);
    this.contactTime = firstUpwards(crossings);
    this.contactAfterPuncture = firstAfter(this.punctureTime, times(true));
    this.releaseTime = firstAfter(this.contactTime, times(false));
  }

  // The depth of the tool behind a surface, which may be at infinity.
  depth({ point, normal }, position) {
    const begin = normal.reduce((sum, x, k) => (x ? sum + x * point[k] : sum), 0);
    return combine(normal, position, -begin);
  }

  // The columns of the operator's command, [F_h; v_d]; undefined if packets transmit it.
  sent() {
    const velocity = this.run.signal("velocity_command");
    return velocity && [...this.run.signal("force_command"), ...velocity];
  }

  // The times at which jumps of the command, including its start, arrive at the slave.
  echoes() {
    const { time, rows, width, z } = this.run;
    const sent = this.sent();
    if (!sent) return [];
    const hasJumped = (i) =>
      time[i] - time[i - 1] <= SAME_INSTANT &&
      sent.some((k) => rows[i * width + k] !== rows[(i - 1) * width + k]);
    return range(time.length)
      .filter((i) => !i || hasJumped(i))
      .map((i) => time[i] + z.command_delay[0]);
  }

  // The command [F_h; v_d] that the slave receives, in the current pieces.
  received() {
    const { run, pieces } = this;
    const sent = this.sent();
    return sent
      ? pieces.delayed(sent, run.z.command_delay[0])
      : pieces.signals(run.signal("forward_packet_received"));
  }

  // The component along the normal of the command with which overshoots are compared.
  along(received) {
    const { run, n, v_d, normal } = this;
    const constant = Array(5).fill(dot(v_d, normal));
    if (run.loop.has_constant_command) return received[0].map(() => constant);
    return combine(normal, received.slice(n, 2 * n));
  }
}

// The metrics of an insertion, keyed by name.
function insertionMetrics(insertion) {
  const { pieces, overshoot, punctureTime, contactTime } = insertion;
  const { lengths } = pieces;
  const whole = pieces.between();
  const before = pieces.between(undefined, punctureTime ?? contactTime);
  const metrics = { start_velocity_overshoot: Math.max(0, maximum(overshoot, before)) };
  const perAxis = {
    velocity_rms_error: (k) => rms(minus(insertion.velocity[k], insertion.command[k]), lengths),
    force_rms_error: (k) => rms(minus(insertion.force[k], insertion.hapticForce[k]), lengths),
    coordination_rms_error: (k) => coordinationError(insertion, k),
    control_force_peak: (k) => largest(insertion.controlForce[k], whole),
    control_force_variation: (k) => variation(insertion.controlForce[k]),
  };
  if (punctureTime !== undefined) Object.assign(metrics, punctureMetrics(insertion));
  if (contactTime !== undefined) Object.assign(metrics, collisionMetrics(insertion));
  for (const [name, metric] of Object.entries(perAxis)) {
    AXES.slice(0, insertion.n).forEach((axis, k) => {
      metrics[`${name}.${axis}`] = metric(k);
    });
  }
  return metrics;
}

// The rms distance along an axis between hand and tool; null for a rotation, or without a felt
// velocity.
function coordinationError({ feltVelocity, position, pieces: { lengths } }, k) {
  if (!feltVelocity || k > 2) return null;
  const felt = integral(feltVelocity[k], lengths, position[k][0][0]);
  return rms(minus(felt, position[k]), lengths);
}

// Metrics of a run with a puncture.
function punctureMetrics(insertion) {
  const {
    pieces,
    puncture: { normal },
    velocity,
    force,
    punctureTime: time,
  } = insertion;
  const [first] = pieces.between(time);
  return {
    "puncture.time": time,
    "puncture.velocity": valueBefore(combine(normal, velocity), first),
    "puncture.force": valueBefore(combine(normal, force), first),
    "puncture.velocity_overshoot": maximum(
      insertion.overshoot,
      pieces.between(time, insertion.contactAfterPuncture),
    ),
  };
}

// Metrics of a run with a contact.
function collisionMetrics(insertion) {
  const {
    run,
    pieces,
    contact: { normal },
    contactTime: time,
    speed,
  } = insertion;
  const v = combine(normal, insertion.velocity);
  const F = combine(normal, insertion.force);
  const since = pieces.between(time);
  const slow = SETTLING_RATIO * speed;
  const settle = (bands) => (run.reason ? null : settlingTime(pieces, since[0], bands));
  return {
    "collision.time": time,
    "collision.velocity": valueBefore(v, since[0]),
    "collision.initial_impact_force": maximum(F, pieces.between(time, insertion.releaseTime)),
    "collision.peak_force": maximum(F, since),
    "collision.rebound_velocity": minimum(v, since),
    "collision.settling_time": settle([{ y: [v], centre: [0], radius: slow }]),
    "collision.rest_time": settle(restBands(insertion, slow)),
  };
}

// The bands of rest: the velocities of translation and rotation and, if there is any, their forces.
function restBands({ velocity, force }, slow) {
  const bands = [];
  for (let first = 0; first < velocity.length; first += 3) {
    const y = force.slice(first, first + 3);
    const end = y.map((x) => x.at(-1)[4]);
    const v = velocity.slice(first, first + 3);
    bands.push({ y: v, centre: v.map(() => 0), radius: slow });
    if (y.flat(2).some((x) => x)) {
      bands.push({ y, centre: end, radius: SETTLING_RATIO * Math.hypot(...end) });
    }
  }
  return bands;
}

// The events: crossings of surfaces, and switches of the operator.
function insertionEvents({ run, surfaces }) {
  const events = [];
  const [mode] = run.signal("surgeon_mode") ?? [];
  const known = surfaces.filter(
    ({ name }, i) => name in CROSSINGS && surfaces.findIndex((x) => x.name === name) === i,
  );
  for (const { name, crossings } of known) {
    const [upwards, downwards] = CROSSINGS[name];
    events.push(
      ...crossings.map(({ time, isUpwards }) => ({ name: isUpwards ? upwards : downwards, time })),
    );
  }
  const modeAt = (row) => run.rows[row * run.width + mode];
  for (let row = 1; mode !== undefined && row < run.time.length; ++row) {
    if (modeAt(row) === modeAt(row - 1)) continue;
    const name = modeAt(row) === 1 ? "surgeon_force" : "surgeon_stop";
    events.push({ name, time: run.time[row] });
  }
  return events.sort((a, b) => a.time - b.time);
}

// The metrics of a tracking, keyed by name.
function trackingMetrics(run) {
  const pieces = new Pieces(run);
  const whole = pieces.between();
  const metrics = {};
  const get = (name) => pieces.signals(run.signal(name));
  const position = get("tool_position");
  const desired = get("desired_position");
  const force = get("environment_force");
  const estimate = get("disturbance_estimate");
  const error = position.map((x, k) => minus(x, desired[k]));
  const perAxis = {
    max_error: (k) => largest(error[k], whole),
    rms_error: (k) => rms(error[k], pieces.lengths),
    disturbance_rms_error: (k) => rms(minus(estimate[k], force[k]), pieces.lengths),
  };
  for (const [name, metric] of Object.entries(perAxis)) {
    error.forEach((_, k) => {
      metrics[`${name}.${AXES[k]}`] = metric(k);
    });
  }
  return metrics;
}

// The events and metrics of a finished run. Metrics that the run does not have are left out.
export function measure(run) {
  let events = [];
  let metrics = {};
  if (run.loop.metrics === "tracking") metrics = trackingMetrics(run);
  if (run.loop.metrics === "insertion") {
    const insertion = new InsertionRun(run);
    events = insertionEvents(insertion);
    metrics = insertionMetrics(insertion);
  }
  const known = Object.entries(metrics).filter(([, x]) => Number.isFinite(x));
  return { events, metrics: Object.fromEntries(known) };
}
