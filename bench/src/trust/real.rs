//! The real sets.

use std::collections::BTreeMap;
use std::path::Path;

use quadlift::geometry::{Body, BodyKind};
use quadlift::metrics::TruthObject;
use quadlift::solve::{Estimate, Method, PosteriorOptions};
use quadlift::{LocalizeOptions, localize};
use quadlift_io::builtin_priors;
use rayon::prelude::*;

use super::regions::Judged;
use crate::data::TrueScene;
use crate::error::Error;
use crate::paper::ACCV_SEQUENCES;
use crate::progress::Steps;

/// Sequences of KITTI with boxes of a real detector.
const KITTI: [&str; 4] = ["S05", "S09", "S22", "S36"];

/// Height of KITTI's cameras above the road, meters (from the description of the data set).
const CAMERA_HEIGHT: f64 = 1.65;

/// Source of the tight boxes of the projected models, in LINEMOD and LMO.
const EXACT: &str = "model";

/// The reference of estimates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Against {
    /// The truth of the data set.
    Truth,
    /// The body of the same kind that touches exact boxes in the same frames.
    ExactBoxes,
}

/// A set of scenes that are treated alike.
pub(super) struct RealSet {
    /// The name in tables.
    pub name: &'static str,
    /// Scene files and the source of their boxes.
    scenes: Vec<(String, &'static str)>,
    /// Whether the scenes show cars.
    cars: bool,
}

/// All sets.
pub(super) fn sets() -> Vec<RealSet> {
    let kitti = |poses: &str| KITTI.map(|name| (format!("kitti_{name}_{poses}"), "rrc")).to_vec();
    let lmo = |source| ["lmo_A", "lmo_B"].map(|name| (name.to_owned(), source));
    vec![
        RealSet {
            name: "LINEMOD",
            scenes: ACCV_SEQUENCES.map(|name| (format!("accv_{name}"), "yolo")).to_vec(),
            cars: false,
        },
        RealSet { name: "LMO", scenes: ["model", "visible-mask", "yolo"].map(lmo).concat(), cars: false },
        RealSet { name: "TUW", scenes: vec![("tuw_demo".to_owned(), "authors")], cars: false },
        RealSet { name: "KITTI aligned", scenes: kitti("aligned"), cars: true },
        RealSet { name: "KITTI oxts", scenes: kitti("oxts"), cars: true },
    ]
}

impl RealSet {
    /// The options of a user who knows the kind of the objects.
    fn options(&self, source: &str, seed: u64) -> LocalizeOptions {
        let mut options = LocalizeOptions { source: Some(source.to_owned()), seed, ..Default::default() };
        if self.cars {
            options.max_occluded = Some(1.0);
            options.max_truncated = Some(0.0);
            options.method = Method::Posterior(PosteriorOptions {
                body: Some(BodyKind::Cuboid),
                priors: builtin_priors(),
                camera_height: Some(CAMERA_HEIGHT),
                ..Default::default()
            });
        }
        options
    }

    /// Number of scenes.
    pub(super) fn steps(&self) -> usize {
        self.scenes.len()
    }

    /// The bodies that boxes without a detector's errors give, by id.
    fn of_exact_boxes(
        &self,
        scene: &TrueScene,
        body: Option<BodyKind>,
        seed: u64,
    ) -> Result<BTreeMap<String, Body>, Error> {
        let mut options = self.options(EXACT, seed);
        options.method.posterior_options_mut().into_iter().for_each(|map| map.body = body);
        let localization = localize(&scene.scene, &options)?;
        let named = |e: &Estimate| Some((scene.scene.object_ids[e.object_index].clone(), e.body?));
        Ok(localization.estimates.iter().filter_map(named).collect())
    }

    /// Whether there are boxes without a detector's errors.
    pub(super) fn has_exact_boxes(&self) -> bool {
        matches!(self.name, "LINEMOD" | "LMO")
    }

    /// Localizes the scenes and compares the objects with the truth, under changed options.
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::Localize`].
    pub(super) fn judged(
        &self,
        data: &Path,
        seed: u64,
        against: Against,
        change: &(dyn Fn(&mut PosteriorOptions) + Sync),
        steps: &Steps,
    ) -> Result<Vec<Judged>, Error> {
        let of_scene = |(file, source): &(String, &'static str)| -> Result<Vec<Judged>, Error> {
            if against == Against::ExactBoxes && *source == EXACT {
                return Ok(Vec::new());
            }
            let scene = TrueScene::read(data, file, file)?;
            let mut options = self.options(source, seed);
            options.method.posterior_options_mut().into_iter().for_each(change);
            let localization = localize(&scene.scene, &options)?;
            let exact = match against {
                Against::Truth => None,
                Against::ExactBoxes => Some(self.of_exact_boxes(&scene, localization.body, seed)?),
            };
            steps.done();
            let judge = |estimate: &Estimate| {
                let id = &scene.scene.object_ids[estimate.object_index];
                let truth = match &exact {
                    Some(bodies) => *bodies.get(id)?,
                    None => true_body(scene.truth.iter().find(|t| t.id == *id)?, estimate)?,
                };
                Judged::new(estimate, &truth, scene.scene.up.as_ref())
            };
            Ok(localization.estimates.iter().filter_map(judge).collect())
        };
        let scenes: Vec<_> = self.scenes.par_iter().map(of_scene).collect::<Result<_, _>>()?;
        Ok(scenes.concat())
    }
}

/// The true body that an estimate is of.
fn true_body(truth: &TruthObject, estimate: &Estimate) -> Option<Body> {
    match (estimate.body?.kind, truth.cuboid, truth.ellipsoid) {
        (BodyKind::Cuboid, Some(cuboid), _) => Some(cuboid),
        (_, _, ellipsoid) => ellipsoid.map(Body::from),
    }
}
