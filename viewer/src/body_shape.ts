// Points on bodies. Every body is a unit shape that its axes stretch: a sphere, a cube, a cylinder, a superellipsoid or
// a rounded cube.

import type { Body, Vec3 } from "./data.ts";
import { column, rotationMatrix } from "./linear.ts";

/**
 * The point where the plane with normal `v` touches the unit shape: the gradient of its support function, of a
 * superellipsoid with exponent q that of (sum |v_i|^q)^(1/q), of a rounded cube with roundness r that of
 * (1 - r) sum |v_i| + r |v|. With q = 2 it is the sphere; q = 1 is left to cubes.
 */
export function unitPoint(v: Vec3, { kind, exponent }: Pick<Body, "kind" | "exponent">): Vec3 {
  if (kind === "rounded") {
    const [roundness, norm] = [exponent - 1, Math.hypot(...v)];
    // Where a sphere's ends meet a component is 0 or a rounding error of either sign: the middle of the face, not both corners.
    const sign = (x: number): number => (Math.abs(x) < 1e-6 * norm ? 0 : Math.sign(x));
    return v.map((x) => (1 - roundness) * sign(x) + (roundness * x) / norm) as Vec3;
  }
  const largest = Math.max(...v.map(Math.abs));
  const w = v.map((x) => x / largest) as Vec3;
  const length = w.reduce((sum, x) => sum + Math.abs(x) ** exponent, 0) ** (1 / exponent);
  return w.map((x) => Math.sign(x) * (Math.abs(x) / length) ** (exponent - 1)) as Vec3;
}

/** Maps points of the unit shape to the world. */
export function worldFromUnit(body: Body): (point: Vec3) => Vec3 {
  const rotation = rotationMatrix(body.rotation);
  const axes = [0, 1, 2].map((k) => column(rotation, k).map((x) => x * (body.half[k] ?? NaN)) as Vec3);
  const [a, b, c] = axes as [Vec3, Vec3, Vec3];
  return (p) => {
    const at = (i: 0 | 1 | 2): number => body.center[i] + p[0] * a[i] + p[1] * b[i] + p[2] * c[i];
    return [at(0), at(1), at(2)];
  };
}

/** Points on the rims of the unit cylinder, bottom and top, with the first one again at the end. */
function rim(points: number, z: -1 | 1): Vec3[] {
  const at = (k: number): number => (2 * Math.PI * k) / points;
  return Array.from({ length: points + 1 }, (_, k) => [Math.cos(at(k)), Math.sin(at(k)), z] as Vec3);
}

const CORNERS: Vec3[] = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1]);
const EDGES: [number, number][] = [];
for (let k = 0; k < 8; k++) {
  for (const bit of [1, 2, 4]) if (!(k & bit)) EDGES.push([k, k | bit]);
}

/** Points on each of the three curves of a round wireframe. */
const CURVE_POINTS = 32;

/** Lines that show a body, as pairs of points in the world: edges of a cuboid, rims and four lines between
 * them of a cylinder, else its three central sections. */
export function wireframe(body: Body): [Vec3, Vec3][] {
  const place = worldFromUnit(body);
  if (body.kind === "cuboid") {
    const corners = CORNERS.map(place);
    return EDGES.map(([i, j]) => [corners[i] as Vec3, corners[j] as Vec3]);
  }
  const lines: [Vec3, Vec3][] = [];
  if (body.kind === "cylinder") {
    const [bottom, top] = [rim(CURVE_POINTS, -1).map(place), rim(CURVE_POINTS, 1).map(place)];
    for (const circle of [bottom, top]) {
      for (let k = 0; k < CURVE_POINTS; k++) lines.push([circle[k] as Vec3, circle[k + 1] as Vec3]);
    }
    for (let k = 0; k < CURVE_POINTS; k += CURVE_POINTS / 4) lines.push([bottom[k] as Vec3, top[k] as Vec3]);
    return lines;
  }
  for (let axis = 0; axis < 3; axis++) {
    const at = (k: number): Vec3 => {
      const angle = (2 * Math.PI * k) / CURVE_POINTS;
      const v: Vec3 = [0, 0, 0];
      v[(axis + 1) % 3] = Math.cos(angle);
      v[(axis + 2) % 3] = Math.sin(angle);
      return place(unitPoint(v, body));
    };
    for (let k = 0; k < CURVE_POINTS; k++) lines.push([at(k), at(k + 1)]);
  }
  return lines;
}

/** Points whose convex hull is close to the body; of a cuboid its corners, of a cylinder its rims. */
export function surfacePoints(body: Body): Vec3[] {
  const place = worldFromUnit(body);
  if (body.kind === "cuboid") return CORNERS.map(place);
  if (body.kind === "cylinder") return [...rim(64, -1), ...rim(64, 1)].map(place);
  const points: Vec3[] = [];
  for (let i = 0; i <= 24; i++) {
    const polar = (Math.PI * i) / 24;
    for (let j = 0; j < 48; j++) {
      const angle = (2 * Math.PI * j) / 48;
      const v: Vec3 = [Math.sin(polar) * Math.cos(angle), Math.sin(polar) * Math.sin(angle), Math.cos(polar)];
      points.push(place(unitPoint(v, body)));
    }
  }
  return points;
}
