// What a task's claims are at the thesis's numbers, and at those that the link sets.
(async () => {
  await teleop.ready;
  const [task, ...values] = location.hash.slice(1).split("&");
  const lab = teleop.labs.find(({ name }) => name === task);
  const published = lab.found;
  const hidden = () =>
    Object.keys(published).filter((key) => $(`claim-${key}`).querySelector(".now").hidden);
  const hiddenAtFirst = hidden().length;
  const numbers = values.map((text) => text.split("=")).map(([key, x]) => [key, Number(x)]);
  await lab.set(Object.fromEntries(numbers));
  const texts = Object.fromEntries(
    Object.keys(published).map((key) => [
      key,
      $(`claim-${key}`).querySelector(".now").textContent.replace("With these sliders: ", ""),
    ]),
  );
  lab.draw(true);
  const heads = [...lab.section.querySelectorAll(".head")].map((head) => head.textContent);
  return { heads, published, moved: lab.found, texts, hidden: [hiddenAtFirst, hidden().length] };
})();
