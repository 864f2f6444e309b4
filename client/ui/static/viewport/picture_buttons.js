// The round buttons at the upper right of the viewport.

import { svg } from "./svg.js";

/** @typedef {import("./viewport.js").Viewport} Viewport */

/**
 * @typedef {Object} PictureButton
 * @property {string} title what it does
 * @property {string} key what does the same
 * @property {string} icon an SVG path within 16 x 16
 * @property {boolean} [ofPage] whether it is about a page's panels
 * @property {(viewport: Viewport) => void} press
 */

/** From the right to the left. @type {PictureButton[]} */
const BUTTONS = [
  {
    title: "keys",
    key: "?",
    icon: "M5.5 6a2.5 2.5 0 1 1 3.6 2.2c-.8.4-1.1.9-1.1 1.8M8 12.2v.6",
    press(viewport) {
      viewport.toggleHelp();
      viewport.canvas.focus();
    },
  },
  {
    title: "the picture alone",
    key: "P",
    icon: "M3 6V3h3M10 3h3v3M13 10v3h-3M6 13H3v-3",
    ofPage: true,
    press: (viewport) => viewport.alone.toggle(),
  },
  {
    title: "colours of the tables",
    key: "C",
    icon: "M2.5 6h11v4h-11zM6 6v4M10 6v4",
    ofPage: true,
    press: (viewport) => viewport.alone.toggleColours(),
  },
  {
    title: "three slices",
    key: "S",
    icon: "M2.5 2.5h11v11h-11zM8 2.5v11M2.5 8h11",
    ofPage: true,
    press: (viewport) => viewport.slices?.toggle(),
  },
  {
    title: "measure",
    key: "M",
    icon: "M2 11 11 2l3 3-9 9zM5 8l1.5 1.5M8 5l1.5 1.5",
    press: (viewport) => viewport.measuring.toggle(),
  },
  { title: "copy the picture", key: "Ctrl C", icon: "M6 6h7v7H6zM3 10V3h7", press: (viewport) => void viewport.copy() },
];

/** @param {Viewport} viewport @param {boolean} wholePage */
export function pictureButtons(viewport, wholePage) {
  const row = document.createElement("div");
  row.className = "vs-picture-buttons";
  for (const { title, key, icon, ofPage, press } of BUTTONS) {
    if (ofPage && !wholePage) continue;
    const button = document.createElement("button");
    button.type = "button";
    button.title = `${title} (${key})`;
    button.setAttribute("aria-label", title);
    button.append(svg("svg", { viewBox: "0 0 16 16", "aria-hidden": "true" }, [svg("path", { d: icon })]));
    button.addEventListener("click", () => press(viewport));
    row.append(button);
  }
  return row;
}
