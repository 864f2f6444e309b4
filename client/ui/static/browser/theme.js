// @ts-check
// Light or dark: what is drawn on a canvas must be drawn anew in the other colours.

/** @param {() => void} changed @param {AbortSignal} signal ends it */
export function onTheme(changed, signal) {
  const observer = new MutationObserver(changed);
  observer.observe(document.body, { attributeFilter: ["class"] });
  signal.addEventListener("abort", () => observer.disconnect());
}
