// Points of the scene's surfaces in the 3D view, such as those of a COLMAP model: context around the objects.

import * as THREE from "three";
import type { Vec3 } from "./data.ts";

export class Points3d {
  readonly group: THREE.Points;
  private readonly material = new THREE.PointsMaterial({
    size: 2, sizeAttenuation: false, transparent: true, opacity: 0.65, depthWrite: false,
  });

  /** `points` has x, y, z of each, `origin` is the place of the world that is drawn at zero. */
  constructor(points: number[], origin: Vec3) {
    const geometry = new THREE.BufferGeometry();
    const relative = Float32Array.from(points, (x, k) => x - origin[k % 3]!);
    geometry.setAttribute("position", new THREE.BufferAttribute(relative, 3));
    this.group = new THREE.Points(geometry, this.material);
    // Translucent bodies are drawn over them.
    this.group.renderOrder = -1;
  }

  setColor(color: string): void {
    this.material.color.set(color);
  }
}
