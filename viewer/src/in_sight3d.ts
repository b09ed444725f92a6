// Whether an object can be seen in the 3D view, or has to be flown to.

import * as THREE from "three";
import type { ReportObject, Vec3 } from "./data.ts";
import { subtract } from "./linear.ts";

/** Share of the view, from its middle, that an object is sought in. */
const INNER = 0.97;

/** Share of the height of the view that an object must have to be seen. */
const LEAST_SIZE = 0.015;

/** Whether the center of an object is in the view of a camera, and the object is not a mere dot. */
export function isInSight(object: ReportObject | undefined, camera: THREE.PerspectiveCamera, origin: Vec3): boolean {
  const body = object?.body ?? object?.truth;
  const center = body?.center ?? object?.center;
  // There is nothing to fly to.
  if (center == null) return true;
  camera.updateMatrixWorld();
  const place = new THREE.Vector3(...subtract(center, origin));
  const height = 2 * Math.tan((camera.fov * Math.PI) / 360) * place.distanceTo(camera.position);
  if (body != null && 2 * Math.max(...body.half) < LEAST_SIZE * height) return false;
  const { x, y, z } = place.project(camera);
  return z < 1 && Math.abs(x) < INNER && Math.abs(y) < INNER;
}
