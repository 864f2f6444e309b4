// Three slices beside the picture, straight across the grid's axes, through one point that all of them share.

import { sliceLayouts } from "./slice_layout.js";
import { SliceView } from "./slice_view.js";

const REST = 60; // milliseconds until the value under a pointer is asked for
const ZOOMED = 200; // milliseconds without a further zoom, after which finer slices are asked for
const SHOWN = "vs-with-slices"; // a class of the host
const REMEMBERED = "volsplat-slices";
const GREY = "volsplat-grey-slices";
const MOST_SAMPLES = 4096;

/** @typedef {import("../viewport/rotation.js").Vector} Vector */
/** @typedef {import("../viewport/bounds_box.js").Bounds} Bounds */
/** @typedef {import("../viewport/viewport_messages.d.ts").PageMessage} PageMessage */
/** @typedef {import("../viewport/viewport_messages.d.ts").SliceHeader} SliceHeader */
/** @typedef {import("../viewport/viewport_messages.d.ts").VolumeTold} VolumeTold */

/**
 * @typedef {Object} SlicesListener
 * @property {(message: PageMessage) => void} send
 * @property {() => void} moved the point is another one, or there are slices or none
 * @property {() => void} left the pointer is over no voxel of a slice any more
 * @property {import("../measure/measuring.js").Measuring} measuring
 */

export class Slices {
  #host;
  #listener;
  #volume = /** @type {VolumeTold | null} */ (null);
  #views = /** @type {SliceView[]} */ ([]);
  #bounds = /** @type {Bounds | null} */ (null);
  #point = /** @type {Vector | null} */ (null);
  #hovering = 0;
  #zooming = 0;
  #asked = ""; // what was last sent
  #observer = new ResizeObserver(() => this.#ask());

  /** @param {HTMLElement} host in which they stand beside the viewport @param {SlicesListener} listener */
  constructor(host, listener) {
    this.#host = host;
    this.#listener = listener;
    this.on = localStorage.getItem(REMEMBERED) !== null;
    this.coloured = localStorage.getItem(GREY) === null;
    this.#observer.observe(host);
  }

  close() {
    this.#observer.disconnect();
    clearTimeout(this.#hovering);
    clearTimeout(this.#zooming);
    this.#hide();
  }

  /** The voxel that they go through, null while there are none. @returns {Vector | null} */
  get point() {
    return this.on ? this.#point : null;
  }

  /** Show them, or no longer; remembered by the browser. */
  toggle() {
    this.on = !this.on;
    remember(REMEMBERED, this.on);
    this.#build();
  }

  /** In the colours of the tables, or grey. */
  toggleColours() {
    this.coloured = !this.coloured;
    remember(GREY, !this.coloured);
    this.#ask();
  }

  /** The process knows nothing any more of what was asked. */
  reconnected() {
    this.#asked = "";
    this.#ask();
  }

  /** @param {VolumeTold} volume */
  set volume(volume) {
    this.#volume = volume;
    this.#build();
  }

  /** @param {Bounds} bounds */
  set bounds(bounds) {
    this.#bounds = bounds;
    this.#point ??= /** @type {Vector} */ (bounds.low.map((low, n) => Math.floor((low + bounds.high[n] - 1) / 2)));
    if (this.#views.length === 0) this.#build();
    for (const view of this.#views) view.bounds = bounds;
    this.#ask();
  }

  /** Have them go through this voxel. @param {Vector} index */
  goTo(index) {
    if (this.#point?.every((n, axis) => n === index[axis])) return;
    this.#point = index;
    for (const view of this.#views) view.point = index;
    this.#ask();
    this.#listener.moved();
  }

  /** What was measured has changed. */
  drawMeasured() {
    for (const view of this.#views) view.drawMeasured();
  }

  /** @param {SliceHeader} header @param {Uint8Array<any>} bytes PNG */
  async show(header, bytes) {
    const view = this.#views[header.slice];
    const image = await createImageBitmap(new Blob([bytes]), { colorSpaceConversion: "none" }).catch(() => null);
    if (image !== null && view === this.#views[header.slice]) view?.show(header, image);
    this.#listener.send({ type: "slice_shown" });
  }

  #build() {
    this.#hide();
    this.#ask(); // so that those to come are all sent
    if (!this.on || this.#volume === null || this.#point === null) {
      this.#listener.moved();
      return;
    }
    const names = this.#volume.axes?.map(({ name }) => name) ?? ["i", "j", "k"];
    const listener = {
      go: (/** @type {Vector} */ index) => this.goTo(index),
      hover: (/** @type {Vector | null} */ index) => this.#hover(index),
      zoomed: () => {
        clearTimeout(this.#zooming);
        this.#zooming = setTimeout(() => this.#ask(), ZOOMED);
      },
      measuring: this.#listener.measuring,
    };
    this.#views = sliceLayouts(this.#volume).map((layout, axis) => new SliceView(layout, listener, names[axis]));
    this.#host.append(...this.#views.map((view) => view.element));
    this.#host.classList.add(SHOWN);
    for (const view of this.#views) {
      if (this.#bounds !== null) view.bounds = this.#bounds;
      view.point = this.#point;
    }
    this.#ask();
    this.#listener.moved();
  }

  #hide() {
    for (const view of this.#views) view.remove();
    this.#views = [];
    this.#host.classList.remove(SHOWN);
  }

  #ask() {
    const none = this.#views.length === 0;
    const room = Math.max(...this.#views.map((view) => view.room), 0);
    if (none ? this.#asked === "" : room === 0) return; // none were asked for, or they are not on the screen yet
    const longest = Math.min(MOST_SAMPLES, 2 ** Math.ceil(Math.log2(Math.max(room, 1))));
    const at = none ? null : this.#point;
    const message = /** @type {const} */ ({ type: "slices", at, coloured: this.coloured, longest });
    const asked = none ? "" : JSON.stringify(message);
    if (asked !== "" && asked === this.#asked) return;
    this.#asked = asked;
    this.#listener.send(message);
  }

  /** @param {Vector | null} index */
  #hover(index) {
    clearTimeout(this.#hovering);
    if (index === null) this.#listener.left();
    else this.#hovering = setTimeout(() => this.#listener.send({ type: "voxel", index }), REST);
  }
}

/** @param {string} key @param {boolean} on */
function remember(key, on) {
  if (on) localStorage.setItem(key, "1");
  else localStorage.removeItem(key);
}
