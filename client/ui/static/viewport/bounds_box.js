// The box of the bounds over a picture, with a handle on each face: dragging it moves that face along its axis, and with
// Shift the one across as well. Keys do the same; what they do is settled once the key is let go, as a drag is.

import { BoundsHandle } from "../bounds/bounds_handle.js";
import { FACES, edgesOf, faceMoved, laidOver, middleOf, placeOf, slabMoved } from "../bounds/box_faces.js";
import { Roving } from "../browser/roving.js";
import { onTheme } from "../browser/theme.js";
import { Projection } from "./camera.js";
import { MarkCanvas } from "./mark_canvas.js";
import { svg } from "./svg.js";

const LINE = 0.08; // of the text's size
const STRENGTHS = { front: 0.75, behind: 0.25 };
const FAR = 10; // voxels of Page Up and Page Down
const STEPS = { ArrowUp: 1, ArrowDown: -1, PageUp: FAR, PageDown: -FAR, Home: -Infinity, End: Infinity };
const NEXT = { ArrowRight: 1, ArrowLeft: -1 };

/** @typedef {import("../bounds/box_faces.js").Bounds} Bounds */
/** @typedef {import("../bounds/box_faces.js").Face} Face */
/** @typedef {import("../bounds/box_faces.js").Moved} Moved */
/** @typedef {import("./camera.js").Grid} Grid */
/** @typedef {import("./frame.js").Frame} Frame */

export class BoundsBox {
  #grid;
  #drag;
  #canvas = new MarkCanvas("vs-edges");
  #handles = FACES.map((face) => new BoundsHandle(face));
  #stops = new Roving(this.#handles.map(({ element }) => element));
  #label = svg("text", { class: "vs-handle-label" });
  #pointed = /** @type {BoundsHandle | null} */ (null);
  #focused = /** @type {BoundsHandle | null} */ (null);
  #told = /** @type {Bounds | null} */ (null);
  #done = /** @type {Moved} */ (new Map()); // by hands here, and perhaps not in what is told
  #hand = /** @type {Moved} */ (new Map()); // by the one that is at it
  #bounds = /** @type {Bounds | null} */ (null); // what is told with all that over it
  #held = false; // whether the hand is at a key
  #projection = /** @type {Projection | null} */ (null);
  #frame = /** @type {Frame | null} */ (null);
  #moving = false;

