// The camera's arithmetic: from grid to picture and back, and what each gesture makes of a view. Nothing here knows of
// the page; a view is a plain value and never changed in place.
//
// Positions are picture pixels from the centre of the top-left pixel, x to the right, y down (protocol/rules/frame_plan.py).

import * as rotation from "./rotation.js";

/** @typedef {import("./rotation.js").Quaternion} Quaternion */
/** @typedef {import("./rotation.js").Vector} Vector */
/** @typedef {import("./rotation.js").Matrix} Matrix */
/** @typedef {[number, number]} Point */
/** @typedef {{width: number, height: number}} Size of a picture, in its pixels */
/** @typedef {{rotation: Quaternion, zoom: number, center: Vector}} View zoom in pixels per reference spacing */

const LEAST_ZOOM = 1 / 64;
const MOST_ZOOM = 256;

/** What the camera needs to know of a volume. */
export class Grid {
  /** @param {{dims: Vector, index_to_upright: Matrix, reference_spacing: number}} volume its message */
  constructor({ dims, index_to_upright, reference_spacing }) {
    this.dims = dims;
    this.toUpright = index_to_upright;
    this.toIndex = rotation.inverse(index_to_upright);
    this.referenceSpacing = reference_spacing;
  }
}

/** What a view makes of the grid's points in a picture of one size. */
export class Projection {
  /** @param {View} view @param {Grid} grid @param {Size} size */
  constructor(view, grid, size) {
    const scale = view.zoom / grid.referenceSpacing;
    const onScreen = rotation.matrixProduct(rotation.matrixOf(view.rotation), grid.toUpright);
    /** Grid step to pixels: rows x right, y down, z to the viewer. @type {Matrix} */
    this.pixelsPerIndex = /** @type {Matrix} */ (
      onScreen.map((row, axis) => row.map((part) => part * (axis === 1 ? -scale : scale)))
    );
    this.center = view.center;
    this.size = size;
  }

  /** Where a grid point is: [x, y, depth], depth rising towards the viewer. @param {Vector} index @returns {Vector} */
  at(index) {
    const from = /** @type {Vector} */ (index.map((part, axis) => part - this.center[axis]));
    const [x, y, z] = rotation.applied(this.pixelsPerIndex, from);
    return [x + (this.size.width - 1) / 2, y + (this.size.height - 1) / 2, z];
  }

  /** The pixels that one step along a grid axis makes. @param {number} axis @returns {Vector} */
  step(axis) {
    return rotation.transposed(this.pixelsPerIndex)[axis];
  }
}

/**
 * The point of the track-ball under a pixel: on a sphere as wide as the picture's shorter side, and where that grows
 * steep on a sheet about it (Bell's), so that no place in the picture is dead.
 * @param {Point} at @param {Size} size @returns {Vector} of length 1, screen axes (y up)
 */
function ballPoint([px, py], size) {
  const radius = Math.min(size.width, size.height) / 2;
  const x = (px - (size.width - 1) / 2) / radius;
  const y = ((size.height - 1) / 2 - py) / radius;
  const squared = x * x + y * y;
  const z = squared <= 0.5 ? Math.sqrt(1 - squared) : 0.5 / Math.sqrt(squared);
  const length = Math.hypot(x, y, z);
  return [x / length, y / length, z / length];
}

/**
 * Turned as if the ball's point under `from` were drawn to `to`.
 * @param {View} view @param {Size} size @param {Point} from @param {Point} to @returns {View}
 */
export function turned(view, size, from, to) {
  return turnedBy(view, rotation.between(ballPoint(from, size), ballPoint(to, size)));
}

/** @param {View} view @param {Quaternion} turn of the screen's axes @returns {View} */
export function turnedBy(view, turn) {
  return { ...view, rotation: rotation.normalised(rotation.product(turn, view.rotation)) };
}

/**
 * Rolled about the picture's middle by the angle from one point to another.
 * @param {View} view @param {Size} size @param {Point} from @param {Point} to @returns {View}
 */
export function rolled(view, size, from, to) {
  const angle = ([x, y]) => Math.atan2((size.height - 1) / 2 - y, x - (size.width - 1) / 2);
  return turnedBy(view, rotation.about(2, ((angle(to) - angle(from)) * 180) / Math.PI));
}

/**
 * What lay under `from` lies under `to`.
 * @param {View} view @param {Grid} grid @param {Point} from @param {Point} to @returns {View}
 */
export function panned(view, grid, from, to) {
  return moved(view, grid, view.zoom, [from[0] - to[0], from[1] - to[1]]);
}

/**
 * Zoomed by a factor; what lies under `at` stays there.
 * @param {View} view @param {Grid} grid @param {Size} size @param {Point} at @param {number} factor @returns {View}
 */
export function zoomed(view, grid, size, at, factor) {
  const zoom = Math.min(MOST_ZOOM, Math.max(LEAST_ZOOM, view.zoom * factor));
  const growth = zoom / view.zoom - 1;
  const x = (at[0] - (size.width - 1) / 2) * growth;
  const y = (at[1] - (size.height - 1) / 2) * growth;
  return { ...moved(view, grid, zoom, [x, y]), zoom };
}

/**
 * Two fingers: panned, and zoomed as their distance grows.
 * @param {View} view @param {Grid} grid @param {Size} size @param {Point[]} from @param {Point[]} to @returns {View}
 */
export function pinched(view, grid, size, from, to) {
  return zoomed(panned(view, grid, middleOf(from), middleOf(to)), grid, size, middleOf(to), spanOf(to) / spanOf(from));
}

/** The middle between one or two fingers. @param {Point[]} fingers @returns {Point} */
export function middleOf(fingers) {
  const [a, b] = [fingers[0], fingers[fingers.length - 1]];
  return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
}

/** How far apart they are, for one finger always the same. @param {Point[]} fingers */
export function spanOf(fingers) {
  const [a, b] = [fingers[0], fingers[fingers.length - 1]];
  return Math.max(1, Math.hypot(a[0] - b[0], a[1] - b[1]));
}

/**
 * The centre moved by pixels (x right, y down) of a picture at `zoom`.
 * @param {View} view @param {Grid} grid @param {number} zoom @param {Point} pixels @returns {View}
 */
function moved(view, grid, zoom, [x, y]) {
  const scale = grid.referenceSpacing / zoom;
  const back = rotation.transposed(rotation.matrixOf(view.rotation));
  const step = rotation.applied(grid.toIndex, rotation.applied(back, [x * scale, -y * scale, 0]));
  return { ...view, center: /** @type {Vector} */ (view.center.map((part, axis) => part + step[axis])) };
}
