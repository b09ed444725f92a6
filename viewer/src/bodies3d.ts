// Bodies in the 3D view, solid or as wires.

import * as THREE from "three";
import type { Body, Report, Vec3 } from "./data.ts";
import { unitPoint, wireframe } from "./body_shape.ts";
import { subtract } from "./linear.ts";
import { isUnreliable } from "./words.ts";

/** With more objects than this the view is drawn more simply. */
export const MANY = 200;

/** Which body of an object is drawn. */
export type Which = "body" | "enclosing" | "truth" | "centerShell";

/** The place of a body: maps its unit shape to the view's coordinates. */
export function placement(body: Body, origin: Vec3): THREE.Matrix4 {
  const [w, x, y, z] = body.rotation;
  return new THREE.Matrix4().compose(
    new THREE.Vector3(...subtract(body.center, origin)),
    new THREE.Quaternion(x, y, z, w),
    new THREE.Vector3(...body.half),
  );
}

/** Number of triangles around a round body: smooth borders where there are few bodies. */
export function roundsFor(bodies: number): number {
  return bodies > MANY ? 16 : bodies > 50 ? 40 : 64;
}

/** The unit shape of a body, with so many triangles around it. */
export function unitGeometry(body: Body, rounds: number): THREE.BufferGeometry {
  if (body.kind === "cuboid") return new THREE.BoxGeometry(2, 2, 2);
  // About the third axis, not the second one as in three.js.
  if (body.kind === "cylinder") return new THREE.CylinderGeometry(1, 1, 2, rounds).rotateX(Math.PI / 2);
  const geometry = new THREE.SphereGeometry(1, rounds, rounds / 2);
  if (body.kind === "ellipsoid") return geometry;
  const positions = geometry.getAttribute("position");
  for (let i = 0; i < positions.count; i++) {
    const v: Vec3 = [positions.getX(i), positions.getY(i), positions.getZ(i)];
    positions.setXYZ(i, ...unitPoint(v, body));
  }
  // The direction a point was made from is the normal of its place.
  return geometry;
}

/** Opacity of a body that its views do not agree with, between its dashed lines. */
const UNRELIABLE_OPACITY = 0.16;

/** A body with more than this share of the size of the object's own body hides that. */
const HIDES = 0.5;

/** The dashed wires of a body that its views do not agree with. */
export function dashedWires(body: Body, origin: Vec3, color: string): THREE.LineSegments {
  const size = Math.max(...body.half);
  const material = new THREE.LineDashedMaterial({ color, dashSize: 0.12 * size, gapSize: 0.09 * size });
  return lines(wireframe(body), origin, material).computeLineDistances();
}

/** How the bodies of a layer look. */
export interface BodyStyle {
  opacity: number;
  /** Opacity of one that would hide the body of its object, where that differs. */
  largeOpacity?: number;
  /** Whether bodies that their views do not agree with are dashed. */
  dashed?: boolean;
  /** Color of an object's body. */
  color: (object: number) => string;
  /** Whether an object's body is shown. */
  shows: (object: number) => boolean;
  /** Whether the bodies are drawn over all else, as what lies inside of others. */
  over?: boolean;
}

/**
 * All bodies of a kind. A few are translucent, and three.js draws them from far to near; many are opaque and drawn in
 * one go (instances of one mesh for each shape). Either way the picture does not depend on the order of the objects.
 */
export class BodyLayer {
  readonly group = new THREE.Group();
  private readonly geometries = new Map<string, THREE.BufferGeometry>();
  private readonly isMany: boolean;

  constructor(
    private readonly report: Report,
    private readonly which: Which,
    private readonly origin: Vec3,
    private readonly style: BodyStyle,
  ) {
    this.isMany = report.objects.length > MANY;
    this.rebuild();
  }

