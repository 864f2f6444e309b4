// Rotations as unit quaternions [x, y, z, w] from the volume's upright axes to the screen's (x right, y up, z to the
// viewer), and the named views; protocol/description/view_rotation.py has the same ones.

/** @typedef {[number, number, number, number]} Quaternion */
/** @typedef {[number, number, number]} Vector */
/** @typedef {[Vector, Vector, Vector]} Matrix rows */

const FRONT = /** @type {Quaternion} */ ([-Math.SQRT1_2, 0, 0, Math.SQRT1_2]);

/** Azimuth, elevation and roll in degrees. @type {Record<string, Vector>} */
const NAMED_ANGLES = {
  front: [0, 0, 0],
  back: [180, 0, 0],
  left: [-90, 0, 0], // the viewer at +x
  right: [90, 0, 0], // the viewer at -x
  top: [180, 90, 0], // the viewer at +z, -y up
  bottom: [0, -90, 0], // the viewer at -z, -y up
};

/** The six axis views, in the order of the keys 1 to 6. */
export const AXIS_VIEWS = Object.freeze(Object.keys(NAMED_ANGLES));

/** The rotation of one of AXIS_VIEWS. @param {string} name @returns {Quaternion} */
export function namedView(name) {
  const [azimuth, elevation, roll] = NAMED_ANGLES[name];
  const tipped = product(about(0, elevation), product(FRONT, about(2, azimuth)));
  return product(about(2, roll), tipped);
}

/** Hamilton's product: b is applied first. @param {Quaternion} a @param {Quaternion} b @returns {Quaternion} */
export function product([ax, ay, az, aw], [bx, by, bz, bw]) {
  return [
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
    aw * bw - ax * bx - ay * by - az * bz,
  ];
}

/** @param {Quaternion} q @returns {Quaternion} */
export function normalised(q) {
  const length = Math.hypot(...q);
  return /** @type {Quaternion} */ (q.map((part) => part / length));
}

/** The turn about a coordinate axis of the screen. @param {0|1|2} axis @param {number} degrees @returns {Quaternion} */
export function about(axis, degrees) {
  const half = (degrees * Math.PI) / 360;
  const isHalfTurn = Math.abs(degrees) === 180; // to be exact
  const turn = /** @type {Quaternion} */ ([0, 0, 0, isHalfTurn ? 0 : Math.cos(half)]);
  turn[axis] = Math.sin(half);
  return turn;
}

/** The shortest turn that takes unit vector a to b. @param {Vector} a @param {Vector} b @returns {Quaternion} */
export function between(a, b) {
  const w = 1 + dot(a, b);
  if (w < 1e-12) return about(Math.abs(a[2]) < 0.9 ? 2 : 1, 180); // opposite: any axis will do
  return normalised([...cross(a, b), w]);
}

/** The same turn, made `share` times. @param {Quaternion} turn @param {number} share @returns {Quaternion} */
export function power(turn, share) {
  const [x, y, z, w] = turn[3] < 0 ? turn.map((part) => -part) : turn;
  const sine = Math.hypot(x, y, z);
  if (sine < 1e-12) return [0, 0, 0, 1];
  const half = Math.atan2(sine, w) * share;
  const scale = Math.sin(half) / sine;
  return [x * scale, y * scale, z * scale, Math.cos(half)];
}

/** @param {Quaternion} q of any length @returns {Matrix} */
export function matrixOf(q) {
  const [x, y, z, w] = normalised(q);
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
  ];
}

/** @param {Vector} a @param {Vector} b */
export function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** @param {Vector} a @param {Vector} b @returns {Vector} */
export function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

/** @param {Matrix} m @param {Vector} v @returns {Vector} */
export function applied(m, v) {
  return [dot(m[0], v), dot(m[1], v), dot(m[2], v)];
}

/** @param {Matrix} m @returns {Matrix} */
export function transposed(m) {
  return [
    [m[0][0], m[1][0], m[2][0]],
    [m[0][1], m[1][1], m[2][1]],
    [m[0][2], m[1][2], m[2][2]],
  ];
}

/** @param {Matrix} a @param {Matrix} b @returns {Matrix} */
export function matrixProduct(a, b) {
  const columns = transposed(b);
  return /** @type {Matrix} */ (a.map((row) => columns.map((column) => dot(row, column))));
}

/** @param {Matrix} m not singular @returns {Matrix} */
export function inverse([a, b, c]) {
  const determinant = dot(a, cross(b, c));
  const columns = [cross(b, c), cross(c, a), cross(a, b)];
  return transposed(/** @type {Matrix} */ (columns.map((column) => column.map((part) => part / determinant))));
}
