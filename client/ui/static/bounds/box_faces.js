// The faces and edges of a box of voxels: where they go when they are moved, and which the viewer sees.

import { cross, dot } from "../viewport/rotation.js";

export const AXES = "ijk";

/** @typedef {import("../viewport/camera.js").Point} Point */
/** @typedef {import("../viewport/camera.js").Projection} Projection */
/** @typedef {import("../viewport/frame.js").Frame} Frame */
/** @typedef {import("../viewport/rotation.js").Vector} Vector */
/** @typedef {{low: Vector, high: Vector}} Bounds half-open */
/** @typedef {{axis: number, end: "low" | "high"}} Face */
/** @typedef {Map<Face, number>} Moved where faces were put, each of FACES */

/** @type {Face[]} */
export const FACES = [0, 1, 2].flatMap((axis) => /** @type {Face[]} */ ([{ axis, end: "low" }, { axis, end: "high" }]));

/** Where a face is. @param {Bounds} bounds @param {Face} face */
export function placeOf(bounds, { axis, end }) {
  return bounds[end][axis];
}

/** How far it can go: a voxel at least is left. @param {Bounds} bounds @param {Face} face @param {number[]} dims @returns {[number, number]} */
export function reachOf({ low, high }, { axis, end }, dims) {
  return end === "low" ? [0, high[axis] - 1] : [low[axis] + 1, dims[axis]];
}

/**
 * Where one face goes that is moved.
 * @param {Bounds} began @param {Face} face @param {number} voxels from where it began
 * @param {Bounds} now which may be other ones than when it began @param {number[]} dims
 * @returns {Moved}
 */
export function faceMoved(began, face, voxels, now, dims) {
  return new Map([[face, clamped(placeOf(began, face) + voxels, ...reachOf(now, face, dims))]]);
}

/** Where a face and the one across go that are moved alike. @type {typeof faceMoved} */
export function slabMoved(began, { axis }, voxels, _now, dims) {
  const by = clamped(voxels, -began.low[axis], dims[axis] - began.high[axis]);
  return new Map(FACES.filter((face) => face.axis === axis).map((face) => [face, placeOf(began, face) + by]));
}

/**
 * The bounds with faces where they were put, but for one that would be past the one across.
 * @param {Bounds} bounds @param {Moved} moved @param {number[]} dims @returns {Bounds}
 */
export function laidOver(bounds, moved, dims) {
  const laid = /** @type {Bounds} */ ({ low: [...bounds.low], high: [...bounds.high] });
  for (const [{ axis, end }, place] of moved) laid[end][axis] = place;
  for (const [face, place] of moved) laid[face.end][face.axis] = clamped(place, ...reachOf(laid, face, dims));
  return laid;
}

function clamped(value, least, most) {
  return Math.min(most, Math.max(least, value));
}

/**
 * The twelve edges of a box of voxels, in CSS pixels of the element, and whether the box hides them.
 * @param {Bounds} bounds @param {Projection} projection @param {Frame} frame @returns {{ends: Point[], behind: boolean}[]}
 */
export function edgesOf({ low, high }, projection, frame) {
  return EDGES.map(({ ends, faces }) => ({
    ends: ends.map((corner) => {
      const index = corner.map((end, axis) => (end === "low" ? low[axis] : high[axis]) - 0.5);
      const [x, y] = projection.at(/** @type {Vector} */ (index));
      return frame.toElement([x, y]);
    }),
    behind: !faces.some((face) => facesViewer(face, projection)),
  }));
}

/** Each edge with its two corners and the two faces that it joins. */
const EDGES = [0, 1, 2].flatMap((along) => {
  const [b, c] = [(along + 1) % 3, (along + 2) % 3];
  return ["low", "high"].flatMap((endB) =>
    ["low", "high"].map((endC) => {
      const corner = (end) => [0, 1, 2].map((axis) => (axis === along ? end : axis === b ? endB : endC));
      const faces = /** @type {Face[]} */ ([{ axis: b, end: endB }, { axis: c, end: endC }]);
      return { ends: [corner("low"), corner("high")], faces };
    }),
  );
});

/** Whether a face's outer side is seen, on a skew grid too. @param {Face} face @param {Projection} projection */
export function facesViewer({ axis, end }, projection) {
  const normal = cross(projection.step((axis + 1) % 3), projection.step((axis + 2) % 3));
  const outward = Math.sign(dot(normal, projection.step(axis))) * (end === "high" ? 1 : -1);
  return normal[2] * outward > 0;
}

/** Where the middle of a face is in the picture. @param {Bounds} bounds @param {Face} face @param {Projection} projection @returns {Point} */
export function middleOf({ low, high }, { axis, end }, projection) {
  const middle = low.map((part, n) => (part + high[n] - 1) / 2);
  middle[axis] = (end === "low" ? low : high)[axis] - 0.5;
  return /** @type {Point} */ (projection.at(/** @type {Vector} */ (middle)).slice(0, 2));
}
