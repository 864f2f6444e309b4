// The value under a pointer that rests: density and gradient strength of the front-most visible sample.

import { tellValues } from "./value_event.js";

const REST = 60; // milliseconds

/** @typedef {import("./camera.js").Point} Point */

export class ValueReadout {
  #ask;
  #names;
  #timer = 0;
  #asked = /** @type {Point | null} */ (null);

  /**
   * @param {{density_name: string, strength_name: string}} volume its message
   * @param {(at: Point) => void} ask for the value at a picture pixel
   */
  constructor({ density_name, strength_name }, ask) {
    this.#ask = ask;
    this.#names = [density_name, strength_name];
    this.element = document.createElement("output");
    this.element.className = "vs-value";
    this.element.hidden = true;
  }

  /** The pointer is at a picture pixel; `still` tells whether nothing moves. @param {Point} at @param {() => boolean} still */
  hover(at, still) {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      if (!still()) return;
      this.#asked = at;
      this.#ask(at);
    }, REST);
  }

  /** What was told no longer holds. */
  clear() {
    clearTimeout(this.#timer);
    this.#asked = null;
    this.#hide();
  }

  /** @param {{x: number, y: number, index: number[] | null, density?: number, strength?: number}} found */
  answer({ x, y, index, density, strength }) {
    if (this.#asked === null || this.#asked[0] !== x || this.#asked[1] !== y) return;
    if (index === null) return this.#hide();
    this.element.hidden = false;
    const values = [density, strength].map((value, n) => `${this.#names[n]} ${shortNumber(value)}`);
    this.element.textContent = `${values.join(" · ")} at (${index.join(", ")})`;
    const [i, j, k] = index;
    tellValues(this.element, { density, strength, "grid-i": i, "grid-j": j, "grid-k": k });
  }

  #hide() {
    if (this.element.hidden) return;
    this.element.hidden = true;
    tellValues(this.element, null);
  }
}

/** Three digits, or all before the point. @param {number} value */
export function shortNumber(value) {
  return Math.abs(value) >= 100 ? String(Math.round(value)) : String(Number(value.toPrecision(3)));
}
