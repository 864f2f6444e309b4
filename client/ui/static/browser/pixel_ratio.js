// @ts-check
// How many of the screen's pixels a CSS pixel has: other ones on another screen, and at another zoom, though nothing on
// the page is resized.

/** @param {() => void} changed @param {AbortSignal} signal ends it */
export function onPixelRatio(changed, signal) {
  const now = window.matchMedia(`(resolution: ${window.devicePixelRatio}dppx)`);
  const told = () => {
    changed();
    onPixelRatio(changed, signal);
  };
  now.addEventListener("change", told, { once: true, signal });
}
