// @ts-check
// The chips of the steps A to F. They change with every picture, so they are kept out of the page's own rendering, which
// goes over the whole page each time.

/**
 * How one chip looks. `fill`: seconds that its step will take, and has taken; null if nothing is known of that.
 * @typedef {{current: boolean, finished: boolean, title: string, time: string, fill: [number, number] | null}} ChipState
 */

export class StepChips {
  #chips;

  /** @param {HTMLElement} host @param {string[]} letters */
  constructor(host, letters) {
    this.#chips = letters.map((letter) => new Chip(letter));
    host.append(...this.#chips.map((chip) => chip.element));
  }

  /** @param {ChipState[]} states one for each step */
  show(states) {
    states.forEach((state, n) => this.#chips[n].show(state));
  }
}

class Chip {
  #filling = false;
  #timesFilled = 0;

  /** @param {string} letter */
  constructor(letter) {
    this.element = part("vs-step");
    this.element.dataset.step = letter;
    this.bar = part("vs-step-bar");
    const track = part("vs-step-track");
    track.append(this.bar);
    this.element.append(part("vs-step-letter", letter), track);
  }

  /** @param {ChipState} state */
  show({ current, finished, title, time, fill }) {
    this.element.classList.toggle("vs-now", current);
    this.element.classList.toggle("vs-done", finished);
    this.element.setAttribute("aria-current", current ? "step" : "false");
    const told = time ? `${title} (${time})` : title;
    if (this.element.title !== told) this.element.title = told;
    this.#fill(fill);
  }

  /** @param {[number, number] | null} fill */
  #fill(fill) {
    if (fill === null) {
      this.bar.style.animation = "";
    } else if (!this.#filling) {
      this.#timesFilled += 1; // another name starts the animation anew
      const [expected, elapsed] = fill;
      this.bar.style.animation = `vs-fill-${this.#timesFilled % 2} ${expected}s linear ${-elapsed}s forwards`;
    }
    this.#filling = fill !== null;
  }
}

/** @param {string} name its class @param {string} text */
function part(name, text = "") {
  const element = document.createElement("div");
  element.className = name;
  element.textContent = text;
  return element;
}
