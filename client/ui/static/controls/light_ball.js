// @ts-check
// A small ball that a light is dragged on: shaded as the light falls on it, with a dot where the light stands.

import { onPixelRatio } from "../browser/pixel_ratio.js";
import { onTheme } from "../browser/theme.js";

/** @typedef {[number, number, number]} Direction along the screen's axes: x right, y up, z towards the viewer */

const DOT_RADIUS = 5; // CSS pixels
const MARGIN = 8; // CSS pixels around the ball, so that a dot at its rim is whole
const KEY_STEP = 0.1; // radians for each press of an arrow key

/**
 * The direction under the pointer. On the ball it is the point that one sees, or the one behind it for the far side;
 * past the rim it goes on round to the other side.
 * @param {number} x in radii from the middle, to the right
 * @param {number} y in radii from the middle, up
 * @param {boolean} far whether the drag began on the far side
 * @returns {Direction}
 */
function directionAt(x, y, far) {
  const distance = Math.hypot(x, y);
  const past = distance > 1;
  const radius = past ? Math.max(0, 2 - distance) : distance;
  const scale = distance > 0 ? radius / distance : 0;
  const depth = Math.sqrt(Math.max(0, 1 - radius * radius));
  return [x * scale, y * scale, far !== past ? -depth : depth];
}

/**
 * @param {Direction} direction of any length but zero
 * @returns {Direction}
 */
export function normalised(direction) {
  const length = Math.hypot(...direction);
  return [direction[0] / length, direction[1] / length, direction[2] / length];
}

export class LightBall {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {(direction: Direction, settled: boolean) => void} onTurned called while it is dragged and when it is let go
   */
  constructor(canvas, onTurned) {
    this.canvas = canvas;
    this.onTurned = onTurned;
    this.dragging = false;
    /** @type {Direction} */
    this.direction = [0, 0, 1];
    this.far = false;
    this.frame = 0;
    this.listeners = new AbortController();
    const options = { signal: this.listeners.signal };
    canvas.addEventListener("pointerdown", (event) => this.grab(event), options);
    canvas.addEventListener("pointermove", (event) => this.drag(event), options);
    canvas.addEventListener("pointerup", () => this.release(), options);
    canvas.addEventListener("pointercancel", () => this.release(), options);
    canvas.addEventListener("keydown", (event) => this.press(event), options);
    this.resized = new ResizeObserver(() => this.draw());
    this.resized.observe(canvas);
    onPixelRatio(() => this.draw(), this.listeners.signal);
    onTheme(() => this.draw(), this.listeners.signal);
  }

  /** @param {Direction} direction of any length but zero */
  show(direction) {
    const turned = normalised(direction);
    if (this.dragging || turned.every((part, axis) => part === this.direction?.[axis])) return;
    this.direction = turned;
    this.draw();
  }

  close() {
    this.listeners.abort();
    this.resized.disconnect();
    cancelAnimationFrame(this.frame);
  }

  /** @param {PointerEvent} event */
  grab(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.dragging = true;
    this.far = this.direction[2] < 0;
    this.drag(event);
  }

  /** @param {PointerEvent} event */
  drag(event) {
    if (!this.dragging) return;
    const box = this.canvas.getBoundingClientRect();
    const radius = Math.min(box.width, box.height) / 2 - MARGIN;
    const x = (event.clientX - box.left - box.width / 2) / radius;
    const y = (box.top + box.height / 2 - event.clientY) / radius;
    this.direction = directionAt(x, y, this.far);
    this.draw();
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      if (this.dragging) this.onTurned(this.direction, false);
    });
  }

  release() {
    if (!this.dragging) return;
    this.dragging = false;
    this.onTurned(this.direction, true);
  }

  /** @param {KeyboardEvent} event */
  press(event) {
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const turn = turns[/** @type {keyof typeof turns} */ (event.key)];
    if (!turn) return;
    event.preventDefault();
    event.stopPropagation();
    const [x, y, z] = this.direction;
    const cosine = Math.cos(KEY_STEP);
    const sine = Math.sin(KEY_STEP) * (turn[0] + turn[1]);
    this.direction = turn[0]
      ? [x * cosine + z * sine, y, z * cosine - x * sine]
      : [x, y * cosine + z * sine, z * cosine - y * sine];
    this.draw();
    this.onTurned(this.direction, true);
  }

  draw() {
    const { canvas } = this;
    const ratio = window.devicePixelRatio;
    const width = Math.round(canvas.clientWidth * ratio);
    const height = Math.round(canvas.clientHeight * ratio);
    const painter = canvas.getContext("2d");
    if (!painter || !width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const style = getComputedStyle(canvas);
    const colour = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
    const radius = Math.min(width, height) / 2 - MARGIN * ratio;
    painter.setTransform(1, 0, 0, 1, width / 2, height / 2);
    painter.clearRect(-width / 2, -height / 2, width, height);
    painter.drawImage(this.ball(Math.ceil(radius)), -radius, -radius, 2 * radius, 2 * radius);
    painter.lineWidth = ratio;
    painter.strokeStyle = colour("--vs-line");
    painter.beginPath();
    painter.arc(0, 0, radius, 0, 2 * Math.PI);
    painter.stroke();
    const [x, y, z] = this.direction;
    painter.beginPath();
    painter.arc(x * radius, -y * radius, DOT_RADIUS * ratio, 0, 2 * Math.PI);
    painter.lineWidth = 2 * ratio;
    painter.fillStyle = z < 0 ? colour("--vs-panel") : colour("--vs-accent");
    painter.strokeStyle = z < 0 ? colour("--vs-accent") : colour("--vs-panel");
    painter.fill();
    painter.stroke();
  }

  /**
   * The lit sphere, without the dot.
   * @param {number} radius in device pixels
   */
  ball(radius) {
    const size = 2 * radius;
    const picture = new OffscreenCanvas(size, size);
    const painter = /** @type {OffscreenCanvasRenderingContext2D} */ (picture.getContext("2d"));
    const pixels = painter.createImageData(size, size);
    const [lx, ly, lz] = this.direction;
    const half = normalised([lx, ly, lz + 1.000001]);
    for (let row = 0; row < size; row++) {
      for (let column = 0; column < size; column++) {
        const x = (column + 0.5) / radius - 1;
        const y = 1 - (row + 0.5) / radius;
        const square = x * x + y * y;
        const cover = Math.min(1, (1 - Math.sqrt(square)) * radius + 0.5); // soft at the rim
        if (cover <= 0) continue;
        const z = Math.sqrt(Math.max(0, 1 - square));
        const diffuse = Math.max(0, x * lx + y * ly + z * lz);
        const shine = diffuse > 0 ? Math.max(0, x * half[0] + y * half[1] + z * half[2]) ** 40 : 0;
        const level = 46 + 150 * diffuse + 59 * shine;
        pixels.data.set([level, level, level, 255 * cover], 4 * (row * size + column));
      }
    }
    painter.putImageData(pixels, 0, 0);
    return picture;
  }
}
