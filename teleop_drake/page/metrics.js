// Events and metrics of a run, by the definitions of tasks/insertion_metrics.py and
// tasks/tracking.py. They are made of functions that have the names of those in numerics/pieces.py.
//
// A signal in pieces is an array with the five values of each piece; of a vector there is one for
// each component. Between its values a signal is the quartic through them.

const NODES = [0, 0.25, 0.5, 0.75, 1];
const SAME_INSTANT = 5e-12, INWARDS = 2 * SAME_INSTANT;
const LEBESGUE = 2.3;
const AT_REST = 1e-6, SETTLING_RATIO = 0.05;
const AXES = ["x", "y", "z", "rx", "ry", "rz"];
const CROSSINGS = { puncture: ["puncture", "heal"], contact: ["contact", "release"] };

// Coefficients of ascending powers of the quartic through five values.
function powersOf(values) {
  const y = values[0], a = values[1] - y, b = values[2] - y, c = values[3] - y, d = values[4] - y;
  return [
    y,
    (48 * a - 36 * b + 16 * c - 3 * d) / 3,
    (-208 * a + 228 * b - 112 * c + 22 * d) / 3,
    (288 * a - 384 * b + 224 * c - 48 * d) / 3,
    (-128 * a + 192 * b - 128 * c + 32 * d) / 3,
  ];
}

// A polynomial at a share of its piece.
function valueAt(powers, x) {
  let value = 0;
  for (let k = powers.length - 1; k >= 0; --k) value = value * x + powers[k];
  return value;
}

// Where a condition that holds at the lower end of an interval ceases to hold.
function bisect(holds, low, high) {
  let middle = (low + high) / 2;
  while (low < middle && middle < high) {
    if (holds(middle)) low = middle;
    else high = middle;
    middle = (low + high) / 2;
  }
  return high;
}

// The sum of signals in pieces with weights, and a number.
function combine(weights, signals, constant = 0) {
  return signals[0].map((y, i) => y.map((_, node) =>
    signals.reduce((sum, x, k) => sum + weights[k] * x[i][node], constant)));
}
const minus = (a, b) => combine([1, -1], [a, b]);
const negative = (a) => combine([-1], [a]);

// The steps of a run, cut at instants.
class Pieces {
  constructor(run, cuts = []) {
    const { time, ends } = run, instants = [...cuts].sort((a, b) => a - b);
    Object.assign(this, { run, list: [] });
    let next = 0;
    ends.forEach((last, step) => {
      let begin = time[last - 4];
      const end = time[last], start = begin;
      // A step between two instants that are one is a part of what jumps there.
      if (end - start <= SAME_INSTANT) return;
      for (; next < instants.length && instants[next] < end - SAME_INSTANT; ++next) {
        if (instants[next] <= Math.max(begin, start) + SAME_INSTANT) continue;
        this.list.push({ begin, end: instants[next], step, isPart: true });
        begin = instants[next];
      }
      this.list.push({ begin, end, step, isPart: begin > start });
    });
    // A run without steps is one piece, of which 1 is told.
    const only = { begin: time.at(-1), end: time.at(-1), step: -1, isPart: false };
    if (!this.list.length) this.list.push(only);
    this.lengths = this.list.map(({ begin, end }) => end - begin || 1);
  }

  // A column of the rows in pieces.
  signal(column) {
    const { run, list } = this, { rows, width, ends } = run;
    return list.map(({ begin, end, step, isPart }) => NODES.map((x) => {
      if (step < 0) return rows[(run.time.length - 1) * width + column];
      if (!isPart) return rows[(ends[step] - 4 + 4 * x) * width + column];
      return run.vector([column], begin + x * (end - begin), step)[0];
    }));
  }

  // Columns of the rows in pieces.
  signals(columns) { return columns.map((column) => this.signal(column)); }

  // Columns as they were a delay ago; 0 at first. A jump at an end of a piece has happened, or not.
  delayed(columns, delay) {
    const { run, list } = this, first = run.time[0];
    const values = list.map(({ begin, end }) => NODES.map((x) => {
      const inwards = Math.min(INWARDS, (end - begin) / 8) * ((x === 0) - (x === 1));
      const sent = begin + x * (end - begin) - delay + inwards;
      return sent < first ? columns.map(() => 0) : run.vector(columns, sent);
    }));
    return columns.map((_, k) => values.map((piece) => piece.map((value) => value[k])));
  }

