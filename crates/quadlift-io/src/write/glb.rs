//! glTF 2.0 in one binary file: a node for each object that places a mesh of half extents one, in translucent colors of
//! the categories, and the camera frusta as lines. Meters, y up.
//!
//! Format: *glTF 2.0 Specification* (Khronos), sections 3 and 4.4.

use std::collections::BTreeMap;

use nalgebra::{Rotation3, Unit, Vector3};
use quadlift::geometry::{Body, Mesh, quaternion_from_rotation};
use serde_json::{Value, json};

use super::format::{ExportFormat, Writer};
use super::{CheckedScene, Document, Object, colors};

/// How opaque the bodies are.
const ALPHA: f64 = 0.5;

/// Numbers of the format: component types, targets of buffer views, modes of primitives, chunks of the file.
const U32: u32 = 5125;
const F32: u32 = 5126;
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;
const LINES: u32 = 1;
const JSON_CHUNK: &[u8; 4] = b"JSON";
const BINARY_CHUNK: &[u8; 4] = b"BIN\0";

/// Edges of a frustum as indices of its five points.
const EDGES: [[u32; 2]; 8] = [[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1]];

/// The row of this format.
pub(super) const FORMAT: ExportFormat = ExportFormat {
    name: "glb",
    about: "glTF binary: one node per object, and camera frusta; meters, y up",
    options: &["enclosing", "frusta", "length_unit"],
    write: Writer::Bodies(|scene, options| Ok(glb(scene, options.frusta))),
};

/// The scene as glTF. The root node turns the world so that y is up and converts its unit to meters; the nodes below it
/// have world coordinates. `frustum_depth` as in [`super::ply::ply`].
pub(super) fn glb(scene: &CheckedScene, frustum_depth: Option<f64>) -> Document {
    let mut parts = Parts::default();
    let mut nodes: Vec<Value> = Vec::new();
    let categories = scene.categories();
    let materials: Vec<Value> = categories
        .iter()
        .enumerate()
        .map(|(index, name)| material(name, colors::of_category(index), ALPHA))
        .chain([material("cameras", colors::CAMERA, 1.0)])
        .collect();
    let category_indices = scene.category_indices();
    // One mesh for each shape and category; all categories share the numbers of a shape.
    let mut shapes: BTreeMap<(&str, Option<u64>), Value> = BTreeMap::new();
    let mut mesh_of: BTreeMap<((&str, Option<u64>), usize), usize> = BTreeMap::new();
    for object in &scene.objects {
        let body = &object.body;
        let kind = body.kind.simplest();
        let shape = (kind.name(), kind.parameter().map(f64::to_bits));
        let category = category_indices[object.category_name()];
        let geometry = shapes.entry(shape).or_insert_with(|| parts.add_mesh(&kind.mesh()));
        let mesh = *mesh_of.entry((shape, category)).or_insert_with(|| {
            let mut primitive = geometry.clone();
            primitive["material"] = json!(category);
            parts.meshes.push(json!({ "name": categories[category], "primitives": [primitive] }));
            parts.meshes.len() - 1
        });
        nodes.push(object_node(object, body, mesh));
    }
    let frusta = scene.frusta(frustum_depth);
    if !frusta.is_empty() {
        // Single precision suffices near the first camera, which may be far from the origin of the world.
        let origin = frusta[0][0];
        let points: Vec<Vector3<f64>> = frusta.iter().flatten().map(|point| point - origin).collect();
        let edges = (0..frusta.len() as u32).flat_map(|k| EDGES.iter().flatten().map(move |i| 5 * k + i)).collect();
        let primitive = json!({
            "attributes": { "POSITION": parts.add_vectors(&points, true) },
            "indices": parts.add_indices(edges),
            "mode": LINES,
            "material": categories.len(),
        });
        parts.meshes.push(json!({ "name": "cameras", "primitives": [primitive] }));
        let translation: [f64; 3] = origin.coords.into();
        nodes.push(json!({ "name": "cameras", "mesh": parts.meshes.len() - 1, "translation": translation }));
    }
    let (up, up_note) = upward(scene);
    let (meters, unit_note) = scene.meters();
    let root = json!({
        "name": scene.file.name.as_deref().unwrap_or("scene"),
        "rotation": quaternion(&y_up_from(&up)),
        "scale": [meters, meters, meters],
        "children": (0..nodes.len()).collect::<Vec<_>>(),
    });
    nodes.push(root);
    let document = json!({
        "asset": { "version": "2.0", "generator": concat!("quadlift ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [nodes.len() - 1] }],
        "nodes": nodes,
        "meshes": parts.meshes,
        "materials": materials,
        "accessors": parts.accessors,
        "bufferViews": parts.views,
        "buffers": [{ "byteLength": parts.bytes.len() }],
    });
    Document {
        content: container(document.to_string().into_bytes(), parts.bytes),
        counts: vec![("object", scene.objects.len()), ("camera", frusta.len())],
        notes: [up_note, unit_note].into_iter().flatten().collect(),
    }
}

fn object_node(object: &Object, body: &Body, mesh: usize) -> Value {
    let (translation, scale): ([f64; 3], [f64; 3]) = (body.center.coords.into(), body.half_extents.into());
    json!({
        "name": object.id,
        "mesh": mesh,
        "translation": translation,
        "rotation": quaternion(&body.rotation),
        "scale": scale,
        "extras": { "id": object.id, "category": object.category },
    })
}

/// `[x, y, z, w]`.
fn quaternion(rotation: &Rotation3<f64>) -> [f64; 4] {
    let [w, x, y, z] = quaternion_from_rotation(rotation);
    [x, y, z, w]
}

fn material(name: &str, color: [u8; 3], alpha: f64) -> Value {
    let [r, g, b] = colors::linear(color);
    let mut material = json!({
        "name": name,
        "pbrMetallicRoughness": { "baseColorFactor": [r, g, b, alpha], "metallicFactor": 0, "roughnessFactor": 0.8 },
    });
    if alpha < 1.0 {
        material["alphaMode"] = json!("BLEND");
    }
    material
}

/// The world direction against gravity: the scene's, or the mean upward axis of the cameras.
fn upward(scene: &CheckedScene) -> (Unit<Vector3<f64>>, Option<String>) {
    if let Some(up) = scene.scene.up {
        return (up, None);
    }
    let camera_up = |m: nalgebra::Matrix3<f64>| -m.row(1).transpose();
    let poses = scene.scene.frames.iter().filter_map(|frame| frame.projection.camera_pose());
    let sum: Vector3<f64> = poses.map(|pose| camera_up(pose.matrix().fixed_columns::<3>(0).into_owned())).sum();
    match Unit::try_new(sum, 1e-6) {
        Some(up) => {
            let note = "the scene has no \"up\": the mean upward axis of the cameras was used";
            (up, Some(note.to_owned()))
        }
        None => (Vector3::y_axis(), Some("the scene has no \"up\": y was used".to_owned())),
    }
}

/// The smallest rotation that turns `up` to y.
fn y_up_from(up: &Vector3<f64>) -> Rotation3<f64> {
    Rotation3::rotation_between(up, &Vector3::y())
        // Half a turn, for which every axis would do.
        .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI))
}

