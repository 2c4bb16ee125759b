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

// Text without characters that mean something in HTML.
export const safe = (text) => text.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt()};`);

// A short line in a controller's colour, its title and some text.
export function keyOf({ color, title }, text = "") {
  const line = make("span", { className: "key", style: `border-color: ${color}` });
  return make("span", {}, line, `${title} ${text}`);
}

// Shows a text in the line of the status.
export function say(text, className = "") {
  Object.assign($("status"), { textContent: text, className });
}

// Waits for the next picture; a page that is not shown has none.
export function nextFrame() {
  return new Promise((go) => {
    requestAnimationFrame(go);
    setTimeout(go, 50);
  });
}
