// @ts-check
// A trackpad's pinch as Safari tells of it, by events of its own; elsewhere it comes as a wheel with Ctrl.

/** @typedef {MouseEvent & {scale: number}} GestureEvent `scale`: of the fingers' distance, since they came down */

/**
 * @param {HTMLElement} element
 * @param {(event: MouseEvent, factor: number) => void} pinched so many times wider since the event before
 */
export function onTrackpadPinch(element, pinched) {
  let before = 1;
  element.addEventListener("gesturestart", (event) => {
    event.preventDefault(); // the browser would zoom the page
    before = 1;
  });
  element.addEventListener("gesturechange", (event) => {
    event.preventDefault();
    const { scale } = /** @type {GestureEvent} */ (event);
    pinched(/** @type {MouseEvent} */ (event), scale / before);
    before = scale;
  });
}
