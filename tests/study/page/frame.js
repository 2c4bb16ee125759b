// The height of a notebook's frame, and that of the page in it.
(async () => {
  const frame = document.querySelector("iframe");
  while (!frame.contentWindow.teleop) await new Promise((go) => setTimeout(go, 50));
  await frame.contentWindow.teleop.ready;
  const inner = frame.contentDocument;
  const isWhole = () => inner.documentElement.scrollHeight <= frame.clientHeight;
  for (let wait = 0; wait < 100 && !isWhole(); ++wait) {
    await new Promise((go) => setTimeout(go, 100));
  }
  const scopes = [...inner.querySelectorAll(".scope")];
  return {
    height: frame.clientHeight,
    page: inner.documentElement.scrollHeight,
    count: scopes.length,
    bottom: scopes.at(-1).getBoundingClientRect().bottom,
    run: (await frame.contentWindow.teleop.run("direct_force")).time.length,
  };
})();