/// Meshes and the numbers that they point to.
#[derive(Debug, Default)]
struct Parts {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
}

impl Parts {
    /// A primitive without a material.
    fn add_mesh(&mut self, mesh: &Mesh) -> Value {
        let mut attributes = json!({ "POSITION": self.add_vectors(&mesh.vertices, true) });
        // Without normals a viewer shades the faces flat.
        if !mesh.normals.is_empty() {
            attributes["NORMAL"] = self.add_vectors(&mesh.normals, false);
        }
        let indices = self.add_indices(mesh.triangles.iter().flatten().copied().collect());
        json!({ "attributes": attributes, "indices": indices })
    }

    /// Index of a new accessor to vectors; bounds are required for positions.
    fn add_vectors(&mut self, vectors: &[Vector3<f64>], with_bounds: bool) -> Value {
        let singles: Vec<[f32; 3]> = vectors.iter().map(|v| [v.x as f32, v.y as f32, v.z as f32]).collect();
        let view = self.add_bytes(singles.iter().flatten().flat_map(|x| x.to_le_bytes()), VERTICES);
        let mut accessor = json!({ "bufferView": view, "componentType": F32, "count": singles.len(), "type": "VEC3" });
        if with_bounds {
            let bound = |pick: fn(f32, f32) -> f32| {
                [0, 1, 2].map(|axis| singles.iter().map(|v| v[axis]).reduce(pick).unwrap_or_default())
            };
            accessor["min"] = json!(bound(f32::min));
            accessor["max"] = json!(bound(f32::max));
        }
        self.add_accessor(accessor)
    }

    fn add_indices(&mut self, indices: Vec<u32>) -> Value {
        let view = self.add_bytes(indices.iter().flat_map(|i| i.to_le_bytes()), INDICES);
        self.add_accessor(json!({
            "bufferView": view, "componentType": U32, "count": indices.len(), "type": "SCALAR",
        }))
    }

    fn add_accessor(&mut self, accessor: Value) -> Value {
        self.accessors.push(accessor);
        json!(self.accessors.len() - 1)
    }

