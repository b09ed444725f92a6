//! One body seen exactly, for the tests of the parts.

use nalgebra::{Point3, Rotation3, Vector3};

use super::model::Model;
use super::observations::Observations;
use super::options::AssociateOptions;
use crate::geometry::{Ellipsoid, project_ellipsoid};
use crate::scene::{DetectionInput, SceneBuilder};
use crate::synthetic::{SyntheticOptions, Trajectory, generate};

/// A body somewhere near the middle.
pub(super) fn ellipsoid() -> Ellipsoid {
    Ellipsoid {
        center: Point3::new(3.0, -2.0, 1.0),
        semi_axes: Vector3::new(3.0, 2.0, 1.5),
        rotation: Rotation3::from_euler_angles(0.3, 0.5, -0.4),
    }
}

/// The exact boxes of a body in so many views around it, and a model with the first noise.
pub(super) fn seen_by(views: usize, body: &Ellipsoid) -> (Observations, Model) {
    let make = SyntheticOptions { objects: 0, views, trajectory: Trajectory::Orbit, ..Default::default() };
    let mut builder = SceneBuilder::new("one body");
    for frame in generate(&make).unwrap().scene.frames {
        builder.add_frame(&frame.id, frame.projection, Some([1280.0, 960.0])).unwrap();
        let bounding_box = project_ellipsoid(&frame.projection, body).unwrap().bounding_box();
        let detection = DetectionInput { frame: &frame.id, bounding_box: Some(bounding_box), ..Default::default() };
        builder.add_detection(&detection).unwrap();
    }
    let observations = Observations::new(&builder.build(), &(0..views).collect::<Vec<_>>());
    let model = Model::new(&observations, &AssociateOptions::default(), vec![None]);
    (observations, model)
}
