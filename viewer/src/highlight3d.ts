// The selected object in the 3D view: its body stronger and with wires, its axes with their lengths, the other bodies
// that fit its views as well, and the line to the object that its distance is measured to.

import * as THREE from "three";
import type { Report, Vec3 } from "./data.ts";
import { dashedWires, lines, placement, roundsFor, unitGeometry } from "./bodies3d.ts";
import { wireframe, worldFromUnit } from "./body_shape.ts";
import type { Label3d } from "./labels3d.ts";
import { add, scale } from "./linear.ts";
import type { Measure } from "./measure.ts";
import { isUnreliable, lengths } from "./words.ts";

/** How the highlight is drawn. */
export interface HighlightStyle {
  color: string;
  accent: string;
  ink: string;
}

/** Draws the selected object into `group`; returns the texts that belong to it. */
export function highlight(
  group: THREE.Group,
  report: Report,
  selected: number,
  measure: Measure,
  origin: Vec3,
  style: HighlightStyle,
): Label3d[] {
  for (const child of group.children) {
    if (child instanceof THREE.Mesh || child instanceof THREE.LineSegments) child.geometry.dispose();
  }
  group.clear();
  const labels: Label3d[] = [];
  const object = report.objects[selected];
  if (object === undefined) return labels;
  const over = (color: string): THREE.LineBasicMaterial =>
    new THREE.LineBasicMaterial({ color, depthTest: false, transparent: true });
  const draw = (pairs: [Vec3, Vec3][], color: string): void => {
    const drawn = lines(pairs, origin, over(color));
    drawn.renderOrder = 3;
    group.add(drawn);
  };
  const { body } = object;
  if (body !== null) {
    const unreliable = isUnreliable(object);
    const material = new THREE.MeshLambertMaterial({
      color: style.color, transparent: true, opacity: unreliable ? 0.25 : 0.55, depthWrite: false,
    });
    const mesh = new THREE.Mesh(unitGeometry(body, roundsFor(1)), material);
    mesh.applyMatrix4(placement(body, origin));
    mesh.renderOrder = 1;
    group.add(mesh);
    if (unreliable) group.add(dashedWires(body, origin, style.accent));
    else draw(wireframe(body), style.accent);
    // Its axes, from one end to the other.
    const place = worldFromUnit(body);
    const ends = [0, 1, 2].map((k) => [-1, 1].map((s) => place([0, 1, 2].map((j) => (j === k ? s : 0)) as Vec3)));
    draw(ends as [Vec3, Vec3][], style.ink);
    const sizes = lengths(report, body.half.map((half) => 2 * half));
    ends.forEach(([, end], k) => {
      const text = `${sizes[k]} ${report.lengthUnit ?? "units"}`;
      if (end !== undefined) labels.push({ text, at: end, must: false, mayStandApart: true, outOf: selected });
    });
  }
  for (const other of object.alternatives) draw(wireframe(other.body), style.ink);
  const line = measure.line();
  if (line !== null) {
    draw([[line.from, line.to]], style.accent);
    labels.push({ text: line.text, at: scale(add(line.from, line.to), 0.5), color: style.accent, must: true });
  }
  return labels;
}
