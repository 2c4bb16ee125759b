// The page as it is laid out for paper, and its files.
(async () => {
  await teleop.ready;
  const svg = scopesAsSvg();
  const csv = signalsAsCsv();
  dispatchEvent(new Event("beforeprint"));
  const isShown = (x) => x.getClientRects().length > 0;
  const seen = {
    svg,
    csv,
    controls: [...document.querySelectorAll("button, input, select")].filter(isShown).length,
    right: Math.max(
      ...[...document.querySelectorAll("body *")].filter(isShown).map((x) => {
        return x.getBoundingClientRect().right;
      }),
    ),
    lastTick: Math.max(
      ...[...document.querySelectorAll(".scope > svg > text")].map((x) => {
        return x.getBoundingClientRect().right;
      }),
    ),
    height: document.body.offsetHeight,
    values: $("printed").textContent,
    rows: [...document.querySelectorAll("#metrics > table tr")].filter(isShown).length,
    scheme: document.documentElement.style.colorScheme,
  };
  dispatchEvent(new Event("afterprint"));
  seen.after = document.documentElement.style.colorScheme;
  seen.isBack = isShown($("play"));
  return seen;
})();
