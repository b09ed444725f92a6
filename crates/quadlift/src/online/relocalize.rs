//! Where the camera of an image is, from its boxes and the map.

use super::memory::Memory;
use super::tracked::Presence;
use super::update::ObjectId;
use crate::body_model::ellipsoid::shape_jacobian;
use crate::geometry::Ellipsoid;
use crate::relocalize::{Landmark, LandmarkMap, LocateOptions, LocateStatus, Query, Relocalization};
use crate::solve::{Covariance, CovarianceCoordinates, Matrix9};

/// Where the camera of an image is in a map.
#[derive(Debug, Clone, PartialEq)]
pub struct MapRelocalization {
    /// The poses; the landmarks of their matches are indices into `ids`.
    pub located: Relocalization,
    /// Ids of the objects that can be seen.
    pub ids: Vec<ObjectId>,
}

/// [`super::ObjectMap::landmarks`].
pub(super) fn landmarks(memory: &Memory) -> (Vec<ObjectId>, LandmarkMap) {
    let confirmed = memory.objects.tracked().filter(|tracked| tracked.presence == Presence::Confirmed);
    let (ids, landmarks) = confirmed
        .filter_map(|tracked| {
            let object = &tracked.object;
            let center = (object.center + memory.origin).into();
            let shape = object.root * object.root.transpose();
            let most = tracked.categories.iter().max_by_key(|(category, count)| (*count, std::cmp::Reverse(*category)));
            // From the center in units of the radius and the entries of D (see `Object::covariance`).
            let mut slopes = Matrix9::identity() * object.radius;
            slopes.fixed_view_mut::<6, 6>(3, 3).copy_from(&shape_jacobian(&object.root));
            let matrix = slopes * object.covariance * slopes.transpose();
            let coordinates = CovarianceCoordinates::CenterVechShape;
            let landmark = Landmark {
                body: Ellipsoid::from_shape(center, &shape).ok()?.into(),
                covariance: Some(Covariance { coordinates, matrix }).filter(|_| matrix.iter().all(|x| x.is_finite())),
                category: most.and_then(|&(category, _)| memory.categories.names()[usize::from(category)].clone()),
                correction: None,
            };
            Some((tracked.id, landmark))
        })
        .unzip();
    (ids, LandmarkMap::new(landmarks))
}

/// [`super::ObjectMap::relocalize`].
pub(super) fn relocalize(memory: &Memory, query: &Query, options: &LocateOptions) -> MapRelocalization {
    let (ids, map) = landmarks(memory);
    let mut located = map.relocalize(query, options);
    if memory.windows.consistent == Some(false) && located.status == LocateStatus::Ok {
        located.status = LocateStatus::Inconsistent;
    }
    MapRelocalization { located, ids }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::online::{Frame, ObjectMap, OnlineOptions};
    use crate::relocalize::QueryBox;
    use crate::scene::NewDetection;
    use crate::synthetic::{Noise, Observations, SyntheticOptions, generate};

    #[test]
    fn a_frame_that_was_left_out_is_located() {
        let made = generate(&SyntheticOptions {
            objects: 12,
            views: 20,
            seed: 3,
            observations: Observations::Boxes,
            noise: vec![Noise::BoxEdges(0.02)],
            ..Default::default()
        });
        let scene = made.unwrap().scene;
        let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
        let left_out = 15;
        let boxes = |frame: usize| {
            let of_frame = scene.detections.iter().filter(move |d| d.frame_index as usize == frame);
            of_frame.filter_map(|d| d.bounding_box).collect::<Vec<_>>()
        };
        for (index, frame) in scene.frames.iter().enumerate().filter(|(index, _)| *index != left_out) {
            let detections: Vec<NewDetection> = boxes(index).into_iter().map(NewDetection::from_box).collect();
            map.observe(&Frame::of_scene(&scene, frame, index as f64), &detections).unwrap();
        }
        let frame = &scene.frames[left_out];
        let boxes = boxes(left_out).into_iter();
        let query = Query {
            intrinsics: frame.projection.intrinsics().unwrap(),
            image_size: frame.image_size,
            boxes: boxes.map(|bounding_box| QueryBox { bounding_box, box_in_image: None, category: None }).collect(),
        };
        let found = map.relocalize(&query, &map.locate_options());
        assert_eq!(found.located.status, LocateStatus::Ok);
        let best = &found.located.poses[0];
        let truth = frame.projection.camera_pose().unwrap();
        // The motion from the estimate to the truth, in standard deviations.
        let turn =
            truth.matrix().fixed_columns::<3>(0) * best.cam_from_world.matrix().fixed_columns::<3>(0).transpose();
        let shift = truth.matrix().column(3) - turn * best.cam_from_world.matrix().column(3);
        let turn = crate::geometry::rotation_vector(&nalgebra::Rotation3::from_matrix_unchecked(turn));
        let error = nalgebra::Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
        let nees = error.dot(&(best.covariance.try_inverse().unwrap() * error));
        // Beyond 22.5 is one of 1000 with six degrees of freedom.
        assert!(nees < 22.5 && best.matches.len() >= 10, "{nees} {:?}", best.matches);
        assert_eq!(found.ids.len(), map.objects().count());
        map.memory.windows.consistent = Some(false);
        assert_eq!(map.relocalize(&query, &map.locate_options()).located.status, LocateStatus::Inconsistent);
        let empty = ObjectMap::new(OnlineOptions::default()).unwrap();
        assert_eq!(empty.relocalize(&query, &empty.locate_options()).located.status, LocateStatus::TooFewObjects);
    }
}
