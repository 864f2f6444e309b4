// @ts-check
// A panel's inner edge is dragged, or moved by keys, to make it wider or narrower. Widths are kept for this tab.
//
// How wide a panel is that nobody has changed, and where panels lie beside the picture at all, page.css and drawers.css
// say. A window that becomes small takes from the panels for as long as it is, not for good.

const KEPT = "volsplat-panel-widths";
const STEP = 16; // CSS pixels that an arrow key moves an edge
const MOST = 56; // em of a panel
const LEAST_PICTURE = 320; // CSS pixels that are left of the picture's width

/** @typedef {{panel: string, variable: string, label: string, towards: number, least: number}} Edge */

export class PanelWidths {
  #page;
  /** @type {Separator[]} */
  #separators;
  /** @type {Record<string, number>} widths that were chosen, by their variables */
  #chosen = JSON.parse(sessionStorage.getItem(KEPT) ?? "{}");
  #closing = new AbortController();

  /** @param {HTMLElement} page that holds the panels @param {Edge[]} edges */
  constructor(page, edges) {
    this.#page = page;
    this.#separators = edges.map((edge) => new Separator(page, edge, (width) => this.#choose(edge, width)));
    window.addEventListener("resize", () => this.#show(), { signal: this.#closing.signal });
    this.#show();
  }

  close() {
    this.#closing.abort();
    for (const { element } of this.#separators) element.remove();
  }

  /** @param {Edge} edge @param {number | null} width none: as it is by itself */
  #choose({ variable }, width) {
    if (width === null) delete this.#chosen[variable];
    else this.#chosen[variable] = width;
    sessionStorage.setItem(KEPT, JSON.stringify(this.#chosen));
    this.#show();
  }

  #show() {
    for (const { edge } of this.#separators) this.#page.style.removeProperty(edge.variable);
    for (const separator of this.#separators) {
      const most = this.#most(separator);
      const chosen = this.#chosen[separator.edge.variable];
      if (chosen !== undefined) {
        const width = Math.round(within(chosen, separator.least, most));
        this.#page.style.setProperty(separator.edge.variable, `${width}px`);
      }
      separator.tell(most);
    }
    for (const separator of this.#separators) separator.tell(this.#most(separator));
  }

  /** What leaves enough of the picture. @param {Separator} separator */
  #most({ panel, least }) {
    const picture = /** @type {HTMLElement} */ (this.#page.querySelector(".vs-view"));
    const left = Math.floor(widthOf(panel) + widthOf(picture) - LEAST_PICTURE);
    return Math.max(least, Math.min(Math.round(MOST * emOf(panel)), left));
  }
}

class Separator {
  #move;
  #most = 0;
  #from = /** @type {{x: number, width: number} | null} */ (null); // where a drag has begun

  /** @param {HTMLElement} page @param {Edge} edge @param {(width: number | null) => void} move */
  constructor(page, edge, move) {
    this.edge = edge;
    this.panel = /** @type {HTMLElement} */ (page.querySelector(edge.panel));
    this.#move = move;
    this.element = document.createElement("div");
    this.element.className = `vs-separator ${edge.towards > 0 ? "vs-of-left" : "vs-of-right"}`;
    this.element.tabIndex = 0;
    this.element.title = "drag to make the panel wider or narrower, double click for its own width";
    const said = { role: "separator", "aria-orientation": "vertical", "aria-label": edge.label };
    for (const [name, value] of Object.entries(said)) this.element.setAttribute(name, value);
    this.element.addEventListener("pointerdown", (event) => this.#onDown(event));
    this.element.addEventListener("pointermove", (event) => this.#onMove(event));
    for (const name of ["pointerup", "pointercancel"]) this.element.addEventListener(name, () => (this.#from = null));
    this.element.addEventListener("dblclick", () => this.#move(null));
    this.element.addEventListener("keydown", (event) => this.#onKey(event));
    this.panel.after(this.element);
  }

  /** Less would cut off what stands in the panel. */
  get least() {
    return Math.round(this.edge.least * emOf(this.panel));
  }

  get width() {
    return widthOf(this.panel);
  }

  /** How wide it is, and may be. @param {number} most */
  tell(most) {
    this.#most = most;
    const width = Math.round(this.width);
    this.element.setAttribute("aria-valuemin", `${this.least}`);
    this.element.setAttribute("aria-valuemax", `${most}`);
    this.element.setAttribute("aria-valuenow", `${width}`);
    this.element.setAttribute("aria-valuetext", `${width} pixels`);
  }

  /** @param {PointerEvent} event */
  #onDown(event) {
    if (event.button !== 0) return;
    this.element.setPointerCapture(event.pointerId);
    this.#from = { x: event.clientX, width: this.width };
  }

  /** @param {PointerEvent} event */
  #onMove(event) {
    if (this.#from === null || event.clientX === this.#from.x) return;
    this.#to(this.#from.width + this.edge.towards * (event.clientX - this.#from.x));
  }

  /** @param {KeyboardEvent} event */
  #onKey(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const grows = this.edge.towards * STEP;
    /** @type {Record<string, () => void>} */
    const keys = {
      ArrowRight: () => this.#to(this.width + grows),
      ArrowLeft: () => this.#to(this.width - grows),
      Home: () => this.#to(this.least),
      End: () => this.#to(this.#most),
      Enter: () => this.#move(null),
    };
    if (!(event.key in keys)) return;
    event.preventDefault();
    event.stopPropagation();
    keys[event.key]();
  }

  /** @param {number} width */
  #to(width) {
    this.#move(within(width, this.least, this.#most));
  }
}

/** @param {Element} element */
function widthOf(element) {
  return element.getBoundingClientRect().width;
}

/** CSS pixels of its letters' size. @param {Element} element */
function emOf(element) {
  return parseFloat(getComputedStyle(element).fontSize);
}

/** @param {number} value @param {number} least @param {number} most */
function within(value, least, most) {
  return Math.min(Math.max(value, least), most);
}
