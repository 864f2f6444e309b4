// @ts-check
// The drawing of one table: its curve, or its strip of colours, over the histogram of what indexes it.
import { ENTRIES, barHeights, channels, dataText, endText, hexOf, ticks, valueAt, within } from "./table_numbers.js";

/** @typedef {import("./table_numbers.js").Point} Point */
/** @typedef {import("../viewport/value_event.js").Values} Values */
/** @typedef {{field: string, label: string, low: number, high: number, unit: string}} Axis */
/** @typedef {{points: Point[], selected: number, pencil: boolean, hover: number | null}} State */

// Measures in pixels for text of 13 pixels; they grow with it.
const TEXT = 13;
const LEFT = 22; // for the scale 0..1
const RIGHT = 7;
const AXIS = 16;
const STRIP = { top: 1, height: 16, below: 10 }; // and what is free below it
const LOW_STRIP = { top: 1, height: 10, below: 5 }; // if the whole drawing is lower than LOW
const LOW = 92;
const TOP = 7; // where a plot without a strip begins
const RADIUS = { colour: 5, scalar: 4, crowded: 3 };
const GRAB = 10; // how near a pointer must come to a point
const LINE_GRAB = 6;
const TICK = 64; // the least room for one
const DIGIT = 6.5; // the width of one under the plot
const BETWEEN = 8; // two numbers there

const MOST_HANDLES = 64; // a table of more points is edited by drawing
const CROWD = 24; // points, from which they are drawn smaller

/** What a table's colours are called in the document, for the bars of another table's plot. @param {string} name */
const gradientOf = (name) => `vs-colours-${name}`;

export class TablePlot {
  /** @param {HTMLElement} parent @param {string} name @param {boolean} colour */
  constructor(parent, name, colour) {
    this.name = name;
    this.colour = colour;
    this.size = { width: 300, height: 100 };
    this.scale = 1;
    this.logarithmic = true;
    /** @type {Axis} */
    this.axis = { field: "", label: "", low: 0, high: 1, unit: "" };
    /** @type {number[] | null} */
    this.histogram = null;
    /** @type {Values | null} */
    this.told = null;
    this.gradient = gradientOf(name);
    // Chromium takes whatever SVG listens to the focus for a stop of Tab.
    this.svg = element("svg", { class: "vs-table-plot", role: "group", "aria-label": `${name}, drawn`, tabindex: -1 });
    this.svg.innerHTML = `
      <defs><linearGradient id="${this.gradient}"></linearGradient></defs>
      <g data-part="grid"></g><path data-part="histogram"></path><g data-part="axis"></g>
      <path data-part="area"></path><g data-part="lines"></g>
      <rect data-part="strip" rx="2" fill="url(#${this.gradient})"></rect>
      <line data-part="told" display="none"></line>
      <g data-part="pointer"><line></line><circle r="2.5"></circle></g><g data-part="points"></g>`;
    /** @type {Record<string, SVGElement>} */
    this.parts = {};
    for (const part of this.svg.querySelectorAll("[data-part]"))
      this.parts[/** @type {string} */ (part.getAttribute("data-part"))] = /** @type {SVGElement} */ (part);
    for (const channel of colour ? ["red", "green", "blue"] : ["only"])
      this.parts.lines.append(element("path", { "data-channel": channel }));
    if (!colour) this.parts.strip.remove();
    parent.append(this.svg);
  }

  /** Handles, in the order of the points; none while there are too many to grab. @returns {SVGElement[]} */
  get handles() {
    return /** @type {SVGElement[]} */ ([...this.parts.points.children]);
  }

  /** Fill a place in the page, in pixels. @param {number} width @param {number} height */
  resize(width, height) {
    this.size = { width, height };
    this.scale = parseFloat(getComputedStyle(this.svg).fontSize) / TEXT;
  }

  /** The table position under a place in the window. @param {number} clientX */
  positionAt(clientX) {
    const x = clientX - this.svg.getBoundingClientRect().left;
    return within(0, (x - this._left) / this._width, 1);
  }

  /** The value 0..1 under a place in the window. @param {number} clientY */
  valueAt(clientY) {
    const y = clientY - this.svg.getBoundingClientRect().top;
    return within(0, 1 - (y - this._top) / this._height, 1);
  }

  /** Whether a place in the window is on the strip of colours. @param {number} clientY */
  onStrip(clientY) {
    return this.colour && clientY - this.svg.getBoundingClientRect().top < this._top - 4 * this.scale;
  }

