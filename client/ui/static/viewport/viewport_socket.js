// The viewport's transport over one WebSocket, which finds back to the client's process after a drop.

const FIRST_WAIT = 250; // milliseconds before the first new attempt; doubled after each failure
const LONGEST_WAIT = 4000;
const QUIET = 400; // a drop that is over by then is not spoken of
const TICK = 2000; // between two questions whether the process is there
const SILENT = 5000; // without an answer that is spoken of: the line is stalled, or the process
const DEAD = 20000; // without an answer after which the connection is made anew; a slow line may be full for seconds
const MISSED = 2; // questions that could not even be asked, one after the other, that count likewise
const ASLEEP = 15000; // between two ticks: the machine slept, and the connection may be dead without knowing
const REFUSED = 1008; // close code of a missing token
const FORBIDDEN = 403; // the answer to a page without it, for which a socket only fails
const THERE = 204; // the answer while this page may be heard
const BARRED = 3; // attempts that fail, one after the other, while the process answers: something bars sockets
const OTHER_VOLUME = 4001; // close code that has the page loaded anew, since another volume is shown

const LOST = "No connection to volsplat's process. The picture stays as it was; trying again…";
const NO_ANSWER = "volsplat's process does not answer. The picture stays as it was; waiting…";
const NO_SOCKETS =
  "volsplat's process answers, but no WebSocket gets through to it: a proxy in between must pass them on; ask who runs it, or come by ssh.";
const TOKEN_MISSING = "This page may no longer see the volume: open the whole address that `volsplat view` printed.";

/** @typedef {import("./viewport_messages.d.ts").PageMessage} PageMessage */
/** @typedef {import("./viewport_messages.d.ts").ProcessMessage} ProcessMessage */
/** @typedef {import("./viewport_messages.d.ts").PictureHeader} PictureHeader */
/** @typedef {import("./viewport_messages.d.ts").SliceHeader} SliceHeader */
/** @typedef {import("./viewport.js").TransportState} TransportState */

export class ViewportSocket {
  #url;
  #alive;
  #socket = /** @type {WebSocket | null} */ (null);
  #wait = FIRST_WAIT;
  #retry = 0;
  #failed = 0; // attempts since the last that did not
  #telling = 0; // the timer that will say it, or has
  #lastTick = Date.now();
  #ticking = 0;
  #asking = false; // whether an answer is waited for
  #missed = 0; // questions without an answer, one after the other
  #stalled = false; // given up until an answer comes
  #message = /** @type {(message: ProcessMessage) => void} */ (() => {});
  #picture = /** @type {(header: PictureHeader, bytes: Uint8Array) => void} */ (() => {});
  #slice = /** @type {(header: SliceHeader, bytes: Uint8Array) => void} */ (() => {});
  #state = /** @type {(state: TransportState) => void} */ (() => {});
  #onVisible = () => this.#woken();
  #onOnline = () => this.#again();

  /**
   * @param {string | URL} url of the WebSocket; nothing happens before open()
   * @param {string | URL} alive what to fetch to learn whether anybody is there; any answer will do
   */
  constructor(url, alive) {
    this.#url = url;
    this.#alive = alive;
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
    this.#ticking = 0;
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

  /** @param {(header: SliceHeader, bytes: Uint8Array) => void} listener */
  onslice(listener) {
    this.#slice = listener;
  }

  /** @param {(state: TransportState) => void} listener */
  onstate(listener) {
    this.#state = listener;
  }

  /** Nothing is sent while there is no connection; whoever speaks says anew after it what still holds. @param {PageMessage} message */
  send(message) {
    if (this.#connected) this.#socket.send(JSON.stringify(message));
  }

  #connect() {
    const socket = new WebSocket(this.#url);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    socket.onopen = () => this.#found();
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.#message(JSON.parse(data));
      else this.#take(...pictureParts(data));
    };
    socket.onclose = ({ code }) => this.#closed(code);
  }

  /** @param {PictureHeader | SliceHeader} header @param {Uint8Array} bytes */
  #take(header, bytes) {
    if ("slice" in header) this.#slice(header, bytes);
    else this.#picture(header, bytes);
  }

  #closed(code) {
    if (code === REFUSED) {
      this.#drop();
      this.#state({ connected: false, text: TOKEN_MISSING });
      return;
    }
    if (code === OTHER_VOLUME) {
      this.#drop();
      location.reload();
      return;
    }
    this.#failed++;
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
    this.#failed = 0;
    this.#state({ connected: true, anew: true, text: "" });
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
    if (this.#connected) return;
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
    } else if (document.visibilityState === "visible") this.#ask();
  }

  /**
   * Whether the process answers. It is asked beside the socket, on which a large picture may be on its way for long, and
   * which knows for minutes nothing of a line that carries nothing any more.
   */
  async #ask() {
    if (this.#asking) return;
    this.#asking = true;
    const telling = setTimeout(() => this.#tellSilence(), SILENT);
    const answered = await fetch(this.#alive, { cache: "no-store", signal: AbortSignal.timeout(DEAD) }).then(
      ({ status }) => status,
      (error) => (error.name === "TimeoutError" ? null : 0),
    );
    clearTimeout(telling);
    this.#asking = false;
    if (this.#ticking === 0) return; // closed meanwhile
    this.#missed = answered ? 0 : this.#missed + 1;
    if (answered === FORBIDDEN) this.#refused();
    else if (answered === THERE && this.#failed >= BARRED) this.#tellBarred();
    else if (answered) this.#answered();
    else if (this.#connected && (answered === null || this.#missed >= MISSED)) {
      this.#stalled = true;
      this.#lose();
    }
  }

  #tellSilence() {
    if (this.#connected) this.#state({ connected: false, text: NO_ANSWER });
  }

  #tellBarred() {
    clearTimeout(this.#telling);
    this.#state({ connected: false, text: NO_SOCKETS });
  }

  #answered() {
    if (this.#stalled) {
      this.#stalled = false;
      this.#connect();
    } else if (this.#connected) this.#state({ connected: true, anew: false, text: "" });
  }

  /** Another process is there, as after a start anew, which does not know this page; a tab with its address lets all in. */
  #refused() {
    if (this.#connected) return;
    clearTimeout(this.#telling);
    this.#state({ connected: false, text: TOKEN_MISSING });
  }

  get #connected() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  #woken() {
    if (document.visibilityState !== "visible") return;
    this.#lastTick = Date.now(); // ticks are slow in a hidden tab
    this.#again();
  }
}

/** A binary message's header and image. @param {ArrayBuffer} data @returns {[any, Uint8Array]} */
function pictureParts(data) {
  const length = new DataView(data).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  return [header, new Uint8Array(data, 4 + length)];
}
