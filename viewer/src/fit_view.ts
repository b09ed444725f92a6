// From where a perspective camera sees all of some points, as large as its picture allows.

import type { Vec3 } from "./data.ts";
import { add, cross, dot, scale, subtract, unit } from "./linear.ts";

export interface Fit {
  target: Vec3;
  /** Distance of the camera from the target. */
  distance: number;
}

/**
 * Where to look at and from how far, in the direction `from` (from the target to the camera, length one), with `up`
 * upwards. `reach` are the tangents of half the angles of the picture, across and upwards, that the points may fill.
 */
export function fitView(points: Vec3[], from: Vec3, up: Vec3, reach: [number, number]): Fit {
  const right = unit(cross(up, from), unit(cross([from[1], from[2], from[0]], from), [1, 0, 0]));
  const above = cross(from, right);
  let target = points.reduce((sum, point) => add(sum, scale(point, 1 / points.length)), [0, 0, 0] as Vec3);
  const needed = (): number => {
    let distance = 0;
    for (const point of points) {
      const to = subtract(point, target);
      const side = Math.max(Math.abs(dot(to, right)) / reach[0], Math.abs(dot(to, above)) / reach[1]);
      distance = Math.max(distance, dot(to, from) + side);
    }
    return distance;
  };
  for (let round = 0; round < 8; round++) {
    const distance = needed();
    if (!(distance > 0)) break;
    // The middle of what is seen becomes the target.
    const middle = (axis: Vec3): number => {
      let [low, high] = [Infinity, -Infinity];
      for (const point of points) {
        const to = subtract(point, target);
        const slope = dot(to, axis) / Math.max(distance - dot(to, from), 1e-3 * distance);
        [low, high] = [Math.min(low, slope), Math.max(high, slope)];
      }
      return (distance * (low + high)) / 2;
    };
    target = add(target, add(scale(right, middle(right)), scale(above, middle(above))));
  }
  return { target, distance: needed() };
}
