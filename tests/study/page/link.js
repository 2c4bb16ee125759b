// The state of a page that is opened by a link, and the link to it.
(async () => {
  await teleop.ready;
  return {
    delay: teleop.inputs.delay.value,
    stiffness: teleop.inputs["environment.layers.bone.stiffness"].value,
    kind: shownLoop().kind,
    cursor: state.cursor,
    scopes: state.scopes,
    link: linkOfState(),
    status: $("status").textContent,
  };
})();
