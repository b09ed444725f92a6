// Grid, ground and axes of the world in the 3D view.

import * as THREE from "three";
import type { Vec3 } from "./data.ts";
import { lines } from "./bodies3d.ts";
import { add, norm, scale } from "./linear.ts";
import { planeAxes, roundNumber, type Space } from "./space.ts";

/** Red, green and blue: the axes x, y and z. */
const AXES: [string, string, Vec3][] = [
  ["x", "#d93a31", [1, 0, 0]],
  ["y", "#2f8f48", [0, 1, 0]],
  ["z", "#3b7de0", [0, 0, 1]],
];

/** Light from the sky of the world, and less of it from the ground. */
export function skyLight(up: Vec3): THREE.HemisphereLight {
  const light = new THREE.HemisphereLight("#ffffff", "#70707c", 1.2);
  light.position.set(...up);
  return light;
}

export class Surroundings3d {
  readonly group = new THREE.Group();
  /** Side of the squares of the grid, world units. */
  readonly step: number;
  /** Where the names of the axes and of the direction against gravity stand, in the world. */
  readonly names: { text: string; at: Vec3 }[] = [];
  private readonly material = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.45 });
  private readonly upMaterial = new THREE.LineBasicMaterial();

  constructor(space: Space) {
    const radius = space.objectPoints.length > 0 ? space.objectRadius : space.radius;
    this.step = roundNumber(radius / 5);
    const [a, b] = planeAxes(space.up);
    const reach = this.step * Math.ceil((1.3 * radius) / this.step);
    const middle = add(space.origin, scale(space.up, space.floor));
    const at = (u: number, v: number): Vec3 => add(middle, add(scale(a, u), scale(b, v)));
    const grid: [Vec3, Vec3][] = [];
    for (let u = -reach; u <= reach * 1.0001; u += this.step) {
      grid.push([at(u, -reach), at(u, reach)], [at(-reach, u), at(reach, u)]);
    }
    this.group.add(lines(grid, space.origin, this.material));
    // The axes of the world stand at its origin where that is near; else they only show directions.
    const near = norm(space.origin) < 1.5 * radius;
    const foot: Vec3 = near ? [0, 0, 0] : at(-reach, -reach);
    for (const [text, color, axis] of AXES) {
      const end = add(foot, scale(axis, 1.5 * this.step));
      this.group.add(lines([[foot, end]], space.origin, new THREE.LineBasicMaterial({ color })));
      this.names.push({ text, at: end });
    }
    if (space.upIsKnown) {
      // An arrow at a corner of the grid.
      const [low, top] = [at(reach, -reach), add(at(reach, -reach), scale(space.up, 1.5 * this.step))];
      const barb = (side: number): Vec3 =>
        add(top, add(scale(a, side * 0.2 * this.step), scale(space.up, -0.35 * this.step)));
      this.group.add(lines([[low, top], [top, barb(1)], [top, barb(-1)]], space.origin, this.upMaterial));
      this.names.push({ text: "up", at: top });
    }
  }

  setColor(line: string, ink: string): void {
    this.material.color.set(line);
    this.upMaterial.color.set(ink);
  }
}
