// Where the parts of a page stand on a phone, and how large what is touched is.
(async () => {
  await teleop.ready;
  const parts = ["inputs", "scopes-section", "task", "diagram", "metrics"];
  const isShown = (x) => x.getClientRects().length > 0;
  const targets = [...document.querySelectorAll("button, input, select, summary")].filter(isShown);
  const level = $("level");
  return {
    tops: parts.map((id) => $(id).getBoundingClientRect().top),
    width: document.documentElement.scrollWidth,
    small: targets
      .filter((x) => x.type !== "checkbox" && x.getBoundingClientRect().height < 44)
      .map((x) => x.outerHTML.slice(0, 80)),
    share: level.querySelector("svg").clientWidth / level.clientWidth,
  };
})();
