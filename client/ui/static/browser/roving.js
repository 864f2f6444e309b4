// One stop of Tab for things side by side, as in a toolbar: from one to the next lead the arrows.

/** @typedef {HTMLElement | SVGElement} Item */

export class Roving {
  #items;
  #stop;

  /** @param {Item[]} items in their order; those that are hidden are passed over */
  constructor(items) {
    this.#items = items;
    for (const item of items) {
      item.setAttribute("tabindex", "-1");
      item.addEventListener("focus", () => this.#stopAt(item));
    }
    this.#stopAt(items[0]);
  }

  /** Have Tab stop at one that is shown. */
  keep() {
    const [first] = this.#shown;
    if (first !== undefined && this.#stop.hasAttribute("hidden")) this.#stopAt(first);
  }

  /** To the next, or the one before; round at the ends. @param {number} by */
  go(by) {
    const shown = this.#shown;
    shown.at((shown.indexOf(this.#stop) + by) % shown.length)?.focus({ preventScroll: true });
  }

  get #shown() {
    return this.#items.filter((item) => !item.hasAttribute("hidden"));
  }

  /** @param {Item} item */
  #stopAt(item) {
    this.#stop?.setAttribute("tabindex", "-1");
    item.setAttribute("tabindex", "0");
    this.#stop = item;
  }
}
