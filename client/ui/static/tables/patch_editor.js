// @ts-check
// The scene's 2-D table, edited by hand: patches moved, stretched, coloured, added and taken away over the 2-D histogram.
//
// What a person does shows here at once and goes out through onChange, while it moves at most once for each frame of
// the screen and not settled, settled when it ends.
import { followHand } from "../controls/held_input.js";
import { colourOf, hexOf } from "./table_numbers.js";
import { PatchPlot } from "./patch_plot.js";
import { HANDLES, STEP, added, moved, placeOf, stretched } from "./patch_shapes.js";
import { onValues } from "../viewport/value_event.js";

/** @typedef {import("./patch_shapes.js").Patch} Patch */
/** @typedef {import("./table_plot.js").Axis} Axis */
/** @typedef {import("./patch_shapes.js").Handle} Handle */

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const NUMBERS = /** @type {const} */ (["opacity", "soft"]);
const COLOURS = /** @type {const} */ (["refl", "emit"]);

export class PatchEditor {
  /**
   * @param {HTMLElement} root
   * @param {{onChange: (patches: Patch[], settled: boolean) => void, onSeen: () => void}} to
   *   onSeen hears when the drawing comes into sight
   */
  constructor(root, to) {
    this.to = to;
    /** @type {Patch[]} */
    this.patches = [];
    this.selected = -1;
    /** @type {Patch[] | null} what there was before the change that is not yet settled */
    this.before = null;
    /** @type {Patch[] | null} what was told meanwhile */
    this.told = null;
    /** @type {((event: PointerEvent) => void) | null} */
    this.drag = null;
    this.frame = 0; // the screen's frame in which a change goes out, or 0
    root.innerHTML = HEAD;
    this.root = root;
    this.plot = new PatchPlot(root);
    root.insertAdjacentHTML("beforeend", FIELDS);
    this.fields = this._find(".vs-plane-fields");
    this.closing = new AbortController();
    this._listen();
    onValues((values) => this.plot.showTold(values), this.closing.signal);
    this.resized = new ResizeObserver(([{ contentRect }]) => {
      if (contentRect.width === 0) return;
      this.plot.resize(contentRect.width, contentRect.height);
      this._draw();
    });
    this.resized.observe(this.plot.box);
    this.seen = new IntersectionObserver((entries) => entries.some((entry) => entry.isIntersecting) && this.to.onSeen());
    this.seen.observe(this.plot.box);
  }

  /** Show the scene's; while a hand is at them, once it lets go without having changed any. @param {Patch[]} patches */
  show(patches) {
    this.told = this.before && patches;
    if (this.before) return;
    this.patches = patches;
    if (this.selected >= patches.length) this.selected = -1;
    this._draw();
  }

  /** @param {{across: Axis, up: Axis}} axes */
  showAxes(axes) {
    this.plot.axes = axes;
    this._draw();
  }

  /** @param {string} levels  bytes in base64, `side` in a row @param {number} side */
  showCounts(levels, side) {
    this.plot.showCounts(Uint8Array.from(atob(levels), (letter) => letter.charCodeAt(0)), side);
    this.root.dataset.counted = "yes";
  }

  close() {
    this.resized.disconnect();
    this.seen.disconnect();
    this.closing.abort();
    cancelAnimationFrame(this.frame);
  }

  /** @param {string} selector @returns {HTMLElement} */
  _find(selector) {
    return /** @type {HTMLElement} */ (this.root.querySelector(selector));
  }

  /** @param {string} name @returns {HTMLInputElement} */
  _input(name) {
    return /** @type {HTMLInputElement} */ (this.fields.querySelector(`[name=${name}]`));
  }

