// What a person can do to the view by a key or a button.

import { panned, turnedBy, zoomed } from "./camera.js";
import { about, namedView, product } from "./rotation.js";

/** @typedef {import("./camera.js").Point} Point */
/** @typedef {import("./rotation.js").Quaternion} Quaternion */
/** @typedef {import("./viewport.js").Viewport} Viewport */

export class ViewActions {
  #viewport;
  #home;

  /** @param {Viewport} viewport @param {Quaternion} home the rotation that reset goes to */
  constructor(viewport, home) {
    this.#viewport = viewport;
    this.#home = home;
  }

  /** @param {string} side one of AXIS_VIEWS */
  lookFrom(side) {
    this.#go((view) => ({ ...view, rotation: namedView(side) }));
  }

  reset() {
    this.#go((view) => ({ ...this.#fitted(view), rotation: this.#home }));
  }

  /** All that is visible in the picture, standing as it does. */
  fit() {
    this.#go((view) => this.#fitted(view));
  }

  /** The front of the volume to the right and down. @param {number} right degrees @param {number} down degrees */
  turnBy(right, down) {
    this.#nudge((view) => turnedBy(view, product(about(0, down), about(1, right))));
  }

  /** Counter-clockwise. @param {number} degrees */
  rollBy(degrees) {
    this.#nudge((view) => turnedBy(view, about(2, degrees)));
  }

  /** By shares of the picture's shorter side. @param {number} right @param {number} down */
  panBy(right, down) {
    const { grid, size } = this.#viewport;
    const side = Math.min(size.width, size.height);
    this.#nudge((view) => panned(view, grid, [0, 0], [right * side, down * side]));
  }

  /** About the picture's middle. @param {number} factor */
  zoomBy(factor) {
    const { grid, size } = this.#viewport;
    const middle = /** @type {Point} */ ([(size.width - 1) / 2, (size.height - 1) / 2]);
    this.#nudge((view) => zoomed(view, grid, size, middle, this.#viewport.zoomFactor(view, factor)));
  }

  /** Whether the volume goes on turning when it is let go. */
  toggleInertia() {
    const { steering } = this.#viewport;
    steering.inertia = !steering.inertia;
  }

  #go(change) {
    const { ready, view, steering } = this.#viewport;
    if (ready) steering.go(change(view), performance.now());
  }

  /** A small step, of which there may be many, as when a key is held down. */
  #nudge(change) {
    const { ready, view, steering } = this.#viewport;
    if (ready) steering.nudge(change(view), performance.now());
  }

  #fitted(view) {
    return { ...view, ...this.#viewport.fit };
  }
}
