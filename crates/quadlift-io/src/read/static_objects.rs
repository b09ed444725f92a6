//! True objects from labels of many frames: each is the mean of its cuboids in the world, if it is static.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix4, Point3, Rotation3, Vector3};
use quadlift::geometry::{Body, BodyKind};

use crate::scene_file::ObjectRecord;

/// An object is static if its centers scatter by less than this fraction of its longest half extent (root mean square).
/// GPS poses drift by less over the few frames in which a parked car is seen.
const STILL: f64 = 0.5;

/// Cuboids of one object in several frames.
#[derive(Debug, Clone, Default)]
struct Labels {
    category: Option<String>,
    centers: Vec<Vector3<f64>>,
    rotations: Vec<Matrix3<f64>>,
    half_extents: Vec<Vector3<f64>>,
}

/// The labeled objects of a scene, by id.
#[derive(Debug, Clone, Default)]
pub(super) struct LabelledObjects {
    by_id: BTreeMap<String, Labels>,
}

impl LabelledObjects {
    /// One more label of an object: its pose in the world and half its extents along its axes.
    pub(super) fn add(
        &mut self,
        id: &str,
        category: Option<&str>,
        world_from_object: &Matrix4<f64>,
        half_extents: Vector3<f64>,
    ) {
        let labels = self.by_id.entry(id.to_owned()).or_default();
        labels.category = category.map(str::to_owned);
        labels.centers.push(world_from_object.fixed_view::<3, 1>(0, 3).into_owned());
        labels.rotations.push(world_from_object.fixed_view::<3, 3>(0, 0).into_owned());
        labels.half_extents.push(half_extents);
    }

    /// The static objects, and the ids of the others.
    pub(super) fn objects(&self) -> (Vec<ObjectRecord>, Vec<String>) {
        let (mut still, mut moving) = (Vec::new(), Vec::new());
        for (id, labels) in &self.by_id {
            match labels.mean() {
                Some(cuboid) => {
                    let (id, category) = (id.clone(), labels.category.clone());
                    let mut object = ObjectRecord { id, category, ..ObjectRecord::default() };
                    object.set_true_body(&cuboid);
                    // A label is the box of a body of any kind: as in the papers, the ellipsoid inscribed in it is true.
                    object.ellipsoid.iter_mut().for_each(|e| e.semi_axes = cuboid.half_extents.into());
                    still.push(object);
                }
                None => moving.push(id.clone()),
            }
        }
        (still, moving)
    }
}

impl Labels {
    /// The mean cuboid; `None` if the object moves, or if values are invalid.
    fn mean(&self) -> Option<Body> {
        let n = self.centers.len() as f64;
        let center = self.centers.iter().sum::<Vector3<f64>>() / n;
        let half_extents = self.half_extents.iter().sum::<Vector3<f64>>() / n;
        let scatter = (self.centers.iter().map(|c| (c - center).norm_squared()).sum::<f64>() / n).sqrt();
        let possible = half_extents.min() > 0.0 && half_extents.iter().chain(center.iter()).all(|x| x.is_finite());
        if !possible || scatter > STILL * half_extents.max() {
            return None;
        }
        let rotation = nearest_rotation(&(self.rotations.iter().sum::<Matrix3<f64>>() / n))?;
        Some(Body { center: Point3::from(center), rotation, half_extents, kind: BodyKind::Cuboid })
    }
}

/// The rotation that is nearest to a matrix in the sum of squares; of a mean of rotations, their chordal mean.
fn nearest_rotation(m: &Matrix3<f64>) -> Option<Rotation3<f64>> {
    if !m.iter().all(|x| x.is_finite()) || m.determinant() <= 1e-6 {
        return None;
    }
    let svd = m.try_svd(true, true, f64::EPSILON, 1000)?;
    Some(Rotation3::from_matrix_unchecked(svd.u? * svd.v_t?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn still_objects_are_averaged_and_moving_ones_named() {
        let mut objects = LabelledObjects::default();
        let half = Vector3::new(2.0, 0.8, 0.9);
        for (turn, x) in [(0.1, 9.9), (0.2, 10.0), (0.3, 10.1)] {
            let mut pose = Rotation3::from_euler_angles(0.0, turn, 0.0).to_homogeneous();
            pose[(0, 3)] = x;
            objects.add("parked", Some("car"), &pose, half);
            pose[(0, 3)] = 30.0 * x;
            objects.add("driving", Some("car"), &pose, half);
        }
        let (still, moving) = objects.objects();
        assert_eq!(moving, ["driving"]);
        let cuboid = still[0].cuboid.as_ref().unwrap();
        assert!((cuboid.center[0] - 10.0).abs() < 1e-12);
        assert!((cuboid.rotation[2] - 0.1f64.sin()).abs() < 1e-12, "half of 0.2 about y: {:?}", cuboid.rotation);
        assert_eq!((still[0].id.as_str(), still[0].category.as_deref()), ("parked", Some("car")));
    }
}
