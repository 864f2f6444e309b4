// The viewport: the picture of the volume, and everything that is done with a pointer or a key over it. It knows a
// transport only, so that the same module works in volsplat's page (viewport_socket.js) and in a notebook.

import { Measuring } from "../measure/measuring.js";
import { Frame } from "./frame.js";
import { Gestures } from "./gestures.js";
import { isFree, keyList, obeyKey } from "./keys.js";
import { Marks } from "./marks.js";
import { Outbox, remember } from "./outbox.js";
import { PictureAlone } from "./picture_alone.js";
import { pictureButtons } from "./picture_buttons.js";
import { PictureCanvas } from "./picture_canvas.js";
import { onPixelRatio } from "../browser/pixel_ratio.js";
import { namedView } from "./rotation.js";
import { Steering } from "./steering.js";
import { TroubleBar } from "./trouble_bar.js";
import { ViewActions } from "./view_actions.js";

const SMALLEST = 8; // times smaller than it fits
const RESIZED_AFTER = 100; // milliseconds without a further change
const LABEL = "The volume. Drag or use the arrow keys to turn it; press ? for all keys.";

/** @typedef {import("./camera.js").Grid} Grid */
/** @typedef {import("./camera.js").Point} Point */
/** @typedef {import("./camera.js").Size} Size */
/** @typedef {import("./camera.js").View} View */
/** @typedef {import("./rotation.js").Quaternion} Quaternion */
/** @typedef {import("./rotation.js").Vector} Vector */

/** @typedef {import("./viewport_messages.d.ts").PageMessage} PageMessage */
/** @typedef {import("./viewport_messages.d.ts").ProcessMessage} ProcessMessage */
/** @typedef {import("./viewport_messages.d.ts").PictureHeader} PictureHeader */
/** @typedef {import("./viewport_messages.d.ts").SceneTold} SceneTold */
/** @typedef {import("../slices/slices.js").Slices} Slices */
/** @typedef {import("../slices/slices.js").SlicesListener} SlicesListener */
/** @typedef {import("./viewport_messages.d.ts").VolumeTold} VolumeTold */

/**
 * @typedef {Object} TransportState
 * @property {boolean} connected whether what is said is heard
 * @property {boolean} [anew] whether the process knows nothing of what was said before
 * @property {string} text what to tell the person, "" if nothing new
 */

/**
 * @typedef {Object} Transport
 * @property {(message: PageMessage) => void} send
 * @property {(listener: (message: ProcessMessage) => void) => void} onmessage
 * @property {(listener: (header: PictureHeader, bytes: Uint8Array) => void) => void} onpicture
 * @property {(listener: (state: TransportState) => void) => void} onstate
 */

export class Viewport {
  #transport;
  #outbox;
  #pictures;
  #picture = /** @type {PictureHeader | null} */ (null); // header of what is on the canvas
  #scene = /** @type {SceneTold | null} */ (null);
  #fit = /** @type {Partial<View>} */ ({});
  #marks = /** @type {Marks | null} */ (null); // once the volume is known
  #pointer = /** @type {Point | null} */ (null); // where it rests or moves, in the element
  #pointing = false; // with Shift: the slices are to go through what is seen there
  #contained = 0; // the last event of ours that the process has told of
  #picked = /** @type {{at: Point, then: (index: Vector) => void} | null} */ (null); // asked for, but not found yet
  #trouble = new TroubleBar();
  #help = document.createElement("div");
  #asked = { width: 0, height: 0 }; // the size of pictures last asked for
  #heard = false; // whether a process has heard of it
  #resized = 0;
  #box = { width: 0, height: 0 }; // of the element; to ask it at every picture would lay out the page each time
  #corner = { left: 0, top: 0 }; // of the element, in the window
  #observer = new ResizeObserver(() => this.#onResize());
  #closing = new AbortController();

