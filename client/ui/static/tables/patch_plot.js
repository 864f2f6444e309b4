// @ts-check
// The drawing of patches over the 2-D histogram, with the data's units along both axes.
import { dataText, endText, hexOf, ticks, within } from "./table_numbers.js";
import { HANDLES, coreOf, cornersOf, placeOf } from "./patch_shapes.js";

/** @typedef {import("./patch_shapes.js").Patch} Patch */
/** @typedef {import("./table_plot.js").Axis} Axis */
/** @typedef {import("../viewport/value_event.js").Values} Values */

// Measures in pixels for text of 13 pixels; they grow with it.
const TEXT = 13;
const LEFT = 14; // for the name of the upright axis
const RIGHT = 7;
const TOP = 7;
const AXIS = 28; // the numbers, and the name below them
const TICK = 64; // the least room for one
const RADIUS = 4.5;
const LEAST_FILL = 0.12;

export class PatchPlot {
  /** @param {HTMLElement} parent */
  constructor(parent) {
    this.size = { width: 280, height: 200 };
    this.scale = 1;
    /** @type {{across: Axis, up: Axis}} */
    this.axes = { across: { field: "", label: "", low: 0, high: 1, unit: "" }, up: { field: "", label: "", low: 0, high: 1, unit: "" } };
    parent.insertAdjacentHTML("beforeend", `
      <div class="vs-plane-plot"><canvas aria-hidden="true"></canvas>
        <svg role="group" tabindex="-1">
          <rect data-part="frame"></rect><g data-part="axes"></g><g data-part="patches"></g><g data-part="handles"></g>
          <circle data-part="told" display="none"></circle>
        </svg></div>`);
    this.box = /** @type {HTMLElement} */ (parent.lastElementChild);
    this.canvas = /** @type {HTMLCanvasElement} */ (this.box.querySelector("canvas"));
    this.svg = /** @type {SVGSVGElement} */ (this.box.querySelector("svg"));
    /** @type {Record<string, SVGElement>} */
    this.parts = {};
    for (const part of this.svg.querySelectorAll("[data-part]"))
      this.parts[/** @type {string} */ (part.getAttribute("data-part"))] = /** @type {SVGElement} */ (part);
  }

  /** Fill a place in the page, in pixels. @param {number} width @param {number} height */
  resize(width, height) {
    this.size = { width, height };
    this.scale = parseFloat(getComputedStyle(this.svg).fontSize) / TEXT;
    const [left, top] = [this._x(0), this._y(1)];
    Object.assign(this.canvas.style, {
      left: `${left}px`, top: `${top}px`, width: `${this._x(1) - left}px`, height: `${this._y(0) - top}px`,
    });
  }

  /** How full each place is, a byte each: `side` in a row, from density and strength 0 on. @param {Uint8Array} levels @param {number} side */
  showCounts(levels, side) {
    this.canvas.width = this.canvas.height = side;
    const context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    const image = context.createImageData(side, side);
    levels.forEach((level, n) => {
      const at = 4 * ((side - 1 - Math.floor(n / side)) * side + (n % side));
      image.data.set([128, 136, 146, level], at); // grey that shows in either theme
    });
    context.putImageData(image, 0, 0);
  }

  /** Density and strength under a place in the window. @param {number} clientX @param {number} clientY @returns {[number, number]} */
  placeAt(clientX, clientY) {
    const { left, top } = this.svg.getBoundingClientRect();
    const across = (clientX - left - this._x(0)) / (this._x(1) - this._x(0));
    const up = (clientY - top - this._y(0)) / (this._y(1) - this._y(0));
    return [within(0, across, 1), within(0, up, 1)];
  }

  /** Such as "1124 and 210". @param {number} density @param {number} strength */
  textOf(density, strength) {
    return `${this.valueText(this.axes.across, density)} and ${this.valueText(this.axes.up, strength)}`;
  }

  /** The data's value at a position of an axis. @param {Axis} axis @param {number} position */
  valueText({ low, high }, position) {
    return dataText(low + position * (high - low), low, high);
  }

  /** @param {Patch[]} patches @param {number} selected */
  draw(patches, selected) {
    this.svg.setAttribute("viewBox", `0 0 ${this.size.width} ${this.size.height}`);
    setAttributes(this.parts.frame, { x: this._x(0), y: this._y(1), width: this._x(1) - this._x(0), height: this._y(0) - this._y(1) });
    this._drawAxes();
    this._drawPatches(patches, selected);
    this._drawHandles(patches, selected);
  }

  /** Mark what is under the pointer in the image, if it is known. @param {Values | null} told */
  showTold(told) {
    const { across, up } = this.axes;
    const [density, strength] = [told?.[across.field], told?.[up.field]];
    const known = density !== undefined && strength !== undefined;
    this.parts.told.setAttribute("display", known ? "inline" : "none");
    if (!known) return;
    const [x, y] = [[density, across], [strength, up]].map(([value, axis]) => {
      const { low, high } = /** @type {Axis} */ (axis);
      return within(0, (/** @type {number} */ (value) - low) / (high - low), 1);
    });
    setAttributes(this.parts.told, { cx: this._x(x), cy: this._y(y), r: 3 * this.scale });
  }