  /** The point under a place in the window, or -1; of two at one position the one on the pointer's side. */
  pointAt(/** @type {Point[]} */ points, /** @type {number} */ clientX, /** @type {number} */ clientY) {
    const box = this.svg.getBoundingClientRect();
    const [x, y] = [clientX - box.left, clientY - box.top];
    if (points.length > MOST_HANDLES) return -1;
    let best = -1;
    let nearest = GRAB * this.scale;
    points.forEach((point, n) => {
      const [px, py] = this._place(point);
      const away = this.colour && !this.onStrip(clientY) ? Infinity : Math.hypot(px - x, py - y);
      if (away < nearest || (best >= 0 && away === nearest && x > px)) [best, nearest] = [n, away];
    });
    return best;
  }

  /** Whether a place in the window is on what a click adds a point to: the line, or the strip. */
  onLine(/** @type {Point[]} */ points, /** @type {number} */ clientX, /** @type {number} */ clientY) {
    if (this.colour) return this.onStrip(clientY);
    const y = clientY - this.svg.getBoundingClientRect().top;
    const value = /** @type {number} */ (valueAt(points, this.positionAt(clientX)));
    return Math.abs(this._y(value) - y) < LINE_GRAB * this.scale;
  }

  /** @param {State} state */
  draw(state) {
    this.svg.setAttribute("viewBox", `0 0 ${this.size.width} ${this.size.height}`);
    this.svg.classList.toggle("vs-pencil", state.pencil);
    this._drawGrid();
    this._drawHistogram();
    this._drawCurve(state.points);
    this._drawPoints(state);
    this._drawPointer(state);
    this._drawTold();
  }

  /** Tint the bars with the colours of another table over the same field, or of none. @param {string} name */
  tint(name) {
    this.svg.classList.toggle("vs-tinted", name !== "");
    this.parts.histogram.style.fill = name && `url(#${gradientOf(name)})`;
  }

  /** Mark the value under the pointer in the image, if it is known. @param {Values | null} told */
  showTold(told) {
    this.told = told;
    this._drawTold();
  }

  /** Such as "1124 → 0.31". @param {Point[]} points @param {number} position */
  readout(points, position) {
    const value = valueAt(points, position);
    return `${this.dataText(position)} → ${typeof value === "number" ? value.toFixed(3) : hexOf(value)}`;
  }

  /** The data's value at a table position, as text. @param {number} position */
  dataText(position) {
    const { low, high } = this.axis;
    return dataText(low + position * (high - low), low, high);
  }

  get _left() {
    return LEFT * this.scale;
  }

  get _top() {
    const { top, height, below } = this._strip;
    return (this.colour ? top + height + below : TOP) * this.scale;
  }

  get _strip() {
    return this.size.height < LOW * this.scale ? LOW_STRIP : STRIP;
  }

  get _width() {
    return this.size.width - (LEFT + RIGHT) * this.scale;
  }

  get _height() {
    return this.size.height - AXIS * this.scale - this._top;
  }

  /** @param {number} position */
  _x(position) {
    return this._left + position * this._width;
  }

  /** @param {number} value */
  _y(value) {
    return this._top + (1 - value) * this._height;
  }

  /** @param {Point} point @returns {[number, number]} */
  _place([position, value]) {
    const { top, height } = this._strip;
    return [this._x(position), typeof value === "number" ? this._y(value) : (top + height / 2) * this.scale];
  }

  _drawGrid() {
    const [left, right] = [this._left, this._left + this._width];
    const px = this.scale;
    const rows = [0, 0.5, 1].map(
      (value) => `<line x1="${left}" x2="${right}" y1="${this._y(value)}" y2="${this._y(value)}"></line>
        <text x="${left - 5 * px}" y="${this._y(value) + 3.5 * px}" text-anchor="end">${value === 0.5 ? "½" : value}</text>`,
    );
    this.parts.grid.innerHTML = rows.join("");
    this._drawAxis(left, right);
  }

  /** Both ends of the axis, and between them round values if there is room. @param {number} left @param {number} right */
  _drawAxis(left, right) {
    const { low, high } = this.axis;
    const px = this.scale;
    const bottom = this._y(0);
    const text = (/** @type {number} */ x, /** @type {string} */ anchor, /** @type {string} */ said, end = "") =>
      `<text x="${x}" y="${bottom + 13.5 * px}" text-anchor="${anchor}"${end && ` data-end="${end}"`}>${said}</text>`;
    const [first, last] = [endText(low, low, high), endText(high, low, high)];
    const free = [left + (first.length * DIGIT + BETWEEN) * px, right - (last.length * DIGIT + BETWEEN) * px];
    const marks = ticks(low, high, Math.max(2, Math.floor(this._width / (TICK * px)))).map(({ value, text: said }) => {
      const x = this._x((value - low) / (high - low));
      const half = (said.length * DIGIT * px) / 2;
      const line = `<line x1="${x}" x2="${x}" y1="${bottom}" y2="${bottom + 4 * px}"></line>`;
      return line + (x - half > free[0] && x + half < free[1] ? text(x, "middle", said) : "");
    });
    this.parts.axis.innerHTML = marks.join("") + text(left, "start", first, "low") + text(right, "end", last, "high");
  }

