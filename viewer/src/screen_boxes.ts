// Where the bodies are on the screen, as boxes: labels stay out of them.

import * as THREE from "three";
import { surfacePoints } from "./body_shape.ts";
import type { Report, Vec3 } from "./data.ts";
import { subtract } from "./linear.ts";
import type { Box } from "./place_labels.ts";

/** Of the many points on a round body these are enough for its box. */
const EVERY = 7;

export class ScreenBoxes {
  private readonly points: THREE.Vector3[][];

  constructor(report: Report, origin: Vec3) {
    this.points = report.objects.map(({ body, truth }) => {
      const shown = body ?? truth;
      const all = shown === null ? [] : surfacePoints(shown);
      const some = all.length > 8 ? all.filter((_, k) => k % EVERY === 0) : all;
      return some.map((point) => new THREE.Vector3(...subtract(point, origin)));
    });
  }

  /** The boxes of the objects in a view of this size; undefined for what is not in front of the camera, or not shown. */
  of(camera: THREE.Camera, width: number, height: number, shows: (object: number) => boolean): (Box | undefined)[] {
    const at = new THREE.Vector3();
    return this.points.map((points, object) => {
      if (points.length === 0 || !shows(object)) return undefined;
      const box: Box = [Infinity, Infinity, -Infinity, -Infinity];
      for (const point of points) {
        at.copy(point).project(camera);
        if (at.z > 1) return undefined;
        const [x, y] = [((at.x + 1) * width) / 2, ((1 - at.y) * height) / 2];
        [box[0], box[1]] = [Math.min(box[0], x), Math.min(box[1], y)];
        [box[2], box[3]] = [Math.max(box[2], x), Math.max(box[3], y)];
      }
      return box;
    });
  }
}
