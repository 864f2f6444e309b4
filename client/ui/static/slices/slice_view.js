// One slice: its image, and over it the bounds, the point that all slices share, and what lies on each side. It is a slider
// as well, whose value is the slice that it shows.

import { onPixelRatio } from "../browser/pixel_ratio.js";
import { wheelPixels } from "../browser/wheel.js";
import { svg } from "../viewport/svg.js";
import { SliceGestures } from "./slice_gestures.js";

const MARGIN = 14; // CSS pixels about the grid, for the letters
const LETTER = { height: 12, width: 8 }; // CSS pixels, with the air about it
const HALF_ZOOM = 400; // wheel pixels that halve or double the zoom
const MOST_ZOOM = 64;
const KEY_ZOOM = 1.25;
const PINCH = 10; // a touchpad's pinch comes as a wheel of small steps with Ctrl
const NOTCH = 50; // wheel pixels of one slice of a touchpad; what comes at once of more is a wheel's own notch
const FAR = 10; // slices that PageUp and PageDown step
const AXES = "ijk";

/** @typedef {import("../viewport/camera.js").Point} Point */
/** @typedef {import("../viewport/rotation.js").Vector} Vector */
/** @typedef {import("../viewport/bounds_box.js").Bounds} Bounds */
/** @typedef {import("../viewport/viewport_messages.d.ts").SliceHeader} SliceHeader */
/** @typedef {import("./slice_layout.js").SliceLayout} SliceLayout */

/**
 * @typedef {Object} SliceListener
 * @property {(index: Vector) => void} go the shared point is to be this voxel
 * @property {(index: Vector | null) => void} hover the pointer is at this voxel, or away
 * @property {() => void} zoomed it may have room for more samples
 * @property {import("../measure/measuring.js").Measuring} measuring takes what is clicked while it is on
 */

export class SliceView {
  #layout;
  #listener;
  #canvas = document.createElement("canvas");
  #title = document.createElement("div");
  #wait = document.createElement("div");
  #bounds = svg("polygon", { class: "vs-slice-bounds" });
  #cross = [svg("line"), svg("line")];
  #measured = svg("g", { class: "vs-measured-lines" });
  #letters = ["left", "right", "top", "bottom"].map((side) => svg("text", { class: `vs-at-${side}` }));
  #image = /** @type {ImageBitmap | null} */ (null);
  #header = /** @type {SliceHeader | null} */ (null);
  #point = /** @type {Vector} */ ([0, 0, 0]);
  #box = /** @type {Bounds | null} */ (null);
  #size = { width: 0, height: 0 }; // of the element, CSS pixels
  #zoom = 1; // times larger than all of the grid fits
  #shift = /** @type {Point} */ ([0, 0]); // of what is in the middle, from the grid's middle, in physical units
  #turned = 0; // wheel pixels that have not made a slice yet
  #observer = new ResizeObserver(() => this.#place());
  #closing = new AbortController();

