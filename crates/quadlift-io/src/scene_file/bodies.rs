//! The objects of a scene file as bodies of the library, checked.

use std::collections::HashMap;

use nalgebra::{Point3, Rotation3, Vector2, Vector3};
use quadlift::geometry::{Body, Cuboid, Cylinder, Ellipsoid, Superellipsoid, rotation_from_quaternion};
use quadlift::solve::{Covariance, CovarianceCoordinates, Matrix9, Status};

use super::object_records::{
    BodyRecord, CovarianceRecord, CuboidRecord, CylinderRecord, EllipsoidRecord, ObjectRecord, SuperellipsoidRecord,
};
use super::records::SceneFile;
use crate::error::EntryError;

/// The bodies of one object: the truth, or an estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectBodies {
    /// Id, which detections name.
    pub id: String,
    /// Category.
    pub category: Option<String>,
    /// Status of the estimate; absent for true objects.
    pub status: Option<Status>,
    /// Center in the world: the given one, or that of a body.
    pub center: Option<Point3<f64>>,
    /// The ellipsoid; of an estimate, the one that is tangent to the measurements.
    pub ellipsoid: Option<Ellipsoid>,
    /// The enclosing ellipsoid, which should contain the real object.
    pub enclosing_ellipsoid: Option<Ellipsoid>,
    /// The cuboid.
    pub cuboid: Option<Cuboid>,
    /// The enclosing cuboid, which should contain the real object.
    pub enclosing_cuboid: Option<Cuboid>,
    /// The cylinder.
    pub cylinder: Option<Cylinder>,
    /// The enclosing cylinder, which should contain the real object.
    pub enclosing_cylinder: Option<Cylinder>,
    /// The superellipsoid.
    pub superellipsoid: Option<Superellipsoid>,
    /// The enclosing superellipsoid, which should contain the real object.
    pub enclosing_superellipsoid: Option<Superellipsoid>,
    /// Uncertainty of an estimate.
    pub covariance: Option<Covariance>,
}

impl ObjectBodies {
    /// The body that was estimated, of its kind: not the equivalent ellipsoid of a cuboid.
    pub fn body(&self) -> Option<Body> {
        (self.superellipsoid.map(Body::Superellipsoid))
            .or(self.cylinder.map(Body::Cylinder))
            .or(self.cuboid.map(Body::Cuboid))
            .or(self.ellipsoid.map(Body::Ellipsoid))
    }

    /// The enclosing body of this kind, which should contain the real object.
    pub fn enclosing_body(&self) -> Option<Body> {
        (self.enclosing_superellipsoid.map(Body::Superellipsoid))
            .or(self.enclosing_cylinder.map(Body::Cylinder))
            .or(self.enclosing_cuboid.map(Body::Cuboid))
            .or(self.enclosing_ellipsoid.map(Body::Ellipsoid))
    }
}

impl SceneFile {
    /// The objects of the file as bodies, in the order of the file.
    ///
    /// # Errors
    /// [`EntryError`] names the first invalid entry: a duplicate id, an axis that is not positive, a rotation that
    /// is not a unit quaternion, an unknown status.
    pub fn to_objects(&self) -> Result<Vec<ObjectBodies>, EntryError> {
        let mut first_with: HashMap<&str, usize> = HashMap::with_capacity(self.objects.len());
        let mut objects = Vec::with_capacity(self.objects.len());
        for (index, record) in self.objects.iter().enumerate() {
            if let Some(first) = first_with.insert(&record.id, index) {
                let problem = format!("the object id \"{}\" is used twice (first by objects[{first}])", record.id);
                return Err(EntryError::new(format!("objects[{index}]"), problem));
            }
            objects.push(bodies(record, &format!("objects[{index}]"))?);
        }
        Ok(objects)
    }
}

