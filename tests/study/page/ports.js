// The boxes of a picture, what a box tells of its ports, and the crumbs.
(async () => {
  await teleop.ready;
  const boxes = [...document.querySelectorAll("[data-box]")].map((x) => x.dataset.box);
  const first = document.querySelector(`[data-box="${boxes.at(-1)}"]`);
  first.dispatchEvent(new Event("click", { bubbles: true }));
  return { boxes, ports: $("box").textContent, crumbs: $("crumbs").textContent };
})();
