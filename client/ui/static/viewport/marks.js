// All that is drawn over the picture of one volume: bounds, cube, scale, the value under the pointer.

import { edgesOf } from "../bounds/box_faces.js";
import { BoundsBox } from "./bounds_box.js";
import { Grid, Projection } from "./camera.js";
import { OrientationCube } from "./orientation_cube.js";
import { ScaleBars } from "./scale_bar.js";
import { drawLine, svg } from "./svg.js";
import { ValueReadout } from "./value_readout.js";

/** @typedef {import("./bounds_box.js").Bounds} Bounds */
/** @typedef {import("./camera.js").Point} Point */

export class Marks {
  #measuring;
  #closing = new AbortController();
  #measured = svg("g", { class: "vs-measured-lines" });
  #pointed; // where slices cross
  /** The voxel where slices cross, if there are any. @type {import("./rotation.js").Vector | null} */
  point = null;

  /**
   * @param {import("./viewport_messages.d.ts").VolumeTold} volume
   * @param {{
   *   moveBounds: (bounds: Bounds, settled: boolean, at: number) => void,
   *   probe: (at: Point) => void,
   *   lookFrom: (side: string) => void,
   *   measuring: import("../measure/measuring.js").Measuring,
   * }} listeners of what the person does to them
   */
  constructor(volume, { moveBounds, probe, lookFrom, measuring }) {
    this.grid = new Grid(volume);
    const { signal } = this.#closing;
    this.box = new BoundsBox(this.grid, moveBounds, signal);
    this.value = new ValueReadout(volume, probe);
    this.cube = new OrientationCube(volume.sides, lookFrom, signal);
    this.scale = new ScaleBars(volume);
    this.missing = svg("g", { class: "vs-missing" }); // boxes of what no server holds any more
    this.undrawn = svg("g", { class: "vs-undrawn" }); // parts of the picture that a splat server was lost with
    this.#pointed = svg("g", { class: "vs-point" }, [svg("circle", { r: "5" }), svg("path", { d: "M-11 0h8M3 0h8M0 -11v8M0 3v8" })]);
    this.overlay = svg("svg", { class: "vs-overlay" }, [this.missing, this.undrawn, this.#pointed, this.#measured, this.box.element]);
    this.#measuring = measuring;
    const corner = document.createElement("div");
    corner.className = "vs-corner";
    corner.append(measuring.element, this.value.element, this.scale.element);
    this.elements = [this.box.edges, this.overlay, corner, this.cube.element, this.cube.sides];
  }

  remove() {
    this.#closing.abort();
    this.value.clear();
    this.scale.remove();
    for (const element of this.elements) element.remove();
  }

  /**
   * Put them where a picture has them.
   * @param {import("./viewport_messages.d.ts").PictureHeader} picture @param {import("./frame.js").Frame} frame
   * @param {boolean} moving whether a hand is at the view
   */
  place(picture, frame, moving) {
    const projection = new Projection(picture.view, this.grid, picture);
    this.box.place(projection, frame, moving);
    this.cube.draw(picture.view.rotation);
    this.scale.draw(picture.view.zoom * frame.scale, frame.element.width, projection, moving);
    const at = (/** @type {import("./rotation.js").Vector} */ point) =>
      frame.toElement(/** @type {Point} */ (projection.at(point).slice(0, 2)));
    this.#measuring.draw(this.#measured, (point) => ({ at: at(point), near: true }));
    this.#pointed.toggleAttribute("hidden", this.point === null);
    if (this.point !== null) {
      const [x, y] = at(this.point);
      this.#pointed.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
    }
    this.missing.replaceChildren(
      ...picture.missing.flatMap(([low, high]) => edgesOf({ low, high }, projection, frame)).map(({ ends: [from, to] }) => {
        const line = svg("line");
        drawLine(line, from, to);
        return line;
      }),
    );
    this.undrawn.replaceChildren(
      ...picture.undrawn.map(([left, top, width, height]) => {
        const [x, y] = frame.toElement([left - 0.5, top - 0.5]);
        const size = { width: `${width * frame.scale}`, height: `${height * frame.scale}` };
        return svg("rect", { x: `${x}`, y: `${y}`, ...size });
      }),
    );
  }
}
