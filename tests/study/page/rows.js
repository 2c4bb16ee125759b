// All rows, events and metrics of each controller.
(async () => {
  await teleop.ready;
  const results = [];
  for (const loop of chosen()) {
    const { run, metrics, events } = await teleop.run(loop.kind);
    const signals = Object.fromEntries(
      Object.keys(loop.signals).map((name) => [
        name,
        run.time.length && range(run.time.length).map((i) => run.row(run.signal(name), i)),
      ]),
    );
    const { time, ends } = run;
    results.push({ kind: loop.kind, time: [...time], ends, signals, metrics, events });
  }
  return results;
})();
