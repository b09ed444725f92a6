// The little linear algebra of projections: 3x3 matrices and 3x4 projections as lists of numbers, by rows.

import type { Vec3 } from "./data.ts";

type Matrix3 = number[];

export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const add = (a: Vec3, b: Vec3): Vec3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Vec3, s: number): Vec3 => [a[0] * s, a[1] * s, a[2] * s];
export const norm = (a: Vec3): number => Math.hypot(...a);
export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

/** The vector with length one; `fallback` where it has none. */
export function unit(a: Vec3, fallback: Vec3): Vec3 {
  const length = norm(a);
  return length > 0 && Number.isFinite(length) ? scale(a, 1 / length) : fallback;
}

/** Row i of the left 3x3 block of a projection. */
export function row(projection: number[], i: number): Vec3 {
  return [projection[4 * i] ?? NaN, projection[4 * i + 1] ?? NaN, projection[4 * i + 2] ?? NaN];
}

/** The homogeneous pixel of a point: positive last coordinate in front of the camera. */
export function project(projection: number[], point: Vec3): Vec3 {
  const at = (i: number): number => dot(row(projection, i), point) + (projection[4 * i + 3] ?? NaN);
  return [at(0), at(1), at(2)];
}

/** The rotation of a quaternion (w first), by rows. */
export function rotationMatrix([w, x, y, z]: [number, number, number, number]): Matrix3 {
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
}

/** Column j of a 3x3 matrix. */
export function column(m: Matrix3, j: number): Vec3 {
  return [m[j] ?? NaN, m[3 + j] ?? NaN, m[6 + j] ?? NaN];
}

/** Where a camera is and which way its pixels look. */
export interface Viewpoint {
  center: Vec3;
  /** Unit axes in the world: to the right, down and forward. */
  axes: [Vec3, Vec3, Vec3];
  /** The direction of a pixel's ray, with length one. */
  direction(x: number, y: number): Vec3;
}

/** The viewpoint of a projection; null when it has none. */
export function viewpoint(projection: number[]): Viewpoint | null {
  const [a, b, c] = [row(projection, 0), row(projection, 1), row(projection, 2)];
  const determinant = dot(a, cross(b, c));
  // The columns of the inverse are these cross products.
  const solve = (v: Vec3): Vec3 =>
    scale(add(add(scale(cross(b, c), v[0]), scale(cross(c, a), v[1])), scale(cross(a, b), v[2])), 1 / determinant);
  const last = (i: number): number => projection[4 * i + 3] ?? NaN;
  const center = solve([-last(0), -last(1), -last(2)]);
  if (!center.every(Number.isFinite)) return null;
  const forward = unit(c, [0, 0, 1]);
  const down = unit(subtract(b, scale(forward, dot(b, forward))), [0, 1, 0]);
  return { center, axes: [cross(down, forward), down, forward], direction: (x, y) => unit(solve([x, y, 1]), [0, 0, 1]) };
}