impl ObjectRecord {
    /// The other bodies that fit the object's views about as well, with their log odds. `entry` is the place of the
    /// object in the file.
    ///
    /// # Errors
    /// [`EntryError`] names the first number that makes no body.
    pub fn to_alternatives(&self, entry: &str) -> Result<Vec<(Body, f64)>, EntryError> {
        let place = |k: usize, kind: &str| format!("{entry}.alternatives[{k}].{kind}");
        let others = self.alternatives.iter().enumerate();
        others
            .map(|(k, other)| {
                let body = match &other.body {
                    BodyRecord::Ellipsoid(record) => Body::Ellipsoid(ellipsoid(record, place(k, "ellipsoid"))?),
                    BodyRecord::Cuboid(record) => Body::Cuboid(cuboid(record, place(k, "cuboid"))?),
                    BodyRecord::Cylinder(record) => Body::Cylinder(cylinder(record, place(k, "cylinder"))?),
                    BodyRecord::Superellipsoid(record) => {
                        Body::Superellipsoid(superellipsoid(record, place(k, "superellipsoid"))?)
                    }
                };
                Ok((body, other.log_odds))
            })
            .collect()
    }
}

fn bodies(record: &ObjectRecord, entry: &str) -> Result<ObjectBodies, EntryError> {
    let place = |field: &str| format!("{entry}.{field}");
    let mut object = ObjectBodies {
        id: record.id.clone(),
        category: record.category.clone(),
        status: record.status.as_deref().map(|name| status(name, place("status"))).transpose()?,
        center: None,
        ellipsoid: given(record.ellipsoid.as_ref(), place("ellipsoid"), ellipsoid)?,
        enclosing_ellipsoid: given(record.enclosing_ellipsoid.as_ref(), place("enclosing_ellipsoid"), ellipsoid)?,
        cuboid: given(record.cuboid.as_deref(), place("cuboid"), cuboid)?,
        enclosing_cuboid: given(record.enclosing_cuboid.as_deref(), place("enclosing_cuboid"), cuboid)?,
        cylinder: given(record.cylinder.as_deref(), place("cylinder"), cylinder)?,
        enclosing_cylinder: given(record.enclosing_cylinder.as_deref(), place("enclosing_cylinder"), cylinder)?,
        superellipsoid: given(record.superellipsoid.as_deref(), place("superellipsoid"), superellipsoid)?,
        enclosing_superellipsoid: given(
            record.enclosing_superellipsoid.as_deref(),
            place("enclosing_superellipsoid"),
            superellipsoid,
        )?,
        covariance: covariance(record.covariance.as_deref(), place("covariance"))?,
    };
    object.center = match record.center {
        Some(center) => Some(finite_point(&center, place("center"))?),
        None => (object.ellipsoid.map(|body| body.center))
            .or(object.cuboid.map(|body| body.center))
            .or(object.cylinder.map(|body| body.center))
            .or(object.superellipsoid.map(|body| body.center)),
    };
    Ok(object)
}

/// The body of a record where there is one.
fn given<R, B>(
    record: Option<&R>,
    place: String,
    body: fn(&R, String) -> Result<B, EntryError>,
) -> Result<Option<B>, EntryError> {
    record.map(|record| body(record, place)).transpose()
}

fn ellipsoid(record: &EllipsoidRecord, place: String) -> Result<Ellipsoid, EntryError> {
    Ok(Ellipsoid {
        center: finite_point(&record.center, format!("{place}.center"))?,
        semi_axes: positive_lengths(&record.semi_axes, format!("{place}.semi_axes"))?,
        rotation: unit_rotation(&record.rotation, format!("{place}.rotation"))?,
    })
}

fn cuboid(record: &CuboidRecord, place: String) -> Result<Cuboid, EntryError> {
    Ok(Cuboid {
        center: finite_point(&record.center, format!("{place}.center"))?,
        half_extents: positive_lengths(&record.half_extents, format!("{place}.half_extents"))?,
        rotation: unit_rotation(&record.rotation, format!("{place}.rotation"))?,
    })
}

