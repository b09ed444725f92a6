// The estimated bodies as a binary glTF file: one node for each object, with its label, id, category and status.

import * as THREE from "three";
import { unitGeometry } from "./bodies3d.ts";
import type { Report } from "./data.ts";
import { isUnreliable, objectName } from "./words.ts";

/** Numbers of the glTF specification. */
const [FLOAT, UNSIGNED_SHORT, ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER] = [5126, 5123, 34962, 34963];
const [MAGIC, JSON_CHUNK, BINARY_CHUNK] = [0x46546c67, 0x4e4f534a, 0x004e4942];

/** Triangles around a round body. */
const ROUNDS = 40;

interface Shape {
  attributes: { POSITION: number; NORMAL: number };
  indices: number;
}

export function bodiesGlb(
  report: Report,
  shows: (object: number) => boolean,
  color: (object: number) => string,
): Uint8Array<ArrayBuffer> {
  const parts: Uint8Array[] = [];
  const bufferViews: object[] = [];
  const accessors: object[] = [];
  let length = 0;
  const add = (array: Float32Array | Uint16Array, type: string, extent: object = {}): number => {
    const bytes = padded(new Uint8Array(array.buffer, array.byteOffset, array.byteLength), 0);
    const isIndex = array instanceof Uint16Array;
    bufferViews.push({
      buffer: 0, byteOffset: length, byteLength: array.byteLength, target: isIndex ? ELEMENT_ARRAY_BUFFER : ARRAY_BUFFER,
    });
    parts.push(bytes);
    length += bytes.length;
    const size = type === "VEC3" ? 3 : 1;
    accessors.push({
      bufferView: bufferViews.length - 1, componentType: isIndex ? UNSIGNED_SHORT : FLOAT,
      count: array.length / size, type, ...extent,
    });
    return accessors.length - 1;
  };
  const shapes = new Map<string, Shape>();
  const materials: object[] = [];
  const meshes: object[] = [];
  const nodes: object[] = [];
  report.objects.forEach((object, index) => {
    const { body } = object;
    if (body === null || !shows(index)) return;
    const key = `${body.kind} ${body.exponent}`;
    let shape = shapes.get(key);
    if (shape === undefined) {
      const geometry = unitGeometry(body, ROUNDS);
      const positions = Float32Array.from(geometry.getAttribute("position").array);
      shape = {
        attributes: {
          POSITION: add(positions, "VEC3", { min: extreme(positions, Math.min), max: extreme(positions, Math.max) }),
          NORMAL: add(Float32Array.from(geometry.getAttribute("normal").array), "VEC3"),
        },
        indices: add(Uint16Array.from(geometry.getIndex()?.array ?? []), "SCALAR"),
      };
      geometry.dispose();
      shapes.set(key, shape);
    }
    const { r, g, b } = new THREE.Color(color(index));
    const uncertain = isUnreliable(object);
    materials.push({
      pbrMetallicRoughness: { baseColorFactor: [r, g, b, uncertain ? 0.3 : 1], metallicFactor: 0, roughnessFactor: 0.8 },
      ...(uncertain ? { alphaMode: "BLEND" } : {}),
    });
    const name = objectName(report, index);
    meshes.push({ name, primitives: [{ ...shape, material: materials.length - 1 }] });
    const [w, x, y, z] = body.rotation;
    nodes.push({
      name, mesh: meshes.length - 1, translation: body.center, rotation: [x, y, z, w], scale: body.half,
      extras: { id: object.id, category: report.categories[object.category] ?? null, status: object.status },
    });
  });
  // In glTF, y points up.
  const turn = report.up === null
    ? new THREE.Quaternion()
    : new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(...report.up).normalize(), new THREE.Vector3(0, 1, 0));
  const root = { name: report.title, rotation: turn.toArray(), ...(nodes.length > 0 ? { children: nodes.map((_, k) => k) } : {}) };
  const document = {
    asset: { version: "2.0", generator: report.program, extras: { lengthUnit: report.lengthUnit } },
    scene: 0,
    scenes: [{ nodes: [nodes.length] }],
    nodes: [...nodes, root],
    ...(nodes.length > 0 ? { meshes, materials, accessors, bufferViews, buffers: [{ byteLength: length }] } : {}),
  };
  return container(padded(new TextEncoder().encode(JSON.stringify(document)), 0x20), parts, length);
}

/** The smallest or largest value along each axis. */
function extreme(positions: Float32Array, of: (a: number, b: number) => number): number[] {
  return [0, 1, 2].map((axis) => positions.filter((_, k) => k % 3 === axis).reduce((a, b) => of(a, b)));
}

/** Fills up to a multiple of four bytes. */
function padded(bytes: Uint8Array, fill: number): Uint8Array {
  const result = new Uint8Array(4 * Math.ceil(bytes.length / 4)).fill(fill);
  result.set(bytes);
  return result;
}

function container(json: Uint8Array, parts: Uint8Array[], length: number): Uint8Array<ArrayBuffer> {
  const total = 20 + json.length + (length > 0 ? 8 + length : 0);
  const file = new Uint8Array(total);
  const header = new DataView(file.buffer);
  [MAGIC, 2, total, json.length, JSON_CHUNK].forEach((value, k) => header.setUint32(4 * k, value, true));
  file.set(json, 20);
  if (length === 0) return file;
  let at = 20 + json.length;
  header.setUint32(at, length, true);
  header.setUint32(at + 4, BINARY_CHUNK, true);
  at += 8;
  for (const part of parts) {
    file.set(part, at);
    at += part.length;
  }
  return file;
}
