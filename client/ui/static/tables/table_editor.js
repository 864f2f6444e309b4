// @ts-check
// One shading table, edited by hand: points dragged over the data's histogram, drawn freehand, or typed.
//
// What a person does shows here at once and goes out through onChange, while it moves at most once for each frame of
// the screen and not settled, settled when it ends. The scene's own points come back through showPoints.
import { TableFields } from "./table_fields.js";
import { ENTRIES, channels, rounded, valueAt, valueOf, within } from "./table_numbers.js";
import { PencilStroke } from "./table_pencil.js";
import { TablePlot } from "./table_plot.js";
import { onValues } from "../viewport/value_event.js";

/** @typedef {import("./table_numbers.js").Point} Point */
/** @typedef {import("./table_numbers.js").Value} Value */
/** @typedef {import("./table_plot.js").Axis} Axis */
/** @typedef {{number: number, points: Point[], settled: boolean, freehand: boolean}} Change */

const LAST = ENTRIES - 1;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const POSITION_STEP = 1 / LAST; // of an arrow key; a tenth of it with Shift
const VALUE_STEP = 1 / 100;
const MOST_FILE_BYTES = 500_000;

export class TableEditor {
  /**
   * @param {HTMLElement} head  gets the title, what is under the pointer and the switches
   * @param {HTMLElement} body  gets the drawing and the fields
   * @param {{name: string, colour: boolean, onChange: (change: Change) => void, onSelect: (index: number) => void,
   *   onLoad: (file: {name: string, text: string}) => void}} options
   */
  constructor(head, body, options) {
    this.options = options;
    /** @type {Point[]} */
    this.points = [];
    this.selected = -1;
    this.pencil = false;
    /** @type {number | null} */
    this.hover = null;
    /** @type {Point[] | null} what the table was before the change that is not yet settled */
    this.before = null;
    /** @type {((event: PointerEvent) => void) | null} what a moving pointer does while it is held down */
    this.drag = null;
    this.adding = false; // whether that is held at a point that it has added
    this.sent = 0; // changes so far
    this.frame = 0; // the screen's frame in which a change goes out, or 0
    head.innerHTML = `<b></b><span class="vs-table-field"></span><output></output>
      <button type="button" name="log" aria-pressed="true" title="histogram on a logarithmic or linear scale">log</button>
      <button type="button" name="pencil" aria-pressed="false" title="draw freehand"><i class="material-icons">edit</i></button>`;
    this.head = head;
    this.body = body;
    this._inHead("b").textContent = options.name;
    for (const name of ["log", "pencil"])
      this._inHead(`[name=${name}]`).setAttribute("aria-label", `${options.name}: ${name === "log" ? "logarithmic histogram" : "draw freehand"}`);
    this.plot = new TablePlot(body, options.name, options.colour);
    this.fields = new TableFields(body, options.name, options.colour, {
      onPosition: (typed) => this._typePosition(typed),
      onValue: (value, settled) => this._setValue(value, settled),
      onRemove: () => this._remove(this.selected),
    });
    this._listen();
    this.closing = new AbortController();
    onValues((values) => this.plot.showTold(values), this.closing.signal);
    this.observer = new ResizeObserver(([{ contentRect }]) => {
      if (contentRect.width === 0) return; // the picture is alone
      this.plot.resize(contentRect.width, contentRect.height);
      this._draw();
    });
    this.observer.observe(this.plot.svg);
  }

  /**
   * Show the scene's points, unless they are being changed here or a change is still on its way.
   * @param {Point[]} points
   * @param {number} answers  the number of the last change of this editor that the scene has seen
   */
  showPoints(points, answers) {
    if (this.before || answers < this.sent) return;
    if (JSON.stringify(points) !== JSON.stringify(this.points)) this.fields.complain("");
    this.points = points.map(([position, value]) => [position, valueOf(value, [...channels(value)])]);
    if (this.selected >= points.length) this._select(-1);
    this._draw();
  }

  /**
   * @param {Axis} axis
   * @param {number[] | null} histogram
   * @param {string} unused  why the table changes nothing, or ""
   * @param {string} tint  the table over the same field whose colours the bars take, or ""
   */
  showField(axis, histogram, unused, tint) {
    this.plot.axis = axis;
    this.plot.histogram = histogram;
    this.plot.tint(tint);
    const field = this._inHead(".vs-table-field");
    field.textContent = unused ? unused : `by ${axis.label}${axis.unit ? ` (${axis.unit})` : ""}`;
    field.title = field.textContent;
    this.body.classList.toggle("vs-unused", Boolean(unused));
    this._draw();
  }

  /** Tell of bad input. @param {string} text */
  complain(text) {
    this.fields.complain(text);
  }

