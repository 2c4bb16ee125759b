// The text of a page's diagram.
teleop.ready.then(() => $("diagram").textContent);
