// @ts-check
// A panel is folded and unfolded by its heading. Which are folded is kept for this tab.

const KEPT = "volsplat-folded";

export class Folding {
  #page;
  /** @type {Set<string>} names of the folded panels */
  #folded = new Set(JSON.parse(sessionStorage.getItem(KEPT) ?? "[]"));
  #closing = new AbortController();

  /** @param {HTMLElement} page that holds the panels */
  constructor(page) {
    this.#page = page;
    page.addEventListener("click", (event) => this.#onClick(event), { signal: this.#closing.signal });
    for (const button of page.querySelectorAll(".vs-fold")) this.#show(button);
  }

  close() {
    this.#closing.abort();
  }

  /** @param {MouseEvent} event */
  #onClick(event) {
    const button = event.target instanceof Element ? event.target.closest(".vs-fold") : null;
    if (button === null || !this.#page.contains(button)) return;
    const name = nameOf(button);
    if (!this.#folded.delete(name)) this.#folded.add(name);
    sessionStorage.setItem(KEPT, JSON.stringify([...this.#folded]));
    this.#show(button);
  }

  /** @param {Element} button */
  #show(button) {
    const folded = this.#folded.has(nameOf(button));
    button.setAttribute("aria-expanded", String(!folded));
    panelOf(button).toggleAttribute("data-folded", folded);
  }
}

/** @param {Element} button */
function panelOf(button) {
  return /** @type {Element} */ (button.closest(".vs-panel"));
}

/** @param {Element} button */
function nameOf(button) {
  return panelOf(button).getAttribute("aria-label") ?? "";
}
