// Runs of a scenario's page with and without delay.
(async () => {
  await teleop.ready;
  const runs = [];
  for (const delay of [0, 0.04]) {
    await teleop.set("delay", delay);
    for (const kind of teleop.controllers) {
      const run = await teleop.run(kind);
      const velocity = teleop.sample(run, "tool_velocity", [0.3, 0.6, 0.9]);
      runs.push({ delay, kind, velocity });
    }
  }
  return { runs, min: teleop.inputs.delay.min };
})();