  /** @param {number} density */
  _x(density) {
    const left = LEFT * this.scale;
    return left + density * (this.size.width - left - RIGHT * this.scale);
  }

  /** @param {number} strength */
  _y(strength) {
    const top = TOP * this.scale;
    return top + (1 - strength) * (this.size.height - top - AXIS * this.scale);
  }

  _drawAxes() {
    const px = this.scale;
    const { across, up } = this.axes;
    this.svg.setAttribute("aria-label", `patches over ${across.label} and ${up.label}`);
    const [left, right, bottom, top] = [this._x(0), this._x(1), this._y(0), this._y(1)];
    const text = (/** @type {number} */ x, /** @type {number} */ y, /** @type {string} */ anchor, /** @type {string} */ said, more = "") =>
      `<text x="${x}" y="${y}" text-anchor="${anchor}"${more}>${escaped(said)}</text>`;
    const ends = [endText(across.low, across.low, across.high), endText(across.high, across.low, across.high)];
    const marks = ticks(across.low, across.high, Math.max(2, Math.floor((right - left) / (TICK * px)))).map(({ value, text: said }) => {
      const x = this._x((value - across.low) / (across.high - across.low));
      const room = 7 * px * (Math.max(...ends.map((end) => end.length)) + said.length / 2);
      const number = x - left > room && right - x > room ? text(x, bottom + 12 * px, "middle", said) : "";
      return `<line x1="${x}" x2="${x}" y1="${bottom}" y2="${bottom + 3 * px}"></line>${number}`;
    });
    const turned = ` transform="rotate(-90 ${10 * px} ${(top + bottom) / 2})"`;
    this.parts.axes.innerHTML = [
      ...marks,
      text(left, bottom + 12 * px, "start", ends[0]),
      text(right, bottom + 12 * px, "end", ends[1]),
      text((left + right) / 2, bottom + 25 * px, "middle", titled(across)),
      text(10 * px, (top + bottom) / 2, "middle", `${titled(up)}, to ${endText(up.high, up.low, up.high)}`, turned),
    ].join("");
  }

  /** @param {Patch[]} patches @param {number} selected */
  _drawPatches(patches, selected) {
    const group = this.parts.patches;
    while (group.children.length > patches.length) group.lastElementChild?.remove();
    while (group.children.length < patches.length)
      group.append(element("g", { role: "button", tabindex: 0 }, element("polygon", { class: "vs-patch" }), element("polygon", { class: "vs-core" })));
    patches.forEach((patch, n) => {
      const one = group.children[n];
      const [[left, low], , [right, high]] = [cornersOf(patch)[0], 0, cornersOf(patch)[2]];
      setAttributes(one, {
        "aria-label": `patch ${n + 1} of ${patches.length}: from ${this.textOf(left, low)} to ${this.textOf(right, high)}`,
        "aria-pressed": n === selected,
      });
      [cornersOf(patch), coreOf(patch)].forEach((corners, part) => {
        const shape = /** @type {SVGElement} */ (one.children[part]);
        shape.setAttribute("points", corners.map(([x, y]) => `${this._x(x)},${this._y(y)}`).join(" "));
        shape.style.fill = shownColour(patch);
        shape.style.fillOpacity = String((LEAST_FILL + (1 - LEAST_FILL) * patch.opacity) / 2);
      });
    });
  }

  /** @param {Patch[]} patches @param {number} selected */
  _drawHandles(patches, selected) {
    const group = this.parts.handles;
    const patch = patches[selected];
    while (group.children.length > (patch ? HANDLES.length : 0)) group.lastElementChild?.remove();
    if (!patch) return;
    while (group.children.length < HANDLES.length)
      group.append(element("circle", { role: "slider", tabindex: 0, "aria-valuemin": 0, "aria-valuemax": 1 }));
    HANDLES.forEach((handle, n) => {
      const [density, strength] = placeOf(patch, handle);
      setAttributes(group.children[n], {
        cx: this._x(density), cy: this._y(strength), r: RADIUS * this.scale,
        "aria-label": `patch ${selected + 1}, ${handle}`,
        "aria-valuenow": density,
        "aria-valuetext": this.textOf(density, strength),
      });
    });
  }
}

/** What a patch looks like: what it gives off and reflects. @param {Patch} patch */
const shownColour = ({ emit, refl }) => hexOf(emit.map((channel, n) => Math.min(channel + refl[n], 1)));

/** @param {Axis} axis */
const titled = ({ label, unit }) => (unit ? `${label} (${unit})` : label);

/** @param {string} text */
const escaped = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;");

/** @param {string} tag @param {Record<string, unknown>} attributes @param {SVGElement[]} children @returns {SVGElement} */
function element(tag, attributes, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  setAttributes(made, attributes);
  made.append(...children);
  return /** @type {SVGElement} */ (made);
}

/** @param {Element} target @param {Record<string, unknown>} attributes */
function setAttributes(target, attributes) {
  for (const [name, value] of Object.entries(attributes)) target.setAttribute(name, String(value));
}
