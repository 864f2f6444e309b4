// @ts-check
// An input that a hand moves. Browsers tell of its end by `change`, but of none that comes back to where it began.

const ENDS = ["pointerup", "pointercancel", "keyup"];

/**
 * @param {HTMLInputElement} input
 * @param {(settled: boolean) => void} onMoved while it is moved, and settled once it is let go
 * @param {AbortSignal} [signal] ends it
 */
export function followHand(input, onMoved, signal) {
  let moving = false;
  const move = (/** @type {boolean} */ settled) => {
    moving = !settled;
    onMoved(settled);
  };
  const letGo = () => moving && move(true);
  input.addEventListener("input", () => move(false), { signal });
  input.addEventListener("change", () => move(true), { signal });
  input.addEventListener("blur", letGo, { signal });
  // Once a `change`, which follows the pointer's end, was heard.
  for (const end of ENDS) window.addEventListener(end, () => moving && setTimeout(letGo), { signal, capture: true });
}