  /** @param {SliceLayout} layout @param {SliceListener} listener @param {string} name of the axis across */
  constructor(layout, listener, name) {
    this.#layout = layout;
    this.#listener = listener;
    this.#title.className = "vs-slice-title";
    this.#wait.className = "vs-slice-wait";
    const lines = svg("g", { class: "vs-slice-cross" }, this.#cross);
    const overlay = svg("svg", { class: "vs-slice-overlay", "aria-hidden": "true" }, [
      this.#bounds,
      lines,
      this.#measured,
      ...this.#letters,
    ]);
    this.element = document.createElement("div");
    this.element.className = `vs-slice vs-slice-${layout.view}`;
    this.element.tabIndex = 0;
    this.element.setAttribute("role", "slider");
    this.element.setAttribute("aria-label", [layout.plane, `slice across ${name}`].filter(Boolean).join(" "));
    this.element.setAttribute("aria-valuemin", "0");
    this.element.setAttribute("aria-valuemax", `${layout.dims[layout.axis] - 1}`);
    this.name = name;
    this.element.append(this.#canvas, overlay, this.#title, this.#wait);
    this.#listen();
    this.#observer.observe(this.element);
    this.#observer.observe(this.#title);
    onPixelRatio(() => this.#redraw(), this.#closing.signal);
  }

  remove() {
    this.#observer.disconnect();
    this.#closing.abort();
    this.#image?.close();
    this.element.remove();
  }

  /** The samples along a side that there is room for. */
  get room() {
    const fits = Math.ceil(Math.max(this.#size.width, this.#size.height) * window.devicePixelRatio);
    return Math.max(fits, Math.min(Math.ceil(fits * this.#zoom), Math.max(...this.#layout.size)));
  }

  /** @param {SliceHeader} header @param {ImageBitmap} image */
  show(header, image) {
    this.#image?.close();
    this.#image = image;
    this.#header = header;
    this.element.dataset.shown = `${header.index}`;
    this.#tell();
    this.#draw();
  }

  /** The voxel that all slices go through. @returns {Vector} */
  get point() {
    return this.#point;
  }

  /** @param {Vector} point the voxel that all slices go through */
  set point(point) {
    this.#point = point;
    this.#tell();
    this.#place();
  }

  /** @param {Bounds} bounds */
  set bounds(bounds) {
    this.#box = bounds;
    this.#place();
  }

  /** Where a voxel's middle is in the element. @param {Vector} index @returns {Point} */
  inElement(index) {
    const [a, b] = this.#layout.sides;
    return this.#fromPlane(this.#layout.at(index[a], index[b]));
  }

  /** Points in other slices are drawn fainter. */
  drawMeasured() {
    const { axis } = this.#layout;
    const near = (/** @type {Vector} */ point) => Math.round(point[axis]) === this.#point[axis];
    this.#listener.measuring.draw(this.#measured, (point) => ({ at: this.inElement(point), near: near(point) }));
  }

  #tell() {
    const { axis, dims, plane } = this.#layout;
    const [index, last] = [this.#point[axis], dims[axis] - 1];
    const missing = this.#header?.missing ? " – a part is missing" : "";
    this.#title.textContent = `${[plane, `${this.name} ${index}`].filter(Boolean).join(" · ")} / ${last}${missing}`;
    this.element.setAttribute("aria-valuenow", `${index}`);
    this.element.setAttribute("aria-valuetext", `${AXES[axis]} ${index} of ${last}${missing}`);
    this.#wait.hidden = this.#header?.index === index;
  }

  #listen() {
    const { element } = this;
    new SliceGestures(this, this.#listener);
    element.addEventListener("dblclick", () => this.#listener.measuring.on || this.#look(1, [0, 0]));
    element.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    element.addEventListener("keydown", (event) => this.#key(event));
  }

  #wheel(event) {
    event.preventDefault();
    const pixels = wheelPixels(event, this.element);
    if (event.ctrlKey || event.metaKey) {
      const zoomed = pixels * (Math.abs(pixels) < NOTCH ? PINCH : 1);
      return this.move(this.at(event), this.at(event), 2 ** (-zoomed / HALF_ZOOM));
    }
    this.#step(this.#slicesOf(event, pixels));
  }

  /** How many slices a turn of the wheel steps: one for each notch, and of a touchpad as far as its small steps add up. */
  #slicesOf(event, pixels) {
    if (event.deltaMode !== WheelEvent.DOM_DELTA_PIXEL || Math.abs(pixels) >= NOTCH) {
      this.#turned = 0;
      return -Math.sign(pixels);
    }
    this.#turned -= pixels;
    const slices = Math.trunc(this.#turned / NOTCH);
    this.#turned -= slices * NOTCH;
    return slices;
  }

  #key(event) {
    const last = this.#layout.dims[this.#layout.axis] - 1;
    const steps = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: FAR, PageDown: -FAR, Home: -last, End: last };
    if (event.key === "Enter" && this.#listener.measuring.on) return this.#listener.measuring.add(this.#point);
    const zooms = { "+": KEY_ZOOM, "=": KEY_ZOOM, "-": 1 / KEY_ZOOM };
    const known = Object.hasOwn(steps, event.key) || Object.hasOwn(zooms, event.key) || event.key === "0";
    if (event.ctrlKey || event.altKey || event.metaKey || !known) return;
    event.preventDefault();
    event.stopPropagation(); // the viewport's own keys do not hear of it
    const crossing = this.inElement(this.#point);
    if (event.key === "0") this.#look(1, [0, 0]);
    else if (Object.hasOwn(zooms, event.key)) this.move(crossing, crossing, zooms[event.key]);
    else this.#step(steps[event.key]);
  }

  // -- zooming and moving

  /** What lies at one place of the element comes to another, and is so many times larger. @param {Point} from @param {Point} to @param {number} factor */
  move(from, to, factor = 1) {
    const zoom = Math.min(Math.max(this.#zoom * factor, 1), MOST_ZOOM);
    const [[x, y], [toX, toY]] = [this.#toPlane(from), this.#toPlane(to)];
    const [middle, kept] = [this.#frame, this.#zoom / zoom];
    const [right, up] = [x + (middle.x - toX) * kept, y + (middle.y - toY) * kept];
    this.#look(zoom, [right - middle.x + this.#shift[0], up - middle.y + this.#shift[1]]);
  }

  /** The grid covers the middle, and where it is not enlarged it stays in the middle. @param {number} zoom @param {Point} shift */
  #look(zoom, [right, up]) {
    const corners = this.#layout.corners();
    const most = [0, 1].map((n) => {
      const all = corners.map((corner) => corner[n]);
      return ((Math.max(...all) - Math.min(...all)) / 2) * (1 - 1 / zoom);
    });
    this.#zoom = zoom;
    this.#shift = [Math.min(Math.max(right, -most[0]), most[0]), Math.min(Math.max(up, -most[1]), most[1])];
    this.element.dataset.zoom = zoom.toFixed(3);
    this.#place();
    this.#redraw();
  }

  #redraw() {
    this.#draw();
    this.#listener.zoomed();
  }

  /** Where an event is in the element. @param {MouseEvent} event @returns {Point} */
  at(event) {
    const { left, top } = this.element.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  }

  #step(slices) {
    if (slices !== 0) this.#listener.go(this.#within(this.#point.map((n, axis) => (axis === this.#layout.axis ? n + slices : n))));
  }

  /** The place in the grid under an event, which may lie between voxels. @param {MouseEvent} event @returns {Vector} */
  placeAt(event) {
    const found = [...this.#point];
    const along = this.#layout.indexAt(this.#toPlane(this.at(event)));
    this.#layout.sides.forEach((side, n) => (found[side] = along[n]));
    return this.#within(found);
  }

  /** Whether an event is over the slice. @param {MouseEvent} event */
  isInside(event) {
    const along = this.#layout.indexAt(this.#toPlane(this.at(event)));
    return along.every((n, side) => n >= -0.5 && n < this.#layout.size[side] - 0.5);
  }

  /** @param {number[]} index @returns {Vector} */
  #within(index) {
    return /** @type {Vector} */ (index.map((n, axis) => Math.min(Math.max(n, 0), this.#layout.dims[axis] - 1)));
  }

  // -- where things are

  /** CSS pixels for a physical unit, and what is in the middle of the element. */
  get #frame() {
    const corners = this.#layout.corners();
    const [xs, ys] = [0, 1].map((n) => corners.map((corner) => corner[n]));
    const extent = (/** @type {number[]} */ all) => Math.max(...all) - Math.min(...all);
    const middle = (/** @type {number[]} */ all) => (Math.max(...all) + Math.min(...all)) / 2;
    const { width, height } = this.#size;
    const room = (/** @type {number} */ side) => Math.max(side - 2 * MARGIN, 1);
    const scale = this.#zoom * Math.min(room(width) / extent(xs), room(height) / extent(ys));
    return { scale, x: middle(xs) + this.#shift[0], y: middle(ys) + this.#shift[1] };
  }

  /** @param {Point} at @returns {Point} */
  #fromPlane([x, y]) {
    const frame = this.#frame;
    return [this.#size.width / 2 + (x - frame.x) * frame.scale, this.#size.height / 2 - (y - frame.y) * frame.scale];
  }

  /** @param {Point} at @returns {Point} */
  #toPlane([x, y]) {
    const frame = this.#frame;
    return [(x - this.#size.width / 2) / frame.scale + frame.x, (this.#size.height / 2 - y) / frame.scale + frame.y];
  }

  #place() {
    const { width, height } = { width: this.element.clientWidth, height: this.element.clientHeight };
    const resized = width !== this.#size.width || height !== this.#size.height;
    if (width === 0 || height === 0) return; // not on the screen
    this.#size = { width, height };
    this.#placeLetters(width, height);
    const [a, b] = this.#layout.sides;
    const [along, down] = this.#layout.size;
    const ends = (/** @type {[Point, Point]} */ pair) => pair.map(([p, q]) => this.#fromPlane(this.#layout.at(p, q)));
    place(this.#cross[0], ends([[this.#point[a], -0.5], [this.#point[a], down - 0.5]]));
    place(this.#cross[1], ends([[-0.5, this.#point[b]], [along - 0.5, this.#point[b]]]));
    if (this.#box !== null) {
      const { low, high } = this.#box;
      const corners = this.#layout.corners([low[a], low[b]], [high[a], high[b]]);
      const points = corners.map((corner) => this.#fromPlane(corner).map((n) => n.toFixed(1)).join(","));
      this.#bounds.setAttribute("points", points.join(" "));
      const { axis } = this.#layout;
      this.#bounds.classList.toggle("vs-outside", this.#point[axis] < low[axis] || this.#point[axis] >= high[axis]);
    }
    this.drawMeasured();
    if (resized) this.#draw();
  }

  #placeLetters(width, height) {
    const { left, right, top, bottom } = this.#layout.letters;
    const { offsetLeft, offsetTop, offsetWidth, offsetHeight } = this.#title;
    const besideTitle = offsetLeft + offsetWidth + (top.length * LETTER.width) / 2 <= width / 2;
    const places = [
      [left, 3, height / 2],
      [right, width - 3, height / 2],
      [top, width / 2, (besideTitle ? 0 : offsetTop + offsetHeight) + LETTER.height],
      [bottom, width / 2, height - 4],
    ];
    places.forEach(([letter, x, y], n) => {
      this.#letters[n].textContent = `${letter}`;
      this.#letters[n].setAttribute("x", `${x}`);
      this.#letters[n].setAttribute("y", `${y}`);
    });
  }

  #draw() {
    const pixels = window.devicePixelRatio;
    const [width, height] = [this.#size.width, this.#size.height].map((side) => Math.round(side * pixels));
    if (this.#image === null || this.#header === null || width === 0) return;
    this.#canvas.width = width; // clears it
    this.#canvas.height = height;
    const context = this.#canvas.getContext("2d");
    const [[ax, ay], [bx, by]] = this.#layout.steps;
    const [right, down] = this.#header.step;
    const scale = this.#frame.scale * pixels;
    const [x, y] = this.#fromPlane(this.#layout.at(-0.5, -0.5));
    const matrix = [ax * right, -ay * right, bx * down, -by * down].map((part) => part * scale);
    context.imageSmoothingEnabled = Math.hypot(matrix[0], matrix[1]) < 1;
    context.setTransform(matrix[0], matrix[1], matrix[2], matrix[3], x * pixels, y * pixels);
    context.drawImage(this.#image, 0, 0);
  }
}

/** @param {SVGElement} line @param {Point[]} ends */
function place(line, [[x1, y1], [x2, y2]]) {
  for (const [key, value] of Object.entries({ x1, y1, x2, y2 })) line.setAttribute(key, value.toFixed(1));
}
