// What axe-core finds in a page whose parts are all shown.
teleop.ready.then(async () => {
  document.getElementById("explain").click();
  const { violations } = await axe.run();
  return violations.map(({ id, nodes }) => [id, nodes.map((node) => node.html)]);
});