  _listen() {
    const svg = this.plot.svg;
    svg.addEventListener("pointerdown", (event) => this._press(event));
    svg.addEventListener("pointermove", (event) => {
      this._readOut(event);
      this.drag?.(event);
    });
    svg.addEventListener("pointerup", () => this._release());
    svg.addEventListener("lostpointercapture", () => this._release());
    // A finger on a patch moves that, any other scrolls the panel.
    svg.addEventListener("touchmove", (event) => this.drag && event.preventDefault(), { passive: false });
    svg.addEventListener("pointerleave", () => (this._find("output").textContent = ""));
    svg.addEventListener("keydown", (event) => this._key(event));
    svg.addEventListener("keyup", (event) => event.key in ARROWS && this._settle());
    svg.addEventListener("focusout", () => !this.drag && this._settle());
    svg.addEventListener("focusin", (event) => {
      const patch = [...this.plot.parts.patches.children].indexOf(/** @type {Element} */ (event.target));
      if (patch >= 0) this._select(patch);
    });
    this._find("[name=add]").addEventListener("click", () => this._add());
    this._find("[name=remove]").addEventListener("click", () => this._remove());
    for (const name of NUMBERS) this._follow(name, Number);
    for (const name of COLOURS) this._follow(name, colourOf);
  }

  /** @param {string} name @param {(text: string) => unknown} valueOf */
  _follow(name, valueOf) {
    const input = this._input(name);
    followHand(input, (settled) => this._put({ [name]: valueOf(input.value) }, settled), this.closing.signal);
  }

  // -- the pointer

  /** @param {PointerEvent} event */
  _press(event) {
    if (event.button !== 0 || this.drag) return;
    const target = /** @type {Element} */ (event.target);
    const handle = [...this.plot.parts.handles.children].indexOf(target);
    const group = target.closest("[data-part=patches] > g");
    const patch = group ? [...this.plot.parts.patches.children].indexOf(group) : -1;
    if (handle >= 0) this._begin(event, this._stretching(HANDLES[handle]), /** @type {SVGElement} */ (target));
    else if (patch >= 0) {
      this._select(patch);
      this._begin(event, this._moving(event), /** @type {SVGElement} */ (group));
    } else this._select(-1);
  }

  /** @param {PointerEvent} event @param {(event: PointerEvent) => void} drag @param {SVGElement} focused */
  _begin(event, drag, focused) {
    event.preventDefault(); // no text is selected
    this.plot.svg.setPointerCapture(event.pointerId);
    this.before = this.patches;
    this.drag = drag;
    focused.focus({ preventScroll: true });
  }

  /** @param {PointerEvent} start */
  _moving(start) {
    const patch = this.patches[this.selected];
    const [x, y] = this.plot.placeAt(start.clientX, start.clientY);
    return (/** @type {PointerEvent} */ event) => {
      const [density, strength] = this.plot.placeAt(event.clientX, event.clientY);
      this._change(moved(patch, density - x, strength - y));
    };
  }

  /** @param {Handle} handle */
  _stretching(handle) {
    return (/** @type {PointerEvent} */ event) =>
      this._change(stretched(this.patches[this.selected], handle, ...this.plot.placeAt(event.clientX, event.clientY)));
  }

  _release() {
    if (!this.drag) return;
    this.drag = null;
    this._settle();
  }

  /** @param {PointerEvent} event */
  _readOut(event) {
    this._find("output").textContent = this.plot.textOf(...this.plot.placeAt(event.clientX, event.clientY));
  }

  // -- keys

