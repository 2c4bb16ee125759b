// Elements of the page.

export const $ = (id) => document.getElementById(id);

// Makes an element with properties and children.
export function make(tag, properties, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

// Makes a button.
export const makeButton = (textContent, onclick, properties = {}) =>
  make("button", { textContent, onclick, ...properties });

// A text whose special characters are escaped for HTML.
export const safe = (text) => text.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt()};`);

// A legend entry: a short line in a controller's colour, its title and a text.
export function keyOf({ color, title }, text = "") {
  const line = make("span", { className: "key", style: `border-color: ${color}` });
  return make("span", {}, line, `${title} ${text}`);
}

// Shows a text in the status line.
export function say(text, className = "") {
  Object.assign($("status"), { textContent: text, className });
}

// Waits for the next animation frame, or 50 ms, because a hidden page has no frames.
export function nextFrame() {
  return new Promise((go) => {
    requestAnimationFrame(go);
    setTimeout(go, 50);
  });
}
