// The handle of one face of the bounds: a slider for screen readers, whose value is where the face is.

import { AXES, facesViewer, placeOf, reachOf } from "./box_faces.js";
import { svg } from "../viewport/svg.js";

const STEEPEST = 0.15; // of a face's axis that must lie in the screen, for its handle to be draggable
const ENDS = { low: "lowest", high: "end of" };

/** @typedef {import("./box_faces.js").Bounds} Bounds */
/** @typedef {import("./box_faces.js").Face} Face */
/** @typedef {import("../viewport/camera.js").Point} Point */
/** @typedef {import("../viewport/camera.js").Projection} Projection */

export class BoundsHandle {
  #said = "";

  /** @param {Face} face */
  constructor(face) {
    this.face = face;
    /** What the page calls its place. */
    this.name = `${ENDS[face.end]} ${AXES[face.axis]}`;
    const told = { role: "slider", "aria-label": `${this.name}, a handle`, "aria-orientation": "vertical" };
    const marked = { class: "vs-handle", "data-face": `${face.end}-${AXES[face.axis]}`, hidden: "" }; // until it has a place
    this.element = svg("g", { ...told, ...marked }, [svg("circle", { class: "vs-reach" }), svg("circle", { class: "vs-dot" })]);
  }

  /** @param {Point} at @param {Projection} projection @param {boolean} focused which keeps it where nobody could drag it */
  place([x, y], projection, focused) {
    const step = projection.step(this.face.axis);
    const steep = Math.hypot(step[0], step[1]) < STEEPEST * Math.hypot(...step);
    this.element.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
    this.element.toggleAttribute("hidden", steep && !focused);
    this.element.classList.toggle("vs-behind", !facesViewer(this.face, projection));
  }

  /** Say where the face is, unless that is what was said last. @param {Bounds} bounds @param {number[]} dims */
  say(bounds, dims) {
    const place = placeOf(bounds, this.face);
    const said = [place, place, ...reachOf(bounds, this.face, dims)];
    if (`${said}` === this.#said) return;
    this.#said = `${said}`;
    ["now", "text", "min", "max"].forEach((part, n) => this.element.setAttribute(`aria-value${part}`, `${said[n]}`));
  }
}
