// The box of the bounds over a picture, with a handle on each face: dragging it moves that face along its axis, and with
// Shift the one across as well.

import { onTheme } from "../browser/theme.js";
import { Projection } from "./camera.js";
import { MarkCanvas } from "./mark_canvas.js";
import { cross, dot } from "./rotation.js";
import { svg } from "./svg.js";

const LINE = 0.08; // of the text's size
const STRENGTHS = { front: 0.75, behind: 0.25 };
const STEEPEST = 0.15; // of a face's axis that must lie in the screen, for its handle to be draggable
const AXES = "ijk";

/** @typedef {import("./camera.js").Grid} Grid */
/** @typedef {import("./camera.js").Point} Point */
/** @typedef {import("./frame.js").Frame} Frame */
/** @typedef {import("./rotation.js").Vector} Vector */
/** @typedef {{low: Vector, high: Vector}} Bounds half-open */
/** @typedef {{axis: number, end: "low" | "high"}} Face */

/** @type {Face[]} */
const FACES = [0, 1, 2].flatMap((axis) => /** @type {Face[]} */ ([{ axis, end: "low" }, { axis, end: "high" }]));

export class BoundsBox {
  #grid;
  #drag;
  #canvas = new MarkCanvas("vs-edges");
  #handles;
  #label = svg("text", { class: "vs-handle-label" });
  #bounds = /** @type {Bounds | null} */ (null);
  #projection = /** @type {Projection | null} */ (null);
  #frame = /** @type {Frame | null} */ (null);