fn cylinder(record: &CylinderRecord, place: String) -> Result<Cylinder, EntryError> {
    let positive = |x: f64| x > 0.0 && x.is_finite();
    if !record.radii.into_iter().all(positive) {
        let problem = format!("expected two positive numbers, found {:?}", record.radii);
        return Err(EntryError::new(format!("{place}.radii"), problem));
    }
    if !positive(record.half_height) {
        let problem = format!("expected a positive number, found {:?}", record.half_height);
        return Err(EntryError::new(format!("{place}.half_height"), problem));
    }
    Ok(Cylinder {
        center: finite_point(&record.center, format!("{place}.center"))?,
        radii: Vector2::from(record.radii),
        half_height: record.half_height,
        rotation: unit_rotation(&record.rotation, format!("{place}.rotation"))?,
    })
}

fn superellipsoid(record: &SuperellipsoidRecord, place: String) -> Result<Superellipsoid, EntryError> {
    let support_exponent = record.support_exponent;
    if !(1.0..=2.0).contains(&support_exponent) {
        let problem = format!("{support_exponent} is not a number from 1 (cuboid) to 2 (ellipsoid)");
        return Err(EntryError::new(format!("{place}.support_exponent"), problem));
    }
    Ok(Superellipsoid {
        center: finite_point(&record.center, format!("{place}.center"))?,
        semi_axes: positive_lengths(&record.semi_axes, format!("{place}.semi_axes"))?,
        rotation: unit_rotation(&record.rotation, format!("{place}.rotation"))?,
        support_exponent,
    })
}

fn finite_point(point: &[f64; 3], place: String) -> Result<Point3<f64>, EntryError> {
    if point.iter().all(|x| x.is_finite()) {
        return Ok(Point3::from(*point));
    }
    Err(EntryError::new(place, "the point holds a number that is not finite"))
}

fn positive_lengths(lengths: &[f64; 3], place: String) -> Result<Vector3<f64>, EntryError> {
    if lengths.iter().all(|x| *x > 0.0 && x.is_finite()) {
        return Ok(Vector3::from(*lengths));
    }
    Err(EntryError::new(place, format!("expected three positive numbers, found {lengths:?}")))
}

fn unit_rotation(quaternion: &[f64; 4], place: String) -> Result<Rotation3<f64>, EntryError> {
    rotation_from_quaternion(*quaternion)
        .ok_or_else(|| EntryError::new(place, format!("expected a unit quaternion [w, x, y, z], found {quaternion:?}")))
}

fn status(name: &str, place: String) -> Result<Status, EntryError> {
    let all = Status::ALL;
    all.into_iter().find(|status| status.name() == name).ok_or_else(|| {
        let problem = format!("unknown status \"{name}\"; expected one of {}", all.map(Status::name).join(", "));
        EntryError::new(place, problem)
    })
}

/// The name of a covariance's coordinates in files.
pub fn coordinates_name(coordinates: CovarianceCoordinates) -> &'static str {
    match coordinates {
        CovarianceCoordinates::CenterVechShape => "center_vech_shape",
        CovarianceCoordinates::CenterRotationLogAxes => "center_rotation_log_axes",
    }
}

fn covariance(record: Option<&CovarianceRecord>, place: String) -> Result<Option<Covariance>, EntryError> {
    let Some(record) = record else { return Ok(None) };
    let all = [CovarianceCoordinates::CenterVechShape, CovarianceCoordinates::CenterRotationLogAxes];
    let coordinates = all.into_iter().find(|c| coordinates_name(*c) == record.coordinates).ok_or_else(|| {
        let names = all.map(coordinates_name).join(" or ");
        let problem = format!("unknown coordinates \"{}\"; expected {names}", record.coordinates);
        EntryError::new(format!("{place}.coordinates"), problem)
    })?;
    let matrix = Matrix9::from_fn(|i, j| record.matrix[i][j]);
    let size = matrix.amax();
    if !size.is_finite() || (matrix - matrix.transpose()).amax() > 1e-6 * size {
        return Err(EntryError::new(format!("{place}.matrix"), "the matrix is not symmetric and finite"));
    }
    Ok(Some(Covariance { coordinates, matrix }))
}