  // The first piece whose middle is not before an instant; without one the given place.
  place(time, otherwise) {
    if (time === undefined) return otherwise;
    const found = this.list.findIndex(({ begin, end }) => (begin + end) / 2 >= time);
    return found < 0 ? this.list.length : found;
  }

  // The places of the pieces between two instants, without one from or to the run's end.
  between(begin, end) { return [this.place(begin, 0), this.place(end, this.list.length)]; }

  // Where a signal changes its sign; 0 counts as positive.
  crossings(y) {
    const found = [];
    y.forEach((values, i) => {
      for (let j = 0; j < 4; ++j) {
        const isIn = values[j] >= 0;
        if (values[j + 1] >= 0 === isIn) continue;
        const powers = powersOf(values), { begin, end } = this.list[i];
        const share = bisect((x) => valueAt(powers, x) >= 0 === isIn, j / 4, (j + 1) / 4);
        found.push({ time: begin + share * (end - begin), isUpwards: !isIn });
      }
    });
    return found;
  }
}

// When a signal first becomes positive, and the first of some instants after another one.
const firstUpwards = (crossings) => crossings.find((x) => x.isUpwards)?.time;
const firstAfter = (time, times) => (time === undefined ? undefined : times.find((t) => t > time));

// A signal just before a place among its pieces.
const valueBefore = (y, place) => (place ? y[place - 1][4] : y[0][0]);

// Values of a piece between which it is monotonic.
function extremes(values) {
  const slope = powersOf(values).slice(1).map((c, k) => (k + 1) * c), found = [values[0]];
  for (let j = 0; j < 4; ++j) {
    const [low, high] = [j / 4, (j + 1) / 4], isUp = valueAt(slope, low) >= 0;
    if (valueAt(slope, high) >= 0 !== isUp) {
      const share = bisect((x) => valueAt(slope, x) >= 0 === isUp, low, high);
      found.push(valueAt(powersOf(values), share));
    }
    found.push(values[j + 1]);
  }
  return found;
}

// The largest value of a signal in some pieces; without a piece that before them.
function maximum(y, [first, last]) {
  if (first >= last) return valueBefore(y, first);
  let most = -Infinity;
  for (let i = first; i < last; ++i) {
    const high = Math.max(...y[i]), low = Math.min(...y[i]);
    // A quartic goes beyond half of its values' range by at most this factor.
    if ((high + low) / 2 + LEBESGUE * (high - low) / 2 < most) continue;
    most = Math.max(most, ...extremes(y[i]));
  }
  return most;
}
const minimum = (y, span) => -maximum(negative(y), span);
const largest = (y, span) => Math.max(maximum(y, span), -minimum(y, span));

// The total variation of a signal, jumps included.
function variation(y) {
  const values = y.flatMap(extremes);
  return values.reduce((sum, x, i) => sum + (i ? Math.abs(x - values[i - 1]) : 0), 0);
}

// The root of the mean square of a signal over time.
function rms(y, lengths) {
  let total = 0, duration = 0;
  y.forEach((values, i) => {
    const c = powersOf(values);
    let square = 0;
    c.forEach((p, a) => c.forEach((q, b) => { square += p * q / (a + b + 1); }));
    total += lengths[i] * square;
    duration += lengths[i];
  });
  return Math.sqrt(Math.max(0, total) / duration);
}

// The integral of a signal over time as a signal.
function integral(y, lengths, start) {
  let at = start;
  return y.map((values, i) => {
    const c = powersOf(values).map((p, a) => p / (a + 1)), begin = at;
    const within = NODES.map((x) => begin + lengths[i] * x * valueAt(c, x));
    at = within[4];
    return within;
  });
}

// How long it takes from a place on until vectors stay in their bands; null if they do not, or if
// they did for as long before. A band is the components of a vector, its centre and its radius.
function settlingTime(pieces, first, bands) {
  const { list } = pieces;
  if (first >= list.length) return null;
  const start = list[first].begin;
  let since = start, longest = 0, wasMoving = false;
  for (let i = first; i < list.length; ++i) {
    const { begin, end } = list[i];
    const powers = bands.map(({ y, centre }) =>
      y.map((x, k) => powersOf(x[i].map((value) => value - centre[k]))));
    const isMoving = (x) => bands.some(({ radius }, b) =>
      !(Math.hypot(...powers[b].map((c) => valueAt(c, x))) < radius));
    for (let j = 0; j < 5; ++j) {
      if (isMoving(j / 4) === wasMoving) continue;
      const known = wasMoving;
      const share = bisect((x) => isMoving(x) === known, Math.max(j - 1, 0) / 4, j / 4);
      const time = begin + share * (end - begin);
      if (!wasMoving) longest = Math.max(longest, time - since);
      since = time;
      wasMoving = !wasMoving;
    }
  }
  return wasMoving || list.at(-1).end - since <= longest ? null : since - start;
}

