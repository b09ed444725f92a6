//! Meshes of bodies whose half extents are one.

use std::collections::HashMap;

use nalgebra::Vector3;

/// A closed surface of triangles that are counterclockwise seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// Corners of the triangles.
    pub vertices: Vec<Vector3<f64>>,
    /// Indices of their corners.
    pub triangles: Vec<[u32; 3]>,
    /// Outward unit normals at the vertices of a smooth surface; empty for bodies whose faces are flat.
    pub normals: Vec<Vector3<f64>>,
}

/// The surface of a cube divided into cells, so many along an edge, whose corners are pushed along their rays onto a body: `gauge` is the
/// factor by which the body must grow to have a point on its surface.
pub(super) fn pushed_cube(divisions: i32, gauge: impl Fn(&Vector3<f64>) -> f64) -> Mesh {
    let mut mesh = Mesh { vertices: Vec::new(), triangles: Vec::new(), normals: Vec::new() };
    let mut index_of = HashMap::new();
    let mut vertex = |cell: [i32; 3]| {
        *index_of.entry(cell).or_insert_with(|| {
            // Cells of equal angles, so that a ball has triangles of similar sizes.
            let angle = |i: i32| std::f64::consts::FRAC_PI_4 * (2.0 * f64::from(i) / f64::from(divisions) - 1.0);
            let on_cube = Vector3::from(cell.map(|i| angle(i).tan()));
            mesh.vertices.push(on_cube / gauge(&on_cube));
            mesh.vertices.len() as u32 - 1
        })
    };
    for axis in 0..3 {
        for (side, forward) in [(0, false), (divisions, true)] {
            for (i, j) in (0..divisions).flat_map(|i| (0..divisions).map(move |j| (i, j))) {
                let mut corner = |i: i32, j: i32| {
                    let mut cell = [0; 3];
                    cell[axis] = side;
                    cell[(axis + 1) % 3] = i;
                    cell[(axis + 2) % 3] = j;
                    vertex(cell)
                };
                let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                let cells = if forward { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
                mesh.triangles.extend(cells);
            }
        }
    }
    mesh
}
