// What a number field does whose number is deleted, and what a text does for a number.
(async () => {
  await teleop.ready;
  const { row } = state.inputs.delay;
  const field = row.querySelector("input[type=number]");
  field.focus();
  field.value = "";
  field.dispatchEvent(new Event("change"));
  const status = $("status").textContent;
  field.blur();
  let text = "";
  try {
    teleop.set("delay", "0.2");
  } catch (error) {
    text = error.message;
  }
  return { status, text, delay: teleop.inputs.delay.value, shown: field.value };
})();
