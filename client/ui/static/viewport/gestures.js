// Pointers and wheel over a viewport: mouse, pen and fingers.
//
//   left drag turns · right or middle drag, or Shift, pans · Ctrl rolls · a click centres, or measures · the wheel zooms
//   one finger turns · two zoom and pan

import { panned, pinched, rolled, turned, zoomed } from "./camera.js";
import { onTrackpadPinch } from "../browser/trackpad_pinch.js";
import { wheelPixels } from "../browser/wheel.js";

const CLICK = 3; // CSS pixels: what moves less is a click
const HALF_ZOOM = 400; // wheel pixels that halve or double the zoom
const MOST = 200; // wheel pixels that count at once
const SOONEST = "onpointerrawupdate" in window ? "pointerrawupdate" : null; // in Chromium and Firefox
const PINCH = 10; // a touchpad's pinch comes as a wheel of small steps

/** @typedef {import("./camera.js").Point} Point */
/** @typedef {import("./camera.js").View} View */
/** @typedef {import("./viewport.js").Viewport} Viewport */

export class Gestures {
  #viewport;
  #fingers = /** @type {Map<number, Point>} */ (new Map());
  #began = /** @type {{kind: string, view: View, from: Point[], at: Point} | null} */ (null);
  #moved = false;
  #following = /** @type {AbortController | null} */ (null); // moves that come before their animation frame
  #heardSoon = false; // and that they do come: then the others tell nothing new

  /** @param {Viewport} viewport */
  constructor(viewport) {
    this.#viewport = viewport;
    const element = viewport.canvas;
    element.addEventListener("pointerdown", (event) => this.#down(event));
    element.addEventListener("pointermove", (event) => this.#move(event, "pointermove"));
    element.addEventListener("pointerup", (event) => this.#up(event, true));
    element.addEventListener("pointercancel", (event) => this.#up(event, false));
    element.addEventListener("mousedown", (event) => event.preventDefault()); // no scrolling by the middle button
    element.addEventListener("contextmenu", (event) => event.preventDefault());
    // The wheel zooms over the handles too.
    viewport.element.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    onTrackpadPinch(viewport.element, (event, factor) => this.#zoom(event, factor));
  }

  #down(event) {
    event.currentTarget.focus({ preventScroll: true });
    this.#viewport.hover(null);
    if (!this.#viewport.ready || this.#fingers.size === 2) return;
    event.currentTarget.setPointerCapture(event.pointerId);
    this.#fingers.set(event.pointerId, this.#viewport.pointAt(event));
    const more = this.#fingers.size > 1;
    this.#begin(more ? "pinch" : kindOf(event), [event.clientX, event.clientY]);
    this.#moved ||= more;
    this.#follow(event.currentTarget);
  }

  #begin(kind, at) {
    const { view } = this.#viewport;
    this.#began = { kind, view, from: [...this.#fingers.values()], at };
    this.#viewport.steering.hold();
  }

  /** Hear of moves as soon as they are made, where a browser tells; others wait for their next animation frame. */
  #follow(element) {
    if (!SOONEST || this.#following) return;
    this.#following = new AbortController();
    this.#heardSoon = false;
    const { signal } = this.#following;
    element.addEventListener("pointerrawupdate", (event) => this.#move(event, SOONEST), { signal });
  }

  #move(event, kind) {
    if (!this.#fingers.has(event.pointerId)) {
      if (kind === "pointermove") this.#viewport.hover(event);
      return;
    }
    if (kind === SOONEST) this.#heardSoon = true;
    else if (this.#heardSoon) return;
    const [x, y] = this.#began.at;
    this.#moved ||= Math.hypot(event.clientX - x, event.clientY - y) >= CLICK;
    if (!this.#moved) return;
    this.#fingers.set(event.pointerId, this.#viewport.pointAt(event));
    this.#viewport.steering.drag(this.#dragged(), event.timeStamp);
  }

  #dragged() {
    const { kind, view, from } = this.#began;
    const { grid, size } = this.#viewport;
    const to = [...this.#fingers.values()];
    if (kind === "pinch") return pinched(view, grid, size, from, to);
    if (kind === "pan") return panned(view, grid, from[0], to[0]);
    return kind === "roll" ? rolled(view, size, from[0], to[0]) : turned(view, size, from[0], to[0]);
  }

  #up(event, byPerson) {
    if (!this.#fingers.delete(event.pointerId)) return;
    if (this.#fingers.size > 0) {
      this.#begin("turn", [event.clientX, event.clientY]);
      return;
    }
    this.#following?.abort();
    this.#following = null;
    this.#heardSoon = false;
    const clicked = byPerson && !this.#moved;
    if (clicked) this.#viewport.steering.abandon();
    else this.#viewport.steering.release(event.timeStamp);
    if (clicked && this.#began.kind === "turn") this.#viewport.click(event);
    this.#began = null;
    this.#moved = false;
  }

  #wheel(event) {
    if (event.target.closest(".vs-help")) return; // which scrolls
    event.preventDefault();
    const pixels = wheelPixels(event, this.#viewport.element) * (event.ctrlKey ? PINCH : 1);
    this.#zoom(event, 2 ** (-Math.min(MOST, Math.max(-MOST, pixels)) / HALF_ZOOM));
  }

  /** About the pointer, unless fingers are at it. */
  #zoom(event, wanted) {
    if (!this.#viewport.ready || this.#fingers.size > 0) return;
    const { steering, view, grid, size } = this.#viewport;
    const factor = this.#viewport.zoomFactor(view, wanted);
    steering.nudge(zoomed(view, grid, size, this.#viewport.pointAt(event), factor), event.timeStamp);
  }
}

function kindOf(event) {
  if (event.button !== 0 || event.shiftKey) return "pan";
  return event.ctrlKey ? "roll" : "turn";
}
