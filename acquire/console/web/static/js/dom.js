/**
 * Helpers around the DOM. Text of the snapshot reaches the page through `textContent` and attributes only,
 * so names of objects and plans stay text whatever they contain.
 */

const SVG = "http://www.w3.org/2000/svg";

/** Element with the given id. */
export const byId = (id) => document.getElementById(id);

/** Set the text of a node if it differs, so that selections and live regions are left alone. */
export function setText(node, text) {
  const wanted = text === null || text === undefined ? "" : String(text);
  if (node.textContent !== wanted) node.textContent = wanted;
}

/** Show or hide a node. */
export function show(node, visible) {
  // The attribute, not the property: elements of SVG have no property `hidden`.
  if (node.hasAttribute("hidden") === Boolean(visible)) node.toggleAttribute("hidden", !visible);
}

/** Set or remove an attribute if it differs. */
export function setAttribute(node, name, value) {
  if (value === null || value === undefined) node.removeAttribute(name);
  else if (node.getAttribute(name) !== String(value)) node.setAttribute(name, String(value));
}

/** Enable or disable a control, and state the reason as its tooltip if it is disabled. */
export function setDisabled(node, disabled, reason = "") {
  if (node.disabled !== Boolean(disabled)) node.disabled = Boolean(disabled);
  setAttribute(node, "title", disabled && reason ? reason : null);
}

/**
 * New HTML element.
 *
 * `properties` holds attributes; `class` and `data-*` among them. Children are nodes or texts.
 */
export function make(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) setAttribute(node, name, value);
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

/** New SVG element, with attributes and children as in `make`. */
export function svg(tag, properties = {}, ...children) {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) setAttribute(node, name, value);
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

const contents = new WeakMap();

/**
 * Rebuild the children of a node if `data` has changed since the last call.
 *
 * `build` returns an array of nodes. Focus stays on the control with the same `data-key`.
 */
export function rebuild(node, data, build) {
  const key = JSON.stringify(data);
  if (contents.get(node) === key) return;
  contents.set(node, key);
  const focused = node.contains(document.activeElement) ? document.activeElement.dataset.key : undefined;
  node.replaceChildren(...build());
  if (focused === undefined) return;
  const next = [...node.querySelectorAll("[data-key]")].find((each) => each.dataset.key === focused);
  if (next) next.focus({ preventScroll: true });
}

/** Forget what `rebuild` drew, so that the next call draws anew. */
export function forget(node) {
  contents.delete(node);
}

/** True if the node takes typed text, in which case Space is a character. */
export function takesText(node) {
  if (!node) return false;
  if (node.tagName === "TEXTAREA" || node.isContentEditable) return true;
  const texts = ["text", "number", "search", "email", "url", "password", "tel"];
  return node.tagName === "INPUT" && texts.includes(node.type);
}
