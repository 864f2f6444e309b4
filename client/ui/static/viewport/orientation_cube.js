// A small cube that stands as the volume stands; a click on a face looks at it straight. Keys and screen readers have a
// button for each face, of which one is seen only while it has the focus: the canvas alone turns with the picture.

import { Roving } from "../browser/roving.js";
import { onTheme } from "../browser/theme.js";
import { MarkCanvas } from "./mark_canvas.js";
import { AXIS_VIEWS, applied, cross, dot, matrixOf } from "./rotation.js";

/** @typedef {import("./rotation.js").Vector} Vector */

/** In upright axes. `up` is parallel to two edges of the face. */
const SIDES = /** @type {{view: string, normal: Vector, up: Vector}[]} */ ([
  { view: "front", normal: [0, -1, 0], up: [0, 0, 1] },
  { view: "back", normal: [0, 1, 0], up: [0, 0, 1] },
  { view: "left", normal: [1, 0, 0], up: [0, 0, 1] },
  { view: "right", normal: [-1, 0, 0], up: [0, 0, 1] },
  { view: "top", normal: [0, 0, 1], up: [0, -1, 0] },
  { view: "bottom", normal: [0, 0, -1], up: [0, -1, 0] },
]);

const HALF = 1 / 3.6; // of a side, as a share of the room for all of the cube, however it stands
const ROUNDED = 0.12; // corners, in halves of a side
const LINE = 0.05;
const LIGHT = /** @type {Vector} */ ([-0.3, 0.5, 0.81]);
const DARKEST = 0.25; // share of the text's colour in that of a side
const LARGEST_LETTERS = 1.05; // in halves of a side
const WIDEST = 2.7; // letters of such a size on a side, one beside the other
const EDGE_ON = 0.02; // towards the viewer, below which a side is not seen
const NEXT = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
const TIE = 1e-6; // what is no nearer upright than by this is as near: rounding decides nothing

/**
 * @typedef {Object} Standing a side that faces the viewer, in CSS pixels of the cube's room
 * @property {string} view that looks at it straight
 * @property {[number, number, number, number, number, number]} matrix from the side, its letter upright and the middle at 0, to the room
 * @property {number} shade 0..1, how dark it is
 */

/**
 * The sides that are seen.
 * @param {import("./rotation.js").Quaternion} rotation of the view @param {number} room CSS pixels each way @returns {Standing[]}
 */
export function standing(rotation, room) {
  const toScreen = matrixOf(rotation);
  const [middle, half] = [room / 2, room * HALF];
  return SIDES.flatMap(({ view, normal, up }) => {
    const n = applied(toScreen, normal);
    if (n[2] <= EDGE_ON) return [];
    const u = nearestUpright(applied(toScreen, up), n);
    const r = cross(u, n);
    const matrix = /** @type {Standing["matrix"]} */ ([r[0], -r[1], -u[0], u[1], middle + n[0] * half, middle - n[1] * half]);
    return [{ view, matrix, shade: DARKEST * (1 - Math.max(0, dot(n, LIGHT))) }];
  });
}

export class OrientationCube {
  #canvas = new MarkCanvas("vs-cube");
  #letters;
  #rotation = /** @type {import("./rotation.js").Quaternion | null} */ (null);
  #room = 0; // CSS pixels
  #pointer = /** @type {{x: number, y: number} | null} */ (null); // in the room, if it is there
  #over = /** @type {string | undefined} */ (undefined); // the view of the side under it
  #focused = /** @type {string | undefined} */ (undefined); // that of the button with the focus

