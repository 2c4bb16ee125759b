// The link to a drive, and what the page says that is opened by such a link.
(async () => {
  await teleop.ready;
  const isShown = (id) => $(id).getClientRects().length > 0;
  const before = { curves: isShown("scopes-section"), title: $("subtitle").textContent };
  const status = $("status").textContent;
  const { full_speed: full } = state.data.hand;
  if (!state.hand.length) {
    const speedAt = (t) => (t < 0.2 ? 0 : full * (t < 8 ? 1 : 0.105));
    state.hand = range(541).map((i) => [i / 60, speedAt(i / 60)]);
    await endDrive("adaptive_backstepping");
  }
  const run = state.runs.find(({ loop }) => loop.kind === "adaptive_backstepping");
  setCursor(3);
  return {
    before,
    link: (await linkOfDrive(run)).split("#")[1],
    hand: state.hand,
    metrics: run.metrics,
    score: $("banner").textContent,
    challenge: $("challenge").textContent,
    pale: document.querySelectorAll(".scope polyline.pale").length,
    ghosts: document.querySelectorAll("#scene .ghost").length,
    status,
  };
})();
