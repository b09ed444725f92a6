//! A scene that is divided into objects, and how well that was done.

use quadlift::association::{AssociateOptions, Association, associate};
use quadlift::geometry::{BodyKind, Ellipsoid};
use quadlift::metrics::{ClusteringScore, ObjectDetectionScore, pairwise_clustering_scores, score_found};
use quadlift::scene::{Scene, SceneError};
use quadlift::solve::PosteriorOptions;
use quadlift::{Localization, LocalizeOptions, localize};

use crate::error::Error;
use crate::scores::mean;

/// Minimum volume IoU of a found object with a true one.
const MIN_IOU: f64 = 0.25;

/// Minimum number of detections of a true object.
pub(crate) const MIN_VIEWS: usize = 3;

/// A scene as input of association, with its ground truth. It contains only the selected detections.
#[derive(Debug, Clone)]
pub(crate) struct Case {
    /// The scene; ids of its detections are what association may look at.
    pub scene: Scene,
    /// For each detection, the index of the object in `bodies` that it shows; absent where it shows none of them.
    pub true_objects: Vec<Option<u32>>,
    /// The true objects.
    pub bodies: Vec<Ellipsoid>,
}

/// The scores of an association.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CaseScore {
    /// The detections.
    pub division: ClusteringScore,
    /// The objects, with the bodies that association itself fits.
    pub found: ObjectDetectionScore,
    /// Share of the true objects that have a found center within their longest semi-axis.
    pub centers_found: Option<f64>,
    /// Mean volume IoU of the true objects, localized from what was found.
    pub o3d: f64,
    /// The same, localized from the true identities.
    pub o3d_with_true_ids: f64,
    /// Objects at least half of whose detections show true ones.
    pub standing: Marked,
    /// All others: they are false.
    pub false_objects: Marked,
}

/// Objects, and how many of them are marked as uncertain.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Marked {
    /// Number of objects.
    pub objects: usize,
    /// Number of uncertain ones.
    pub uncertain: usize,
}

impl Marked {
    /// Share that is marked.
    pub(crate) fn share(self) -> Option<f64> {
        (self.objects > 0).then(|| self.uncertain as f64 / self.objects as f64)
    }

    /// Both together.
    pub(crate) fn and(self, other: Self) -> Self {
        Self { objects: self.objects + other.objects, uncertain: self.uncertain + other.uncertain }
    }
}

/// The association of a case.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Division {
    /// The detections.
    pub score: ClusteringScore,
    /// Objects at least half of whose detections show true ones.
    pub standing: Marked,
    /// All others: they are false.
    pub false_objects: Marked,
}

impl Case {
    /// Divides the scene and compares the division, and nothing else, with the truth.
    ///
    /// # Errors
    /// [`Error::Associate`] if the options do not fit the scene.
    pub(crate) fn division(&self, options: &AssociateOptions) -> Result<Division, Error> {
        let association = associate(&self.scene, options)?;
        let (standing, false_objects) = self.marked(&association);
        let score = pairwise_clustering_scores(&self.true_objects, &association.object_of_detection);
        Ok(Division { score, standing, false_objects })
    }

    /// Divides the scene and compares the division with the truth.
    ///
    /// # Errors
    /// [`Error::Associate`], [`Error::Localize`] when options do not fit the scene.
    pub(crate) fn score(&self, options: &AssociateOptions) -> Result<CaseScore, Error> {
        let association = associate(&self.scene, options)?;
        let (standing, false_objects) = self.marked(&association);
        let bodies: Vec<Option<Ellipsoid>> = association.objects.iter().map(|object| object.ellipsoid).collect();
        Ok(CaseScore {
            division: pairwise_clustering_scores(&self.true_objects, &association.object_of_detection),
            found: score_found(&bodies, &self.detected_bodies(), MIN_IOU),
            centers_found: self.centers_found(&bodies),
            o3d: o3d(&association.applied_to(&self.scene, None), &self.detected_bodies())?,
            o3d_with_true_ids: o3d(&self.with_true_ids()?, &self.detected_bodies())?,
            standing,
            false_objects,
        })
    }

