// The times that a page shows at first, at its end, and after a wheel has zoomed in and out.
(async () => {
  await teleop.ready;
  const times = () => ({ window: state.window, cursor: state.cursor });
  const first = times();
  setCursor(Infinity);
  const last = times();
  zoom(0.5, state.cursor);
  const near = times();
  zoom(Infinity, 0);
  setCursor(-1);
  const { min, max } = $("clock");
  return { first, last, near, again: times(), clock: [Number(min), Number(max)] };
})();
