// Lets the volume go on turning after the pointer has let go of it, ever slower.

import * as rotation from "./rotation.js";

const TRAIL = 80; // milliseconds of the last movement that tell how fast it was
const STILL = 50; // milliseconds after which a pointer that no longer moves throws nothing
const DECAY = 600; // milliseconds in which the speed falls to 1/e
const END = 0.02; // degrees per millisecond

/** @typedef {import("./rotation.js").Quaternion} Quaternion */

export class Inertia {
  #trail = /** @type {{rotation: Quaternion, at: number}[]} */ ([]);
  #frame = 0;
  #turning = new AbortController(); // aborted at its end

  get turning() {
    return this.#frame !== 0;
  }

  /** The volume stood so at that time, under the pointer. @param {Quaternion} stood @param {number} at */
  note(stood, at) {
    this.#trail = [...this.#trail.filter((sample) => at - sample.at < TRAIL), { rotation: stood, at }];
  }

  stop() {
    cancelAnimationFrame(this.#frame);
    this.#turning.abort();
    this.#frame = 0;
    this.#trail = [];
  }

  /**
   * Let go at time `at`. `turn` is called with each further turn; `end` when there are no more, at once if the
   * pointer stood still, or once nobody sees it any more: a hidden tab has no animation frames.
   * @param {number} at @param {(turn: Quaternion) => void} turn @param {() => void} end
   */
  release(at, turn, end) {
    const [first, last] = [this.#trail[0], this.#trail.at(-1)];
    this.stop();
    if (document.hidden || !last || at - last.at > STILL || last.at <= first.at) return end();
    const inverse = /** @type {Quaternion} */ (first.rotation.map((part, n) => (n < 3 ? -part : part)));
    const whole = rotation.product(last.rotation, inverse);
    const span = last.at - first.at;
    const speed = (2 * Math.acos(Math.min(1, Math.abs(whole[3]))) * 180) / Math.PI / span;
    const began = performance.now();
    let before = began;
    const rest = () => {
      this.stop();
      end();
    };
    this.#turning = new AbortController();
    const { signal } = this.#turning;
    document.addEventListener("visibilitychange", () => document.hidden && rest(), { signal });
    const go = (now) => {
      const left = Math.exp(-(now - began) / DECAY);
      if (speed * left < END) return rest();
      turn(rotation.power(whole, (left * Math.max(0, now - before)) / span));
      before = now;
      this.#frame = requestAnimationFrame(go);
    };
    this.#frame = requestAnimationFrame(go);
  }
}