    /// The scene with the true identities.
    fn with_true_ids(&self) -> Result<Scene, SceneError> {
        let mut scene = self.scene.clone().into_parts();
        scene.object_ids = (0..self.bodies.len()).map(|index| index.to_string()).collect();
        for (detection, object) in scene.detections.iter_mut().zip(&self.true_objects) {
            detection.object_index = *object;
        }
        Scene::from_parts(scene)
    }

    /// The true objects that are detected often enough.
    pub(crate) fn detected_bodies(&self) -> Vec<Ellipsoid> {
        let mut views = vec![0; self.bodies.len()];
        self.true_objects.iter().flatten().for_each(|&object| views[object as usize] += 1);
        let often = self.bodies.iter().zip(&views).filter(|(_, views)| **views >= MIN_VIEWS);
        often.map(|(body, _)| *body).collect()
    }

    fn centers_found(&self, found: &[Option<Ellipsoid>]) -> Option<f64> {
        let is_near = |body: &Ellipsoid| {
            let reach = body.semi_axes.max();
            found.iter().flatten().any(|estimate| (estimate.center - body.center).norm() <= reach)
        };
        mean(&self.detected_bodies().iter().map(|body| if is_near(body) { 1.0 } else { 0.0 }).collect::<Vec<_>>())
    }

    /// The true and the false ones of the objects that were found.
    fn marked(&self, association: &Association) -> (Marked, Marked) {
        let mut members = vec![(0usize, 0usize); association.objects.len()];
        for (object, truth) in association.object_of_detection.iter().zip(&self.true_objects) {
            if let Some(object) = object {
                let (all, of_true) = &mut members[*object as usize];
                *all += 1;
                *of_true += usize::from(truth.is_some());
            }
        }
        let (mut standing, mut others) = (Marked::default(), Marked::default());
        for (object, (all, of_true)) in association.objects.iter().zip(members) {
            let kind = if 2 * of_true >= all { &mut standing } else { &mut others };
            kind.objects += 1;
            kind.uncertain += usize::from(object.uncertain.is_some());
        }
        (standing, others)
    }
}

/// Localizes the objects that the detections name: the mean volume IoU of the true objects, 0 for those that are
/// not there.
pub(crate) fn o3d(scene: &Scene, bodies: &[Ellipsoid]) -> Result<f64, Error> {
    let localization = localize_ellipsoids(scene)?;
    let estimates: Vec<Option<Ellipsoid>> = localization.estimates.iter().map(|e| e.closest_ellipsoid()).collect();
    let score = score_found(&estimates, bodies, 0.0);
    Ok(score.mean_iou3d.unwrap_or(0.0) * score.recall().unwrap_or(0.0))
}

/// Localizes the objects that the detections name, as ellipsoids.
pub(crate) fn localize_ellipsoids(scene: &Scene) -> Result<Localization, Error> {
    let map = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
    Ok(localize(scene, &LocalizeOptions::from(map))?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::association::AssociatedObject;

    #[test]
    fn an_object_is_false_when_most_of_its_detections_are() {
        let case = Case {
            scene: Scene::default(),
            true_objects: vec![Some(0), None, Some(0), None, None, Some(1)],
            bodies: Vec::new(),
        };
        let object = |uncertain| AssociatedObject {
            id: String::new(),
            category_index: None,
            views: 3,
            expected_views: 3,
            evidence: None,
            ellipsoid: None,
            uncertain,
        };
        let association = Association {
            object_of_detection: vec![Some(0), Some(0), Some(1), Some(1), Some(1), None],
            objects: vec![object(None), object(Some(quadlift::association::AssociationWarning::Elongated))],
            ..Default::default()
        };
        let (standing, others) = case.marked(&association);
        assert_eq!((standing, others), (Marked { objects: 1, uncertain: 0 }, Marked { objects: 1, uncertain: 1 }));
        assert_eq!(
            (standing.share(), standing.and(others).share(), Marked::default().share()),
            (Some(0.0), Some(0.5), None)
        );
    }
}
