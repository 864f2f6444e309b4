// Bars of round lengths, one for each scale that the volume needs.

const LONGEST = 140; // CSS pixels
const LEAST_ACROSS = Math.sin((20 * Math.PI) / 180); // of an axis: one that is nearer the line of sight has no bar
const SHARE = 0.36; // of the picture's room, at most: the cube stands beside the bars
const PAUSE = 250; // milliseconds between two looks of bars while the view moves: each has the whole page painted anew

/** @typedef {import("./viewport_messages.d.ts").Scale} Scale */

/** The greatest of 1, 2, 5 times a power of ten that is at most `most`. @param {number} most above 0 */
export function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  const factor = [5, 2, 1].find((step) => step * power <= most) ?? 1;
  return Number((factor * power).toPrecision(1));
}

/** The share of a step that lies on the screen. @param {import("./rotation.js").Vector} step */
function acrossSight([x, y, z]) {
  return Math.hypot(x, y) / Math.hypot(x, y, z);
}

export class ScaleBars {
  #bars;
  #reference;
  #drawnAt = -Infinity;
  #later = 0; // the timer of a look that waits

  /** @param {import("./viewport_messages.d.ts").VolumeTold} volume */
  constructor(volume) {
    this.#reference = volume.reference_spacing;
    this.#bars = volume.scales.map((scale) => new ScaleBar(scale));
    this.element = document.createElement("div");
    this.element.className = "vs-scales";
    this.element.append(...this.#bars.map((bar) => bar.element));
  }

  remove() {
    clearTimeout(this.#later);
  }

  /**
   * @param {number} zoom CSS pixels per reference spacing @param {number} width CSS pixels that the picture has
   * @param {import("./camera.js").Projection} projection @param {boolean} moving whether a hand is at the view: then
   * soon enough, for another picture may come or not
   */
  draw(zoom, width, projection, moving) {
    clearTimeout(this.#later);
    const wait = moving ? PAUSE - (performance.now() - this.#drawnAt) : 0;
    if (wait > 0) {
      this.#later = setTimeout(() => this.draw(zoom, width, projection, false), wait);
      return;
    }
    this.#drawnAt = performance.now();
    const longest = Math.min(LONGEST, SHARE * width);
    for (const bar of this.#bars) bar.draw(zoom / this.#reference, longest, projection);
  }
}

class ScaleBar {
  #bar = document.createElement("div");
  #text = document.createElement("span");
  #scale;
  #drawn = ""; // what it is drawn for

  /** @param {Scale} scale */
  constructor(scale) {
    this.#scale = scale;
    this.#bar.className = "vs-scale-bar";
    this.element = document.createElement("div");
    this.element.className = "vs-scale";
    this.element.append(this.#bar, this.#text);
  }

  /**
   * As long as its axis lies on the screen, if it has one; not at all along the line of sight.
   * @param {number} perLength CSS pixels of the volume's physical unit @param {number} longest CSS pixels
   * @param {import("./camera.js").Projection} projection
   */
  draw(perLength, longest, projection) {
    const { axis } = this.#scale;
    const across = axis === null ? 1 : acrossSight(projection.step(axis));
    const asked = `${perLength} ${longest} ${across}`;
    if (asked === this.#drawn) return; // a text that is set lays out the page, even if it is the same
    this.#drawn = asked;
    this.element.classList.toggle("vs-along-sight", across < LEAST_ACROSS);
    if (across < LEAST_ACROSS) return;
    const perUnit = perLength * this.#scale.length * across;
    const length = roundLength(longest / perUnit);
    const unit = this.#scale.unit === "voxels" && length === 1 ? "voxel" : this.#scale.unit;
    this.#bar.style.width = `${(length * perUnit).toFixed(1)}px`;
    this.#text.textContent = [this.#scale.name, length, unit].filter((word) => word !== "").join(" ");
  }
}