  /**
   * @param {HTMLElement} host filled by the viewport
   * @param {Transport} transport
   * @param {{home?: Quaternion, wholePage?: boolean, early?: HTMLImageElement | null, makeSlices?: (listener: SlicesListener) => Slices}} options `home`:
   *   the rotation that reset goes to; `wholePage`: keys are for the viewport wherever on the page nothing else wants
   *   them; `early`: a picture until one has come; `makeSlices`: gives the slices beside it
   */
  constructor(host, transport, { home = namedView("front"), wholePage = false, early = null, makeSlices = undefined } = {}) {
    this.#transport = transport;
    /**
     * Pictures that were drawn, newest last.
     * @type {{number: number, revision: number, event: number, step: string, one_in: number, last: boolean, width: number, height: number,
     *   view: View, shownAt: number}[]}
     */
    this.log = [];
    this.steering = new Steering((view, settled, at) => this.#onSteered(view, settled, at));
    this.actions = new ViewActions(this, home);
    this.measuring = new Measuring(() => this.#drawMeasured());
    this.#outbox = new Outbox((message) => transport.send(message));
    this.element = document.createElement("div");
    this.element.className = "vs-viewport";
    this.canvas = this.#makeCanvas();
    this.#pictures = new PictureCanvas(
      this.canvas,
      (number) => transport.send({ type: "shown", number }),
      (header) => this.#onDrawn(header),
      (text) => this.#trouble.ofProcess(text, false),
    );
    if (early !== null) this.#pictures.begin(early);
    this.#help.className = "vs-help";
    this.#help.hidden = true;
    this.#help.append(keyList());
    this.element.append(this.canvas, pictureButtons(this, wholePage), this.#help, this.#trouble.element);
    host.append(this.element);
    new Gestures(this);
    this.slices = makeSlices?.(this.#ofSlices()) ?? null;
    const { signal } = this.#closing;
    this.alone = wholePage ? new PictureAlone(signal) : null;
    (wholePage ? document : this.element).addEventListener("keydown", (event) => this.#onKey(event), { signal });
    this.#observer.observe(this.element);
    onPixelRatio(() => this.#onResize(), signal);
    transport.onstate((state) => this.#onState(state));
    transport.onmessage((message) => this.#onMessage(message));
    transport.onpicture((header, bytes) => this.#pictures.show(header, bytes));
  }

  /** Let go of everything but the transport. */
  close() {
    this.#observer.disconnect();
    this.#closing.abort();
    clearTimeout(this.#resized);
    this.#trouble.close();
    this.#outbox.close();
    this.steering.close();
    this.slices?.close();
    this.element.remove();
  }

  /** What the person did, each with its time on performance.now()'s clock. @returns {{event: number, at: number}[]} */
  get sent() {
    return this.#outbox.sent;
  }

  /** Whether there is a volume and a view of it. */
  get ready() {
    return this.#marks !== null && this.#scene !== null;
  }

  /** @returns {Grid} */
  get grid() {
    return this.#marks.grid;
  }

  /** What the next gesture begins with. @returns {View} */
  get view() {
    this.#takeOver();
    return this.steering.view;
  }

  /** The size of the picture that the view is for. @returns {Size} */
  get size() {
    return this.steering.size;
  }

  /** Where the view fits what is visible, as the process told when nobody was at it last. @returns {Partial<View>} */
  get fit() {
    return this.#fit;
  }

  /** By how much a zoom may change that is to change by `factor`: no volume shrinks to a dot. @param {View} view @param {number} factor */
  zoomFactor(view, factor) {
    const least = (this.#fit.zoom ?? 0) / SMALLEST;
    return Math.max(factor, Math.min(1, least / view.zoom));
  }

  undo() {
    this.#outbox.hurry();
    this.#transport.send({ type: "undo" });
  }

  redo() {
    this.#outbox.hurry();
    this.#transport.send({ type: "redo" });
  }

  get helpShown() {
    return !this.#help.hidden;
  }

  toggleHelp() {
    this.#help.hidden = !this.#help.hidden;
  }

  /** The picture to the clipboard. */
  async copy() {
    this.#trouble.ofProcess(await this.#pictures.copy(), false);
  }

  // -- for the gestures

  /** Where an event is, in pixels of the picture that the view is for. @param {MouseEvent} event @returns {Point} */
  pointAt(event) {
    return new Frame(this.size, this.#box).toPicture(this.#inElement(event));
  }

  /** The visible voxel under an event becomes the centre, or a point of what is measured. @param {MouseEvent} event */
  click(event) {
    if (this.#picture === null) return;
    if (this.measuring.on) return this.pick(event, (index) => this.measuring.add(index));
    const [x, y] = this.pointAt(event);
    this.#transport.send({ type: "center", x, y });
    if (this.slices?.on) this.pick(event, (index) => this.slices.goTo(index));
  }

  /** Find the visible voxel under an event. @param {MouseEvent} event @param {(index: Vector) => void} then with what is found first */
  pick(event, then) {
    const [x, y] = this.pointAt(event);
    this.#picked = { at: [x, y], then };
    this.#transport.send({ type: "probe", x, y, picked: true });
  }

  /** The pointer is there without a button; null if it is away, or drags. @param {MouseEvent | null} event */
  hover(event) {
    this.#pointer = event && this.#inElement(event);
    this.#pointing = event !== null && event.shiftKey;
    if (event === null) this.#marks?.value.clear();
    else this.#askValue();
  }

  // -- from the process

  /** @param {TransportState} state */
  #onState({ connected, anew, text }) {
    if (text || connected) {
      this.#trouble.ofConnection(text);
      this.element.classList.toggle("vs-lost", !connected);
    }
    if (!anew) return;
    this.#trouble.ofProcess("", true); // what still lasts is told anew
    this.#pictures.reconnected();
    this.#box = this.#measured();
    const before = this.#heard ? this.#asked : undefined; // what was asked before the first connection came to nobody
    this.#heard = true;
    this.#asked = { width: 0, height: 0 };
    this.#sendSize(before);
    this.#outbox.repeatAfter(this.#contained);
    this.slices?.reconnected();
  }

  /** @param {ProcessMessage} message */
  #onMessage(message) {
    switch (message.type) {
      case "volume":
        return this.#onVolume(message);
      case "scene":
        return this.#onScene(message);
      case "probe":
        return this.#onProbe(message);
      case "value":
        return this.#marks?.value.fileValue(message);
      case "voxel":
        return this.#marks?.value.tell(message);
      case "slice_value":
        return this.#marks?.value.sliceValue(message);
      case "trouble":
        return this.#trouble.ofProcess(message.text, message.lasting);
    }
    /** @type {never} */ const unknown = message; // a message without a case is found by its type
    return unknown;
  }

  /** @param {import("./viewport_messages.d.ts").ProbeAnswered} answer */
  #onProbe(answer) {
    this.#marks?.value.answer(answer);
    if (answer.found === null) return;
    const { index } = answer.found;
    const [picked, pointer] = [this.#picked, this.#pointer];
    if (picked !== null && picked.at[0] === answer.x && picked.at[1] === answer.y) {
      this.#picked = null;
      picked.then(index);
    } else if (this.#pointing && pointer !== null && this.slices?.on) this.slices.goTo(index);
  }

  /** @param {VolumeTold} volume */
  #onVolume(volume) {
    this.#marks?.remove();
    this.#marks = new Marks(volume, {
      moveBounds: (bounds, settled, at) => this.#outbox.post({ type: "bounds", ...bounds, settled }, at),
      probe: ([x, y]) => this.#transport.send({ type: "probe", x, y, picked: false }),
      lookFrom: (side) => this.actions.lookFrom(side),
      measuring: this.measuring,
    });
    this.measuring.volume = volume;
    this.canvas.after(...this.#marks.elements);
    if (this.slices !== null) this.slices.volume = volume;
    this.#takeOver();
    this.#place();
  }

  /** @param {SceneTold} scene */
  #onScene(scene) {
    this.#scene = scene;
    if (scene.fit !== null) this.#fit = scene.fit;
    this.#takeOver();
  }

  /** @param {PictureHeader} header */
  #onDrawn(header) {
    if (header.revision !== this.#picture?.revision) this.#marks?.value.clear();
    this.#picture = header;
    const { number, revision, event, step, one_in, last, width, height, view } = header;
    remember(this.log, { number, revision, event, step, one_in, last, width, height, view, shownAt: performance.now() });
    this.#contained = Math.max(this.#contained, header.event);
    this.#takeOver();
    this.#place();
    this.#trouble.ofPicture(header.notice);
    if (header.last) this.#askValue();
  }

  #askValue() {
    if (this.#picture === null || this.#marks === null || this.#pointer === null) return;
    const frame = new Frame(this.size, this.#box); // the picture on the screen may be a smaller one
    if (frame.holds(this.#pointer)) {
      this.#marks.value.hover(frame.toPicture(this.#pointer), () => !this.steering.busy);
    } else {
      this.#marks.value.clear();
    }
  }

  /** Take what others have made of the scene, but for what may be older than what was done here. */
  #takeOver() {
    if (this.#scene === null) return;
    const { view, width, height, bounds } = this.#scene;
    const whole = this.#contained >= this.#outbox.event;
    this.#marks?.box.follow(bounds, whole);
    if (!whole || this.steering.busy) return;
    this.steering.follow(view, { width, height });
    if (this.#marks === null || this.#marks.box.busy) return;
    if (this.slices !== null) this.slices.bounds = bounds;
  }

  // -- the rest

  /** @param {View & Size} view @param {boolean} settled @param {number} at */
  #onSteered(view, settled, at) {
    this.#outbox.post({ type: "view", ...view, settled }, at);
    if (settled) this.#place(); // with all marks again
  }

  #onKey(event) {
    if (!this.ready || !isFree(event, this.element) || !obeyKey(event, this)) return;
    event.preventDefault();
    event.stopPropagation(); // the page's own keys do not hear of it
  }

  #onResize() {
    this.#box = this.#measured();
    this.#place();
    clearTimeout(this.#resized);
    const first = this.#asked.width === 0; // for which nobody should have to wait
    this.#resized = setTimeout(() => this.#sendSize(), first ? 0 : RESIZED_AFTER);
  }

  /** @param {Size} [before] what was asked for before the line was cut */
  #sendSize(before = this.#asked) {
    const { width, height } = this.#box;
    if (width === 0 || height === 0) return; // not on the screen
    const [w, h] = [width, height].map((side) => Math.max(1, Math.round(side * window.devicePixelRatio)));
    if (w === this.#asked.width && h === this.#asked.height) return;
    this.#asked = { width: w, height: h };
    this.#transport.send({ type: "size", ...this.#asked, again: w === before.width && h === before.height });
  }

  /** Put the marks where the picture on the screen has them. */
  #place() {
    if (this.#picture === null || this.#marks === null) return;
    this.#marks.place(this.#picture, this.#frame(), this.steering.moving);
  }

  #frame() {
    return new Frame(this.#picture, this.#box);
  }

  #measured() {
    return { width: this.element.clientWidth, height: this.element.clientHeight };
  }

  /** @returns {Point} */
  #inElement(event) {
    // With a button held the element stays where it is; to ask would lay out the page, for every event of a drag.
    if (event.type === "pointerdown" || event.buttons === 0) this.#corner = this.element.getBoundingClientRect();
    return [event.clientX - this.#corner.left, event.clientY - this.#corner.top];
  }

  #drawMeasured() {
    this.#place();
    this.slices?.drawMeasured();
  }

  /** What slices do to the rest. @returns {SlicesListener} */
  #ofSlices() {
    return {
      send: (message) => this.#transport.send(message),
      moved: () => {
        if (this.#marks !== null) this.#marks.point = this.slices?.point ?? null;
        this.#place();
      },
      left: () => this.#marks?.value.clear(),
      measuring: this.measuring,
    };
  }

  #makeCanvas() {
    const canvas = document.createElement("canvas");
    canvas.className = "vs-picture";
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", LABEL);
    canvas.addEventListener("pointerleave", () => this.hover(null));
    return canvas;
  }
}
