// What the page says under its title, where a run has ended, and after a slider has moved.
(async () => {
  await teleop.ready;
  const said = () => $("outcome").textContent.replaceAll(/\s+/g, " ").trim();
  const first = said();
  const end = Math.min(...state.runs.map((run) => run.time.at(-1)));
  const look = (t) => {
    setCursor(t);
    const [scope] = document.querySelectorAll(".scope");
    return {
      head: scope.querySelector(".head").textContent,
      crosses: scope.querySelectorAll("path.end").length,
      words: [...scope.querySelectorAll("text.name")].map((x) => x.textContent),
      arms: document.querySelectorAll("#scene polyline.arm[points]:not([points=''])").length,
      tools: document.querySelectorAll("#scene g > circle:not(.felt)").length,
      ends: document.querySelectorAll("#scene path.end").length,
    };
  };
  const before = look(end - 0.01);
  const after = look(end + 0.5);
  const table = [...document.querySelectorAll("#metrics tr")].map((row) =>
    [...row.children].map((x) => x.textContent),
  );
  if (teleop.inputs.delay) await teleop.set("delay", teleop.inputs.delay.min);
  const moved = said();
  dispatchEvent(new Event("beforeprint"));
  const isCaption = $("outcome").previousElementSibling === $("scopes");
  const isPrinted = $("outcome").getClientRects().length > 0;
  dispatchEvent(new Event("afterprint"));
  const isBack = $("outcome").previousElementSibling === $("story");
  const live = $("outcome").ariaLive;
  return { first, moved, before, after, table, isCaption, isPrinted, isBack, live };
})();
