// @ts-check
// The row under a table: the selected point as numbers that can be typed, or what the pencil draws.
import { followHand } from "../controls/held_input.js";
import { colourOf, hexOf, numberOf } from "./table_numbers.js";

/** @typedef {import("./table_numbers.js").Point} Point */
/** @typedef {import("./table_numbers.js").Value} Value */
/** @typedef {"brightness" | "red" | "green" | "blue"} Drawn  what the pencil changes of a colour */

export class TableFields {
  /**
   * @param {HTMLElement} parent
   * @param {string} name
   * @param {boolean} colour
   * @param {{onPosition: (typed: number) => string, onValue: (value: Value, settled: boolean) => void, onRemove: () => void}} to
   *   onPosition answers with what is wrong with a typed position, or ""
   */
  constructor(parent, name, colour, to) {
    this.colour = colour;
    this.to = to;
    /** @type {Drawn} */
    this.drawn = "brightness";
    parent.insertAdjacentHTML("beforeend", colour ? rowHtml(name, COLOUR_FIELDS, COLOUR_PENCIL) : rowHtml(name, VALUE_FIELD, VALUE_PENCIL));
    this.row = /** @type {HTMLElement} */ (parent.lastElementChild);
    this.which = /** @type {HTMLElement} */ (this.row.querySelector(".vs-table-which"));
    this.alert = /** @type {HTMLElement} */ (this.row.querySelector("[role=alert]"));
    this.position = this._input("position");
    this.value = this._input("value");
    this.picker = colour ? this._input("picker") : null;
    this.paint = colour ? this._input("paint") : null;
    this.remove = /** @type {HTMLButtonElement} */ (this.row.querySelector("button[name=remove]"));
    this.closing = new AbortController();
    this.texts = { position: "", value: "" }; // what the scene has
    this._listen();
    this.show([], -1, "", false);
  }

  /** @param {Point[]} points @param {number} selected @param {string} positionText @param {boolean} pencil */
  show(points, selected, positionText, pencil) {
    const point = points[selected];
    this.row.dataset.mode = pencil ? "pencil" : point ? "point" : "hint";
    this.which.textContent = point ? `${selected + 1} of ${points.length}` : "";
    this.remove.disabled = points.length < 2;
    if (!point) return;
    const value = point[1];
    this.texts = { position: positionText, value: typeof value === "number" ? plainText(value) : hexOf(value) };
    for (const field of [this.position, this.value])
      if (!field.dataset.edited) field.value = field === this.position ? this.texts.position : this.texts.value;
    if (this.picker && document.activeElement !== this.picker) this.picker.value = this.texts.value;
  }

  /** Tell what is wrong, at the field if there is one; "" takes it away. @param {string} text @param {HTMLInputElement} [field] */
  complain(text, field) {
    this.alert.textContent = text;
    for (const one of [this.position, this.value]) one.setAttribute("aria-invalid", String(one === field && text !== ""));
  }

  /** The colour to paint on the strip. @returns {Value} */
  get painted() {
    return /** @type {Value} */ (colourOf(/** @type {HTMLInputElement} */ (this.paint).value));
  }

  close() {
    this.closing.abort();
  }

  /** Take what is being typed, for the point that it was typed for. */
  leave() {
    const active = document.activeElement;
    if (active instanceof HTMLElement && this.row.contains(active)) active.blur();
  }

  /** Open the browser's colours for the selected stop. */
  pick() {
    this.picker?.showPicker();
  }

  /** @param {string} name @returns {HTMLInputElement} */
  _input(name) {
    return /** @type {HTMLInputElement} */ (this.row.querySelector(`input[name=${name}]`));
  }

