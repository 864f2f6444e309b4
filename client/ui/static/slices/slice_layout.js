// How a slice of the grid is turned for a person: as the view that looks straight at it, true to the spacing of its
// voxels and to the skew of its axes. Nothing here knows of the page.

import { applied, cross, dot, matrixOf, namedView, transposed } from "../viewport/rotation.js";

/** @typedef {import("../viewport/rotation.js").Vector} Vector */
/** @typedef {import("../viewport/camera.js").Point} Point */
/** @typedef {import("../viewport/viewport_messages.d.ts").VolumeTold} VolumeTold */

/** The views that slices are seen in, by the upright axis across them: of a patient the radiologist's. */
const VIEWS = ["left", "front", "bottom"];
const SIDES = [
  ["right", "left"],
  ["front", "back"],
  ["bottom", "top"],
]; // views from the lower and the upper end of each upright axis
const PLANES = [
  ["LR", "sagittal"],
  ["AP", "coronal"],
  ["IS", "axial"],
];

export class SliceLayout {
  /** @param {VolumeTold} volume @param {number} axis that the slice lies across @param {number} across upright axis nearest to it */
  constructor(volume, axis, across) {
    const steps = transposed(volume.index_to_upright);
    this.axis = axis;
    /** The earlier and the later of the two other axes: to the right and down in the slice's image. @type {[number, number]} */
    this.sides = /** @type {[number, number]} */ ([0, 1, 2].filter((n) => n !== axis));
    this.dims = volume.dims;
    const toScreen = matrixOf(namedView(VIEWS[across]));
    const shown = this.sides.map((side) => applied(toScreen, steps[side]));
    const straight = Math.abs(shown[0][0]) + Math.abs(shown[1][1]) >= Math.abs(shown[1][0]) + Math.abs(shown[0][1]);
    const [h, v] = straight ? [0, 1] : [1, 0];
    const right = Math.sign(shown[h][0]) || 1;
    const up = Math.sign(shown[v][1]) || 1;
    const [along, aside] = [steps[this.sides[h]], steps[this.sides[v]]];
    const length = Math.hypot(...along);
    const skew = dot(along, aside) / length;
    /** What a voxel further along each side is, in physical units to the right and up. @type {[Point, Point]} */
    this.steps = [
      [0, 0],
      [0, 0],
    ];
    this.steps[h] = [right * length, 0];
    this.steps[v] = [right * skew, up * Math.sqrt(Math.max(dot(aside, aside) - skew * skew, 0))];
    const letter = (/** @type {Vector} */ direction) => volume.sides[sideOf(direction)];
    /** What lies at the right, left, top and bottom. */
    this.letters = {
      right: letter(scaled(along, right)),
      left: letter(scaled(along, -right)),
      top: letter(scaled(aside, up)),
      bottom: letter(scaled(aside, -up)),
    };
    const ends = SIDES[across].map((side) => volume.sides[side]).sort().join("");
    this.plane = PLANES.find(([letters]) => letters === ends)?.[1] ?? "";
    this.view = VIEWS[across];
  }

  /** Where a point of the grid is, from the first voxel on: physical units to the right and up. @param {number} a @param {number} b along the sides @returns {Point} */
  at(a, b) {
    const [[ax, ay], [bx, by]] = this.steps;
    return [a * ax + b * bx, a * ay + b * by];
  }

  /** The other way: along the sides. @param {Point} at @returns {Point} */
  indexAt([x, y]) {
    const [[ax, ay], [bx, by]] = this.steps;
    const area = ax * by - bx * ay;
    return [(x * by - bx * y) / area, (ax * y - x * ay) / area];
  }

  /** The corners of a box of voxels in the slice. @param {[number, number]} low @param {[number, number]} high half-open @returns {Point[]} */
  corners([a0, b0] = [0, 0], [a1, b1] = this.size) {
    return [
      [a0, b0],
      [a1, b0],
      [a1, b1],
      [a0, b1],
    ].map(([a, b]) => this.at(a - 0.5, b - 0.5));
  }

  /** Voxels along the sides. @returns {[number, number]} */
  get size() {
    return [this.dims[this.sides[0]], this.dims[this.sides[1]]];
  }
}

/** The layouts of the slices across i, j and k: each is seen in a view of its own. @param {VolumeTold} volume */
export function sliceLayouts(volume) {
  const steps = transposed(volume.index_to_upright);
  const normals = [0, 1, 2].map((n) => unit(cross(steps[(n + 1) % 3], steps[(n + 2) % 3])));
  const fit = (/** @type {number[]} */ order) => order.reduce((sum, axis, n) => sum + Math.abs(normals[n][axis]), 0);
  const best = ORDERS.reduce((one, other) => (fit(other) > fit(one) + 1e-9 ? other : one));
  return best.map((across, axis) => new SliceLayout(volume, axis, across));
}

const ORDERS = [
  [0, 1, 2],
  [0, 2, 1],
  [1, 0, 2],
  [1, 2, 0],
  [2, 0, 1],
  [2, 1, 0],
];

/** The view from where a direction points to. @param {Vector} direction in upright axes */
function sideOf(direction) {
  const sizes = direction.map(Math.abs);
  const axis = sizes.indexOf(Math.max(...sizes));
  return SIDES[axis][direction[axis] > 0 ? 1 : 0];
}

/** @param {Vector} v @param {number} factor @returns {Vector} */
function scaled([x, y, z], factor) {
  return [x * factor, y * factor, z * factor];
}

/** @param {Vector} v @returns {Vector} */
function unit(v) {
  return scaled(v, 1 / Math.hypot(...v));
}
