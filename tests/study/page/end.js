// How and when a run ends early.
(async () => {
  await teleop.ready;
  const { run, metrics } = await teleop.run("direct_force");
  return { end: run.time.at(-1), reason: run.reason, metrics };
})();