// The signals of an insertion in pieces, and what happened when.
class InsertionRun {
  constructor(run) {
    const { command, surfaces } = run.z, n = command.length;
    const part = (i) => Array.from(surfaces.slice(i * n, (i + 1) * n));
    Object.assign(this, { run, n, v_d: Array.from(command), speed: Math.hypot(...command) });
    this.surfaces = run.loop.surfaces.map((name, i) =>
      ({ name, point: part(2 * i), normal: part(2 * i + 1) }));
    const named = (name) => this.surfaces.find((surface) => surface.name === name);
    this.puncture = named("puncture");
    this.contact = named("contact");
    const first = this.puncture ?? this.contact ?? this.surfaces[0];
    this.normal = first?.normal ?? this.v_d.map((v) => v / this.speed);
    // Where the tool crosses surfaces.
    const raw = new Pieces(run), position = raw.signals(run.signal("tool_position"));
    for (const surface of this.surfaces) {
      surface.crossings = raw.crossings(this.depth(surface, position));
    }
    // The command is known in pieces before it is known where it reverses.
    const echoes = this.echoes();
    this.pieces = new Pieces(run, echoes);
    const heading = combine([1], [this.along(this.received())], AT_REST * this.speed);
    const crossings = [...this.surfaces.flatMap((x) => x.crossings),
      ...this.pieces.crossings(heading)];
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
    const along = this.along(received), excess = minus(combine(normal, this.velocity), along);
    this.overshoot = excess.map((values, i) => {
      const mean = along[i].reduce((sum, x) => sum + x, 0) / 5;
      return mean < -AT_REST * speed ? values.map((x) => -x) : values;
    });
  }

  // Finds when surfaces are crossed.
  takeTimes() {
    const { puncture, contact } = this, crossings = contact?.crossings ?? [];
    const times = (isUpwards) => crossings.filter((x) => x.isUpwards === isUpwards)
      .map((x) => x.time);
    this.punctureTime = firstUpwards(puncture?.crossings ?? []);
    this.contactTime = firstUpwards(crossings);
    this.contactAfterPuncture = firstAfter(this.punctureTime, times(true));
    this.releaseTime = firstAfter(this.contactTime, times(false));
  }

  // How far the tool is behind a surface, which may begin at infinity.
  depth({ point, normal }, position) {
    const begin = normal.reduce((sum, x, k) => (x ? sum + x * point[k] : sum), 0);
    return combine(normal, position, -begin);
  }

  // The columns of what the operator sends, [F_h; v_d], where no packet has them.
  sent() {
    const velocity = this.run.signal("velocity_command");
    return velocity && [...this.run.signal("force_command"), ...velocity];
  }

  // When a jump of the command arrives at the slave, the start too.
  echoes() {
    const { time, rows, width, z } = this.run, sent = this.sent();
    if (!sent) return [];
    const hasJumped = (i) => time[i] - time[i - 1] <= SAME_INSTANT
      && sent.some((k) => rows[i * width + k] !== rows[(i - 1) * width + k]);
    return range(time.length).filter((i) => !i || hasJumped(i))
      .map((i) => time[i] + z.command_delay[0]);
  }

  // What the slave receives of the operator, in the pieces of now.
  received() {
    const { run, pieces } = this, sent = this.sent();
    return sent ? pieces.delayed(sent, run.z.command_delay[0])
      : pieces.signals(run.signal("forward_packet_received"));
  }

  // The command that overshoots compare with, along the normal.
  along(received) {
    const { run, n, v_d, normal } = this;
    const constant = Array(5).fill(dot(v_d, normal));
    if (run.loop.has_constant_command) return received[0].map(() => constant);
    return combine(normal, received.slice(n, 2 * n));
  }
}

