// Files that are dropped anywhere on the page. A browser left alone would show the file in the page's place.

const OVER = "vs-over";

export class Dropping {
  #host;
  #told;
  #closing = new AbortController();

  /**
   * @param {HTMLElement} host seen while files are held over the page
   * @param {(file: File, isFolder: boolean, count: number) => void} told of the first of the dropped files
   */
  constructor(host, told) {
    this.#host = host;
    this.#told = told;
    const listening = { signal: this.#closing.signal, capture: true };
    window.addEventListener("dragover", (event) => this.#over(event), listening);
    window.addEventListener("dragleave", (event) => event.relatedTarget ?? this.#show(false), listening);
    window.addEventListener("drop", (event) => this.#drop(event), listening);
  }

  close() {
    this.#closing.abort();
  }

  /** @param {DragEvent} event */
  #over(event) {
    if (!this.#takes(event)) return;
    event.dataTransfer.dropEffect = "copy";
    this.#show(true);
  }

  /** @param {DragEvent} event */
  #drop(event) {
    if (!this.#takes(event)) return;
    this.#show(false);
    const { files, items } = event.dataTransfer;
    if (files.length) this.#told(files[0], items[0]?.webkitGetAsEntry()?.isDirectory ?? false, files.length);
  }

  /** Keep it from the browser and from the rest of the page, if it is about files. @param {DragEvent} event */
  #takes(event) {
    const takes = event.dataTransfer?.types.includes("Files") ?? false;
    if (takes) {
      event.preventDefault();
      event.stopPropagation();
    }
    return takes;
  }

  /** @param {boolean} over */
  #show(over) {
    this.#host.classList.toggle(OVER, over);
  }
}
