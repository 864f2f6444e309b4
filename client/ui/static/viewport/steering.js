// The view that the person at this viewport wants: moved at once by what they do, said on as it changes.

import { turnedBy } from "./camera.js";
import { Inertia } from "./inertia.js";

const SETTLES_AFTER = 150; // milliseconds without a further turn of the wheel

/** @typedef {import("./camera.js").Size} Size */
/** @typedef {import("./camera.js").View} View */

export class Steering {
  #say;
  #held = false;
  #settled = true; // what was said last
  #settling = 0;
  #inertia = new Inertia();

  /** @param {(view: View & Size, settled: boolean, at: number) => void} say */
  constructor(say) {
    this.#say = say;
    /** Null until the first scene has come. @type {View | null} */
    this.view = null;
    /** Of the picture that the view is for. @type {Size | null} */
    this.size = null;
    /** Whether the volume goes on turning when let go. */
    this.inertia = false;
  }

  /** Whether a person is at it, so that nobody else may move the view. */
  get busy() {
    return this.#held || this.#settling !== 0 || this.#inertia.turning;
  }

  /** Whether the view is under way to where it will rest. */
  get moving() {
    return !this.#settled;
  }

  /** The scene as others have left it. @param {View} view @param {Size} size */
  follow(view, size) {
    this.view = view;
    this.size = size;
  }

  /** A drag begins. */
  hold() {
    this.#calm();
    this.#held = true;
  }

  /** The drag has come here. @param {View} view @param {number} at */
  drag(view, at) {
    this.#inertia.note(view.rotation, at);
    this.#move(view, false, at);
  }

  /** The drag ends. @param {number} at */
  release(at) {
    this.#held = false;
    const end = () => this.#move(this.view, true, performance.now());
    if (!this.inertia) return end();
    this.#inertia.release(at, (turn) => this.#move(turnedBy(this.view, turn), false, performance.now()), end);
  }

  /** The drag was none. */
  abandon() {
    this.#held = false;
    if (!this.#settled) this.#move(this.view, true, performance.now());
  }

  /** One movement of many, which are over when none has come for a while. @param {View} view @param {number} at */
  nudge(view, at) {
    this.#calm();
    this.#move(view, false, at);
    this.#settling = setTimeout(() => {
      this.#settling = 0;
      this.#move(this.view, true, performance.now());
    }, SETTLES_AFTER);
  }

  /** A movement of its own. @param {View} view @param {number} at */
  go(view, at) {
    this.#calm();
    this.#move(view, true, at);
  }

  /** End what goes on by itself. */
  close() {
    this.#calm();
  }

  #calm() {
    clearTimeout(this.#settling);
    this.#settling = 0;
    this.#inertia.stop();
  }

  #move(view, settled, at) {
    this.view = view;
    this.#settled = settled;
    this.#say({ ...view, ...this.size }, settled, at);
  }
}
