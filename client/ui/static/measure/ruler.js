// Distances and angles between points of the grid, in the units that the volume's axes are told in. Between axes of
// different kinds there are none, which is said in words.

import { applied, dot } from "../viewport/rotation.js";

const ALIKE = 1e-9; // voxels: as far apart points are not

/** @typedef {import("../viewport/rotation.js").Vector} Vector */
/** @typedef {import("../viewport/viewport_messages.d.ts").Scale} Scale */
/** @typedef {import("../viewport/viewport_messages.d.ts").VolumeTold} VolumeTold */

export class Ruler {
  #volume;
  #names;

  /** @param {VolumeTold} volume */
  constructor(volume) {
    this.#volume = volume;
    this.#names = volume.axes?.map(({ name }) => name) ?? ["i", "j", "k"];
  }

  /** How far it is from one point to another, in words. @param {Vector} from @param {Vector} to */
  distance(from, to) {
    const way = difference(to, from);
    const scales = this.#scalesAlong(way);
    if (scales.length > 1) return `no distance: ${this.#why(scales)}`;
    const { unit, length } = scales[0] ?? this.#volume.scales[0];
    const amount = Math.hypot(...applied(this.#volume.index_to_upright, way)) / length;
    return [number(amount), amount === 1 && unit === "voxels" ? "voxel" : unit].filter(Boolean).join(" ");
  }

  /** The angle at a point between the ways to two others, in words. @param {Vector} from @param {Vector} at @param {Vector} to */
  angle(from, at, to) {
    const ways = [from, to].map((end) => difference(end, at));
    const scales = this.#scalesAlong(...ways);
    // Without a unit a file may still say how its spacings stand to one another, which is all that an angle needs.
    if (scales.length > 1 && this.#volume.axes !== null) return `no angle: ${this.#why(scales)}`;
    const [a, b] = ways.map((way) => applied(this.#volume.index_to_upright, way));
    const lengths = Math.hypot(...a) * Math.hypot(...b);
    if (lengths === 0) return "no angle: two of the points are the same";
    return `${number((Math.acos(Math.min(Math.max(dot(a, b) / lengths, -1), 1)) * 180) / Math.PI)}°`;
  }

  /** The scales of all axes along which these ways go. @param {Vector[]} ways @returns {Scale[]} */
  #scalesAlong(...ways) {
    const { scales } = this.#volume;
    const gone = this.#names.filter((_, axis) => ways.some((way) => Math.abs(way[axis]) > ALIKE));
    return scales.filter(({ name }) => gone.some((axis) => name === "" || name.split(", ").includes(axis)));
  }

  /** @param {Scale[]} scales */
  #why(scales) {
    const told = scales.map(({ name, unit }) => (unit ? `${name} (${unit})` : name)).join(" and ");
    if (this.#volume.axes !== null) return `${told} are of different kinds`;
    return `the file states no unit, and voxels are not as long along ${scales.map(({ name }) => name).join(" as along ")}`;
  }
}

/** @param {Vector} to @param {Vector} from @returns {Vector} */
function difference(to, from) {
  return /** @type {Vector} */ (to.map((part, axis) => part - from[axis]));
}

/** Four digits, or all before the point. @param {number} value */
function number(value) {
  return value >= 1000 ? String(Math.round(value)) : String(Number(value.toPrecision(4)));
}
