// Bars of round lengths: one in the volume's unit, or one for each axis of another kind or spacing.

const LONGEST = 140; // CSS pixels
const ALIKE = 1e-3; // by how much, as a share, spacings that count as equal differ

// Units of one kind: axes in them are lengths of the volume, if it has one of them as well.
const KINDS = [
  ["deg", "arcmin", "arcsec", "mas", "rad"],
  ["pm", "Å", "Angstrom", "nm", "um", "µm", "mm", "cm", "m", "km", "AU", "pc", "kpc", "Mpc"],
];

/** @typedef {import("./viewport_messages.d.ts").VolumeTold} VolumeTold an axis' index n stands for first + n * step */
/**
 * What a length in the picture is. @typedef {Object} Scale
 * @property {string} name of the axes that it holds for, "" if it holds for all
 * @property {string} unit "" for what has none
 * @property {number} length in the volume's physical unit, of one `unit`
 */

/** The greatest of 1, 2, 5 times a power of ten that is at most `most`. @param {number} most above 0 */
export function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  const factor = [5, 2, 1].find((step) => step * power <= most) ?? 1;
  return Number((factor * power).toPrecision(1));
}

/** The scales that a volume needs, at least one. @param {VolumeTold} volume @returns {Scale[]} */
export function scalesOf({ unit, axes, index_to_upright }) {
  const spacing = [0, 1, 2].map((axis) => Math.hypot(...index_to_upright.map((row) => row[axis])));
  const ofLength = [0, 1, 2].filter((n) => unit && (axes === null || alike(axes[n].unit, unit)));
  if (axes === null && unit === "" && Math.max(...spacing) <= Math.min(...spacing) * (1 + ALIKE))
    return [{ name: "", unit: "voxels", length: spacing[0] }];
  const others = [0, 1, 2].filter((n) => !ofLength.includes(n)).map((n) => scaleAlong(axes?.[n], "ijk"[n], spacing[n]));
  if (ofLength.length === 0) return joined(others);
  const name = others.length > 0 ? ofLength.map((n) => axes[n].name).join(", ") : "";
  return [{ name, unit, length: 1 }, ...joined(others)];
}

/** Those that are alike as one, by all their names. @param {Scale[]} scales */
function joined(scales) {
  const told = /** @type {Scale[]} */ ([]);
  for (const scale of scales) {
    const same = told.find(({ unit, length }) => unit === scale.unit && Math.abs(length / scale.length - 1) < ALIKE);
    if (same) same.name += `, ${scale.name}`;
    else told.push({ ...scale });
  }
  return told;
}

function scaleAlong(axis, letter, spacing) {
  if (axis === undefined) return { name: letter, unit: "voxels", length: spacing };
  return { name: axis.name, unit: axis.unit, length: axis.step === 0 ? spacing : spacing / Math.abs(axis.step) };
}

/** Whether an axis in one unit is measured by another. @param {string} own "" for what has none @param {string} unit */
function alike(own, unit) {
  return own === "" || own === unit || KINDS.some((kind) => kind.includes(own) && kind.includes(unit));
}

export class ScaleBars {
  #bars;
  #reference;

  /** @param {VolumeTold} volume */
  constructor(volume) {
    this.#reference = volume.reference_spacing;
    this.#bars = scalesOf(volume).map((scale) => new ScaleBar(scale));
    this.element = document.createElement("div");
    this.element.className = "vs-scales";
    this.element.append(...this.#bars.map((bar) => bar.element));
  }

  /** @param {number} zoom CSS pixels per reference spacing */
  draw(zoom) {
    for (const bar of this.#bars) bar.draw(zoom / this.#reference);
  }
}

class ScaleBar {
  #bar = document.createElement("div");
  #text = document.createElement("span");
  #scale;

  /** @param {Scale} scale */
  constructor(scale) {
    this.#scale = scale;
    this.#bar.className = "vs-scale-bar";
    this.element = document.createElement("div");
    this.element.className = "vs-scale";
    this.element.append(this.#bar, this.#text);
  }

  /** @param {number} perLength CSS pixels of the volume's physical unit */
  draw(perLength) {
    const perUnit = perLength * this.#scale.length;
    const length = roundLength(LONGEST / perUnit);
    const unit = this.#scale.unit === "voxels" && length === 1 ? "voxel" : this.#scale.unit;
    this.#bar.style.width = `${(length * perUnit).toFixed(1)}px`;
    this.#text.textContent = [this.#scale.name, length, unit].filter((word) => word !== "").join(" ");
  }
}
