// The picture alone: without the panels about it, over the whole screen where the browser lets it have that.

const ALONE = "vs-alone"; // a class of the document
const WITH_COLOURS = "vs-with-colours";
const REMEMBERED = "volsplat-colours";

export class PictureAlone {
  #root = document.documentElement;

  /** @param {AbortSignal} signal */
  constructor(signal) {
    this.#root.classList.toggle(WITH_COLOURS, localStorage.getItem(REMEMBERED) !== null);
    // Escape, which the browser keeps to itself in full screen, ends both.
    document.addEventListener("fullscreenchange", () => document.fullscreenElement ?? this.#show(false), { signal });
  }

  get on() {
    return this.#root.classList.contains(ALONE);
  }

  toggle() {
    this.#show(!this.on);
    if (this.on) {
      // A browser that refuses leaves the picture alone in its window.
      this.#root.requestFullscreen?.().catch(() => undefined);
    } else if (document.fullscreenElement) {
      document.exitFullscreen();
    }
  }

  /** The colours of the tables over the picture, or not; remembered by the browser. */
  toggleColours() {
    if (this.#root.classList.toggle(WITH_COLOURS)) localStorage.setItem(REMEMBERED, "1");
    else localStorage.removeItem(REMEMBERED);
  }

  #show(alone) {
    this.#root.classList.toggle(ALONE, alone);
  }
}
