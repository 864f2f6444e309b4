// Measuring: two points of the volume make a distance, a third one an angle; a fourth begins anew. Points come from the
// picture, where they are what is seen there, and from slices; lines between them are drawn over both.

import { svg, drawLine } from "../viewport/svg.js";
import { Ruler } from "./ruler.js";

const MOST_POINTS = 3;
const BEGIN = "measuring: click two points, or a third for an angle";

/** @typedef {import("../viewport/camera.js").Point} Point */
/** @typedef {import("../viewport/rotation.js").Vector} Vector */

export class Measuring {
  #changed;
  #ruler = /** @type {Ruler | null} */ (null);
  #points = /** @type {Vector[]} */ ([]);

  /** @param {() => void} changed lines are to be drawn anew */
  constructor(changed) {
    this.#changed = changed;
    this.on = false;
    /** What was measured, in words. */
    this.element = document.createElement("output");
    this.element.className = "vs-measured";
    this.element.hidden = true;
  }

  /** @param {import("../viewport/viewport_messages.d.ts").VolumeTold} volume */
  set volume(volume) {
    this.#ruler = new Ruler(volume);
    this.#tell();
  }

  /** Begin, or end and forget what was measured. */
  toggle() {
    this.on = !this.on;
    this.#points = [];
    this.#tell();
    this.#changed();
  }

  /** A point was set, which may lie between voxels. @param {Vector} point */
  add(point) {
    this.#points = this.#points.length === MOST_POINTS ? [point] : [...this.#points, point];
    this.#tell();
    this.#changed();
  }

  /**
   * Draw points and lines.
   * @param {SVGElement} group to be filled
   * @param {(point: Vector) => {at: Point, near: boolean}} place where a point is, and whether it is there or behind
   */
  draw(group, place) {
    const places = this.#points.map(place);
    const lines = places.slice(1).map(({ at, near }, n) => {
      const line = svg("line", { class: near && places[n].near ? "" : "vs-far" });
      drawLine(line, places[n].at, at);
      return line;
    });
    const ends = places.map(({ at: [x, y], near }) =>
      svg("circle", { cx: x.toFixed(1), cy: y.toFixed(1), r: "3.5", class: near ? "" : "vs-far" }),
    );
    group.replaceChildren(...lines, ...ends);
  }

  #tell() {
    this.element.hidden = !this.on;
    this.element.textContent = this.#words();
  }

  #words() {
    const [first, second, third] = this.#points;
    if (this.#ruler === null || second === undefined) return BEGIN;
    const distance = this.#ruler.distance(first, second);
    if (third === undefined) return distance;
    return `${distance} · ${this.#ruler.distance(second, third)} · ${this.#ruler.angle(first, second, third)}`;
  }
}