  /** Makes the bodies again, after what is shown or its colors have changed. */
  rebuild(): void {
    for (const child of this.group.children) {
      if (child instanceof THREE.InstancedMesh) child.dispose();
      if (child instanceof THREE.LineSegments) child.geometry.dispose();
      if (child instanceof THREE.Mesh || child instanceof THREE.LineSegments) (child.material as THREE.Material).dispose();
    }
    this.group.clear();
    const shapes = new Map<string, { body: Body; object: number }[]>();
    this.report.objects.forEach((object, index) => {
      const body = object[this.which];
      if (body === null || !this.style.shows(index)) return;
      const shape = `${body.kind} ${body.exponent}`;
      const bodies = shapes.get(shape) ?? [];
      bodies.push({ body, object: index });
      shapes.set(shape, bodies);
    });
    for (const [shape, bodies] of shapes) {
      const geometry = this.geometry(shape, bodies[0]?.body);
      if (geometry === null) continue;
      const dashed = this.style.dashed ? bodies.filter(({ object }) => isUnreliable(this.report.objects[object])) : [];
      const sound = bodies.filter((body) => !dashed.includes(body));
      if (this.isMany && sound.length > 0) this.group.add(this.instances(geometry, sound));
      if (!this.isMany) for (const { body, object } of sound) this.group.add(this.single(geometry, body, object));
      for (const { body, object } of dashed) {
        this.group.add(this.single(geometry, body, object, UNRELIABLE_OPACITY));
        this.group.add(dashedWires(body, this.origin, this.style.color(object)));
      }
    }
  }

  /** Makes the bodies more or less translucent. */
  setOpacity(opacity: number): void {
    if (opacity === this.style.opacity) return;
    this.style.opacity = opacity;
    this.rebuild();
  }

  /** The object whose body a ray meets first, or -1. */
  pick(ray: THREE.Raycaster): number {
    const meshes = this.group.children.filter((child) => child instanceof THREE.Mesh);
    const hit = ray.intersectObjects(meshes)[0];
    const objects = hit?.object.userData["objects"] as number[] | undefined;
    return objects?.[hit?.instanceId ?? 0] ?? -1;
  }

  private geometry(shape: string, body: Body | undefined): THREE.BufferGeometry | null {
    if (body === undefined) return null;
    const known = this.geometries.get(shape) ?? unitGeometry(body, roundsFor(this.report.objects.length));
    this.geometries.set(shape, known);
    return known;
  }

  /** The opacity of a sound body. */
  private opacityOf(body: Body, object: number): number {
    const { opacity, largeOpacity = opacity } = this.style;
    const own = this.report.objects[object]?.body;
    return own != null && Math.max(...body.half) > HIDES * Math.max(...own.half) ? largeOpacity : opacity;
  }

  private single(
    geometry: THREE.BufferGeometry,
    body: Body,
    object: number,
    opacity: number = this.opacityOf(body, object),
  ): THREE.Mesh {
    const color = this.style.color(object);
    const material = new THREE.MeshPhongMaterial({
      color, specular: "#303030", shininess: 25, transparent: true, opacity, depthWrite: opacity > 0.8,
      depthTest: this.style.over !== true,
    });
    const mesh = new THREE.Mesh(geometry, material);
    // Sets position, rotation and scale: three.js sorts by the position.
    mesh.applyMatrix4(placement(body, this.origin));
    mesh.userData["objects"] = [object];
    if (this.style.over) mesh.renderOrder = 2;
    return mesh;
  }

  private instances(geometry: THREE.BufferGeometry, bodies: { body: Body; object: number }[]): THREE.InstancedMesh {
    const mesh = new THREE.InstancedMesh(geometry, new THREE.MeshLambertMaterial(), bodies.length);
    const color = new THREE.Color();
    bodies.forEach(({ body, object }, index) => {
      mesh.setMatrixAt(index, placement(body, this.origin));
      mesh.setColorAt(index, color.set(this.style.color(object)));
    });
    mesh.userData["objects"] = bodies.map(({ object }) => object);
    return mesh;
  }
}

/** Lines between pairs of points, relative to the origin. */
export function lines(pairs: [Vec3, Vec3][], origin: Vec3, material: THREE.Material): THREE.LineSegments {
  const numbers = pairs.flatMap(([a, b]) => [...subtract(a, origin), ...subtract(b, origin)]);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(numbers, 3));
  return new THREE.LineSegments(geometry, material);
}

/** Wires of all bodies of a kind. */
export function bodyWires(
  report: Report,
  which: Which,
  origin: Vec3,
  material: THREE.Material,
  shows: (object: number) => boolean,
): THREE.LineSegments {
  const pairs = report.objects.flatMap((object, index) => {
    const body = object[which];
    return body === null || !shows(index) ? [] : wireframe(body);
  });
  return lines(pairs, origin, material);
}