  /**
   * @param {Grid} grid
   * @param {(bounds: Bounds, settled: boolean, at: number) => void} drag called as a face is dragged
   * @param {AbortSignal} signal its end
   */
  constructor(grid, drag, signal) {
    this.#grid = grid;
    this.#drag = drag;
    this.#handles = FACES.map((face) => this.#handle(face));
    this.element = svg("g", { class: "vs-handles" }, [...this.#handles, this.#label]);
    onTheme(() => this.#draw(), signal);
    /** Whether a face is being dragged. */
    this.busy = false;
  }

  /** @param {Bounds} bounds */
  set bounds(bounds) {
    this.#bounds = bounds;
    this.#draw();
  }

  /** The edges. @returns {HTMLCanvasElement} */
  get edges() {
    return this.#canvas.element;
  }

  /**
   * @param {Projection} projection of the picture on the screen @param {Frame} frame
   * @param {boolean} moving whether a hand is at the view: nobody drags a face meanwhile
   */
  place(projection, frame, moving) {
    this.#projection = projection;
    this.#frame = frame;
    this.element.toggleAttribute("hidden", moving);
    this.#draw();
  }

  #draw() {
    if (this.#bounds === null || this.#projection === null) return;
    this.#drawEdges();
    if (!this.element.hasAttribute("hidden")) FACES.forEach((face, n) => this.#placeHandle(this.#handles[n], face));
  }

  #drawEdges() {
    const context = this.#canvas.begin(this.#frame.element);
    const { color, fontSize } = this.#canvas.style;
    context.strokeStyle = color;
    context.lineWidth = LINE * parseFloat(fontSize);
    for (const { ends, behind } of edgesOf(this.#bounds, this.#projection, this.#frame)) {
      context.globalAlpha = behind ? STRENGTHS.behind : STRENGTHS.front;
      context.beginPath();
      context.moveTo(...ends[0]);
      context.lineTo(...ends[1]);
      context.stroke();
    }
  }

  #placeHandle(handle, face) {
    const step = this.#projection.step(face.axis);
    const [x, y] = this.#frame.toElement(this.#middleOf(face));
    handle.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
    handle.toggleAttribute("hidden", Math.hypot(step[0], step[1]) < STEEPEST * Math.hypot(...step));
    handle.classList.toggle("vs-behind", !facesViewer(face, this.#projection));
  }

  #middleOf({ axis, end }) {
    const { low, high } = this.#bounds;
    const middle = low.map((part, n) => (part + high[n] - 1) / 2);
    middle[axis] = this.#bounds[end][axis] - 0.5;
    return /** @type {Point} */ (this.#projection.at(/** @type {Vector} */ (middle)).slice(0, 2));
  }

  #handle(face) {
    const circles = [svg("circle", { class: "vs-reach" }), svg("circle", { class: "vs-dot" })];
    const named = { class: "vs-handle", "data-face": `${face.end}-${AXES[face.axis]}` };
    const handle = svg("g", { ...named, hidden: "" }, circles); // until it has a place: a pointer may be there already
    handle.addEventListener("pointerdown", (event) => this.#begin(event, face, handle));
    handle.addEventListener("pointerenter", () => this.#tell(face));
    handle.addEventListener("pointerleave", () => this.#label.replaceChildren());
    handle.addEventListener("mousedown", (event) => event.preventDefault());
    return handle;
  }

  #begin(down, face, handle) {
    if (down.button !== 0) return;
    const [sx, sy] = this.#projection.step(face.axis);
    const pixels = this.#frame.scale * (sx * sx + sy * sy);
    const began = this.#bounds;
    const moving = new AbortController();
    const { signal } = moving;
    this.busy = true;
    handle.setPointerCapture(down.pointerId);
    handle.addEventListener(
      "pointermove",
      (event) => {
        const voxels = ((event.clientX - down.clientX) * sx + (event.clientY - down.clientY) * sy) / pixels;
        const moved = event.shiftKey ? slabMoved : faceMoved;
        const bounds = moved(began, face, Math.round(voxels), this.#grid.dims);
        if (bounds[face.end][face.axis] === this.#bounds[face.end][face.axis]) return;
        this.bounds = bounds;
        this.#tell(face);
        this.#drag(bounds, false, event.timeStamp);
      },
      { signal },
    );
    const end = (event) => {
      moving.abort();
      this.busy = false;
      if (this.#bounds !== began) this.#drag(this.#bounds, true, event.timeStamp);
    };
    handle.addEventListener("pointerup", end, { signal });
    handle.addEventListener("pointercancel", end, { signal });
  }

  #tell(face) {
    const [x, y] = this.#frame.toElement(this.#middleOf(face));
    this.#label.setAttribute("x", (x + 12).toFixed(1));
    this.#label.setAttribute("y", (y - 10).toFixed(1));
    this.#label.textContent = `${face.end} ${AXES[face.axis]} = ${this.#bounds[face.end][face.axis]}`;
  }
}

/**
 * The twelve edges of a box of voxels, in CSS pixels of the element, and whether the box hides them.
 * @param {Bounds} bounds @param {Projection} projection @param {Frame} frame @returns {{ends: Point[], behind: boolean}[]}
 */
export function edgesOf({ low, high }, projection, frame) {
  return EDGES.map(({ ends, faces }) => ({
    ends: ends.map((corner) => {
      const index = corner.map((end, axis) => (end === "low" ? low[axis] : high[axis]) - 0.5);
      const [x, y] = projection.at(/** @type {Vector} */ (index));
      return frame.toElement([x, y]);
    }),
    behind: !faces.some((face) => facesViewer(face, projection)),
  }));
}

/** The bounds with one face moved. @param {Bounds} began @param {Face} face @param {number} voxels @param {number[]} dims */
function faceMoved(began, { axis, end }, voxels, dims) {
  const [least, most] = end === "low" ? [0, began.high[axis] - 1] : [began.low[axis] + 1, dims[axis]];
  return { ...began, [end]: shifted(began[end], axis, clamped(began[end][axis] + voxels, least, most)) };
}

/** The bounds with a face and the one across moved alike. @type {typeof faceMoved} */
function slabMoved({ low, high }, { axis }, voxels, dims) {
  const by = clamped(voxels, -low[axis], dims[axis] - high[axis]);
  return { low: shifted(low, axis, low[axis] + by), high: shifted(high, axis, high[axis] + by) };
}

/** @returns {Vector} */
function shifted(corner, axis, place) {
  return corner.map((part, n) => (n === axis ? place : part));
}

function clamped(value, least, most) {
  return Math.min(most, Math.max(least, value));
}

/** Each edge with its two corners and the two faces that it joins. */
const EDGES = [0, 1, 2].flatMap((along) => {
  const [b, c] = [(along + 1) % 3, (along + 2) % 3];
  return ["low", "high"].flatMap((endB) =>
    ["low", "high"].map((endC) => {
      const corner = (end) => [0, 1, 2].map((axis) => (axis === along ? end : axis === b ? endB : endC));
      const faces = /** @type {Face[]} */ ([{ axis: b, end: endB }, { axis: c, end: endC }]);
      return { ends: [corner("low"), corner("high")], faces };
    }),
  );
});

/** Whether a face's outer side is seen, on a skew grid too. @param {Face} face @param {Projection} projection */
function facesViewer({ axis, end }, projection) {
  const normal = cross(projection.step((axis + 1) % 3), projection.step((axis + 2) % 3));
  const outward = Math.sign(dot(normal, projection.step(axis))) * (end === "high" ? 1 : -1);
  return normal[2] * outward > 0;
}