  /** Have the person choose a file, whose text goes to onLoad. */
  pickFile() {
    const input = document.createElement("input");
    input.type = "file";
    input.accept = ".toml,text/plain";
    input.addEventListener("change", async () => {
      const file = input.files?.[0];
      if (!file) return;
      if (file.size > MOST_FILE_BYTES) return this.complain(`${file.name} is too large for a table: ${file.size} bytes`);
      this.options.onLoad({ name: file.name, text: await file.text() });
    });
    input.click();
  }

  /** Take no more part in the page. */
  close() {
    this.observer.disconnect();
    this.closing.abort();
    this.fields.close();
    cancelAnimationFrame(this.frame);
  }

  /** @param {string} selector @returns {HTMLElement} */
  _inHead(selector) {
    return /** @type {HTMLElement} */ (this.head.querySelector(selector));
  }

  _listen() {
    const svg = this.plot.svg;
    svg.addEventListener("pointerdown", (event) => this._press(event));
    svg.addEventListener("pointermove", (event) => this._move(event));
    svg.addEventListener("pointerup", () => this._release());
    svg.addEventListener("pointercancel", () => this.adding && this._cancel());
    svg.addEventListener("lostpointercapture", () => this._release());
    svg.addEventListener("touchmove", (event) => this._keepFinger(event), { passive: false });
    svg.addEventListener("pointerleave", () => this._hoverAt(null));
    svg.addEventListener("dblclick", (event) => this._doubleClick(event));
    svg.addEventListener("contextmenu", (event) => {
      event.preventDefault();
      if (!this.pencil) this._remove(this.plot.pointAt(this.points, event.clientX, event.clientY));
    });
    svg.addEventListener("keydown", (event) => this._key(event));
    svg.addEventListener("keyup", (event) => event.key in ARROWS && this._settle());
    svg.addEventListener("focusout", () => !this.drag && this._settle());
    svg.addEventListener("focusin", (event) => this._select(this.plot.handles.indexOf(/** @type {SVGElement} */ (event.target))));
    this._inHead("[name=log]").addEventListener("click", (event) => {
      this.plot.logarithmic = this._toggle(event);
      this._inHead("[name=log]").textContent = this.plot.logarithmic ? "log" : "lin";
      this._draw();
    });
    this._inHead("[name=pencil]").addEventListener("click", (event) => {
      this.pencil = this._toggle(event);
      this._draw();
    });
  }

