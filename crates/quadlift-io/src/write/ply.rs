//! PLY: meshes of the bodies in the colors of their categories, and camera frusta. World coordinates and units.
//!
//! Binary, little-endian; each vertex has doubles `x y z` and bytes `red green blue alpha`, each face a byte with the
//! number of its vertices (3) and their indices as 32-bit integers. Format: Greg Turk, *The PLY polygon file format*.

use nalgebra::Point3;

use super::format::{ExportFormat, Writer};
use super::{CheckedScene, Document, colors};

/// Faces of a frustum as indices of its five points: its center and the corners of the image.
const FRUSTUM: [[u32; 3]; 6] = [[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [1, 2, 3], [1, 3, 4]];

/// Alpha of the bodies and of the frusta.
const ALPHA: [u8; 2] = [160, 255];

/// The row of this format.
pub(super) const FORMAT: ExportFormat = ExportFormat {
    name: "ply",
    about: "PLY: meshes of the bodies and camera frusta",
    options: &["enclosing", "frusta"],
    write: Writer::Bodies(|scene, options| Ok(ply(scene, options.frusta))),
};

/// The scene as one mesh: the objects in their order, then the cameras. `frustum_depth` is the depth of the frusta in
/// world units; zero leaves them out, and without it they have a tenth of the distance to the objects.
pub(super) fn ply(scene: &CheckedScene, frustum_depth: Option<f64>) -> Document {
    let mut mesh = ColoredMesh::default();
    let category_indices = scene.category_indices();
    for object in &scene.objects {
        let body = &object.body;
        let unit = body.kind.mesh();
        let vertices = unit.vertices.iter().map(|v| body.center + body.rotation * v.component_mul(&body.half_extents));
        let [r, g, b] = colors::of_category(category_indices[object.category_name()]);
        mesh.add(vertices, [r, g, b, ALPHA[0]], &unit.triangles);
    }
    let frusta = scene.frusta(frustum_depth);
    for frustum in &frusta {
        let [r, g, b] = colors::CAMERA;
        mesh.add(frustum.iter().copied(), [r, g, b, ALPHA[1]], &FRUSTUM);
    }
    let unit = scene.scene.length_unit.as_deref().map(|unit| unit.replace(char::is_control, " "));
    let mut content = format!(
        "ply\nformat binary_little_endian 1.0\ncomment quadlift: {} objects, {} cameras, unit of length: {}\n\
         element vertex {}\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\n\
         property uchar green\nproperty uchar blue\nproperty uchar alpha\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        scene.objects.len(),
        frusta.len(),
        unit.as_deref().unwrap_or("not named"),
        mesh.vertices.len(),
        mesh.triangles.len(),
    )
    .into_bytes();
    for (vertex, color) in &mesh.vertices {
        vertex.iter().for_each(|x| content.extend(x.to_le_bytes()));
        content.extend(color);
    }
    for triangle in &mesh.triangles {
        content.push(3);
        triangle.iter().for_each(|index| content.extend(index.to_le_bytes()));
    }
    Document { content, counts: vec![("object", scene.objects.len()), ("camera", frusta.len())], notes: Vec::new() }
}

#[derive(Debug, Default)]
struct ColoredMesh {
    vertices: Vec<(Point3<f64>, [u8; 4])>,
    triangles: Vec<[u32; 3]>,
}

impl ColoredMesh {
    fn add(&mut self, vertices: impl Iterator<Item = Point3<f64>>, color: [u8; 4], triangles: &[[u32; 3]]) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(vertices.map(|vertex| (vertex, color)));
        self.triangles.extend(triangles.iter().map(|triangle| triangle.map(|index| first + index)));
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BodyChoice, test_scene};
    use super::*;

    struct Parsed {
        points: Vec<[f64; 3]>,
        colors: Vec<[u8; 4]>,
        faces: Vec<[u32; 3]>,
    }

    /// Reads as the header says.
    fn parse(bytes: &[u8]) -> Parsed {
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        let count = |name: &str| -> usize {
            let line = header.lines().find_map(|line| line.strip_prefix(&format!("element {name} ")));
            line.unwrap().parse().unwrap()
        };
        let (vertices, faces) = bytes[end..].split_at(28 * count("vertex"));
        assert_eq!(faces.len(), 13 * count("face"));
        let double = |b: &[u8]| f64::from_le_bytes(b.try_into().unwrap());
        let index = |b: &[u8]| u32::from_le_bytes(b.try_into().unwrap());
        let points = vertices.chunks(28).map(|v| [double(&v[..8]), double(&v[8..16]), double(&v[16..24])]).collect();
        let colors = vertices.chunks(28).map(|v| v[24..].try_into().unwrap()).collect();
        let faces = faces.chunks(13).map(|f| {
            assert_eq!(f[0], 3);
            [index(&f[1..5]), index(&f[5..9]), index(&f[9..])]
        });
        Parsed { points, colors, faces: faces.collect() }
    }

    #[test]
    fn bodies_and_cameras_are_where_they_should_be() {
        let file = test_scene::three_bodies();
        let document = ply(&CheckedScene::new(&file, BodyChoice::Body).unwrap(), Some(1.0));
        assert!(document.content.starts_with(b"ply\nformat binary_little_endian 1.0\ncomment "));
        assert_eq!(document.counts, [("object", 3), ("camera", 2)]);
        let Parsed { points, colors, faces } = parse(&document.content);
        // A rounded body has 12 x 12 cells on six sides; a cuboid 8 corners; a frustum 5 points.
        let rounded = 6 * 12 * 12 + 2;
        assert_eq!(points.len(), 2 * rounded + 8 + 2 * 5);
        assert_eq!(faces.len(), 2 * 6 * 12 * 12 * 2 + 12 + 2 * 6);
        assert!(faces.iter().flatten().all(|i| (*i as usize) < points.len()));
        let extent = |range: std::ops::Range<usize>, axis: usize| {
            points[range].iter().map(|p| p[axis]).fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)))
        };
        let close = |(a, b): (f64, f64), (x, y): (f64, f64)| (a - x).abs() < 1e-9 && (b - y).abs() < 1e-9;
        assert!(close(extent(0..rounded, 0), (0.5, 1.5)) && close(extent(0..rounded, 2), (-0.75, 0.75)));
        // The cuboid is turned by 0.5 about z.
        let reach = 0.5f64.cos() + 0.5 * 0.5f64.sin();
        assert!(close(extent(rounded..rounded + 8, 0), (-1.0 - reach, -1.0 + reach)));
        assert!(close(extent(points.len() - 10..points.len() - 5, 1), (-10.0, -9.0)), "the first camera");
        // Cups have one color, boxes another.
        assert_eq!(colors[0], colors[rounded + 8]);
        assert_ne!(colors[0], colors[rounded]);
        assert_eq!(colors[points.len() - 1], [110, 110, 110, 255]);
    }

    #[test]
    fn frusta_are_closed_and_face_outwards() {
        let file = test_scene::three_bodies();
        let scene = CheckedScene::new(&file, BodyChoice::Body).unwrap();
        let points = scene.frusta(Some(1.0))[0].map(|p| p.coords);
        let volume: f64 = FRUSTUM
            .iter()
            .map(|&[a, b, c]| [a, b, c].map(|i| points[i as usize]))
            .map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0)
            .sum();
        // A third of the base (1.28 x 0.96) at depth 1.
        assert!((volume - 1.28 * 0.96 / 3.0).abs() < 1e-12, "{volume}");
    }
}