// Metrics of an insertion by their names.
function insertionMetrics(insertion) {
  const { pieces, overshoot, punctureTime, contactTime } = insertion, { lengths } = pieces;
  const whole = pieces.between(), before = pieces.between(undefined, punctureTime ?? contactTime);
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
    AXES.slice(0, insertion.n).forEach((axis, k) => { metrics[`${name}.${axis}`] = metric(k); });
  }
  return metrics;
}

// How far the hand is from the tool; null without what was felt, or about an axis.
function coordinationError({ feltVelocity, position, pieces: { lengths } }, k) {
  if (!feltVelocity || k > 2) return null;
  const felt = integral(feltVelocity[k], lengths, position[k][0][0]);
  return rms(minus(felt, position[k]), lengths);
}

// Metrics of a run with a puncture.
function punctureMetrics(insertion) {
  const { pieces, puncture: { normal }, velocity, force, punctureTime: time } = insertion;
  const [first] = pieces.between(time);
  return {
    "puncture.time": time,
    "puncture.velocity": valueBefore(combine(normal, velocity), first),
    "puncture.force": valueBefore(combine(normal, force), first),
    "puncture.velocity_overshoot": maximum(insertion.overshoot,
      pieces.between(time, insertion.contactAfterPuncture)),
  };
}

// Metrics of a run with a contact.
function collisionMetrics(insertion) {
  const { run, pieces, contact: { normal }, contactTime: time, speed } = insertion;
  const v = combine(normal, insertion.velocity), F = combine(normal, insertion.force);
  const since = pieces.between(time), slow = SETTLING_RATIO * speed;
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

// The bands of translation and rotation, each with its force where there is any.
function restBands({ velocity, force }, slow) {
  const bands = [];
  for (let first = 0; first < velocity.length; first += 3) {
    const y = force.slice(first, first + 3), end = y.map((x) => x.at(-1)[4]);
    const v = velocity.slice(first, first + 3);
    bands.push({ y: v, centre: v.map(() => 0), radius: slow });
    if (y.flat(2).some((x) => x)) {
      bands.push({ y, centre: end, radius: SETTLING_RATIO * Math.hypot(...end) });
    }
  }
  return bands;
}

// When the tool crosses a surface and when the operator switches.
function insertionEvents({ run, surfaces }) {
  const events = [], [mode] = run.signal("surgeon_mode") ?? [];
  const known = surfaces.filter(({ name }, i) =>
    name in CROSSINGS && surfaces.findIndex((x) => x.name === name) === i);
  for (const { name, crossings } of known) {
    const [upwards, downwards] = CROSSINGS[name];
    events.push(...crossings.map(({ time, isUpwards }) =>
      ({ name: isUpwards ? upwards : downwards, time })));
  }
  const modeAt = (row) => run.rows[row * run.width + mode];
  for (let row = 1; mode !== undefined && row < run.time.length; ++row) {
    if (modeAt(row) === modeAt(row - 1)) continue;
    const name = modeAt(row) === 1 ? "surgeon_force" : "surgeon_stop";
    events.push({ name, time: run.time[row] });
  }
  return events.sort((a, b) => a.time - b.time);
}

// Metrics of a tracking by their names.
function trackingMetrics(run) {
  const pieces = new Pieces(run), whole = pieces.between(), metrics = {};
  const get = (name) => pieces.signals(run.signal(name));
  const position = get("tool_position"), desired = get("desired_position");
  const force = get("environment_force"), estimate = get("disturbance_estimate");
  const error = position.map((x, k) => minus(x, desired[k]));
  const perAxis = {
    max_error: (k) => largest(error[k], whole),
    rms_error: (k) => rms(error[k], pieces.lengths),
    disturbance_rms_error: (k) => rms(minus(estimate[k], force[k]), pieces.lengths),
  };
  for (const [name, metric] of Object.entries(perAxis)) {
    error.forEach((_, k) => { metrics[`${name}.${AXES[k]}`] = metric(k); });
  }
  return metrics;
}

// Events and metrics of a run that is over. What was not measured is not among the metrics.
function measure(run) {
  let events = [], metrics = {};
  if (run.loop.metrics === "tracking") metrics = trackingMetrics(run);
  if (run.loop.metrics === "insertion") {
    const insertion = new InsertionRun(run);
    events = insertionEvents(insertion);
    metrics = insertionMetrics(insertion);
  }
  const known = Object.entries(metrics).filter(([, x]) => Number.isFinite(x));
  return { events, metrics: Object.fromEntries(known) };
}
