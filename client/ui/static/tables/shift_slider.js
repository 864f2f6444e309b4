// @ts-check
// A slider that pushes something along an axis for as long as it is held, and springs back when it is let go.
import { followHand } from "../controls/held_input.js";
import { ENTRIES, dataText } from "./table_numbers.js";

const REACH = ENTRIES - 1; // steps to either side
const STEP = 1 / (2 * REACH); // of the axis: of a key, and the least of the pointer

export class ShiftSlider {
  /** @param {HTMLElement} host @param {string} name @param {(by: number, settled: boolean) => void} onShift by a share of the axis */
  constructor(host, name, onShift) {
    host.innerHTML = `<input type="range" min="${-REACH}" max="${REACH}" ><output></output>`;
    this.slider = /** @type {HTMLInputElement} */ (host.firstElementChild);
    this.output = /** @type {HTMLOutputElement} */ (host.lastElementChild);
    this.slider.setAttribute("aria-label", name);
    this.length = 1;
    this.closing = new AbortController();
    const onMoved = (/** @type {boolean} */ settled) => {
      onShift(this._by, settled);
      if (settled) this.slider.value = "0";
      this._show();
    };
    followHand(this.slider, onMoved, this.closing.signal);
    this._show();
  }

  close() {
    this.closing.abort();
  }

  /** @param {number} length of the axis, in the data's units @param {boolean} enabled */
  showAxis(length, enabled) {
    this.length = length;
    this.slider.disabled = !enabled;
    this._show();
  }

  get _by() {
    return this.slider.valueAsNumber * STEP;
  }

  _show() {
    const by = this._by * this.length;
    this.output.textContent = (by > 0 ? "+" : "") + (by ? dataText(by, 0, this.length) : "0");
    this.slider.setAttribute("aria-valuetext", this.output.textContent);
  }
}
