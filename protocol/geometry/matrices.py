"""3-vectors and 3x3 matrices as plain Python floats.

Every number that decides the image is derived with single IEEE operations (no BLAS, no fused arithmetic), so
that each machine of a lab derives the same bits.
"""

import math
from collections.abc import Sequence

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]  # rows

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def length(a: Vector) -> float:
    return math.sqrt(dot(a, a))


def scaled(a: Vector, factor: float) -> Vector:
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def plus(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def minus(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def normalised(a: Vector) -> Vector:
    """`a` at length 1, however short or long it is. Raises ValueError for the zero vector and what is not finite."""
    largest = max(abs(a[0]), abs(a[1]), abs(a[2]))
    if largest == 0.0 or not all(math.isfinite(x) for x in a):
        raise ValueError("a direction needs a finite, non-zero length")
    reduced = (a[0] / largest, a[1] / largest, a[2] / largest)  # its squares neither vanish nor overflow
    size = length(reduced)
    return (reduced[0] / size, reduced[1] / size, reduced[2] / size)


def column(m: Matrix, index: int) -> Vector:
    return (m[0][index], m[1][index], m[2][index])


def transposed(m: Matrix) -> Matrix:
    return (column(m, 0), column(m, 1), column(m, 2))


def applied(m: Matrix, v: Vector) -> Vector:
    return (dot(m[0], v), dot(m[1], v), dot(m[2], v))


def product(a: Matrix, b: Matrix) -> Matrix:
    columns = transposed(b)
    return (
        (dot(a[0], columns[0]), dot(a[0], columns[1]), dot(a[0], columns[2])),
        (dot(a[1], columns[0]), dot(a[1], columns[1]), dot(a[1], columns[2])),
        (dot(a[2], columns[0]), dot(a[2], columns[1]), dot(a[2], columns[2])),
    )


def times(m: Matrix, factor: float) -> Matrix:
    return (scaled(m[0], factor), scaled(m[1], factor), scaled(m[2], factor))


def determinant(m: Matrix) -> float:
    return dot(m[0], cross(m[1], m[2]))


def inverse(m: Matrix) -> Matrix:
    """The inverse by cofactors. Raises ValueError where `m` is singular."""
    det = determinant(m)
    if det == 0.0 or not math.isfinite(det):
        raise ValueError("the matrix has no inverse: its three axes do not span space")
    columns = (cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1]))
    return transposed((scaled(columns[0], 1 / det), scaled(columns[1], 1 / det), scaled(columns[2], 1 / det)))


def rotation_from_quaternion(q: tuple[float, float, float, float]) -> Matrix:
    """The rotation of the quaternion (x, y, z, w), which is normalised first. Raises ValueError for zero."""
    largest = max(abs(part) for part in q)
    if largest == 0.0 or not all(math.isfinite(part) for part in q):
        raise ValueError("a rotation needs a quaternion of finite, non-zero length")
    x, y, z, w = q[0] / largest, q[1] / largest, q[2] / largest, q[3] / largest
    size = math.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / size, y / size, z / size, w / size
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )


def quaternion_from_rotation(m: Matrix) -> tuple[float, float, float, float]:
    """The unit quaternion (x, y, z, w) of a rotation, by the largest of its parts (Shepperd 1978)."""
    xx, yy, zz = m[0][0], m[1][1], m[2][2]
    squares = (1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz)  # 4 times x^2, y^2, z^2, w^2
    xy, xz, yz = m[0][1] + m[1][0], m[0][2] + m[2][0], m[1][2] + m[2][1]
    xw, yw, zw = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]
    largest = squares.index(max(squares))
    x, y, z, w = (
        (squares[0], xy, xz, xw),
        (xy, squares[1], yz, yw),
        (xz, yz, squares[2], zw),
        (xw, yw, zw, squares[3]),
    )[largest]
    size = math.sqrt(x * x + y * y + z * z + w * w)
    return (x / size, y / size, z / size, w / size)


def cube_root(value: float) -> float:
    """The cube root of a positive number by Newton's method, since libm's differs between machines."""
    _, exponent = math.frexp(value)
    root = math.ldexp(1.0, exponent // 3)
    for _ in range(40):
        root -= (root * root * root - value) / (3 * root * root)
    return root


def nearest_axes(directions: Sequence[Vector]) -> tuple[int, int, int]:
    """For each of three directions an axis of its own, so that together they lie nearest."""
    orders = ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))
    return max(orders, key=lambda order: sum(abs(directions[n][axis]) for n, axis in enumerate(order)))
