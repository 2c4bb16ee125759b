// What is said of curves in closed form, in steps of 20 ms.
(async () => {
  await teleop.ready;
  const LENGTH = 10; // s
  const runOf = (valueAt, reference) => {
    const count = LENGTH / 0.02;
    const time = range(count * 4 + 1).map((i) => i * 0.005);
    const rows = time.flatMap((t) => [valueAt(t), reference]);
    const ends = range(count).map((s) => 4 * (s + 1));
    return Object.assign(Object.create(state.runs[0]), { time, rows, ends, width: 2 });
  };
  const turn = 2 * Math.PI;
  const curves = {
    still: [() => 2],
    zero: [() => 0],
    unstable: [(t) => Math.exp(1.5 * t)],
    falling: [(t) => -Math.exp(2 * t)],
    parabola: [(t) => 0.1 * t * t],
    decaying: [(t) => Math.exp(-0.1 * t) * Math.cos(1.4 * turn * t)],
    growing: [(t) => Math.exp(0.1 * t) * Math.cos(0.5 * turn * t)],
    flutter: [(t) => Math.exp(2 * t) * Math.cos(2 * turn * t)],
    steady: [(t) => 3 + Math.sin(0.3 * turn * t)],
    settled: [(t) => 0.98 * (1 - Math.exp(-3 * t))],
    reached: [(t) => 0.98 * (1 - Math.exp(-3 * t)), 1],
    rings: [(t) => 2 - 2 * Math.exp(-2 * t) * Math.cos(3 * turn * t)],
    nothing: [(t) => Math.exp(-5 * t), 0],
    slow: [(t) => Math.exp(-0.05 * t)],
  };
  return Object.fromEntries(
    Object.entries(curves).map(([name, [valueAt, reference = NaN]]) => {
      const at = Number.isNaN(reference) ? undefined : 1;
      return [name, motionInWords(runOf(valueAt, reference), 0, "m", at)];
    }),
  );
})();
