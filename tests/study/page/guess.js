// A guess, asked by the page of a link, the strip with it, and the answers of a class.
(async () => {
  await teleop.ready;
  const until = async (isTrue) => {
    while (!isTrue()) await new Promise((go) => setTimeout(go, 10));
  };
  const isShown = (id) => $(id).getClientRects().length > 0;
  await until(() => !$("done").disabled);
  const asked = {
    question: $("question").textContent,
    hidden: ["outcome", "scopes-section"].filter(isShown),
    strip: document.querySelector(".strip").getClientRects().length,
  };
  $("mark").value = 0.3;
  $("mark").oninput();
  $("done").click();
  const words = () => document.querySelector(".strip p[aria-live]").textContent;
  await until(words);
  const first = words();
  const field = document.querySelector(".strip textarea");
  field.value = `${linkOfState()}\n0,31\n\n0.9\nno idea\nx.html#controller=another&guess=0.2`;
  field.oninput();
  const counts = [...document.querySelectorAll("rect.answers")].map((x) => Number(x.textContent));
  const said = document.querySelector(".strip [role=status]").textContent;
  const wrong = [9, NaN].map((x) => {
    try {
      return takeGuess(x);
    } catch (error) {
      return error.message;
    }
  });
  const rows = Object.fromEntries(strip.rows);
  const link = linkOfState();
  return { asked, first, counts, said, wrong, rows, link, isShown: isShown("outcome") };
})();
