// What somebody sees who opens a page for the first time, and tries what it offers.
(async () => {
  await teleop.ready;
  const textOf = (selector) => document.querySelector(selector)?.textContent.trim();
  const heights = () => [...document.querySelectorAll(".help")].map((x) => x.offsetHeight);
  const sectionsOf = () => [...document.querySelectorAll(".help")].map((x) => x.parentElement.id);
  const [velocity] = document.querySelectorAll(".scope");
  const isHidden = heights();
  document.getElementById("explain").click();
  const seen = {
    title: textOf("h1"),
    story: textOf("#story"),
    tabs: textOf("#tabs"),
    isHidden,
    heights: heights(),
    sections: sectionsOf(),
    head: velocity.querySelector(".head").textContent,
    hasCommand: velocity.querySelectorAll("polyline.command").length,
    names: [...velocity.querySelectorAll("text.name")].map((x) => x.textContent),
    labels: [...document.querySelectorAll("#scene > text")].map((x) => x.textContent),
    main: document.querySelectorAll("#metrics > table tr").length,
    table: document.querySelector("#metrics > table").textContent,
    isFolded: !document.querySelector("#metrics details").open,
    box: [...document.querySelectorAll("[data-box='forward_channel'] text")].map((x) => [
      x.textContent,
      Number(x.getAttribute("font-size")),
    ]),
    tries: [],
  };
  for (const button of document.querySelectorAll("#tries button")) {
    button.click();
    await state.busy;
    await new Promise((go) => setTimeout(go, 100));
    await state.busy;
    const { forward_delay: forward, return_delay: back } = teleop.inputs;
    seen.tries.push([button.textContent, forward.value, back.value, textOf("#subtitle")]);
  }
  return seen;
})();
