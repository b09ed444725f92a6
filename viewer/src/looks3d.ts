// From where the 3D view can be looked at: the objects from a side, everything, one object, or a frame's camera.

import type { Report, Vec3 } from "./data.ts";
import type { Pose } from "./flight.ts";
import { fitView } from "./fit_view.ts";
import { add, dot, scale, subtract, unit } from "./linear.ts";
import { firstLook, planeAxes, type Space } from "./space.ts";

/** From where one looks. */
export type Side = "free" | "top" | "front";

/** Angle of the view from top to bottom, degrees. */
export const FOV = 40;

export class Looks {
  /** `cameras` are the ends of the lines that stand for cameras. */
  constructor(
    private readonly report: Report,
    private readonly space: Space,
    private readonly cameras: () => Vec3[],
    private readonly minDistance: number,
  ) {}

  /** The objects from a side; without any, the cameras. */
  side(side: Side, aspect: number): Pose {
    const objects = this.space.objectPoints;
    return this.fit(objects.length > 0 ? objects : this.cameras(), this.direction(side), aspect);
  }

  everything(aspect: number): Pose {
    return this.fit([...this.space.objectPoints, ...this.cameras()], this.direction("free"), aspect);
  }

  /** An object from this direction; null where it has no place. */
  object(index: number, from: Vec3, aspect: number): Pose | null {
    const object = this.report.objects[index];
    const body = object?.body ?? object?.truth;
    const center = body?.center ?? object?.center;
    if (center == null) return null;
    const reach = body == null ? 0.2 * this.space.objectRadius : 1.4 * Math.max(...body.half);
    const axes: Vec3[] = [[reach, 0, 0], [0, reach, 0], [0, 0, reach]];
    return this.fit(axes.flatMap((axis) => [add(center, axis), subtract(center, axis)]), from, aspect);
  }

  /** Through the camera of a frame: its image fills the view. Null where it has no place. */
  frame(index: number, aspect: number): Pose | null {
    const view = this.space.viewpoints[index];
    const size = this.report.frames[index]?.size;
    if (view == null || size === undefined) return null;
    const [w, h] = size;
    const [right, down, forward] = view.axes;
    let [across, upwards] = [0, 0];
    for (const [x, y] of [[0, 0], [w, 0], [w, h], [0, h]] as const) {
      const direction = view.direction(x, y);
      const along = Math.max(dot(direction, forward), 0.05);
      across = Math.max(across, Math.abs(dot(direction, right)) / along);
      upwards = Math.max(upwards, Math.abs(dot(direction, down)) / along);
    }
    // A little more than the image, so that its border is seen.
    const half = Math.atan(1.04 * Math.max(upwards, across / aspect));
    const depth = Math.max(0.1 * this.space.objectRadius, dot(forward, subtract(this.space.origin, view.center)));
    const position = subtract(view.center, this.space.origin);
    const target = add(position, scale(forward, depth));
    return { position, target, up: scale(down, -1), fov: (360 / Math.PI) * half };
  }

  private direction(side: Side): Vec3 {
    const free = firstLook(this.space);
    if (side === "free") return free;
    const { up } = this.space;
    if (side === "top") return unit(add(up, scale(this.flat(free), 1e-3)), up);
    return this.flat(free);
  }

  /** A direction without its part along `up`, along the nearest axis of the plane across it. */
  private flat(direction: Vec3): Vec3 {
    const [a, b] = planeAxes(this.space.up);
    const [x, y] = [dot(direction, a), dot(direction, b)];
    return Math.abs(x) > Math.abs(y) ? scale(a, Math.sign(x)) : scale(b, Math.sign(y) || 1);
  }

  /** In a direction so that all of these points are in sight. */
  private fit(points: Vec3[], from: Vec3, aspect: number): Pose {
    const { origin, up, radius } = this.space;
    const half = Math.tan((FOV * Math.PI) / 360);
    const relative = points.map((point) => subtract(point, origin));
    const found = relative.length === 0
      ? { target: [0, 0, 0] as Vec3, distance: 3 * radius }
      : fitView(relative, from, up, [0.86 * half * aspect, 0.8 * half]);
    const distance = Math.max(found.distance, 2 * this.minDistance);
    return { position: add(found.target, scale(from, distance)), target: found.target, up, fov: FOV };
  }
}
