// Pointers over a slice: mouse, pen and fingers.
//
//   a drag moves the other slices to what is there, or a click measures · middle or Shift drag pans
//   one finger does as a drag · two zoom and pan

import { middleOf, spanOf } from "../viewport/camera.js";
import { onTrackpadPinch } from "../browser/trackpad_pinch.js";

/** @typedef {import("../viewport/camera.js").Point} Point */
/** @typedef {import("../viewport/rotation.js").Vector} Vector */
/** @typedef {import("./slice_view.js").SliceListener} SliceListener */
/** @typedef {import("./slice_view.js").SliceView} SliceView */

export class SliceGestures {
  #view;
  #listener;
  #down = /** @type {Map<number, Point>} */ (new Map()); // pointers, and where each was last
  #kind = /** @type {"go" | "measure" | "look"} */ ("go");
  #before = /** @type {Vector} */ ([0, 0, 0]); // the shared point before the first pointer came down

  /** @param {SliceView} view @param {SliceListener} listener */
  constructor(view, listener) {
    this.#view = view;
    this.#listener = listener;
    const { element } = view;
    element.addEventListener("mousedown", (event) => event.button === 1 && event.preventDefault()); // which would scroll
    element.addEventListener("pointerdown", (event) => this.#begin(event));
    element.addEventListener("pointermove", (event) => this.#move(event));
    element.addEventListener("pointerup", (event) => this.#end(event, true));
    for (const end of ["pointercancel", "lostpointercapture"]) {
      element.addEventListener(end, (event) => this.#end(event, false));
    }
    element.addEventListener("pointerleave", () => listener.hover(null));
    onTrackpadPinch(element, (event, factor) => this.#down.size === 0 && view.move(view.at(event), view.at(event), factor));
  }

  #begin(event) {
    const looks = event.button === 1 || (event.button === 0 && event.shiftKey);
    if ((event.button !== 0 && !looks) || this.#down.size === 2) return;
    if (looks) event.preventDefault();
    this.#view.element.setPointerCapture(event.pointerId);
    this.#listener.hover(null);
    this.#down.set(event.pointerId, this.#view.at(event));
    if (this.#down.size === 2) return this.#pinch();
    this.#before = this.#view.point;
    this.#kind = looks ? "look" : this.#listener.measuring.on ? "measure" : "go";
    if (this.#kind === "go") this.#go(event);
  }

  /** The first finger was not meant for the slices to go there. */
  #pinch() {
    if (this.#kind === "go") this.#listener.go(this.#before);
    this.#kind = "look";
  }

  #move(event) {
    if (!this.#down.has(event.pointerId)) {
      this.#listener.hover(this.#view.isInside(event) ? this.#voxelAt(event) : null);
      return;
    }
    const from = [...this.#down.values()];
    this.#down.set(event.pointerId, this.#view.at(event));
    const to = [...this.#down.values()];
    if (this.#kind === "look") this.#view.move(middleOf(from), middleOf(to), spanOf(to) / spanOf(from));
    else if (this.#kind === "go") this.#go(event);
  }

  /** What is left of two fingers moves what is enlarged. */
  #end(event, byPerson) {
    if (!this.#down.delete(event.pointerId)) return;
    if (byPerson && this.#kind === "measure") this.#listener.measuring.add(this.#view.placeAt(event));
  }

  #go(event) {
    this.#listener.go(this.#voxelAt(event));
  }

  /** @returns {Vector} */
  #voxelAt(event) {
    return /** @type {Vector} */ (this.#view.placeAt(event).map(Math.round));
  }
}
