// The value under a pointer that rests: density and gradient strength of the front-most visible sample, first as it is
// drawn, then as its file has it.

import { tellValues } from "./value_event.js";

const REST = 60; // milliseconds

/** @typedef {import("./camera.js").Point} Point */
/** @typedef {Pick<import("./viewport_messages.d.ts").ProbeAnswered, "found" | "density_is" | "strength_is">} Found */
/** @typedef {import("./viewport_messages.d.ts").VolumeTold} VolumeTold an axis' index n stands for first + n * step */

export class ValueReadout {
  #ask;
  #names;
  #valueUnit;
  #axes;
  #timer = 0;
  #asked = /** @type {Point | null} */ (null);
  #told = /** @type {{ index: number[], strength: string } | null} */ (null); // of the point that was asked

  /**
   * @param {VolumeTold} volume
   * @param {(at: Point) => void} ask for the value at a picture pixel
   */
  constructor({ density_name, strength_name, value_unit, axes }, ask) {
    this.#ask = ask;
    this.#names = [density_name, strength_name];
    this.#valueUnit = value_unit && ` ${value_unit}`;
    this.#axes = axes;
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
      this.#told = null;
      this.#ask(at);
    }, REST);
  }

  /** What was told no longer holds. */
  clear() {
    clearTimeout(this.#timer);
    this.#asked = this.#told = null;
    this.#hide();
  }

  /** @param {import("./viewport_messages.d.ts").ProbeAnswered} answer */
  answer({ x, y, found, density_is, strength_is }) {
    if (this.#isAsked(x, y)) this.#tell({ found, density_is, strength_is });
  }

  /** What a slice shows of a voxel. @param {Found} told */
  tell(told) {
    this.#asked = null;
    this.#tell(told);
  }

  /** @param {Found} told */
  #tell({ found, density_is, strength_is }) {
    this.#told = null;
    if (found === null) return this.#hide();
    const { index, density, strength } = found;
    this.element.hidden = false;
    this.#told = { index, strength: strength_is + shortNumber(strength) };
    this.#show(density_is + shortNumber(density), this.#told);
    const [i, j, k] = index;
    tellValues(this.element, { density, strength, "grid-i": i, "grid-j": j, "grid-k": k });
  }

  /** The file's own, of the voxel that was told of. @param {import("./viewport_messages.d.ts").FileValueTold} value */
  fileValue({ x, y, density, strength }) {
    if (!this.#isAsked(x, y) || this.#told === null) return;
    this.#show(density, { ...this.#told, ...(strength !== null && { strength }) });
  }

  /** The file's own, of the voxel of a slice that was told of last. @param {import("./viewport_messages.d.ts").SliceValueTold} value */
  sliceValue({ index, density, strength }) {
    if (this.#asked !== null || this.#told === null || index.some((n, axis) => n !== this.#told.index[axis])) return;
    this.#show(density, { ...this.#told, ...(strength !== null && { strength }) });
  }

  /** @param {number} x @param {number} y */
  #isAsked(x, y) {
    return this.#asked !== null && this.#asked[0] === x && this.#asked[1] === y;
  }

  /** @param {string} density @param {{ index: number[], strength: string }} told */
  #show(density, { index, strength }) {
    const values = `${this.#names[0]} ${density}${this.#valueUnit} · ${this.#names[1]} ${strength}`;
    this.element.textContent = `${values} at ${this.#place(index)}`;
  }

  /** What the indices stand for, if the file says. @param {number[]} index */
  #place(index) {
    if (this.#axes === null) return `(${index.join(", ")})`;
    const places = this.#axes.map(({ name, unit, first, step }, n) => {
      const place = Number((first + index[n] * step).toPrecision(7));
      return `${name} ${place}${unit && ` ${unit}`}`;
    });
    return places.join(", ");
  }

  #hide() {
    if (this.element.hidden) return;
    this.element.hidden = true;
    tellValues(this.element, null);
  }
}

/** Three digits, or all before the point. @param {number} value */
function shortNumber(value) {
  return Math.abs(value) >= 100 ? String(Math.round(value)) : String(Number(value.toPrecision(3)));
}
