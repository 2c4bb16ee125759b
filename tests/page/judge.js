// Verdicts of a task's claims at the thesis's numbers, and at those that the link sets.
(async () => {
  await teleop.ready;
  const [task, ...values] = location.hash.slice(1).split("&");
  const lab = teleop.labs.find(({ name }) => name === task);
  const items = [...lab.section.querySelectorAll("li[data-now]")];
  const verdicts = () =>
    Object.fromEntries(items.map(({ id, dataset }) => [id.replace("claim-", ""), dataset.now]));
  const published = verdicts();
  const numbers = values.map((text) => text.split("=")).map(([key, x]) => [key, Number(x)]);
  await lab.set(Object.fromEntries(numbers));
  const texts = items.map((item) => item.querySelector(".now").textContent);
  return { published, moved: verdicts(), texts };
})();
