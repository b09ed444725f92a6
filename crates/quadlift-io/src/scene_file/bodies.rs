//! The objects of a scene file as bodies of the library, checked.

use std::collections::HashMap;

use nalgebra::Point3;
use quadlift::geometry::{Body, BodyKind, Ellipsoid};
use quadlift::solve::{Covariance, CovarianceCoordinates, Matrix9, Status};

use super::object_records::{CovarianceRecord, KindRecord, ObjectRecord, finite_point};
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
    /// The bodies: one of an estimate, of a true object one of each kind that the file gives, an ellipsoid first.
    pub bodies: Vec<Body>,
    /// The box around the real object.
    pub bounds: Option<Body>,
    /// The ellipsoid that should contain the real object.
    pub enclosing: Option<Body>,
    /// Uncertainty of an estimate.
    pub covariance: Option<Covariance>,
}

impl ObjectBodies {
    /// The body; of a true object the one that is no ellipsoid, where there are several.
    pub fn body(&self) -> Option<Body> {
        self.bodies.last().copied()
    }

    /// The ellipsoid, of a true object also beside another body.
    pub fn ellipsoid(&self) -> Option<Ellipsoid> {
        of_kind(&self.bodies, BodyKind::Ellipsoid).map(|body| body.inscribed())
    }

    /// The cuboid.
    pub fn cuboid(&self) -> Option<Body> {
        of_kind(&self.bodies, BodyKind::Cuboid)
    }
}

fn of_kind(bodies: &[Body], kind: BodyKind) -> Option<Body> {
    bodies.iter().copied().find(|body| body.kind == kind)
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
        let others = self.alternatives.iter().enumerate();
        others
            .filter_map(|(k, other)| Some((k, other.body.as_ref()?, other.log_odds)))
            .map(|(k, body, log_odds)| Ok((body.to_body(&format!("{entry}.alternatives[{k}].body"))?, log_odds)))
            .collect()
    }
}

fn bodies(record: &ObjectRecord, entry: &str) -> Result<ObjectBodies, EntryError> {
    let place = |field: &str| format!("{entry}.{field}");
    let status = record.status.as_deref().map(|name| status(name, place("status"))).transpose()?;
    let mut bodies = Vec::new();
    for (kind, of_kind) in record.true_bodies() {
        bodies.extend(of_kind.map(|of_kind| of_kind.to_body(&place(kind))).transpose()?);
    }
    if status.is_some() && bodies.len() > 1 {
        // An estimate of an older version: the ellipsoid stands for the other body.
        bodies.drain(..bodies.len() - 1);
    }
    if let Some(body) = &record.body {
        bodies = vec![body.to_body(&place("body"))?];
    }
    let bounds = record.bounds.as_ref().map(|record| record.to_body(&place("bounds"))).transpose()?;
    let enclosing = record.enclosing.as_ref().map(|body| body.to_body(&place("enclosing"))).transpose()?;
    let covariance = covariance(record.covariance.as_deref(), place("covariance"))?;
    let given = record.center.map(|center| finite_point(&center, place("center"))).transpose()?;
    Ok(ObjectBodies {
        id: record.id.clone(),
        category: record.category.clone(),
        status,
        center: given.or(bodies.first().map(|body| body.center)),
        bodies,
        bounds,
        enclosing,
        covariance,
    })
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
