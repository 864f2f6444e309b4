// The keys of a viewport, and the list of them that `?` shows.

import { AXIS_VIEWS } from "./rotation.js";

const TURN = 5; // degrees
const PAN = 0.05; // of the picture's shorter side
const ZOOM = 1.25;

/** @typedef {import("./viewport.js").Viewport} Viewport */

/** Keys that have no letter, where they lie on a US keyboard. @type {Record<string, string>} */
const BY_PLACE = { Equal: "=", Minus: "-", BracketLeft: "[", BracketRight: "]" };

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** Buttons of the page that keys press, by their selectors; elsewhere these keys scroll. @type {Record<string, string>} */
const PAGES = { PageUp: ".vs-page-up:enabled", PageDown: ".vs-page-down:enabled" };

/** A button of the page, which may have none such. @param {string} button its selector */
const found = (button) => /** @type {HTMLElement | null} */ (document.querySelector(button));

/** Keys without Ctrl; their names tell of Shift. @type {Record<string, (viewport: Viewport) => void>} */
const PLAIN = {
  0: (viewport) => viewport.actions.reset(),
  f: (viewport) => viewport.actions.fit(),
  "+": (viewport) => viewport.actions.zoomBy(ZOOM),
  "=": (viewport) => viewport.actions.zoomBy(ZOOM),
  "-": (viewport) => viewport.actions.zoomBy(1 / ZOOM),
  "[": (viewport) => viewport.actions.rollBy(TURN),
  "]": (viewport) => viewport.actions.rollBy(-TURN),
  i: (viewport) => viewport.actions.toggleInertia(),
  p: (viewport) => viewport.alone?.toggle(),
  c: (viewport) => viewport.alone?.toggleColours(),
  s: (viewport) => viewport.slices?.toggle(),
  m: (viewport) => viewport.measuring.toggle(),
  g: (viewport) => viewport.slices?.toggleColours(),
  o: () => found(".vs-open-volume")?.click(),
  "?": (viewport) => viewport.toggleHelp(),
  ...Object.fromEntries(AXIS_VIEWS.map((name, n) => [n + 1, (viewport) => viewport.actions.lookFrom(name)])),
};

/** @type {[string, string][]} */
const LIST = [
  ["drag", "turn"],
  ["Ctrl drag", "roll"],
  ["Shift drag, right drag", "move"],
  ["drag a handle", "cut"],
  ["Shift drag a handle", "move both ends of the bounds"],
  ["↑ ↓ on a handle", "cut by a voxel"],
  ["one finger", "turn"],
  ["two fingers", "zoom, move"],
  ["wheel", "zoom to the pointer"],
  ["click", "centre what is there"],
  ["1 2 3 4 5 6", AXIS_VIEWS.join(", ")],
  ["0", "reset the view"],
  ["F", "fit what is visible into the window"],
  ["← → ↑ ↓", `turn by ${TURN}°`],
  ["Shift ← → ↑ ↓", "move"],
  ["+ −", "zoom"],
  ["[ ]", `roll by ${TURN}°`],
  ["I", "go on turning when let go, or not"],
  ["P", "the picture alone, over the whole screen"],
  ["C", "show or hide the colours of the tables"],
  ["S", "show or hide three slices"],
  ["G", "slices grey, or in the colours of the tables"],
  ["M", "measure a distance or an angle, or no longer"],
  ["Shift and pointing", "slices through what is seen there"],
  ["O", "open another volume"],
  ["Page Up, Page Down", "the volume before, the next one of a series or folder"],
  ["Ctrl C", "copy the picture"],
  ["Ctrl Z", "undo"],
  ["Ctrl Shift Z", "redo"],
  ["?", "show or hide this list"],
];

const TYPED_IN = "input:not([type=range], [type=checkbox], [type=radio]), textarea, select, [contenteditable]";
const OVER_ALL = "[role=dialog], [role=menu], [role=listbox]"; // open, they have the keys of the whole page

/**
 * Whether a key that was pressed somewhere on the page may be for the viewport. Arrows and pages elsewhere
 * scroll, or move what has the focus.
 * @param {KeyboardEvent} event @param {HTMLElement} element the viewport's
 */
export function isFree(event, element) {
  const target = /** @type {Element} */ (event.target);
  if (element.contains(target)) return true;
  if (event.defaultPrevented || target.closest(TYPED_IN) || document.querySelector(OVER_ALL)) return false;
  return !(event.key in ARROWS || event.key in PAGES) || target === document.body;
}

/**
 * Press a button, but not for a key that is held. Returns whether there is one that can be pressed.
 * @param {string} selector @param {boolean} held
 */
function pressOnce(selector, held) {
  const button = found(selector);
  if (!held) button?.click();
  return button !== null;
}

/** The key by what is on it; where that is no letter of ours, as on a Cyrillic keyboard, by where it lies. @param {KeyboardEvent} event */
function keyOf({ key, code }) {
  if (key.length !== 1) return key;
  if (key <= "~") return key.toLowerCase();
  return /^(?:Key|Digit)(.)$/.exec(code)?.[1].toLowerCase() ?? BY_PLACE[code] ?? key;
}

/** Do what a key says. Returns whether it says anything. @param {KeyboardEvent} event @param {Viewport} viewport */
export function obeyKey(event, viewport) {
  const key = keyOf(event);
  if (event.altKey) return false;
  if (event.ctrlKey || event.metaKey) {
    if (key === "z") event.shiftKey ? viewport.redo() : viewport.undo();
    else if (key === "y") viewport.redo();
    else if (key === "c" && `${getSelection()}` === "") viewport.copy();
    else return false;
    return true;
  }
  if (key in ARROWS) {
    const [x, y] = ARROWS[key];
    if (event.shiftKey) viewport.actions.panBy(x * PAN, y * PAN);
    else viewport.actions.turnBy(x * TURN, y * TURN);
    return true;
  }
  if (key in PAGES) return pressOnce(PAGES[key], event.repeat);
  if (key === "Escape" && viewport.helpShown) viewport.toggleHelp();
  else if (key === "Escape" && viewport.measuring.on) viewport.measuring.toggle();
  else if (key === "Escape" && viewport.alone?.on) viewport.alone.toggle();
  else if (Object.hasOwn(PLAIN, key)) PLAIN[key](viewport);
  else return false;
  return true;
}

/** The list of keys, as a table. */
export function keyList() {
  const table = document.createElement("table");
  for (const [keys, does] of LIST) {
    const row = table.insertRow();
    for (const key of keys.split(", ")) {
      if (row.cells.length === 0) row.insertCell();
      else row.cells[0].append(" or ");
      const shown = document.createElement("kbd");
      shown.textContent = key;
      row.cells[0].append(shown);
    }
    row.insertCell().textContent = does;
  }
  return table;
}
