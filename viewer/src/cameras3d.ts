// Cameras in the 3D view: a frustum for each frame, the path through them, the selected frame with its image, and the
// cameras as they were given where their poses were refined.

import * as THREE from "three";
import type { Report, Vec3 } from "./data.ts";
import { lines } from "./bodies3d.ts";
import { add, norm, scale, subtract, type Viewpoint } from "./linear.ts";
import type { Space } from "./space.ts";

export class Cameras3d {
  readonly group = new THREE.Group();
  readonly path: THREE.LineSegments;
  /** The given cameras, with lines to the refined ones. */
  readonly given = new THREE.Group();
  /** Whether the frames follow each other in space: lines between cameras at random are a tangle. */
  readonly isTrack: boolean;
  private readonly depth: number;
  /** Cameras step back behind the objects, the selected one does not. */
  private readonly material = new THREE.LineBasicMaterial({ transparent: true });
  private readonly chosenMaterial = new THREE.LineBasicMaterial();
  private readonly givenMaterial = new THREE.LineDashedMaterial({ transparent: true, opacity: 0.4 });
  private readonly moveMaterial = new THREE.LineBasicMaterial();
  private chosen = new THREE.Group();

  constructor(
    private readonly report: Report,
    private readonly space: Space,
    private readonly changed: () => void,
  ) {
    const centers = space.viewpoints.flatMap((view) => (view === null ? [] : [view.center]));
    const steps = centers.slice(1).map((center, index) => norm(subtract(center, centers[index] as Vec3)));
    steps.sort((a, b) => a - b);
    // Large enough to be seen, and not so large that one hides the next.
    const step = steps[Math.floor(steps.length / 2)] ?? Infinity;
    this.material.opacity = report.objects.length > 0 ? 0.4 : 1;
    const { radius, objectRadius } = space;
    this.depth = Math.max(0.02 * radius, Math.min(0.07 * radius, 0.2 * objectRadius, 1.2 * step));
    const frusta = (views: (Viewpoint | null)[]): [Vec3, Vec3][] =>
      report.frames.flatMap((_, index) => this.frustum(views, index, this.depth));
    this.group.add(lines(frusta(space.viewpoints), space.origin, this.material));
    const given = lines(frusta(space.given), space.origin, this.givenMaterial).computeLineDistances();
    [this.givenMaterial.dashSize, this.givenMaterial.gapSize] = [0.1 * this.depth, 0.08 * this.depth];
    const moves = space.given.flatMap((view, index): [Vec3, Vec3][] => {
      const now = space.viewpoints[index];
      return view === null || now == null ? [] : [[view.center, now.center]];
    });
    this.given.add(given, lines(moves, space.origin, this.moveMaterial));
    const path = centers.slice(1).map((center, index): [Vec3, Vec3] => [centers[index] as Vec3, center]);
    this.path = lines(path, space.origin, this.material);
    this.isTrack = step < 0.25 * space.radius;
    this.group.add(this.chosen);
  }

  setColors(line: string, accent: string): void {
    this.material.color.set(line);
    this.givenMaterial.color.set(line);
    this.moveMaterial.color.set(accent);
    this.chosenMaterial.color.set(accent);
  }

  /** Shows the frustum of a frame larger, with its image. */
  select(index: number): void {
    this.chosen.clear();
    const depth = 1.6 * this.depth;
    const corners = this.corners(this.space.viewpoints, index, depth);
    if (corners === null) return;
    this.chosen.add(lines(this.frustum(this.space.viewpoints, index, depth), this.space.origin, this.chosenMaterial));
    const source = this.report.frames[index]?.image;
    if (source == null) return;
    const geometry = new THREE.BufferGeometry();
    const points = corners.flatMap((corner) => subtract(corner, this.space.origin));
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    geometry.setAttribute("uv", new THREE.Float32BufferAttribute([0, 1, 1, 1, 1, 0, 0, 0], 2));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    const texture = new THREE.TextureLoader().load(source, this.changed);
    texture.colorSpace = THREE.SRGBColorSpace;
    const material = new THREE.MeshBasicMaterial({ map: texture, side: THREE.DoubleSide });
    this.chosen.add(new THREE.Mesh(geometry, material));
  }

  /** Where all the lines of the cameras end, to have them in sight. */
  points(): Vec3[] {
    return this.report.frames.flatMap((_, index) => {
      const { viewpoints, given } = this.space;
      const ends = (views: (Viewpoint | null)[], depth: number): Vec3[] => {
        const center = views[index]?.center;
        return center === undefined ? [] : [center, ...(this.corners(views, index, depth) ?? [])];
      };
      return [...ends(viewpoints, 1.6 * this.depth), ...ends(given, this.depth)];
    });
  }

  /** The frame whose camera is nearest to a place on the screen, within so many pixels; -1 for none. */
  pick(place: THREE.Vector2, camera: THREE.Camera, width: number, height: number, within: number): number {
    let [best, distance] = [-1, within];
    const point = new THREE.Vector3();
    this.space.viewpoints.forEach((view, index) => {
      if (view === null) return;
      point.set(...subtract(view.center, this.space.origin)).project(camera);
      if (point.z > 1) return;
      const apart = Math.hypot(((point.x - place.x) * width) / 2, ((point.y - place.y) * height) / 2);
      if (apart < distance) [best, distance] = [index, apart];
    });
    return best;
  }

  /** The corners of the image at this distance from the camera, round about. */
  private corners(views: (Viewpoint | null)[], index: number, depth: number): Vec3[] | null {
    const view = views[index];
    const size = this.report.frames[index]?.size;
    if (view == null || size === undefined) return null;
    const [w, h] = size;
    const middle = view.direction(w / 2, h / 2);
    return [[0, 0], [w, 0], [w, h], [0, h]].map(([x, y]) => {
      const direction = view.direction(x ?? 0, y ?? 0);
      const along = direction[0] * middle[0] + direction[1] * middle[1] + direction[2] * middle[2];
      return add(view.center, scale(direction, depth / Math.max(along, 0.1)));
    });
  }

  private frustum(views: (Viewpoint | null)[], index: number, depth: number): [Vec3, Vec3][] {
    const center = views[index]?.center;
    const corners = this.corners(views, index, depth);
    if (center === undefined || corners === null) return [];
    return corners.flatMap((corner, k): [Vec3, Vec3][] => [[center, corner], [corner, corners[(k + 1) % 4] as Vec3]]);
  }
}
