// Where the scene lies: which way is up, what to look at and from where. World units; the 3D view draws everything
// relative to `origin`, because graphics cards count with seven digits.

import { worldFromUnit } from "./body_shape.ts";
import type { Body, Report, Vec3 } from "./data.ts";
import { add, column, cross, dot, norm, rotationMatrix, row, scale, subtract, unit, viewpoint, type Viewpoint } from "./linear.ts";

export interface Space {
  up: Vec3;
  /** Whether the report says where up is; otherwise it is taken from the cameras. */
  upIsKnown: boolean;
  /** The middle of the objects; without objects, of the cameras. */
  origin: Vec3;
  /** About how far the objects reach from it; without objects, how far the cameras do. */
  objectRadius: number;
  /** About how far objects and cameras reach from it. */
  radius: number;
  /** Corners of the objects, without a few that are far off; without objects, the cameras. */
  objectPoints: Vec3[];
  /** Height of the grid along `up`, relative to the origin. */
  floor: number;
  /** Viewpoints of the frames; null where a camera has none. */
  viewpoints: (Viewpoint | null)[];
  /** The same of their given poses; null also where these were not refined. */
  given: (Viewpoint | null)[];
}

export function makeSpace(report: Report): Space {
  const viewpoints = report.frames.map((frame) => viewpoint(frame.projection));
  const given = report.frames.map((frame) => (frame.given === undefined ? null : viewpoint(frame.given.projection)));
  const cameras = viewpoints.flatMap((view) => (view === null ? [] : [view.center]));
  const up = unit(report.up ?? upOfCameras(report), [0, 0, 1]);
  const bodies = report.objects.flatMap((object) => [object.body, object.truth].flatMap((body) => body ?? []));
  const centers = bodies.map((body) => body.center);
  for (const { body, truth, center } of report.objects) if (body === null && truth === null && center) centers.push(center);
  const points = centers.length > 0 ? centers : cameras;
  const origin: Vec3 = [0, 1, 2].map((axis) => middle(points.map((point) => point[axis] ?? 0))) as Vec3;
  const distance = (point: Vec3): number => norm(subtract(point, origin));
  const sizes = bodies.map((body) => Math.max(...body.half));
  // A few objects that are far off must not make all the others tiny. Where there are cameras only all of them are
  // shown, with room for the lines that stand for them.
  const objectRadius =
    (centers.length > 0
      ? quantile(centers.map(distance), 0.9) + quantile(sizes, 0.9)
      : 1.15 * quantile(cameras.map(distance), 1)) || 1;
  const radius = Math.max(objectRadius, Math.min(quantile(cameras.map(distance), 0.9), 20 * objectRadius));
  const heights = bodies.map((body) => dot(subtract(body.center, origin), up) - reachAlong(body, up));
  const floor = heights.length > 0 ? quantile(heights, 0.1) : -objectRadius;
  const near = bodies.filter((body) => distance(body.center) <= 1.5 * objectRadius);
  const objectPoints = [...near.flatMap(corners), ...centers.filter((point) => distance(point) <= objectRadius)];
  return { up, upIsKnown: report.up !== null, origin, objectRadius, radius, objectPoints, floor, viewpoints, given };
}

/** The corners of the box along a body's axes. */
function corners(body: Body): Vec3[] {
  const place = worldFromUnit(body);
  return [0, 1, 2, 3, 4, 5, 6, 7].map((k) => place([k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1]));
}

/** How far a body reaches from its center along a direction, as an ellipsoid. */
function reachAlong(body: Body, direction: Vec3): number {
  const rotation = rotationMatrix(body.rotation);
  return Math.hypot(...[0, 1, 2].map((k) => (body.half[k] ?? 0) * dot(column(rotation, k), direction)));
}

/** Where the cameras have their upper side, on average: row 1 of a projection points down. */
function upOfCameras(report: Report): Vec3 {
  let sum: Vec3 = [0, 0, 0];
  for (const { projection } of report.frames) {
    const forward = unit(row(projection, 2), [0, 0, 1]);
    const down = row(projection, 1);
    sum = add(sum, unit(subtract(down, scale(forward, dot(down, forward))), [0, 1, 0]));
  }
  return scale(sum, -1);
}

/** Two directions that span the plane across `up`, along axes of the world where up is one. */
export function planeAxes(up: Vec3): [Vec3, Vec3] {
  const axes: Vec3[] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  const first = axes.reduce((a, b) => (Math.abs(dot(b, up)) < Math.abs(dot(a, up)) ? b : a));
  const a = unit(subtract(first, scale(up, dot(first, up))), [1, 0, 0]);
  return [a, cross(up, a)];
}

/** Where one first looks from: behind the cameras, a little higher, so far that all is in sight. */
export function firstLook(space: Space): Vec3 {
  const cameras = space.viewpoints.flatMap((view) => (view === null ? [] : [view.center]));
  const mean = [0, 1, 2].map((axis) => middle(cameras.map((camera) => camera[axis] ?? 0))) as Vec3;
  const flat = (v: Vec3): Vec3 => subtract(v, scale(space.up, dot(v, space.up)));
  const [a, b] = planeAxes(space.up);
  const aside = cameras.length > 0 ? unit(flat(subtract(mean, space.origin)), a) : unit(add(a, scale(b, -1)), a);
  // A little to the side, so that the path of a camera that drives straight on is not seen from behind.
  const turned = unit(add(aside, scale(cross(space.up, aside), 0.6)), aside);
  return unit(add(turned, scale(space.up, 0.6)), [0, 0, 1]);
}

function middle(values: number[]): number {
  return quantile(values, 0.5);
}

function quantile(values: number[], share: number): number {
  const sorted = values.filter(Number.isFinite).sort((a, b) => a - b);
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))] ?? 0;
}

/** A round number near `x`: 1, 2 or 5 times a power of ten. */
export function roundNumber(x: number): number {
  const power = 10 ** Math.floor(Math.log10(x));
  const rounded = power * (x / power < 1.5 ? 1 : x / power < 3.5 ? 2 : x / power < 7.5 ? 5 : 10);
  // 0.30000000000000004 is not round.
  return Number(rounded.toPrecision(1));
}
