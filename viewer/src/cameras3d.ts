// Cameras in the 3D view: a frustum for each frame, the path through them, the selected frame with its image, and the
// cameras as they were given where their poses were refined.

import * as THREE from "three";
import type { Report, Vec3 } from "./data.ts";
import { lines } from "./bodies3d.ts";
import { frustum, imageCorners, ImagePlane3d } from "./image_plane3d.ts";
import { norm, subtract, type Viewpoint } from "./linear.ts";
import type { Box } from "./place_labels.ts";
import type { Space } from "./space.ts";

/** How much larger the selected camera is than the others. */
const LARGER = 1.6;

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
  private readonly givenMaterial = new THREE.LineDashedMaterial({ transparent: true, opacity: 0.4 });
  private readonly moveMaterial = new THREE.LineBasicMaterial();
  private readonly image: ImagePlane3d;

  constructor(
    private readonly report: Report,
    private readonly space: Space,
    changed: () => void,
  ) {
    this.image = new ImagePlane3d(report, space, changed);
    const centers = space.viewpoints.flatMap((view) => (view === null ? [] : [view.center]));
    const steps = centers.slice(1).map((center, index) => norm(subtract(center, centers[index] as Vec3)));
    steps.sort((a, b) => a - b);
    // Large enough to be seen, and not so large that one hides the next.
    const step = steps[Math.floor(steps.length / 2)] ?? Infinity;
    this.material.opacity = report.objects.length > 0 ? 0.4 : 1;
    const { radius, objectRadius } = space;
    this.depth = Math.max(0.02 * radius, Math.min(0.07 * radius, 0.2 * objectRadius, 1.2 * step));
    const frusta = (views: (Viewpoint | null)[]): [Vec3, Vec3][] =>
      report.frames.flatMap(({ size }, index) => {
        const view = views[index];
        return view == null ? [] : frustum(view, size, this.depth);
      });
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
    this.group.add(this.image.group);
  }

  setColors(line: string, accent: string): void {
    this.material.color.set(line);
    this.givenMaterial.color.set(line);
    this.moveMaterial.color.set(accent);
    this.image.setColor(accent);
  }

  /** Shows the image of a frame: with its camera, or behind the objects, as the camera sees it. */
  select(index: number, isBehindObjects: boolean): void {
    this.image.show(index, isBehindObjects ? this.image.depthBehindObjects(index) : LARGER * this.depth);
  }

  /** Fades the image of the selected frame where it covers bodies in these boxes. */
  fade(camera: THREE.Camera, width: number, height: number, boxes: (Box | undefined)[]): void {
    this.image.fade(camera, width, height, boxes);
  }

  /** Where all the lines of the cameras end, to have them in sight. */
  points(): Vec3[] {
    return this.report.frames.flatMap(({ size }, index) => {
      const { viewpoints, given } = this.space;
      const ends = (view: Viewpoint | null | undefined, depth: number): Vec3[] =>
        view == null ? [] : [view.center, ...imageCorners(view, size, depth)];
      return [...ends(viewpoints[index], LARGER * this.depth), ...ends(given[index], this.depth)];
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
}