  _listen() {
    this._typed(this.position, () => {
      const typed = numberOf(this.position.value);
      return Number.isFinite(typed) ? this.to.onPosition(typed) : `“${this.position.value}” is not a number`;
    });
    this._typed(this.value, () => {
      const value = this.colour ? colourOf(this.value.value) : numberOf(this.value.value);
      if (this.colour && value === null) return `“${this.value.value}” is not a colour: type #rrggbb`;
      if (typeof value === "number" && !(value >= 0 && value <= 1)) return `“${this.value.value}” is not a number from 0 to 1`;
      this.to.onValue(/** @type {Value} */ (value), true);
      return "";
    });
    if (this.picker) this._follow(this.picker);
    this.remove.addEventListener("click", () => this.to.onRemove());
    for (const radio of this.row.querySelectorAll("input[type=radio]"))
      radio.addEventListener("change", () => (this.drawn = /** @type {Drawn} */ (/** @type {HTMLInputElement} */ (radio).value)));
  }

  /** @param {HTMLInputElement} picker */
  _follow(picker) {
    const onMoved = (/** @type {boolean} */ settled) => this.to.onValue(/** @type {Value} */ (colourOf(picker.value)), settled);
    followHand(picker, onMoved, this.closing.signal);
  }

  /** Take a field's text at Enter or on leaving; `take` answers with what is wrong with it. */
  _typed(/** @type {HTMLInputElement} */ field, /** @type {() => string} */ take) {
    const text = () => (field === this.position ? this.texts.position : this.texts.value);
    const commit = () => {
      if (!field.dataset.edited) return true;
      const wrong = take();
      this.complain(wrong, field);
      if (wrong === "") delete field.dataset.edited;
      return wrong === "";
    };
    field.addEventListener("input", () => {
      field.dataset.edited = "yes";
      this.complain("");
    });
    field.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.key === "Enter" && commit()) field.value = text();
      if (event.key === "Escape") {
        delete field.dataset.edited;
        field.value = text();
        this.complain("");
      }
    });
    field.addEventListener("blur", () => {
      commit();
      delete field.dataset.edited;
      field.value = text();
      field.setAttribute("aria-invalid", "false");
    });
  }
}

/** Up to four decimals. @param {number} value */
const plainText = (value) => String(Number(value.toFixed(4)));

const VALUE_FIELD = (/** @type {string} */ name) =>
  `<label>value <input name="value" inputmode="decimal" autocomplete="off" aria-label="${name}: value of the selected point, 0 to 1"></label>`;

const COLOUR_FIELDS = (/** @type {string} */ name) =>
  `<label>colour <input name="picker" type="color" aria-label="${name}: colour of the selected point"></label>
   <input name="value" class="vs-hex" autocomplete="off" spellcheck="false" aria-label="${name}: colour as #rrggbb">`;

const VALUE_PENCIL = () => `<span>Draw the curve over the histogram.</span>`;

const COLOUR_PENCIL = (/** @type {string} */ name) =>
  ["brightness", "red", "green", "blue"]
    .map(
      (drawn) => `<label class="vs-table-choice"><input type="radio" name="drawn ${name}" value="${drawn}"
        ${drawn === "brightness" ? "checked" : ""}><span data-channel="${drawn}">${drawn}</span></label>`,
    )
    .join("") + `<label class="vs-table-paint">strip <input name="paint" type="color" value="#ffffff" aria-label="${name}: colour to paint on the strip"></label>`;

/** @param {string} name @param {(name: string) => string} fields @param {(name: string) => string} pencil */
const rowHtml = (name, fields, pencil) => `
  <div class="vs-table-fields">
    <span data-mode="hint">Click ${fields === VALUE_FIELD ? "the line" : "the strip"} to add a point, drag to move it.</span>
    <span data-mode="point">
      <span class="vs-table-which"></span>
      <label>at <input name="position" inputmode="decimal" autocomplete="off" aria-label="${name}: position of the selected point, in the data's units"></label>
      ${fields(name)}
      <button name="remove" type="button" aria-label="${name}: remove the selected point" title="remove this point (Delete, or right-click)"><i class="material-icons">delete_outline</i></button>
    </span>
    <span data-mode="pencil">${pencil(name)}</span>
    <div role="alert"></div>
  </div>`;
