// @ts-check
// How far a wheel was turned, in pixels: a browser may count in lines, or in pages where the system is set so.

const LINE = 33; // pixels: Firefox's three lines of a notch are then what others tell of one

/**
 * @param {WheelEvent} event
 * @param {Element} element whose height is a page
 * @returns {number} above 0 downwards
 */
export function wheelPixels(event, element) {
  if (event.deltaMode === WheelEvent.DOM_DELTA_LINE) return event.deltaY * LINE;
  return event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_PAGE ? element.clientHeight : 1);
}
