// Grid and axes of the world in the 3D view.

import * as THREE from "three";
import type { Vec3 } from "./data.ts";
import { lines } from "./bodies3d.ts";
import { add, norm, scale } from "./linear.ts";
import { planeAxes, roundNumber, type Space } from "./space.ts";

export class Surroundings3d {
  readonly group = new THREE.Group();
  /** Side of the squares of the grid, world units. */
  readonly step: number;
  private readonly material = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.5 });

  constructor(space: Space) {
    this.step = roundNumber(space.firstRadius / 6);
    const [a, b] = planeAxes(space.up);
    const reach = this.step * Math.min(50, Math.ceil((1.5 * space.firstRadius) / this.step));
    const middle = add(space.origin, scale(space.up, space.floor));
    const at = (u: number, v: number): Vec3 => add(middle, add(scale(a, u), scale(b, v)));
    const grid: [Vec3, Vec3][] = [];
    for (let u = -reach; u <= reach * 1.0001; u += this.step) {
      grid.push([at(u, -reach), at(u, reach)], [at(-reach, u), at(reach, u)]);
    }
    this.group.add(lines(grid, space.origin, this.material));
    // The axes of the world stand at its origin where that is near; else they only show directions.
    const near = norm(space.origin) < 1.5 * space.radius;
    const foot: Vec3 = near ? [0, 0, 0] : at(-reach, -reach);
    const length = 1.5 * this.step;
    const colors = ["#e0453c", "#3aa655", "#3b7de0"];
    const axes: Vec3[] = [[length, 0, 0], [0, length, 0], [0, 0, length]];
    axes.forEach((axis, index) => {
      const material = new THREE.LineBasicMaterial({ color: colors[index] ?? "#888888" });
      this.group.add(lines([[foot, add(foot, axis)]], space.origin, material));
    });
  }

  setColor(line: string): void {
    this.material.color.set(line);
  }
}
