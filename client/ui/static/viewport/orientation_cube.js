// A small cube that stands as the volume stands; a click on a face looks at it straight.

import { applied, cross, dot, matrixOf } from "./rotation.js";
import { svg } from "./svg.js";

/** @typedef {import("./rotation.js").Vector} Vector */

/** In upright axes. `up` is parallel to two edges of the face. */
const SIDES = /** @type {{view: string, normal: Vector, up: Vector}[]} */ ([
  { view: "front", normal: [0, -1, 0], up: [0, 0, 1] },
  { view: "back", normal: [0, 1, 0], up: [0, 0, 1] },
  { view: "left", normal: [1, 0, 0], up: [0, 0, 1] },
  { view: "right", normal: [-1, 0, 0], up: [0, 0, 1] },
  { view: "top", normal: [0, 0, 1], up: [0, -1, 0] },
  { view: "bottom", normal: [0, 0, -1], up: [0, -1, 0] },
]);

const LARGEST_LETTERS = 1.05; // in halves of a side
const WIDEST = 2.7; // letters of such a size on a side, one beside the other
const TIE = 1e-6; // what is no nearer upright than by this is as near: rounding decides nothing

export class OrientationCube {
  #sides;

  /** @param {Record<string, string>} letters by view @param {(view: string) => void} lookFrom one of AXIS_VIEWS */
  constructor(letters, lookFrom) {
    this.#sides = SIDES.map((side) => {
      const label = svg("text", { class: "vs-letter" });
      label.textContent = letters[side.view];
      label.style.fontSize = `${Math.min(LARGEST_LETTERS, WIDEST / letters[side.view].length)}px`;
      const title = svg("title");
      title.textContent = `look from the ${side.view}`;
      const square = svg("rect", { x: "-1", y: "-1", width: "2", height: "2", rx: "0.12" });
      const element = svg("g", { class: "vs-side", "data-view": side.view }, [title, square, label]);
      element.addEventListener("click", () => lookFrom(side.view));
      return { ...side, element };
    });
    const faces = this.#sides.map(({ element }) => element);
    this.element = svg("svg", { class: "vs-cube", viewBox: "-1.8 -1.8 3.6 3.6" }, faces);
  }

  /** @param {import("./rotation.js").Quaternion} rotation of the view */
  draw(rotation) {
    const toScreen = matrixOf(rotation);
    const light = /** @type {Vector} */ ([-0.3, 0.5, 0.81]);
    for (const { normal, up, element } of this.#sides) {
      const n = applied(toScreen, normal);
      const u = nearestUpright(applied(toScreen, up), n);
      const r = cross(u, n);
      element.toggleAttribute("hidden", n[2] <= 0.02);
      const columns = [r[0], -r[1], -u[0], u[1], n[0], -n[1]].map((part) => part.toFixed(4));
      element.setAttribute("transform", `matrix(${columns.join(" ")})`);
      element.style.setProperty("--vs-shade", (0.25 * (1 - Math.max(0, dot(n, light)))).toFixed(3));
    }
  }
}

/**
 * Where the top of a face's letter points: of the four ways along its edges, the one nearest upright on the screen.
 * @param {Vector} along one edge @param {Vector} normal of the face @returns {Vector}
 */
function nearestUpright(along, normal) {
  const across = cross(along, normal);
  const ways = [along, across, negative(along), negative(across)];
  const uprightness = (/** @type {Vector} */ [x, y]) => y / Math.hypot(x, y);
  return ways.reduce((best, way) => (uprightness(way) > uprightness(best) + TIE ? way : best));
}

/** @param {Vector} v @returns {Vector} */
function negative([x, y, z]) {
  return [-x, -y, -z];
}
