// Makes elements of the page. Text is always set as text, never as markup.

/** Return a new element with attributes and children; a child that is no element becomes text. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

/** Set an element's text where it differs, which spares the browser a layout. */
export function say(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

/** Return a number in words with so many decimals; a dash where there is none. */
export function number(value, decimals = 1) {
  return value === null || value === undefined || !Number.isFinite(value) ? "–" : value.toFixed(decimals).replace("-", "−");
}
