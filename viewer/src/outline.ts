// Outlines of bodies in images: exact ellipses of ellipsoids, the edges and the hull of cuboids, hulls of the others.

import type { Body } from "./data.ts";
import { surfacePoints, wireframe } from "./body_shape.ts";
import { column, dot, project, rotationMatrix, row, scale } from "./linear.ts";

type Point = [number, number];

export interface Outline {
  /** Closed border. */
  border: Point[];
  /** Lines inside of it (edges of a cuboid). */
  lines: [Point, Point][];
}

const ELLIPSE_POINTS = 48;

/** The outline of a body in pixels; null when it does not lie wholly in front of the camera. */
export function outline(projection: number[], body: Body): Outline | null {
  if (body.kind === "ellipsoid") {
    const border = ellipsoidOutline(projection, body);
    return border && { border, lines: [] };
  }
  const points: Point[] = [];
  for (const point of surfacePoints(body)) {
    const [x, y, depth] = project(projection, point);
    if (!(depth > 0)) return null;
    points.push([x / depth, y / depth]);
  }
  if (body.kind !== "cuboid") return { border: hull(points), lines: [] };
  const pixel = (point: [number, number, number]): Point => {
    const [x, y, depth] = project(projection, point);
    return [x / depth, y / depth];
  };
  return { border: hull(points), lines: wireframe(body).map(([a, b]) => [pixel(a), pixel(b)]) };
}

/**
 * The ellipse of an ellipsoid: the dual conic `M A M^T - h h^T` with `A` the shape matrix and `h` the projected center
 * (PfD equation 3); as points on it.
 */
function ellipsoidOutline(projection: number[], body: Body): Point[] | null {
  const rotation = rotationMatrix(body.rotation);
  const axes = [0, 1, 2].map((k) => scale(column(rotation, k), body.half[k] ?? NaN));
  const h = project(projection, body.center);
  // Rows of M times the axes: M A M^T is the product of this with its transpose.
  const reach = [0, 1, 2].map((i) => axes.map((axis) => dot(row(projection, i), axis)) as [number, number, number]);
  const conic = (i: 0 | 1 | 2, j: 0 | 1 | 2): number =>
    dot(reach[i] ?? [NaN, NaN, NaN], reach[j] ?? [NaN, NaN, NaN]) - h[i] * h[j];
  const last = conic(2, 2);
  if (!(last < 0) || !(h[2] > 0)) return null;
  const [cx, cy] = [conic(0, 2) / last, conic(1, 2) / last];
  // The dual conic over -last is S - c c^T.
  const [sxx, sxy, syy] = [cx * cx - conic(0, 0) / last, cx * cy - conic(0, 1) / last, cy * cy - conic(1, 1) / last];
  // Cholesky factor of S: it maps the unit circle to the ellipse.
  const l11 = Math.sqrt(sxx);
  const l21 = sxy / l11;
  const l22 = Math.sqrt(syy - l21 * l21);
  if (!Number.isFinite(l11 + l21 + l22)) return null;
  const points: Point[] = [];
  for (let k = 0; k < ELLIPSE_POINTS; k++) {
    const angle = (2 * Math.PI * k) / ELLIPSE_POINTS;
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    points.push([cx + l11 * c, cy + l21 * c + l22 * s]);
  }
  return points;
}

/** The convex hull of points, in order (Andrew's monotone chain). */
export function hull(points: Point[]): Point[] {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const turn = (a: Point, b: Point, c: Point): number =>
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  const half = (list: Point[]): Point[] => {
    const chain: Point[] = [];
    for (const point of list) {
      while (chain.length >= 2 && turn(chain.at(-2) as Point, chain.at(-1) as Point, point) <= 0) chain.pop();
      chain.push(point);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}