  /**
   * @param {Grid} grid
   * @param {(bounds: Bounds, settled: boolean, at: number) => void} drag called as a face is dragged
   * @param {AbortSignal} signal its end
   */
  constructor(grid, drag, signal) {
    this.#grid = grid;
    this.#drag = drag;
    for (const handle of this.#handles) this.#listen(handle);
    const named = { class: "vs-handles", role: "toolbar", "aria-label": "handles of the bounds" };
    this.element = svg("g", named, [...this.#handles.map(({ element }) => element), this.#label]);
    onTheme(() => this.#draw(), signal);
    /** Whether a hand is at a face. */
    this.busy = false;
  }

  /**
   * Take over what is told, where others may have moved other faces.
   * @param {Bounds} bounds @param {boolean} whole whether all that was done here is in them
   */
  follow(bounds, whole) {
    if (bounds === this.#told && (!whole || this.#done.size === 0)) return;
    this.#told = bounds;
    if (whole) this.#done.clear();
    this.#lay();
  }

  #lay() {
    this.#bounds = laidOver(this.#told, new Map([...this.#done, ...this.#hand]), this.#grid.dims);
    this.#draw();
  }

  /** The edges. @returns {HTMLCanvasElement} */
  get edges() {
    return this.#canvas.element;
  }

  /**
   * @param {Projection} projection of the picture on the screen @param {Frame} frame
   * @param {boolean} moving whether a hand is at the view: nobody drags a face meanwhile. A handle that has the focus is
   *   only not seen then, or it would lose it.
   */
  place(projection, frame, moving) {
    this.#projection = projection;
    this.#frame = frame;
    this.#moving = moving;
    this.element.toggleAttribute("hidden", moving && this.#focused === null);
    this.element.classList.toggle("vs-away", moving);
    this.#draw();
  }

  #draw() {
    if (this.#bounds === null || this.#projection === null) return;
    this.#drawEdges();
    if (this.#moving) return;
    for (const handle of this.#handles) this.#placeHandle(handle);
    this.#stops.keep();
    this.#drawLabel();
    if (!this.busy) this.#say();
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

  #placeHandle(handle) {
    handle.place(this.#middleOf(handle), this.#projection, handle === this.#focused);
  }

  #middleOf({ face }) {
    return this.#frame.toElement(middleOf(this.#bounds, face, this.#projection));
  }

  #say() {
    for (const handle of this.#handles) handle.say(this.#bounds, this.#grid.dims);
  }

  /** @param {BoundsHandle} handle */
  #listen(handle) {
    const { element } = handle;
    element.addEventListener("pointerdown", (event) => this.#begin(event, handle));
    element.addEventListener("pointerenter", () => this.#point(handle));
    element.addEventListener("pointerleave", () => this.#point(null));
    element.addEventListener("mousedown", (event) => event.preventDefault());
    element.addEventListener("keydown", (event) => this.#press(event, handle));
    element.addEventListener("keyup", (event) => event.key in STEPS && this.#letGo(event.timeStamp));
    element.addEventListener("focus", () => this.#focus(handle));
    element.addEventListener("blur", (event) => {
      this.#letGo(event.timeStamp);
      this.#focus(null);
    });
  }

  #begin(down, handle) {
    if (down.button !== 0) return;
    const { face, element } = handle;
    const [sx, sy] = this.#projection.step(face.axis);
    const pixels = this.#frame.scale * (sx * sx + sy * sy);
    this.#letGo(down.timeStamp);
    const began = this.#bounds;
    const moving = new AbortController();
    const { signal } = moving;
    this.busy = true;
    element.setPointerCapture(down.pointerId);
    element.addEventListener(
      "pointermove",
      (event) => {
        const voxels = ((event.clientX - down.clientX) * sx + (event.clientY - down.clientY) * sy) / pixels;
        const now = laidOver(this.#told, this.#done, this.#grid.dims);
        this.#move(this.#moved(began, face, Math.round(voxels), now, event), face, event);
      },
      { signal },
    );
    const end = (event) => {
      moving.abort();
      this.#settle(event.timeStamp);
    };
    element.addEventListener("pointerup", end, { signal });
    element.addEventListener("pointercancel", end, { signal });
  }

  /**
   * With Shift both faces.
   * @param {Bounds} began @param {Face} face @param {number} voxels @param {Bounds} now @param {MouseEvent | KeyboardEvent} event
   */
  #moved(began, face, voxels, now, event) {
    return (event.shiftKey ? slabMoved : faceMoved)(began, face, voxels, now, this.#grid.dims);
  }

  /** @param {Moved} moved all that the hand has moved @param {Face} face @param {MouseEvent | KeyboardEvent} event */
  #move(moved, face, event) {
    if (moved.get(face) === placeOf(this.#bounds, face)) return;
    this.#hand = moved;
    this.#lay();
    this.#drag(this.#bounds, false, event.timeStamp);
  }

  /** @param {number} at */
  #settle(at) {
    const moved = this.#hand.size > 0;
    this.busy = false;
    this.#done = new Map([...this.#done, ...this.#hand]);
    this.#hand = new Map();
    this.#say();
    if (moved) this.#drag(this.#bounds, true, at);
  }

  /** @param {KeyboardEvent} event @param {BoundsHandle} handle */
  #press(event, { face }) {
    if (event.ctrlKey || event.metaKey) this.#letGo(event.timeStamp); // what is held is undone as well
    if (event.ctrlKey || event.altKey || event.metaKey || !(event.key in STEPS || event.key in NEXT)) return;
    event.preventDefault();
    event.stopPropagation();
    if (event.key in NEXT) return this.#stops.go(NEXT[event.key]);
    if (this.#moving || (this.busy && !this.#held)) return; // nobody sees it, or a pointer drags it
    this.#held = this.busy = true;
    const moved = this.#moved(this.#bounds, face, STEPS[event.key], this.#bounds, event);
    this.#move(new Map([...this.#hand, ...moved]), face, event);
    this.#say();
  }

  /** The keys are let go. @param {number} at */
  #letGo(at) {
    if (!this.#held) return;
    this.#held = false;
    this.#settle(at);
  }

  /** @param {BoundsHandle | null} handle */
  #focus(handle) {
    this.#focused = handle;
    this.#draw(); // one that only its focus has kept is away
  }

  /** @param {BoundsHandle | null} handle */
  #point(handle) {
    this.#pointed = handle;
    this.#drawLabel();
  }

  #drawLabel() {
    const handle = this.#pointed ?? this.#focused;
    if (handle === null) return this.#label.replaceChildren();
    const [x, y] = this.#middleOf(handle);
    this.#label.setAttribute("x", (x + 12).toFixed(1));
    this.#label.setAttribute("y", (y - 10).toFixed(1));
    this.#label.textContent = `${handle.name} = ${placeOf(this.#bounds, handle.face)}`;
  }
}
