// What is drawn of a cart-pole, upright at first.
(async () => {
  await teleop.ready;
  const links = () => document.querySelectorAll("#scene .link");
  const lines = () =>
    links()[0]
      .getAttribute("d")
      .match(/M[^M]*/g)
      .map((line) => line.match(/-?[\d.]+/g).map(Number));
  setCursor(0);
  const before = lines();
  setCursor(1);
  return {
    before,
    after: lines(),
    num: links().length,
    axes: document.querySelectorAll("#scene .axis").length,
    isShown: !$("task").hidden,
  };
})();
