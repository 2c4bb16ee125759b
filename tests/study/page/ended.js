// The end of the first run of a page, and the sentence on it.
(async () => {
  await teleop.ready;
  const [run] = state.runs;
  return { end: run.time.at(-1), said: $("outcome").textContent };
})();
