// What a click in the 3D view is on: a body, or the camera of a frame.

import * as THREE from "three";
import type { BodyLayer } from "./bodies3d.ts";
import type { Cameras3d } from "./cameras3d.ts";

/** A camera is hit within so many pixels. */
const NEAR = 8;

/** The object under the pointer, -1 for none, and the frame whose camera is; of layers that are shown. */
export function pick(
  event: MouseEvent,
  canvas: HTMLCanvasElement,
  camera: THREE.Camera,
  bodies: BodyLayer | null,
  cameras: Cameras3d | null,
): { object: number; frame: number } {
  const { left, top, width, height } = canvas.getBoundingClientRect();
  const place = new THREE.Vector2(
    (2 * (event.clientX - left)) / width - 1,
    1 - (2 * (event.clientY - top)) / height,
  );
  const ray = new THREE.Raycaster();
  ray.setFromCamera(place, camera);
  return { object: bodies?.pick(ray) ?? -1, frame: cameras?.pick(place, camera, width, height, NEAR) ?? -1 };
}