  /** @param {Event} event @returns {boolean} whether the button is on now */
  _toggle(event) {
    const button = /** @type {HTMLElement} */ (event.currentTarget);
    const on = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(on));
    return on;
  }

  // -- the pointer

  /** A finger on a point or the pencil does not scroll the panel; any other may, and then adds no point. @param {TouchEvent} event */
  _keepFinger(event) {
    if (this.drag && !this.adding) event.preventDefault();
  }

  /** @param {PointerEvent} event */
  _press(event) {
    this.fields.leave();
    if (event.button !== 0 || this.drag) return;
    this.adding = false;
    if (this.pencil) this._begin(event, this._drawing(event));
    else {
      let index = this.plot.pointAt(this.points, event.clientX, event.clientY);
      this.adding = index < 0 && this.plot.onLine(this.points, event.clientX, event.clientY);
      if (this.adding) index = this._add(event);
      if (index >= 0) this._begin(event, this._dragging(index));
      else this._select(-1);
    }
  }

  /** @param {PointerEvent} event @param {(event: PointerEvent) => void} drag */
  _begin(event, drag) {
    event.preventDefault(); // no text is selected
    this.plot.svg.setPointerCapture(event.pointerId);
    this.before ??= this.points;
    this.drag = drag;
    if (this.pencil) drag(event);
    else this.plot.handles[this.selected]?.focus({ preventScroll: true });
  }

  /** @param {PointerEvent} event */
  _move(event) {
    this._hoverAt(this.plot.positionAt(event.clientX));
    this.drag?.(event);
  }

  _release() {
    if (!this.drag) return;
    this.drag = null;
    this.adding = false;
    this._settle();
  }

  /** @param {number | null} hover */
  _hoverAt(hover) {
    this.hover = hover;
    this._draw();
  }

  /** @param {MouseEvent} event */
  _doubleClick(event) {
    if (this.pencil) return;
    const index = this.plot.pointAt(this.points, event.clientX, event.clientY);
    if (index < 0) {
      this.before ??= this.points;
      this._add(event);
      this._settle();
    } else if (this.options.colour) this.fields.pick();
  }

  /** What moving a point does: its neighbours bound it, Shift keeps its value. @param {number} index */
  _dragging(index) {
    this._select(index);
    return (/** @type {PointerEvent} */ event) => {
      const value = this.points[index][1];
      const keeps = event.shiftKey || typeof value !== "number";
      const moved = keeps ? value : rounded(this.plot.valueAt(event.clientY));
      this._set(index, [this._between(index, rounded(this.plot.positionAt(event.clientX))), moved], false);
    };
  }

  /** What drawing does. @param {PointerEvent} start */
  _drawing(start) {
    const stroke = new PencilStroke(this.points, this.plot, this.fields, start);
    this._select(-1);
    return (/** @type {PointerEvent} */ event) => this._change(stroke.continued(event));
  }

  // -- keys and typing

  /** @param {KeyboardEvent} event */
  _key(event) {
    if (event.key === "Escape" && this.before) return this._cancel();
    if (this.selected < 0 || this.drag) return;
    if (event.key === "Delete" || event.key === "Backspace") {
      event.preventDefault();
      event.stopPropagation();
      return this._remove(this.selected);
    }
    const arrow = ARROWS[/** @type {keyof typeof ARROWS} */ (event.key)];
    if (!arrow || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    const [position, value] = this.points[this.selected];
    const fine = event.shiftKey ? 0.1 : 1;
    const moved = this._between(this.selected, position + arrow[0] * POSITION_STEP * fine);
    const raised = typeof value === "number" ? within(0, rounded(value + arrow[1] * VALUE_STEP * fine), 1) : value;
    this._set(this.selected, [arrow[0] ? moved : position, raised], false);
  }

  /** Move the selected point to a value of the data. @param {number} typed @returns {string} what is wrong with it, or "" */
  _typePosition(typed) {
    const { low, high } = this.plot.axis;
    const [least, most] = this._bounds(this.selected);
    const half = (high - low) / LAST / 2; // texts are rounded to the table's entries
    const position = (typed - low) / (high - low);
    if (typed < low + least * (high - low) - half || typed > low + most * (high - low) + half)
      return `must lie between ${this.plot.dataText(least)} and ${this.plot.dataText(most)}`;
    this._set(this.selected, [within(least, position, most), this.points[this.selected][1]], true);
    return "";
  }

  // -- changes

  /** The positions of a point's neighbours, which bound it. @param {number} index @returns {[number, number]} */
  _bounds(index) {
    return [this.points[index - 1]?.[0] ?? 0, this.points[index + 1]?.[0] ?? 1];
  }

  /** @param {number} index @param {number} position */
  _between(index, position) {
    const [least, most] = this._bounds(index);
    return within(least, position, most);
  }

  /** Add a point under the pointer: on a line with its value, else at the pointer's. @param {MouseEvent} event @returns {number} */
  _add(event) {
    const position = rounded(this.plot.positionAt(event.clientX));
    const value = this.options.colour ? valueAt(this.points, position) : rounded(this.plot.valueAt(event.clientY));
    const after = this.points.findIndex(([at]) => at > position);
    const index = after < 0 ? this.points.length : after;
    this.before ??= this.points;
    this._change([...this.points.slice(0, index), [position, value], ...this.points.slice(index)]);
    this._select(index);
    return index;
  }

  /** @param {number} index */
  _remove(index) {
    if (index < 0 || !this.points[index] || this.drag) return;
    if (this.points.length === 1) return this.complain("a table needs at least one point");
    this._change(this.points.filter((_, n) => n !== index));
    this._select(Math.min(index, this.points.length - 1));
    this._settle();
    this.plot.handles[this.selected]?.focus({ preventScroll: true });
  }

  /** @param {number} index @param {Point} point @param {boolean} settled */
  _set(index, point, settled) {
    this._change(this.points.map((old, n) => (n === index ? point : old)));
    if (settled) this._settle();
  }

  /** Of the selected point, unless none is selected any more when what was picked for it ends. @param {Value} value @param {boolean} settled */
  _setValue(value, settled) {
    const point = this.points[this.selected];
    if (point) this._set(this.selected, [point[0], value], settled);
    else this._settle();
  }

  /** @param {Point[]} points */
  _change(points) {
    this.before ??= this.points;
    this.points = points;
    this.fields.complain("");
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      this._send(false);
    });
    this._draw();
  }

  /** Send the change that is under way as done. */
  _settle() {
    const changed = this.before && this.before !== this.points;
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.before = null;
    if (changed) this._send(true);
  }

  _cancel() {
    this.points = [.../** @type {Point[]} */ (this.before)];
    this.drag = null;
    this.adding = false;
    this._settle();
    this._select(Math.min(this.selected, this.points.length - 1));
  }

  /** @param {boolean} settled */
  _send(settled) {
    this.sent += 1;
    this.options.onChange({ number: this.sent, points: this.points, settled, freehand: this.pencil });
  }

  /** @param {number} index */
  _select(index) {
    if (index === this.selected) return;
    this.selected = index;
    this.fields.complain("");
    this.options.onSelect(index);
    this._draw();
  }

  _draw() {
    if (!this.points.length) return;
    this.plot.draw(this);
    const point = this.points[this.selected];
    this.fields.show(this.points, this.selected, point ? this.plot.dataText(point[0]) : "", this.pencil);
    this._inHead("output").textContent = this.hover === null ? "" : this.plot.readout(this.points, this.hover);
  }
}
