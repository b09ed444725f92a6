// Bodies in the 3D view. All bodies of one shape are drawn in one go (instances of one mesh), wires in one more.

import * as THREE from "three";
import type { Body, Report, Vec3 } from "./data.ts";
import { unitPoint, wireframe } from "./body_shape.ts";
import type { Colors } from "./colors.ts";
import { subtract } from "./linear.ts";

/** With more objects than this the view is drawn more simply. */
export const MANY = 200;

/** Which body of an object is drawn. */
export type Which = "body" | "enclosing" | "truth" | "centerShell";

/** A mesh of many bodies, and which object each instance belongs to. */
export interface BodyMesh {
  mesh: THREE.InstancedMesh;
  objects: number[];
}

/** The place of a body: maps its unit shape to the view's coordinates. */
export function placement(body: Body, origin: Vec3): THREE.Matrix4 {
  const [w, x, y, z] = body.rotation;
  return new THREE.Matrix4().compose(
    new THREE.Vector3(...subtract(body.center, origin)),
    new THREE.Quaternion(x, y, z, w),
    new THREE.Vector3(...body.half),
  );
}

/** The unit shape of a body, with more triangles where there are few bodies. */
export function unitGeometry(body: Body, bodies: number): THREE.BufferGeometry {
  if (body.kind === "cuboid") return new THREE.BoxGeometry(2, 2, 2);
  const rounds = bodies > MANY ? 16 : 40;
  // About the third axis, not the second one as in three.js.
  if (body.kind === "cylinder") return new THREE.CylinderGeometry(1, 1, 2, rounds).rotateX(Math.PI / 2);
  const geometry = new THREE.SphereGeometry(1, rounds, rounds / 2);
  if (body.kind === "ellipsoid") return geometry;
  const positions = geometry.getAttribute("position");
  for (let i = 0; i < positions.count; i++) {
    const v: Vec3 = [positions.getX(i), positions.getY(i), positions.getZ(i)];
    positions.setXYZ(i, ...unitPoint(v, body.exponent));
  }
  // The direction a point was made from is the normal of its place.
  return geometry;
}

/** Meshes of all bodies of a kind, one for each shape. */
export function bodyMeshes(report: Report, which: Which, origin: Vec3, material: THREE.Material): BodyMesh[] {
  const shapes = new Map<string, { body: Body; object: number }[]>();
  report.objects.forEach((object, index) => {
    const body = object[which];
    if (body === null) return;
    const shape = `${body.kind} ${body.exponent}`;
    const bodies = shapes.get(shape) ?? [];
    bodies.push({ body, object: index });
    shapes.set(shape, bodies);
  });
  return [...shapes.values()].flatMap((bodies) => {
    const first = bodies[0];
    if (first === undefined) return [];
    const mesh = new THREE.InstancedMesh(unitGeometry(first.body, bodies.length), material, bodies.length);
    bodies.forEach(({ body }, index) => mesh.setMatrixAt(index, placement(body, origin)));
    return [{ mesh, objects: bodies.map(({ object }) => object) }];
  });
}

/** The meshes in one group. */
export function groupOf(meshes: BodyMesh[]): THREE.Group {
  const group = new THREE.Group();
  // One by one: three.js complains when there is nothing to add.
  for (const { mesh } of meshes) group.add(mesh);
  return group;
}

/** Gives each body the colour of its object; where one is selected, the others pale. */
export function colorBodies(meshes: BodyMesh[], colors: Colors, selected: number, paper: string): void {
  const color = new THREE.Color();
  const pale = new THREE.Color(paper);
  for (const { mesh, objects } of meshes) {
    objects.forEach((object, index) => {
      color.set(colors.ofObject(object));
      if (selected >= 0 && selected !== object) color.lerp(pale, 0.6);
      mesh.setColorAt(index, color);
    });
    if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
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
export function bodyWires(report: Report, which: Which, origin: Vec3, material: THREE.Material): THREE.LineSegments {
  const pairs = report.objects.flatMap((object) => (object[which] === null ? [] : wireframe(object[which])));
  return lines(pairs, origin, material);
}
