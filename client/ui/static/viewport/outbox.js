// What a viewport says of its person's doings: at once, but no more than one message of a kind in some milliseconds, the newest.

const MOST_REMEMBERED = 4096;
const APART = 8; // milliseconds: a mouse tells 60 to 125 moves a second, and what waits here comes late

/** @typedef {import("./viewport_messages.d.ts").ViewTurned} ViewTurned */
/** @typedef {import("./viewport_messages.d.ts").BoundsMoved} BoundsMoved */
/** @typedef {ViewTurned | BoundsMoved} Counted */
/** @typedef {Omit<ViewTurned, "event"> | Omit<BoundsMoved, "event">} Uncounted */

export class Outbox {
  #send;
  #waiting = new Map();
  #newest = /** @type {Map<string, Counted>} */ (new Map()); // of each kind
  #pause = 0; // the timer at whose end the next may go

  /** @param {(message: Counted) => void} send */
  constructor(send) {
    this.#send = send;
    /** Number of the newest event. */
    this.event = 0;
    /** Events and their times on the clock of performance.now(), newest last. @type {{event: number, at: number}[]} */
    this.sent = [];
  }

  /** Say what an event at time `at` has made of things. @param {Uncounted} message @param {number} at */
  post(message, at) {
    this.event += 1;
    remember(this.sent, { event: this.event, at });
    const counted = { ...message, event: this.event };
    this.#newest.set(message.type, counted);
    this.#waiting.set(message.type, counted);
    if (this.#pause === 0) this.#flush();
  }

  /** Say what waits, before anything else is said. */
  hurry() {
    for (const message of this.#waiting.values()) this.#send(message);
    this.#waiting.clear();
  }

  /** Say anew what the person did after an event, since it may have been lost. @param {number} event */
  repeatAfter(event) {
    for (const message of this.#newest.values()) if (message.event > event) this.#send(message);
  }

  close() {
    clearTimeout(this.#pause);
  }

  #flush() {
    this.hurry();
    this.#pause = setTimeout(() => {
      this.#pause = 0;
      if (this.#waiting.size > 0) this.#flush();
    }, APART);
  }
}

/** Append, and forget the oldest beyond some thousands. @template T @param {T[]} list @param {T} item */
export function remember(list, item) {
  list.push(item);
  if (list.length > MOST_REMEMBERED) list.shift();
}
