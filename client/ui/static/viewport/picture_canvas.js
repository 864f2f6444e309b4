// The canvas of a viewport: shows pictures as they come, never an older one after a newer one, and never blinks.

/** @typedef {import("./viewport_messages.d.ts").PictureHeader} PictureHeader */

const PNG = 0x89; // its first byte

export class PictureCanvas {
  #context;
  #newest = 0; // number of the newest picture that is drawn
  #connection = 0; // counts up, so that nothing of an old connection is drawn in a new one

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {(number: number) => void} acknowledge called for every picture, drawn or dropped
   * @param {(header: PictureHeader) => void} drawn called right after one is on the canvas
   * @param {(text: string) => void} tell
   */
  constructor(canvas, acknowledge, drawn, tell) {
    this.canvas = canvas;
    this.#context = canvas.getContext("2d", { alpha: false });
    this.acknowledge = acknowledge;
    this.drawn = drawn;
    this.tell = tell;
  }

  /** Until a picture has come, show this one. @param {HTMLImageElement} image */
  begin(image) {
    this.canvas.width = image.naturalWidth;
    this.canvas.height = image.naturalHeight;
    this.#context.drawImage(image, 0, 0);
  }

  /** Numbers may begin anew. */
  reconnected() {
    this.#connection += 1;
    this.#newest = 0;
  }

  /** @param {PictureHeader} header @param {Uint8Array} bytes JPEG or PNG */
  async show(header, bytes) {
    const connection = this.#connection;
    if (header.number > this.#newest) {
      const image = await decoded(bytes).catch(() => null);
      if (connection !== this.#connection) return;
      if (image === null) this.tell(`Picture ${header.number} arrived damaged; ${cureOf(header)}.`);
      else if (header.number > this.#newest) this.#draw(header, image);
      image?.close();
    }
    this.acknowledge(header.number);
  }

  /** Put it on the clipboard, as PNG. Returns what to tell the person. */
  async copy() {
    if (!navigator.clipboard?.write) {
      return "This browser copies pictures over https and from this machine only; save the picture instead.";
    }
    const png = new Promise((resolve, reject) => {
      this.canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("there is no picture"))), "image/png");
    });
    try {
      await navigator.clipboard.write([new ClipboardItem({ "image/png": /** @type {Promise<Blob>} */ (png) })]);
      return "The picture is on the clipboard.";
    } catch (error) {
      const why = /** @type {Error} */ (error).message.replace(/\.$/, "");
      return `The picture could not be copied: ${why}; save it instead.`;
    }
  }

  /** @param {PictureHeader} header @param {ImageBitmap | VideoFrame} image */
  #draw(header, image) {
    const { number, width, height } = header;
    this.#newest = number;
    if (this.canvas.width !== width || this.canvas.height !== height) {
      Object.assign(this.canvas, { width, height }); // clears it, and is drawn over before anybody sees that
    }
    this.#context.drawImage(image, 0, 0);
    this.drawn(header);
  }
}

/** @param {PictureHeader} header */
const cureOf = ({ last }) => (last ? "move the view to have it drawn again" : "a newer one will replace it");

/** A picture that can be drawn; a Blob would go through the browser's own process first, some 7 ms. @param {Uint8Array<any>} bytes */
async function decoded(bytes) {
  if (!("ImageDecoder" in window)) {
    return createImageBitmap(new Blob([bytes]), { colorSpaceConversion: "none", premultiplyAlpha: "none" });
  }
  const type = bytes[0] === PNG ? "image/png" : "image/jpeg";
  const decoder = new ImageDecoder({ data: bytes, type, colorSpaceConversion: "none" });
  try {
    return (await decoder.decode()).image;
  } finally {
    decoder.close();
  }
}