  _drawHistogram() {
    const counts = this.histogram;
    if (!counts) return this.parts.histogram.setAttribute("d", "");
    const step = 1 / ENTRIES;
    const tops = barHeights(counts, this.logarithmic).map(
      (height, n) => `L${this._x(n * step)},${this._y(height)}L${this._x((n + 1) * step)},${this._y(height)}`,
    );
    this.parts.histogram.setAttribute("d", `M${this._x(0)},${this._y(0)}${tops.join("")}L${this._x(1)},${this._y(0)}Z`);
  }

  /** @param {Point[]} points */
  _drawCurve(points) {
    [...this.parts.lines.children].forEach((line, channel) => {
      const corners = points.map(([at, value]) => `${this._x(at)},${this._y(channels(value)[channel])}`);
      const [first, last] = [channels(points[0][1])[channel], channels(points[points.length - 1][1])[channel]];
      const path = `M${this._x(0)},${this._y(first)}L${corners.join("L")}L${this._x(1)},${this._y(last)}`;
      line.setAttribute("d", path);
      if (!this.colour) this.parts.area.setAttribute("d", `${path}L${this._x(1)},${this._y(0)}L${this._x(0)},${this._y(0)}Z`);
    });
    if (!this.colour) return;
    const { top, height } = this._strip;
    setAttributes(this.parts.strip, { x: this._x(0), y: top * this.scale, width: this._width, height: height * this.scale });
    const stops = points.map(([at, value]) => `<stop offset="${at}" stop-color="${hexOf(channels(value))}"></stop>`);
    /** @type {Element} */ (this.svg.querySelector("linearGradient")).innerHTML = stops.join("");
  }

  /** @param {State} state */
  _drawPoints({ points, selected, pencil }) {
    const shown = pencil || points.length > MOST_HANDLES ? [] : points;
    while (this.handles.length > shown.length) this.handles[this.handles.length - 1].remove();
    while (this.handles.length < shown.length)
      this.parts.points.append(element("circle", { class: this.colour ? "vs-stop" : "", role: "slider", tabindex: 0, "aria-valuemin": 0, "aria-valuemax": 1 }));
    const handles = this.handles;
    shown.forEach((point, n) => {
      const [x, y] = this._place(point);
      const [position, value] = point;
      setAttributes(handles[n], {
        cx: x,
        cy: y,
        r: this.scale * (shown.length > CROWD ? RADIUS.crowded : this.colour ? RADIUS.colour : RADIUS.scalar),
        "aria-label": `${this.name}, ${this.colour ? "colour" : "point"} ${n + 1} of ${points.length}`,
        "aria-valuenow": typeof value === "number" ? value : position,
        "aria-valuetext": `${this.dataText(position)} → ${typeof value === "number" ? value.toFixed(3) : hexOf(value)}`,
        "data-selected": n === selected,
      });
      if (typeof value !== "number") handles[n].style.fill = hexOf(value);
    });
  }

  _drawTold() {
    const { field, low, high } = this.axis;
    const value = this.told?.[field];
    this.parts.told.setAttribute("display", value === undefined ? "none" : "inline");
    if (value === undefined) return;
    const x = this._x(within(0, (value - low) / (high - low), 1));
    setAttributes(this.parts.told, { x1: x, x2: x, y1: this._top, y2: this._y(0) });
  }

  /** @param {State} state */
  _drawPointer({ points, hover }) {
    this.parts.pointer.style.display = hover === null ? "none" : "";
    if (hover === null) return;
    const [line, dot] = this.parts.pointer.children;
    const x = this._x(hover);
    setAttributes(line, { x1: x, x2: x, y1: this._top, y2: this._y(0) });
    const value = valueAt(points, hover);
    setAttributes(dot, { cx: x, cy: this._y(typeof value === "number" ? value : 2) });
  }
}

/** @param {string} tag @param {Record<string, unknown>} attributes @returns {SVGElement} */
function element(tag, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  setAttributes(made, attributes);
  return /** @type {SVGElement} */ (made);
}

/** @param {Element} target @param {Record<string, unknown>} attributes */
function setAttributes(target, attributes) {
  for (const [name, value] of Object.entries(attributes)) target.setAttribute(name, String(value));
}
