// Makes a loop unstable with its slider, and looks at what the page draws and says.
(async () => {
  await teleop.ready;
  await teleop.set("line.delay", 0.5);
  await state.busy;
  const [run] = state.runs;
  const end = run.time.at(-1);
  const place = run.signal("x");
  const [scope] = document.querySelectorAll(".scope");
  return {
    end,
    last: run.vector(place, end)[0],
    values: range(9).map((k) => run.vector(place, end - 2 + 0.25 * k)[0]),
    status: $("status").className,
    said: $("outcome").textContent,
    words: [...scope.querySelectorAll("text.name")].map((x) => x.textContent),
    crosses: scope.querySelectorAll("path.end").length,
    drawn: scope.querySelectorAll("polyline")[0].points.length,
  };
})();
