// Where a picture lies within its element: as large as fits, in the middle.

/** @typedef {import("./camera.js").Size} Size */
/** @typedef {import("./camera.js").Point} Point */

export class Frame {
  /** @param {Size} picture in its pixels @param {Size} element in CSS pixels */
  constructor(picture, element) {
    this.picture = picture;
    this.element = element;
    /** CSS pixels per picture pixel. */
    this.scale = Math.min(element.width / picture.width, element.height / picture.height);
    this.left = (element.width - picture.width * this.scale) / 2;
    this.top = (element.height - picture.height * this.scale) / 2;
  }

  /** From CSS pixels in the element to picture pixels (camera.js). @param {Point} at @returns {Point} */
  toPicture([x, y]) {
    return [(x - this.left) / this.scale - 0.5, (y - this.top) / this.scale - 0.5];
  }

  /** The other way. @param {Point} at @returns {Point} */
  toElement([x, y]) {
    return [(x + 0.5) * this.scale + this.left, (y + 0.5) * this.scale + this.top];
  }

  /** Whether a place in the element is on the picture. @param {Point} at */
  holds(at) {
    const [x, y] = this.toPicture(at);
    return x >= -0.5 && y >= -0.5 && x < this.picture.width - 0.5 && y < this.picture.height - 0.5;
  }
}
