// What a keyboard reaches, what a reader of the screen hears, and what colours there are.
(async () => {
  await teleop.ready;
  const isShown = (x) => x.getClientRects().length > 0;
  const stops = [...document.querySelectorAll("a[href], button, input, select, [tabindex='0']")]
    .filter((x) => isShown(x) && !x.disabled && x.tabIndex >= 0)
    .map((x) => x.type || x.tagName);
  const canvas = document.createElement("canvas").getContext("2d");
  const rgb = (color) => {
    canvas.fillStyle = color;
    canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3);
  };
  const colorOf = (selector, name) => rgb(getComputedStyle(document.querySelector(selector))[name]);
  const lines = state.loops.map(({ color }) => {
    const probe = make("i", { style: `color: ${color}` });
    document.body.append(probe);
    const found = rgb(getComputedStyle(probe).color);
    probe.remove();
    return found;
  });
  const labels = [...document.querySelectorAll("#level [role]")].map((x) => x.ariaLabel);
  return {
    stops,
    labels,
    lines,
    papers: [colorOf("body", "backgroundColor"), colorOf("#inputs", "backgroundColor")],
    texts: [colorOf("body", "color"), colorOf("#status", "color")],
  };
})();
