// @ts-check
// Numbers of a table: its values between points, its 256 entries, and how the data's values are written.

/** @typedef {number | [number, number, number]} Value  an opacity, or a colour of r, g, b, each 0..1 */
/** @typedef {[number, Value]} Point  position 0..1 and value */

export const ENTRIES = 256;
const LOG_FROM = 0.05; // of the bars that hold anything, from the lowest
const LEAST_BAR = 0.03;
const LEAST_DIGITS = 4; // of a value with an exponent
const MOST_DIGITS = 15; // a double has no more

/** @param {number} low @param {number} value @param {number} high */
export const within = (low, value, high) => Math.min(Math.max(value, low), high);

/** Positions and values as drawn, to what a pixel can tell. @param {number} value */
export const rounded = (value) => Math.round(value * 1e5) / 1e5;

/** A value's channels. @param {Value} value @returns {number[]} */
export const channels = (value) => (typeof value === "number" ? [value] : value);

/** @param {Value} like @param {number[]} numbers @returns {Value} */
export const valueOf = (like, numbers) =>
  typeof like === "number" ? numbers[0] : [numbers[0], numbers[1], numbers[2]];

/** The table's value at a position. @param {Point[]} points @param {number} position @returns {Value} */
export function valueAt(points, position) {
  const right = points.findIndex(([at]) => at > position);
  if (right === 0) return points[0][1];
  if (right < 0) return points[points.length - 1][1];
  const [low, below] = points[right - 1];
  const [high, above] = points[right];
  const share = (position - low) / (high - low);
  const upper = channels(above);
  return valueOf(below, channels(below).map((value, n) => value + (upper[n] - value) * share));
}

/** The 256 values of a table. @param {Point[]} points @returns {Value[]} */
export const entries = (points) =>
  Array.from({ length: ENTRIES }, (_, n) => valueAt(points, n / (ENTRIES - 1)));

/** The nearest "#rrggbb". @param {number[]} colour */
export const hexOf = (colour) =>
  "#" + colour.map((channel) => Math.round(255 * channel).toString(16).padStart(2, "0")).join("");

/** The colour of "#rrggbb", or null for any other text. @param {string} text @returns {Value | null} */
export function colourOf(text) {
  const match = /^#?([0-9a-f]{2})([0-9a-f]{2})([0-9a-f]{2})$/i.exec(text.trim());
  return match && [parseInt(match[1], 16) / 255, parseInt(match[2], 16) / 255, parseInt(match[3], 16) / 255];
}

/** The number that a person typed, or NaN; a decimal comma will do. @param {string} text */
export const numberOf = (text) => (text.trim() ? Number(text.trim().replace("−", "-").replace(",", ".")) : NaN);

/** A value of the data, to the resolution of 256 steps from low to high. @param {number} value @param {number} low @param {number} high */
export function dataText(value, low, high) {
  const largest = Math.max(Math.abs(low), Math.abs(high));
  const step = (high - low) / (ENTRIES - 1);
  if (largest >= 1e7 || largest < 1e-3) return withDigits(value, Math.max(LEAST_DIGITS, digitsTo(value, step)));
  const decimals = within(0, Math.ceil(-Math.log10(step)), 8);
  return cleaned(value.toFixed(decimals));
}

/** How high each bar of a histogram stands, 0..1. @param {number[]} counts @param {boolean} logarithmic */
export function barHeights(counts, logarithmic) {
  if (!logarithmic) {
    const most = Math.max(1, ...counts.slice(1, -1)); // the ends also hold what lies beyond them, and would dwarf the rest
    return counts.map((count) => Math.min(count / most, 1));
  }
  // The scale begins below the small counts, so that the bulk is no solid slab; what is rarer still just shows.
  const some = counts.filter((count) => count > 0).sort((a, b) => a - b);
  const least = (some[Math.floor(LOG_FROM * some.length)] ?? 1) / 2;
  const span = Math.log((some[some.length - 1] ?? 1) / least);
  return counts.map((count) => (count > 0 ? Math.max(LEAST_BAR, Math.log(count / least) / span) : 0));
}

/** An end of an axis, without decimals that say nothing. @param {number} value @param {number} low @param {number} high */
export const endText = (value, low, high) => trimmed(dataText(value, low, high));

/** Round values about `most` to an axis, the steps 1, 2 or 5 times a power of ten. @param {number} low @param {number} high @param {number} most */
export function ticks(low, high, most) {
  const rough = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5].find((factor) => factor * power >= rough) ?? 10);
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  if (!(count > 0 && count <= 4 * most)) return [];
  return Array.from({ length: count }, (_, n) => ({ value: (first + n) * step, text: tickText((first + n) * step, step) }));
}

/** @param {number} value @param {number} step */
function tickText(value, step) {
  if (Math.abs(value) >= 1e5 || step < 1e-4) return withDigits(value, digitsTo(value, step));
  return cleaned(value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9))));
}

/** How many digits of a value tell it from the next one, a step away. @param {number} value @param {number} step */
const digitsTo = (value, step) => powerOf(Math.abs(value)) - powerOf(step) + 1;

/** Of ten, that is no greater. @param {number} value */
const powerOf = (value) => Math.floor(Math.log10(value) + 1e-9);

/** @param {number} value @param {number} digits */
const withDigits = (value, digits) => (value ? cleaned(trimmed(value.toPrecision(within(1, digits, MOST_DIGITS)))) : "0");

/** Without zeros after the point that say nothing. @param {string} text */
const trimmed = (text) => text.replace(/(\.\d*?)0+(?=e|$)/, "$1").replace(/\.(?=e|$)/, "").replace("e+", "e");

/** Without a minus before zero, and with a true one before all else. @param {string} text */
const cleaned = (text) => (Number(text) === 0 ? text.replace("-", "") : text.replace(/^-/, "−"));
