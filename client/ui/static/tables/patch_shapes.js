// @ts-check
// Patches of the plane of density by strength, as numbers: their corners, and what a hand makes of them.
import { rounded, within } from "./table_numbers.js";

/** @typedef {[number, number]} Ends  left and right, or lower and upper, 0..1 */
/** @typedef {[number, number, number]} Colour */
/** @typedef {{density: Ends, top: Ends, strength: Ends, soft: number, opacity: number, emit: Colour, refl: Colour}} Patch */
/** @typedef {"lower left" | "lower right" | "upper left" | "upper right" | "left side" | "right side"} Handle */

/** @type {Handle[]} */
export const HANDLES = ["lower left", "lower right", "upper left", "upper right", "left side", "right side"];
export const STEP = 1 / 255; // of an arrow key
/** @type {Colour[]} */
const PALETTE = [[0.93, 0.87, 0.73], [0.85, 0.35, 0.3], [0.35, 0.65, 0.9], [0.45, 0.8, 0.45], [0.9, 0.7, 0.25], [0.7, 0.5, 0.85]];

/** A new one, which stands out from those that are there. @param {number} count @returns {Patch} */
export const added = (count) => ({
  density: [0.4, 0.6],
  top: [0.4, 0.6],
  strength: [0.3, 0.7],
  soft: 0.5,
  opacity: 0.3,
  emit: [0, 0, 0],
  refl: PALETTE[count % PALETTE.length],
});

/** Where a handle lies: density and strength. @param {Patch} patch @param {Handle} handle @returns {[number, number]} */
export function placeOf(patch, handle) {
  const side = handle.endsWith("left") || handle === "left side" ? 0 : 1;
  if (handle.endsWith("side")) return [(patch.density[side] + patch.top[side]) / 2, (patch.strength[0] + patch.strength[1]) / 2];
  const upper = handle.startsWith("upper");
  return [(upper ? patch.top : patch.density)[side], patch.strength[upper ? 1 : 0]];
}

/** The corners, once around. @param {Patch} patch @returns {[number, number][]} */
export const cornersOf = (patch) =>
  /** @type {Handle[]} */ (["lower left", "lower right", "upper right", "upper left"]).map((corner) => placeOf(patch, corner));

/** The corners of what lies within the rim. @param {Patch} patch @returns {[number, number][]} */
export function coreOf(patch) {
  const [low, high] = patch.strength;
  const rim = (patch.soft * (high - low)) / 2;
  const ends = [low > 0 ? low + rim : low, high < 1 ? high - rim : high];
  const sides = ends.map((strength) => {
    const up = (strength - low) / (high - low);
    const [left, right] = [0, 1].map((side) => patch.density[side] + (patch.top[side] - patch.density[side]) * up);
    const inwards = (patch.soft * (right - left)) / 2;
    return [left > 0 ? left + inwards : left, right < 1 ? right - inwards : right];
  });
  return [[sides[0][0], ends[0]], [sides[0][1], ends[0]], [sides[1][1], ends[1]], [sides[1][0], ends[1]]];
}

/** All of it moved, as far as the plane goes. @param {Patch} patch @param {number} across @param {number} up @returns {Patch} */
export function moved(patch, across, up) {
  const along = [...patch.density, ...patch.top];
  const dx = within(-Math.min(...along), across, 1 - Math.max(...along));
  const dy = within(-patch.strength[0], up, 1 - patch.strength[1]);
  const [density, top] = [patch.density, patch.top].map((ends) => /** @type {Ends} */ (ends.map((end) => inside(end + dx))));
  return { ...patch, density, top, strength: [inside(patch.strength[0] + dy), inside(patch.strength[1] + dy)] };
}

/** A handle brought to a place: a corner takes its side of the strengths along. @param {Patch} patch @param {Handle} handle @param {number} density @param {number} strength @returns {Patch} */
export function stretched(patch, handle, density, strength) {
  const side = handle.endsWith("left") || handle === "left side" ? 0 : 1;
  if (handle.endsWith("side")) {
    const by = density - placeOf(patch, handle)[0];
    return { ...patch, density: withEnd(patch.density, side, patch.density[side] + by), top: withEnd(patch.top, side, patch.top[side] + by) };
  }
  const upper = handle.startsWith("upper") ? 1 : 0;
  const key = upper ? "top" : "density";
  const [low, high] = patch.strength;
  const bound = upper ? within(Math.min(low + STEP, 1), strength, 1) : within(0, strength, Math.max(high - STEP, 0));
  return { ...patch, [key]: withEnd(patch[key], side, density), strength: upper ? [low, inside(bound)] : [inside(bound), high] };
}

/** @param {Ends} ends @param {number} side @param {number} to @returns {Ends} */
const withEnd = (ends, side, to) => (side === 0 ? [inside(Math.min(to, ends[1])), ends[1]] : [ends[0], inside(Math.max(to, ends[0]))]);

/** @param {number} value */
const inside = (value) => within(0, rounded(value), 1);
