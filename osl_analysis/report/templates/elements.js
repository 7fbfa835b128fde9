"use strict";
// Elements of the page: text is always text, never markup.

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

function folded(title, ...children) {
  return element("details", {}, element("summary", {}, title), ...children);
}
