// @ts-check
// The pencil: what one stroke over the drawing of a table makes of its 256 entries.
import { ENTRIES, entries, rounded } from "./table_numbers.js";

/** @typedef {import("./table_numbers.js").Point} Point */
/** @typedef {import("./table_numbers.js").Value} Value */

const CHANNELS = ["red", "green", "blue"];

export class PencilStroke {
  /**
   * @param {Point[]} points  the table before the stroke
   * @param {import("./table_plot.js").TablePlot} plot
   * @param {import("./table_fields.js").TableFields} fields  tell what the pencil changes of a colour
   * @param {PointerEvent} start
   */
  constructor(points, plot, fields, start) {
    this.plot = plot;
    this.fields = fields;
    this.entries = entries(points);
    this.onStrip = plot.onStrip(start.clientY);
    this.last = this._where(start);
  }

  /** The table after the pencil went on to where an event is: one point for each entry. @param {PointerEvent} event @returns {Point[]} */
  continued(event) {
    const now = this._where(event);
    const count = Math.abs(now.entry - this.last.entry);
    for (let n = 0; n <= count; n++) {
      const share = count ? n / count : 1;
      const entry = Math.round(this.last.entry + (now.entry - this.last.entry) * share);
      const height = this.last.height + (now.height - this.last.height) * share;
      this.entries[entry] = this._after(this.entries[entry], height);
    }
    this.last = now;
    return this.entries.map((value, n) => [n / (ENTRIES - 1), value]);
  }

  /** @param {PointerEvent} event */
  _where(event) {
    return {
      entry: Math.round(this.plot.positionAt(event.clientX) * (ENTRIES - 1)),
      height: rounded(this.plot.valueAt(event.clientY)),
    };
  }

  /** An entry after the pencil passed at a height 0..1. @param {Value} old @param {number} height @returns {Value} */
  _after(old, height) {
    if (typeof old === "number") return height;
    if (this.onStrip) return this.fields.painted;
    if (this.fields.drawn === "brightness") {
      const brightest = Math.max(...old);
      const [r, g, b] = old.map((channel) => (brightest > 0 ? channel / brightest : 1) * height);
      return [r, g, b];
    }
    const [r, g, b] = old.map((channel, n) => (CHANNELS[n] === this.fields.drawn ? height : channel));
    return [r, g, b];
  }
}
