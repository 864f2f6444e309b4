// @ts-check
// What the hand does with the panels is told by NiceGUI's socket until the process has answered it: of what is on its
// way when a line is cut, nobody knows whether it came. And a line that stands still leaves the page as it is: NiceGUI
// would load it anew, which by that line leads nowhere.

const FOR_EVER = 2 ** 31 - 1; // milliseconds, the longest that browsers wait
const TIMEOUT = "timeout"; // of an attempt to connect that has no answer

/**
 * Socket.IO's, as far as it is used here.
 * @typedef {object} Socket
 * @property {(kind: string, ...said: any[]) => any} emit
 * @property {(kind: string, listener: (...heard: any[]) => void) => void} on
 * @property {(kind: string) => void} off
 * @property {(kind: string) => ((...heard: any[]) => void)[]} listeners
 * @property {(milliseconds: number) => void} timeout  of the answer to what is said next
 * @property {{data: any[]}[]} sendBuffer  what waits for a connection
 */

/**
 * Number what a socket tells as "event", and repeat what is not answered; the process takes each number once.
 * @param {Socket} socket
 */
export function keepEvents(socket) {
  const emit = socket.emit.bind(socket);
  let number = Date.now(); // so that a page which a browser kept, and begins once more, goes on above what it said
  /** @param {object} event */
  const tell = (event) => {
    socket.timeout(FOR_EVER);
    emit("event", event, (/** @type {Error | null} */ lost) => lost && tell(event));
  };
  socket.emit = (kind, ...said) => (kind === "event" ? tell({ ...said[0], number: ++number }) : emit(kind, ...said));
  // What waits is told of as lost as well, so that all of it is told anew in its order.
  socket.on("disconnect", () => {
    socket.sendBuffer = socket.sendBuffer.filter(({ data }) => data[0] !== "event");
  });
}

/**
 * Have a socket that was connected once try again for as long as it takes.
 * @param {Socket} socket
 * @param {() => boolean} connectedOnce
 */
export function keepPage(socket, connectedOnce) {
  const listeners = socket.listeners("connect_error").slice();
  socket.off("connect_error");
  socket.on("connect_error", (error) => {
    if (error.message !== TIMEOUT || !connectedOnce()) for (const listener of listeners) listener(error);
  });
}