  /**
   * @param {Record<string, string>} letters by view @param {(view: string) => void} lookFrom one of AXIS_VIEWS
   * @param {AbortSignal} signal its end
   */
  constructor(letters, lookFrom, signal) {
    this.#letters = letters;
    const { element } = this;
    element.setAttribute("aria-hidden", "true");
    /** The buttons. */
    this.sides = this.#makeSides(lookFrom);
    element.addEventListener("pointermove", (event) => this.#point({ x: event.offsetX, y: event.offsetY }));
    element.addEventListener("pointerleave", () => this.#point(null));
    element.addEventListener("click", (event) => {
      this.#point({ x: event.offsetX, y: event.offsetY }); // a finger has not moved
      if (this.#over !== undefined) lookFrom(this.#over);
    });
    const resized = new ResizeObserver(([{ contentRect }]) => {
      this.#room = contentRect.width;
      this.#draw();
    });
    resized.observe(element);
    signal.addEventListener("abort", () => resized.disconnect());
    onTheme(() => this.#draw(), signal);
  }

  get element() {
    return this.#canvas.element;
  }

  /** @param {import("./rotation.js").Quaternion} rotation of the view */
  draw(rotation) {
    this.#rotation = rotation;
    this.#draw();
  }

  #draw() {
    if (this.#rotation === null || this.#room === 0) return;
    this.#mark(this.#pointed());
    const context = this.#canvas.begin({ width: this.#room, height: this.#room });
    const style = this.#canvas.style;
    const colour = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
    const half = this.#room * HALF;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineWidth = LINE * half;
    context.strokeStyle = colour("--vs-line");
    for (const { view, matrix, shade } of standing(this.#rotation, this.#room)) {
      context.save();
      context.transform(...matrix);
      context.beginPath();
      context.roundRect(-half, -half, 2 * half, 2 * half, ROUNDED * half);
      const isOver = view === this.#over || view === this.#focused;
      context.fillStyle = colour(isOver ? "--vs-accent" : "--vs-panel");
      context.fill();
      context.fillStyle = colour("--vs-text");
      context.globalAlpha = isOver ? 0 : shade;
      context.fill();
      context.globalAlpha = 1;
      context.stroke();
      const letters = this.#letters[view];
      context.font = `600 ${half * Math.min(LARGEST_LETTERS, WIDEST / letters.length)}px ${style.fontFamily}`;
      context.fillStyle = colour(isOver ? "--vs-panel" : "--vs-text");
      context.fillText(letters, 0, 0);
      context.restore();
    }
  }

  /** @param {{x: number, y: number} | null} at */
  #point(at) {
    this.#pointer = at;
    if (this.#pointed() !== this.#over) this.#draw();
  }

  /** The view of the side under the pointer. */
  #pointed() {
    if (this.#pointer === null || this.#rotation === null) return undefined;
    const at = this.#pointer;
    const half = this.#room * HALF;
    return standing(this.#rotation, this.#room).find(({ matrix }) => {
      const { x, y } = new DOMMatrix(matrix).inverse().transformPoint(at);
      return Math.max(Math.abs(x), Math.abs(y)) <= half;
    })?.view;
  }

  /** Tell what a click would do. @param {string | undefined} view */
  #mark(view) {
    if (view === this.#over) return;
    this.#over = view;
    this.element.title = view === undefined ? "" : this.#nameOf(view);
    this.element.classList.toggle("vs-over", view !== undefined);
  }

  /** @param {string} view */
  #nameOf(view) {
    return `look from the ${view} (${this.#letters[view]})`;
  }

  /** @param {(view: string) => void} lookFrom */
  #makeSides(lookFrom) {
    const sides = document.createElement("div");
    sides.className = "vs-sides";
    sides.setAttribute("role", "toolbar");
    sides.setAttribute("aria-label", "sides of the volume");
    const buttons = AXIS_VIEWS.map((view) => this.#makeSide(view, lookFrom));
    sides.append(...buttons);
    const stops = new Roving(buttons);
    sides.addEventListener("keydown", (event) => {
      if (!(event.key in NEXT) || event.ctrlKey || event.altKey || event.metaKey || event.shiftKey) return;
      event.preventDefault();
      event.stopPropagation();
      stops.go(NEXT[/** @type {keyof typeof NEXT} */ (event.key)]);
    });
    return sides;
  }

  /** @param {string} view @param {(view: string) => void} lookFrom */
  #makeSide(view, lookFrom) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = this.#nameOf(view);
    button.addEventListener("click", () => lookFrom(view));
    button.addEventListener("focus", () => this.#focus(view));
    button.addEventListener("blur", () => this.#focus(undefined));
    return button;
  }

  /** @param {string | undefined} view */
  #focus(view) {
    this.#focused = view;
    this.#draw();
  }
}

/**
 * Where the top of a face's letter points: of the four ways along its edges, the one nearest upright on the screen.
 * @param {Vector} along one edge @param {Vector} normal of the face @returns {Vector}
 */
function nearestUpright(along, normal) {
  const across = cross(along, normal);
  const ways = [along, across, negative(along), negative(across)];
  const uprightness = (/** @type {Vector} */ [x, y]) => y / Math.hypot(x, y);
  return ways.reduce((best, way) => (uprightness(way) > uprightness(best) + TIE ? way : best));
}

/** @param {Vector} v @returns {Vector} */
function negative([x, y, z]) {
  return [-x, -y, -z];
}
