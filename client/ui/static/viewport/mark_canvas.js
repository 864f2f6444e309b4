// A canvas for what lies over the picture and moves with it, drawn on in CSS pixels. For elements of the document that move, the
// browser would arrange the layers of the whole page anew with every picture.

/** @typedef {import("./camera.js").Size} Size */

export class MarkCanvas {
  #context;

  /** @param {string} name its class */
  constructor(name) {
    this.element = document.createElement("canvas");
    this.element.className = name;
    this.#context = /** @type {CanvasRenderingContext2D} */ (this.element.getContext("2d"));
  }

  /** Its style, whose `color` and custom properties a canvas is to be drawn in. */
  get style() {
    return getComputedStyle(this.element);
  }

  /** Empty it. @param {Size} size in CSS pixels, as the page shows it */
  begin({ width, height }) {
    const ratio = window.devicePixelRatio;
    const [w, h] = [width, height].map((side) => Math.round(side * ratio));
    if (this.element.width !== w || this.element.height !== h) Object.assign(this.element, { width: w, height: h });
    else {
      this.#context.resetTransform();
      this.#context.clearRect(0, 0, w, h);
    }
    this.#context.setTransform(ratio, 0, 0, ratio, 0, 0);
    return this.#context;
  }
}
