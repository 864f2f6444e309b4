// In a small window the panels beside the picture are drawers over it: one is open at a time, or none.
//
// Where a window is small enough is said in drawers.css alone; in a larger one the buttons are not there, and what
// stands here does nothing.

/** The event by which others ask for the panel that it is sent to. */
const WANTED = "vs-wanted";

const OPEN = "vs-open";

export class Drawers {
  #page;
  /** @type {Map<HTMLElement, HTMLButtonElement>} */
  #buttons = new Map();
  #closing = new AbortController();

  /**
   * @param {HTMLElement} host of the buttons
   * @param {HTMLElement} page that holds the panels
   * @param {{place: string, name: string}[]} panels a selector of each, and what its button says
   */
  constructor(host, page, panels) {
    this.#page = page;
    const { signal } = this.#closing;
    for (const { place, name } of panels) {
      const panel = /** @type {HTMLElement} */ (page.querySelector(place));
      const button = document.createElement("button");
      button.type = "button";
      button.className = "vs-drawer-button";
      button.textContent = name;
      button.addEventListener("click", () => this.show(this.#isOpen(panel) ? null : panel));
      panel.addEventListener(WANTED, () => this.show(panel), { signal });
      panel.addEventListener("keydown", (event) => this.#onKey(event, panel), { signal });
      this.#buttons.set(panel, button);
      host.append(button);
    }
    this.show(null);
  }

  close() {
    this.#closing.abort();
  }

  /** Open this one and close the others. @param {HTMLElement | null} wanted */
  show(wanted) {
    for (const [panel, button] of this.#buttons) {
      panel.toggleAttribute(OPEN, panel === wanted);
      button.setAttribute("aria-expanded", String(panel === wanted));
    }
    this.#page.toggleAttribute(OPEN, wanted !== null);
  }

  #isOpen(panel) {
    return panel.hasAttribute(OPEN);
  }

  /** @param {KeyboardEvent} event @param {HTMLElement} panel */
  #onKey(event, panel) {
    const button = this.#buttons.get(panel);
    if (event.key !== "Escape" || event.defaultPrevented || button.offsetParent === null) return;
    this.show(null);
    button.focus();
  }
}
