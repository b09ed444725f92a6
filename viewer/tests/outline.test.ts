// Outlines against independent calculations.

import assert from "node:assert/strict";
import { test } from "node:test";
import { surfacePoints, unitPoint, worldFromUnit } from "../src/body_shape.ts";
import type { Body, Vec3 } from "../src/data.ts";
import { project, viewpoint } from "../src/linear.ts";
import { hull, outline } from "../src/outline.ts";

/** A camera at (0, 0, -distance) that looks along z. */
function camera(distance: number): number[] {
  const [f, cx, cy] = [700, 320, 240];
  return [f, 0, cx, cx * distance, 0, f, cy, cy * distance, 0, 0, 1, distance];
}

function body(kind: Body["kind"], exponent: number): Body {
  const length = Math.hypot(0.8, 0.3, -0.4, 0.2);
  const rotation = [0.8, 0.3, -0.4, 0.2].map((x) => x / length) as Body["rotation"];
  return { kind, center: [0.4, -0.2, 0.5], half: [1, 0.6, 0.3], rotation, exponent };
}

function extent(points: [number, number][]): number[] {
  const [xs, ys] = [points.map((p) => p[0]), points.map((p) => p[1])];
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}

/** Extent of the projections of many points on the body, which need no outline. */
function extentOfSurface(projection: number[], shown: Body): number[] {
  const place = worldFromUnit(shown);
  const points: [number, number][] = [];
  for (let i = 0; i <= 600; i++) {
    for (let j = 0; j < 600; j++) {
      const [polar, angle] = [(Math.PI * i) / 600, (2 * Math.PI * j) / 600];
      const v: Vec3 = [Math.sin(polar) * Math.cos(angle), Math.sin(polar) * Math.sin(angle), Math.cos(polar)];
      const [x, y, depth] = project(projection, place(unitPoint(v, shown)));
      points.push([x / depth, y / depth]);
    }
  }
  return points.reduce(
    (box, [x, y]) => [Math.min(box[0]!, x), Math.min(box[1]!, y), Math.max(box[2]!, x), Math.max(box[3]!, y)],
    [Infinity, Infinity, -Infinity, -Infinity],
  );
}

function near(found: number[], expected: number[], within: number): void {
  found.forEach((x, k) => assert.ok(Math.abs(x - expected[k]!) < within, `${found} instead of ${expected}`));
}

test("a sphere on the axis has a circle for an outline", () => {
  const sphere: Body = { kind: "ellipsoid", center: [0, 0, 0], half: [1, 1, 1], rotation: [1, 0, 0, 0], exponent: 2 };
  // The cone that touches a unit sphere at distance 5 has the slope 1 / sqrt(24).
  const radius = 700 / Math.sqrt(24);
  for (const [x, y] of outline(camera(5), sphere)!.border) {
    assert.ok(Math.abs(Math.hypot(x - 320, y - 240) - radius) < 1e-9);
  }
});

test("outlines reach as far as the projected surface", () => {
  for (const shown of [body("ellipsoid", 2), body("superellipsoid", 1.5), body("superellipsoid", 1.2)]) {
    // Polygons: a little less than the curves.
    near(extent(outline(camera(6), shown)!.border), extentOfSurface(camera(6), shown), 1.5);
  }
  const cuboid = body("cuboid", 1);
  const corners = surfacePoints(cuboid).map((point) => project(camera(6), point));
  near(extent(outline(camera(6), cuboid)!.border), extent(corners.map(([x, y, z]) => [x / z, y / z])), 1e-9);
  assert.equal(outline(camera(6), cuboid)!.lines.length, 12);
});

test("the outline of a cylinder from above is that of its nearer rim", () => {
  const can: Body = { kind: "cylinder", center: [0, 0, 0], half: [1, 1, 0.5], rotation: [1, 0, 0, 0], exponent: 1 };
  // The rim of radius 1 nearest to the camera is 4.5 away.
  const radius = 700 / 4.5;
  near(extent(outline(camera(5), can)!.border), [320 - radius, 240 - radius, 320 + radius, 240 + radius], 0.5);
});

test("points of a superellipsoid lie on it", () => {
  for (const exponent of [1.1, 1.5, 2]) {
    const power = exponent / (exponent - 1);
    for (const v of [[1, 2, 3], [-1, 0, 0.1], [0, 0, -2], [1e-9, 1, 1]] as Vec3[]) {
      const sum = unitPoint(v, { kind: "superellipsoid", exponent }).reduce((total, x) => total + Math.abs(x) ** power, 0);
      assert.ok(Math.abs(sum - 1) < 1e-9, `${exponent} ${v}: ${sum}`);
    }
  }
});

test("the surface of a rounded body closes where its ends meet", () => {
  const rounded = { kind: "rounded", exponent: 1.4 } as const;
  const [one, other] = [1.2e-16, -1.2e-16].map((y) => unitPoint([-0.8, y, 0.6], rounded));
  one!.forEach((x, k) => assert.ok(Math.abs(x - other![k]!) < 1e-9, `${one} and ${other}`));
});

test("bodies behind or across the camera have no outline", () => {
  for (const shown of [body("ellipsoid", 2), body("superellipsoid", 1.5), body("cuboid", 1)]) {
    assert.equal(outline(camera(-5), shown), null);
    assert.equal(outline(camera(-0.3), shown), null);
  }
});

test("the hull of a square with points inside is the square", () => {
  const square: [number, number][] = [[0, 0], [1, 0], [1, 1], [0, 1]];
  const found = hull([[0.5, 0.5], ...square, [0.2, 0.7]]);
  assert.deepEqual([...found].sort(), [...square].sort());
});

test("the viewpoint of a projection is its camera", () => {
  const view = viewpoint(camera(5))!;
  near(view.center, [0, 0, -5], 1e-9);
  near(view.direction(320, 240), [0, 0, 1], 1e-12);
  const [x, y, depth] = project(camera(5), view.direction(100, 50).map((d, k) => view.center[k]! + 3 * d) as Vec3);
  near([x / depth, y / depth], [100, 50], 1e-9);
});
