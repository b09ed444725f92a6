//! Meshes of bodies.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

use super::{Placement, Shape};

/// Cells along an edge of the cube from which rounded bodies are made; even, so that the ends of the axes are vertices.
const DIVISIONS: i32 = 12;

/// Corners of the polygon that approximates the base of a cylinder.
const ROUND: u32 = 48;

/// A closed surface of triangles that are counterclockwise seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Mesh {
    pub vertices: Vec<Vector3<f64>>,
    pub triangles: Vec<[u32; 3]>,
}

/// The body of half extents one about the origin.
pub(super) fn unit_body(shape: Shape) -> Mesh {
    match shape {
        Shape::Exponent(exponent) => unit_superellipsoid(exponent),
        Shape::Cylinder => unit_cylinder(),
    }
}

/// The cylinder about the third axis: bottom and top rim, then the middle of bottom and top.
fn unit_cylinder() -> Mesh {
    let rim = |z: f64| {
        (0..ROUND).map(move |k| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(ROUND)).sin_cos();
            Vector3::new(cos, sin, z)
        })
    };
    let middles = [Vector3::new(0.0, 0.0, -1.0), Vector3::new(0.0, 0.0, 1.0)];
    let triangles = (0..ROUND).flat_map(|k| {
        let next = (k + 1) % ROUND;
        let [a, b, c, d] = [k, next, next + ROUND, k + ROUND];
        [[a, b, c], [a, c, d], [2 * ROUND, b, a], [2 * ROUND + 1, d, c]]
    });
    Mesh { vertices: rim(-1.0).chain(rim(1.0)).chain(middles).collect(), triangles: triangles.collect() }
}

/// The body of half extents one about the origin with a support exponent from 1 (cube, 8 vertices) to 2 (ball).
///
/// The surface of a cube is divided into cells, whose corners are pushed along their rays onto the body.
fn unit_superellipsoid(support_exponent: f64) -> Mesh {
    let divisions = if support_exponent <= 1.0 { 1 } else { DIVISIONS };
    let mut mesh = Mesh { vertices: Vec::new(), triangles: Vec::new() };
    let mut index_of = HashMap::new();
    let mut vertex = |cell: [i32; 3]| {
        *index_of.entry(cell).or_insert_with(|| {
            // Cells of equal angles, so that a ball has triangles of similar sizes.
            let angle = |i: i32| std::f64::consts::FRAC_PI_4 * (2.0 * f64::from(i) / f64::from(divisions) - 1.0);
            let on_cube = Vector3::from(cell.map(|i| angle(i).tan()));
            mesh.vertices.push(on_cube / gauge(&on_cube, support_exponent));
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

/// The factor by which the unit body must grow to have the point on its surface: the norm whose dual is the support
/// function.
fn gauge(point: &Vector3<f64>, support_exponent: f64) -> f64 {
    let largest = point.amax();
    if support_exponent <= 1.0 {
        return largest;
    }
    let p = support_exponent / (support_exponent - 1.0);
    largest * point.map(|x| (x.abs() / largest).powf(p)).sum().powf(1.0 / p)
}

/// The outward unit normal of the unit body at a point of its surface.
pub(super) fn normal(point: &Vector3<f64>, support_exponent: f64) -> Vector3<f64> {
    let power = 1.0 / (support_exponent - 1.0);
    let largest = point.amax();
    point.map(|x| x.signum() * (x.abs() / largest).powf(power)).normalize()
}

impl Placement {
    /// A point of the unit body in the world.
    pub(super) fn to_world(self, point: &Vector3<f64>) -> Point3<f64> {
        self.center + self.rotation * point.component_mul(&self.half_extents)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::geometry::{Body, ConvexBody, Cylinder, Superellipsoid};

    /// Volume by the theorem of Gauss; it is negative where triangles are turned inside out.
    fn volume(mesh: &Mesh) -> f64 {
        let v = |i: u32| mesh.vertices[i as usize];
        mesh.triangles.iter().map(|&[a, b, c]| v(a).dot(&v(b).cross(&v(c))) / 6.0).sum()
    }

    #[test]
    fn meshes_have_the_volume_of_the_body_and_no_holes() {
        let (center, semi_axes) = (Point3::origin(), Vector3::repeat(1.0));
        let rotation = nalgebra::Rotation3::identity();
        let exponents = [1.0, 1.1, 1.5, 2.0].map(|support_exponent| {
            let body = Body::Superellipsoid(Superellipsoid { center, semi_axes, rotation, support_exponent });
            (Shape::Exponent(support_exponent), body)
        });
        let cylinder = Body::Cylinder(Cylinder::from_half_extents(center, semi_axes, rotation));
        for (q, body) in exponents.into_iter().chain([(Shape::Cylinder, cylinder)]) {
            let mesh = unit_body(q);
            let (found, expected) = (volume(&mesh), body.volume());
            assert!(found <= expected + 1e-12 && found > 0.97 * expected, "{q:?}: {found} {expected}");
            // Euler's formula for a closed surface without handles.
            assert_eq!(mesh.vertices.len(), mesh.triangles.len() / 2 + 2, "{q:?}");
            let mut edges = HashMap::new();
            for t in &mesh.triangles {
                for k in 0..3 {
                    *edges.entry((t[k], t[(k + 1) % 3])).or_insert(0) += 1;
                }
            }
            assert!(edges.iter().all(|((a, b), n)| *n == 1 && edges.get(&(*b, *a)) == Some(&1)), "{q:?}");
        }
        assert_eq!(unit_body(Shape::Exponent(1.0)).vertices.len(), 8);
    }

    #[test]
    fn vertices_lie_on_the_body_and_normals_are_those_of_its_tangent_planes() {
        for q in [1.3, 2.0] {
            let mesh = unit_body(Shape::Exponent(q));
            for point in &mesh.vertices {
                let n = normal(point, q);
                // The tangent plane at the point: n . x = support(n), by the definition of the support function.
                let support = n.map(|x| x.abs().powf(q)).sum().powf(1.0 / q);
                assert!((n.dot(point) - support).abs() < 1e-12, "{q} {point}");
            }
            assert!(mesh.vertices.iter().any(|p| (p - Vector3::y()).norm() < 1e-12), "the end of an axis");
        }
    }
}
