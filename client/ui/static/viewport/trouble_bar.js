// A bar over the viewport that says in words what went wrong.

const SHOWN_FOR = 8000; // milliseconds, for what does not last

export class TroubleBar {
  #texts = { connection: "", passing: "", lasting: "", picture: "" };
  #timer = 0;

  constructor() {
    this.element = document.createElement("div");
    this.element.className = "vs-trouble";
    this.element.setAttribute("role", "status");
    this.element.hidden = true;
  }

  /** What the transport says of the connection; "" takes it away. @param {string} text */
  ofConnection(text) {
    this.#texts.connection = text;
    this.#draw();
  }

  /** What the client's process says; "" takes it away. What lasts is seen again once others have passed. @param {string} text @param {boolean} lasting */
  ofProcess(text, lasting) {
    clearTimeout(this.#timer);
    this.#texts.passing = lasting ? "" : text;
    if (lasting) this.#texts.lasting = text;
    else if (text) this.#timer = setTimeout(() => this.ofProcess("", false), SHOWN_FOR);
    this.#draw();
  }

  /** What there is to say of the picture on the canvas; "" takes it away. @param {string} text */
  ofPicture(text) {
    if (text === this.#texts.picture) return; // as with nearly every picture
    this.#texts.picture = text;
    this.#draw();
  }

  close() {
    clearTimeout(this.#timer);
  }

  #draw() {
    const { connection, passing, lasting, picture } = this.#texts;
    const text = connection || passing || lasting || picture;
    this.element.hidden = text === "";
    this.element.textContent = text;
  }
}
