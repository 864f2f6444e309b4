// @ts-check
// What a viewport tells the rest of the document of the value under the pointer. Who listens is not its business.

const NAME = "volsplat-value";

/** @typedef {Record<string, number>} Values  packet fields by the cross-bar's names, in the units of their axes */

/** Tell, up from an element, of the values under the pointer, or that none are. @param {Element} element @param {Values | null} values */
export function tellValues(element, values) {
  element.dispatchEvent(new CustomEvent(NAME, { bubbles: true, composed: true, detail: values }));
}

/** @param {(values: Values | null) => void} listener @param {AbortSignal} signal ends it */
export function onValues(listener, signal) {
  document.addEventListener(NAME, (event) => listener(/** @type {CustomEvent} */ (event).detail), { signal });
}