    /// Index of a new view. Everything that is stored has four bytes, so that all of it is aligned.
    fn add_bytes(&mut self, bytes: impl Iterator<Item = u8>, target: u32) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        self.views.push(json!({
            "buffer": 0, "byteOffset": offset, "byteLength": self.bytes.len() - offset, "target": target,
        }));
        self.views.len() - 1
    }
}

/// The file: a header and two chunks, each filled up to a multiple of four bytes.
fn container(mut document: Vec<u8>, mut binary: Vec<u8>) -> Vec<u8> {
    document.resize(document.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let length = 12 + 8 + document.len() + 8 + binary.len();
    let mut file = Vec::with_capacity(length);
    file.extend(b"glTF");
    file.extend(2u32.to_le_bytes());
    file.extend((length as u32).to_le_bytes());
    for (kind, chunk) in [(JSON_CHUNK, document), (BINARY_CHUNK, binary)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

#[cfg(test)]
mod tests {
    use super::super::{BodyChoice, test_scene};
    use super::*;
    use crate::scene_file::SceneFile;

    fn parse(bytes: &[u8]) -> (Value, &[u8]) {
        let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], number(4), number(8)), (&b"glTF"[..], 2, bytes.len()));
        let json_length = number(12);
        assert_eq!(&bytes[16..20], b"JSON");
        let binary = 20 + json_length;
        assert_eq!((json_length % 4, &bytes[binary + 4..binary + 8]), (0, &b"BIN\0"[..]));
        assert_eq!(number(binary), bytes.len() - binary - 8);
        (serde_json::from_slice(&bytes[20..binary]).unwrap(), &bytes[binary + 8..])
    }

    fn written(file: &SceneFile) -> (Value, Vec<u8>, Vec<String>) {
        let document = glb(&CheckedScene::new(file, BodyChoice::Body).unwrap(), Some(1.0));
        let (json, binary) = parse(&document.content);
        (json, binary.to_vec(), document.notes)
    }

    #[test]
    fn the_document_places_unit_meshes() {
        let (document, binary, notes) = written(&test_scene::three_bodies());
        assert_eq!(notes, Vec::<String>::new());
        assert_eq!(document["buffers"][0]["byteLength"], binary.len());
        let shown = json!({
            "nodes": document["nodes"], "meshes": document["meshes"], "materials": document["materials"],
            "scenes": document["scenes"],
        });
        insta::assert_snapshot!(serde_json::to_string_pretty(&shown).unwrap());
        // All indices are inside of their accessors and all views inside of the buffer.
        let count = |accessor: &Value| document["accessors"][accessor.as_u64().unwrap() as usize]["count"].clone();
        let mesh = |k: usize| &document["meshes"][k]["primitives"][0];
        assert_eq!(count(&mesh(0)["attributes"]["POSITION"]), 866);
        assert_eq!(count(&mesh(0)["attributes"]["NORMAL"]), 866);
        assert_eq!((count(&mesh(1)["attributes"]["POSITION"]), count(&mesh(1)["indices"])), (json!(8), json!(36)));
        assert_eq!((count(&mesh(3)["attributes"]["POSITION"]), count(&mesh(3)["indices"])), (json!(10), json!(32)));
        let mut end = 0;
        for view in document["bufferViews"].as_array().unwrap() {
            assert_eq!(view["byteOffset"], end);
            end += view["byteLength"].as_u64().unwrap();
        }
        assert_eq!(end, binary.len() as u64);
        assert_eq!(document["accessors"][0]["min"], json!([-1.0, -1.0, -1.0]));
    }

    #[test]
    fn up_becomes_y_and_units_meters() {
        let mut file = test_scene::three_bodies();
        let root = |file: &SceneFile| {
            let (document, _, notes) = written(file);
            let root = document["nodes"].as_array().unwrap().last().unwrap().clone();
            let q: [f64; 4] = serde_json::from_value(root["rotation"].clone()).unwrap();
            let rotation = quadlift::geometry::rotation_from_quaternion([q[3], q[0], q[1], q[2]]).unwrap();
            (rotation, root["scale"][0].as_f64().unwrap(), notes)
        };
        file.length_unit = Some("mm".into());
        for up in [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 2.0, -3.0]] {
            file.up = Some(up);
            let (rotation, scale, notes) = root(&file);
            let up = Vector3::from(up).normalize();
            assert!((rotation * up - Vector3::y()).norm() < 1e-12, "{up}");
            assert_eq!((scale, notes.len()), (0.001, 1));
        }
        // The cameras of the scene stand upright, with z up.
        file.up = None;
        let (rotation, _, notes) = root(&file);
        assert!((rotation * Vector3::z() - Vector3::y()).norm() < 1e-12);
        assert!(notes[0].contains("the mean upward axis of the cameras"), "{notes:?}");
    }
}
