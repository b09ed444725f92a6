// The image of the selected frame in the 3D view: the lines of its camera, and the picture on the plane that they end
// on. A frame without a picture has only the outline of its image.

import * as THREE from "three";
import { lines } from "./bodies3d.ts";
import type { Report, Vec3 } from "./data.ts";
import { add, dot, norm, scale, subtract, type Viewpoint } from "./linear.ts";
import { overlap, type Box } from "./place_labels.ts";
import type { Space } from "./space.ts";

/** The corners of an image at this depth in front of its camera, round about from the upper left one. */
export function imageCorners(view: Viewpoint, [w, h]: [number, number], depth: number): Vec3[] {
  return [[0, 0], [w, 0], [w, h], [0, h]].map(([x, y]) => {
    const direction = view.direction(x ?? 0, y ?? 0);
    return add(view.center, scale(direction, depth / Math.max(dot(direction, view.axes[2]), 0.1)));
  });
}

/** The lines of a camera: from its center to the corners of its image, and around the image. */
export function frustum(view: Viewpoint, size: [number, number], depth: number): [Vec3, Vec3][] {
  const corners = imageCorners(view, size, depth);
  return corners.flatMap((corner, k): [Vec3, Vec3][] => [
    [view.center, corner], [corner, corners[(k + 1) % 4] as Vec3],
  ]);
}

/** Opacity of a picture that stands before bodies. */
const FADED = 0.25;

export class ImagePlane3d {
  readonly group = new THREE.Group();
  private picture: THREE.Mesh<THREE.BufferGeometry, THREE.MeshBasicMaterial> | null = null;
  private readonly material = new THREE.LineBasicMaterial();
  private readonly textures = new THREE.TextureLoader();

  constructor(
    private readonly report: Report,
    private readonly space: Space,
    private readonly changed: () => void,
  ) {}

  setColor(accent: string): void {
    this.material.color.set(accent);
  }

  /** Stands the image of a frame at this depth in front of its camera. */
  show(index: number, depth: number): void {
    for (const child of this.group.children) if (child instanceof THREE.LineSegments) child.geometry.dispose();
    this.picture?.geometry.dispose();
    this.picture?.material.map?.dispose();
    this.picture?.material.dispose();
    this.picture = null;
    this.group.clear();
    const view = this.space.viewpoints[index];
    const frame = this.report.frames[index];
    if (view == null || frame === undefined) return;
    this.group.add(lines(frustum(view, frame.size, depth), this.space.origin, this.material));
    if (frame.image === null) return;
    const geometry = new THREE.BufferGeometry();
    const points = imageCorners(view, frame.size, depth).flatMap((corner) => subtract(corner, this.space.origin));
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    geometry.setAttribute("uv", new THREE.Float32BufferAttribute([0, 1, 1, 1, 1, 0, 0, 0], 2));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    const texture = this.textures.load(frame.image, this.changed);
    texture.colorSpace = THREE.SRGBColorSpace;
    const material = new THREE.MeshBasicMaterial({ map: texture, side: THREE.DoubleSide });
    this.picture = new THREE.Mesh(geometry, material);
    this.group.add(this.picture);
  }

  /** Fades the picture where it stands before bodies, whose boxes in a view of this size are given, or makes it opaque. */
  fade(camera: THREE.Camera, width: number, height: number, boxes: (Box | undefined)[]): void {
    if (this.picture === null) return;
    const corners = this.picture.geometry.getAttribute("position");
    const middle = new THREE.Vector3();
    const own: Box = [Infinity, Infinity, -Infinity, -Infinity];
    for (let k = 0; k < corners.count; k++) {
      const corner = new THREE.Vector3().fromBufferAttribute(corners, k);
      middle.addScaledVector(corner, 1 / corners.count);
      const { x, y } = corner.project(camera);
      const [left, top] = [((x + 1) * width) / 2, ((1 - y) * height) / 2];
      [own[0], own[1]] = [Math.min(own[0], left), Math.min(own[1], top)];
      [own[2], own[3]] = [Math.max(own[2], left), Math.max(own[3], top)];
    }
    const apart = middle.distanceTo(camera.position);
    const covers = boxes.some((box, object) => {
      const center = this.report.objects[object]?.center;
      if (box === undefined || center == null || overlap(box, own) === 0) return false;
      return camera.position.distanceTo(middle.set(...subtract(center, this.space.origin))) > apart;
    });
    const { material } = this.picture;
    if (material.transparent === covers) return;
    [material.transparent, material.opacity, material.depthWrite] = [covers, covers ? FADED : 1, !covers];
    material.needsUpdate = true;
  }

  /** The depth behind all objects that the camera of a frame sees near the scene. */
  depthBehindObjects(index: number): number {
    const view = this.space.viewpoints[index];
    if (view == null) return this.space.objectRadius;
    const depths = this.space.objectPoints.map((point) => dot(subtract(point, view.center), view.axes[2]));
    const own = norm(subtract(view.center, this.space.origin));
    return 1.05 * Math.max(...depths, 0.1 * own, 0.1 * this.space.objectRadius);
  }
}