  /** @param {KeyboardEvent} event */
  _key(event) {
    if (event.key === "Escape" && this.before) return this._cancel();
    const patch = this.patches[this.selected];
    if (!patch || this.drag) return;
    if (event.key === "Delete" || event.key === "Backspace") {
      event.preventDefault();
      event.stopPropagation();
      return this._remove();
    }
    const arrow = ARROWS[/** @type {keyof typeof ARROWS} */ (event.key)];
    if (!arrow || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    const [across, up] = arrow.map((way) => way * STEP * (event.shiftKey ? 0.1 : 1));
    const handle = [...this.plot.parts.handles.children].indexOf(/** @type {Element} */ (event.target));
    if (handle < 0) return this._change(moved(patch, across, up));
    const [density, strength] = placeOf(patch, HANDLES[handle]);
    this._change(stretched(patch, HANDLES[handle], density + across, strength + up));
  }

  // -- changes

  _add() {
    this._changeAll([...this.patches, added(this.patches.length)]);
    this._select(this.patches.length - 1);
    this._settle();
    /** @type {SVGElement} */ (this.plot.parts.patches.lastElementChild)?.focus({ preventScroll: true });
  }

  _remove() {
    if (this.selected < 0) return;
    const left = this.patches.filter((_, n) => n !== this.selected);
    this._changeAll(left);
    this._select(Math.min(this.selected, left.length - 1));
    this._settle();
    const next = /** @type {SVGElement | HTMLElement} */ (this.plot.parts.patches.children[this.selected] ?? this._find("[name=add]"));
    next.focus({ preventScroll: true });
  }

  /** @param {Partial<Patch>} change @param {boolean} settled */
  _put(change, settled) {
    const patch = this.patches[this.selected];
    if (patch) this._change({ ...patch, ...change });
    if (settled) this._settle();
  }

  /** @param {Patch} patch  the selected one's next state */
  _change(patch) {
    this._changeAll(this.patches.map((old, n) => (n === this.selected ? patch : old)));
  }

  /** @param {Patch[]} patches */
  _changeAll(patches) {
    this.before ??= this.patches;
    this.patches = patches;
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      this.to.onChange(this.patches, false);
    });
    this._draw();
  }

  /** Send the change that is under way as done. */
  _settle() {
    const changed = this.before && this.before !== this.patches;
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    const { told } = this;
    this.before = this.told = null;
    if (changed) this.to.onChange(this.patches, true);
    else if (told) this.show(told);
  }

  _cancel() {
    this.drag = null;
    this.patches = [.../** @type {Patch[]} */ (this.before)];
    this._settle();
    this._draw();
  }

  /** @param {number} index */
  _select(index) {
    this.selected = index;
    this._draw();
  }

  _draw() {
    this.plot.draw(this.patches, this.selected);
    const patch = this.patches[this.selected];
    this.fields.dataset.mode = patch ? "patch" : "hint";
    this._find(".vs-plane-fields > p").textContent = this.patches.length
      ? "Click a patch to change it."
      : "None: the four tables decide. A patch takes their place.";
    if (!patch) return;
    this._find(".vs-plane-which").textContent = `${this.selected + 1} of ${this.patches.length}`;
    for (const name of NUMBERS) {
      this._input(name).value = String(patch[name]);
      this._find(`[data-of=${name}]`).textContent = patch[name].toFixed(2);
    }
    for (const name of COLOURS) this._input(name).value = hexOf(patch[name]);
  }
}

const HEAD = `
  <div class="vs-row"><output></output>
    <button type="button" name="add" class="vs-plane-button" title="add a patch"><i class="material-icons" aria-hidden="true">add</i>Add a patch</button></div>`;

/** @param {string} name @param {string} label @param {string} tip */
const slider = (name, label, tip) => `
  <label title="${tip}"><span>${label}</span><input type="range" name="${name}" min="0" max="1" step="0.01" aria-label="${label} of the patch"><span data-of="${name}"></span></label>`;

const FIELDS = `
  <div class="vs-plane-fields" data-mode="hint">
    <p data-mode="hint" class="vs-muted"></p>
    <div data-mode="patch">
      <div><span class="vs-plane-which"></span>
        <label title="what it reflects">reflects <input type="color" name="refl" aria-label="colour that the patch reflects"></label>
        <label title="what it gives off by itself">emits <input type="color" name="emit" aria-label="colour that the patch emits"></label>
        <button type="button" name="remove" class="vs-plane-button" aria-label="remove the patch" title="remove the patch (Delete)"><i class="material-icons" aria-hidden="true">delete_outline</i></button></div>
      ${slider("opacity", "opacity", "within the rim, for a thickness of one voxel")}
      ${slider("soft", "softness", "how far the rim reaches inwards: 1 is to the middle")}
    </div>
  </div>`;
