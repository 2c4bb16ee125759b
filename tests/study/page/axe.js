// What axe-core finds in the states of a page: explained, with the numbers of a box, with a wire,
// while a guess is asked, with its strip, and after a drive.
teleop.ready.then(async () => {
  const found = [];
  const check = async (name) => {
    const { violations } = await axe.run();
    const nodes = violations.flatMap(({ id, nodes: all }) => all.map(({ html }) => [id, html]));
    found.push(...nodes.map((node) => [name, ...node]));
  };
  const click = (element) => element.dispatchEvent(new MouseEvent("click", { bubbles: true }));
  const until = async (isTrue) => {
    while (!isTrue()) await new Promise((go) => setTimeout(go, 10));
  };
  $("explain").click();
  await check("explained");
  $("explain").click();
  const field = Object.values(state.inputs).find(({ isField }) => isField);
  if (field) {
    const path = field.owners.find((owner) => owner);
    showLevel(path.split("/").slice(0, -1).join("/"));
    click(document.querySelector(`[data-box="${path}"]`));
    await check("fields");
    showLevel("");
  }
  if (shownLoop().wires) {
    click(document.querySelector(".edge[data-port] path"));
    await check("wire");
  }
  const guess = [...document.querySelectorAll("#tries button")].at(-1);
  if (guess?.textContent === "Guess first") {
    guess.click();
    await until(() => !$("done").disabled);
    await check("asked");
    $("done").click();
    await until(() => document.querySelector(".strip p[aria-live]")?.textContent);
    await check("guessed");
  }
  if (state.data.hand) {
    state.hand = range(541).map((i) => [i / 60, i < 12 ? 0 : state.data.hand.full_speed]);
    await endDrive("adaptive_backstepping");
    $("challenge").textContent = "Beat 0.83 N";
    await check("driven");
  }
  return found;
});
