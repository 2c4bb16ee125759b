// Runs each controller with each operator, and looks at the picture.
(async () => {
  await teleop.ready;
  const results = {};
  const choices = teleop.inputs["surgeon.kind"]?.choices ?? [null];
  for (const choice of choices) {
    if (choice) await teleop.set("surgeon.kind", choice);
    for (const kind of teleop.controllers) {
      const run = await teleop.run(kind);
      run.sentence = sentenceOf(run.run);
      run.sampled = teleop.sample(run, "tool_position", [0.5, 7.9, 16.1]);
      setCursor(1.3);
      const q = run.run.signal("joint_position");
      if (q) run.q = Array.from(run.run.vector(q, 1.3));
      run.drawn = $("scene").innerHTML;
      run.arm = armAt(state.runs.find((x) => x.loop.kind === kind));
      delete run.signals;
      results[`${choice}:${kind}`] = run;
    }
  }
  return results;
})();
