// A bar of a round length, in the volume's unit.

const LONGEST = 140; // CSS pixels

/** The greatest of 1, 2, 5 times a power of ten that is at most `most`. @param {number} most above 0 */
export function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  const factor = [5, 2, 1].find((step) => step * power <= most) ?? 1;
  return Number((factor * power).toPrecision(1));
}

export class ScaleBar {
  #bar = document.createElement("div");
  #text = document.createElement("span");
  #unit;
  #spacing;

  /** @param {{unit: string, reference_spacing: number}} volume its message; without a unit the bar counts voxels */
  constructor({ unit, reference_spacing }) {
    this.#unit = unit || "voxels";
    this.#spacing = unit ? reference_spacing : 1;
    this.#bar.className = "vs-scale-bar";
    this.element = document.createElement("div");
    this.element.className = "vs-scale";
    this.element.append(this.#bar, this.#text);
  }

  /** @param {number} zoom CSS pixels per reference spacing */
  draw(zoom) {
    const perUnit = zoom / this.#spacing;
    const length = roundLength(LONGEST / perUnit);
    const unit = this.#unit === "voxels" && length === 1 ? "voxel" : this.#unit;
    this.#bar.style.width = `${(length * perUnit).toFixed(1)}px`;
    this.#text.textContent = `${length} ${unit}`;
  }
}
