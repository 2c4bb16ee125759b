// Searches a port of the other controller, a part of a name, and a name that is nowhere.
(async () => {
  await teleop.ready;
  const search = (text) => {
    $("search").value = text;
    $("search").onchange();
    return [shownLoop().kind, state.level, $("status").textContent, $("search").value];
  };
  const [first] = teleop.controllers;
  const isShown = () => state.scopes.includes("controller:psi");
  return {
    first,
    port: search("controller:psi"),
    isPlotted: isShown(),
    part: search("Forward chan"),
    nothing: search("zzz"),
  };
})();
