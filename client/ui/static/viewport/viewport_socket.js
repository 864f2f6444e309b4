// The viewport's transport over one WebSocket, which finds back to the client's process after a drop.

const FIRST_WAIT = 250; // milliseconds before the first new attempt; doubled after each failure
const LONGEST_WAIT = 4000;
const QUIET = 400; // a drop that is over by then is not spoken of
const TICK = 2000;
const ASLEEP = 15000; // between two ticks: the machine slept, and the connection may be dead without knowing
const REFUSED = 1008; // close code of a missing token

const LOST = "No connection to volsplat's process. The picture stays as it was; trying again…";
const TOKEN_MISSING = "This page may no longer see the volume: open the whole address that `volsplat view` printed.";

/** @typedef {import("./viewport_messages.d.ts").PageMessage} PageMessage */
/** @typedef {import("./viewport_messages.d.ts").ProcessMessage} ProcessMessage */
/** @typedef {import("./viewport_messages.d.ts").PictureHeader} PictureHeader */
/** @typedef {{connected: boolean, text: string}} TransportState `text`: what to tell the person, "" if nothing new */

export class ViewportSocket {
  #url;
  #socket = /** @type {WebSocket | null} */ (null);
  #wait = FIRST_WAIT;
  #retry = 0;
  #telling = 0; // the timer that will say it, or has
  #lastTick = Date.now();
  #ticking = 0;
  #message = /** @type {(message: ProcessMessage) => void} */ (() => {});
  #picture = /** @type {(header: PictureHeader, bytes: Uint8Array) => void} */ (() => {});
  #state = /** @type {(state: TransportState) => void} */ (() => {});
  #onVisible = () => this.#woken();
  #onOnline = () => this.#again();

  /** @param {string | URL} url of the WebSocket; nothing happens before open() */
  constructor(url) {
    this.#url = url;
  }

  open() {
    document.addEventListener("visibilitychange", this.#onVisible);
    window.addEventListener("online", this.#onOnline);
    this.#ticking = setInterval(() => this.#tick(), TICK);
    this.#connect();
  }

  close() {
    document.removeEventListener("visibilitychange", this.#onVisible);
    window.removeEventListener("online", this.#onOnline);
    clearInterval(this.#ticking);
    clearTimeout(this.#telling);
    this.#drop();
  }

  /** @param {(message: ProcessMessage) => void} listener */
  onmessage(listener) {
    this.#message = listener;
  }

  /** @param {(header: PictureHeader, bytes: Uint8Array) => void} listener */
  onpicture(listener) {
    this.#picture = listener;
  }

  /** @param {(state: TransportState) => void} listener */
  onstate(listener) {
    this.#state = listener;
  }

  /** Nothing is sent while there is no connection: all that is said is said anew after it. @param {PageMessage} message */
  send(message) {
    if (this.#socket?.readyState === WebSocket.OPEN) this.#socket.send(JSON.stringify(message));
  }

  #connect() {
    const socket = new WebSocket(this.#url);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    socket.onopen = () => this.#found();
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.#message(JSON.parse(data));
      else this.#picture(...pictureParts(data));
    };
    socket.onclose = ({ code }) => this.#closed(code);
  }

  #closed(code) {
    if (code === REFUSED) {
      this.#drop();
      this.#state({ connected: false, text: TOKEN_MISSING });
      return;
    }
    this.#lose();
    this.#retry = setTimeout(() => this.#connect(), this.#wait);
    this.#wait = Math.min(2 * this.#wait, LONGEST_WAIT);
  }

  #lose() {
    this.#drop();
    this.#state({ connected: false, text: "" });
    this.#telling ||= setTimeout(() => this.#state({ connected: false, text: LOST }), QUIET);
  }

  #found() {
    clearTimeout(this.#telling);
    this.#telling = 0;
    this.#wait = FIRST_WAIT;
    this.#state({ connected: true, text: "" });
  }

  /** Let go of the socket, so that nothing late comes from it. */
  #drop() {
    clearTimeout(this.#retry);
    if (this.#socket === null) return;
    this.#socket.onopen = this.#socket.onmessage = this.#socket.onclose = null;
    this.#socket.close();
    this.#socket = null;
  }

  #again() {
    if (this.#socket?.readyState === WebSocket.OPEN) return;
    this.#drop();
    this.#connect();
  }

  #tick() {
    const now = Date.now();
    const slept = now - this.#lastTick > ASLEEP && document.visibilityState === "visible";
    this.#lastTick = now;
    if (slept) {
      this.#lose();
      this.#connect();
    }
  }

  #woken() {
    if (document.visibilityState !== "visible") return;
    this.#lastTick = Date.now(); // ticks are slow in a hidden tab
    this.#again();
  }
}

/** A binary message's header and image. @param {ArrayBuffer} data @returns {[PictureHeader, Uint8Array]} */
export function pictureParts(data) {
  const length = new DataView(data).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  return [header, new Uint8Array(data, 4 + length)];
}
