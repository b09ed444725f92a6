//! Writers of formats of other programs, one file each. They take a [`CheckedScene`] and return a [`Document`]: the
//! bytes of a file with notes.
//!
//! A size has several meanings in these formats: half extents (scene files), full extents (ROS, KITTI), scale factors of
//! a body of radius one (glTF). Every file says which one it writes.

mod colors;
mod frusta;
pub mod geodesy;
mod units;
mod options;
mod format;
mod cameras;
mod coco;
mod csv;
mod glb;
mod ply;
#[cfg_attr(not(feature = "mcap"), expect(dead_code, reason = "only logs have scores of views"))]
mod scores;
mod geojson;
#[cfg(feature = "mcap")]
mod pose_covariance;
#[cfg(feature = "mcap")]
mod stamps;
#[cfg(feature = "mcap")]
pub mod mcap;
mod views;
mod bop;
mod kitti;

#[cfg(test)]
pub(crate) mod test_scene;

use std::collections::{BTreeMap, HashSet};

use nalgebra::Point3;
use quadlift::geometry::{Body, ConvexBody};
use quadlift::scene::Scene;
use quadlift::solve::{Covariance, Status};

use crate::error::EntryError;
use crate::scene_file::SceneFile;

pub use format::{ExportFormat, Writer};
pub use options::{WRITE, WriteOptions};
pub(crate) use units::meters_of;

/// The formats of objects and cameras that are written. Recordings are written by the crate quadlift-report.
pub const EXPORTS: &[ExportFormat] = &[
    ply::FORMAT,
    glb::FORMAT,
    kitti::FORMAT,
    bop::FORMAT,
    coco::FORMAT,
    geojson::FORMAT,
    #[cfg(feature = "mcap")]
    mcap::FORMAT,
    csv::FORMAT,
    cameras::TUM,
    cameras::COLMAP,
];

/// A file in another program's format.
#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    /// The bytes of the file.
    pub content: Vec<u8>,
    /// How many things of each kind it holds, by their names in the singular.
    pub counts: Vec<(&'static str, usize)>,
    /// Notes: conversions, assumptions and losses.
    pub notes: Vec<String>,
}

/// Which body of an object is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BodyChoice {
    /// The body.
    #[default]
    Body,
    /// The enclosing ellipsoid; if there is none, as [`BodyChoice::Body`].
    Enclosing,
}

/// A scene whose numbers and ids are known to be right, and the bodies of its objects.
#[derive(Debug, Clone)]
pub struct CheckedScene<'a> {
    file: &'a SceneFile,
    scene: Scene,
    length_unit: Option<String>,
    objects: Vec<Object>,
    /// Ids of the objects without a body: only the CSV table holds them.
    pub without_body: Vec<String>,
    /// Ids of the objects with a body whose status is another than `ok`.
    pub not_ok: Vec<String>,
}

/// An object with a body.
#[derive(Debug, Clone, PartialEq)]
struct Object {
    id: String,
    category: Option<String>,
    body: Body,
    /// The box around the object, unless enclosing ellipsoids are written.
    bounds: Option<Body>,
    /// Of the estimated body, which is another one than that of an enclosing ellipsoid.
    covariance: Option<(Covariance, Body)>,
}

impl<'a> CheckedScene<'a> {
    /// The same scene with lengths in another unit, if one is given.
    #[must_use]
    pub fn in_unit(mut self, unit: Option<&str>) -> Self {
        self.length_unit = unit.map(str::to_owned).or(self.length_unit);
        self
    }

    /// Checks a scene and takes one body of each object.
    ///
    /// # Errors
    /// [`EntryError`] as [`SceneFile::to_scene`] and [`SceneFile::to_objects`], or if enclosing ellipsoids are asked for and there is none.
    pub fn new(file: &'a SceneFile, choice: BodyChoice) -> Result<Self, EntryError> {
        let scene = file.to_scene()?;
        let (mut objects, mut without_body, mut not_ok) = (Vec::new(), Vec::new(), Vec::new());
        let all = file.to_objects()?;
        if choice == BodyChoice::Enclosing && !all.is_empty() && all.iter().all(|object| object.enclosing.is_none()) {
            let problem = "no object has an enclosing ellipsoid; \"quadlift localize --enclosing\" adds them";
            return Err(EntryError::new("objects", problem));
        }
        for object in all {
            let enclosing = if choice == BodyChoice::Enclosing { object.enclosing } else { None };
            let estimated = object.body();
            match enclosing.or(estimated) {
                Some(body) => {
                    if object.status.is_some_and(|status| status != Status::Ok) {
                        not_ok.push(object.id.clone());
                    }
                    objects.push(Object {
                        id: object.id,
                        category: object.category,
                        body,
                        bounds: object.bounds.filter(|_| choice == BodyChoice::Body),
                        covariance: object.covariance.zip(estimated),
                    });
                }
                None => without_body.push(object.id),
            }
        }
        Ok(Self { file, length_unit: scene.length_unit.clone(), scene, objects, without_body, not_ok })
    }

    /// Number of objects with a body.
    pub fn bodies(&self) -> usize {
        self.objects.len()
    }

    /// Ids of the objects with a body, and the centers of the bodies.
    pub fn centers(&self) -> impl Iterator<Item = (&str, Point3<f64>)> {
        self.objects.iter().map(|object| (object.id.as_str(), object.body.center()))
    }

    /// The categories of the objects by their first appearance; objects without one have the category "object".
    fn categories(&self) -> Vec<&str> {
        let mut known = HashSet::new();
        self.objects.iter().map(Object::category_name).filter(|name| known.insert(*name)).collect()
    }

    /// Index of each category in [`Self::categories`].
    fn category_indices(&self) -> BTreeMap<&str, usize> {
        self.categories().into_iter().enumerate().map(|(index, name)| (name, index)).collect()
    }
}

impl Object {
    fn category_name(&self) -> &str {
        self.category.as_deref().unwrap_or("object")
    }

    /// What formats of boxes hold: the box around the object, or its body.
    fn boxed(&self) -> &Body {
        self.bounds.as_ref().unwrap_or(&self.body)
    }
}

/// Whole numbers for names: those in the names (after a prefix that they may have) where all of them are different
/// numbers, their positions otherwise. Also whether it is the latter.
fn numbers_for<'a>(names: impl Iterator<Item = &'a str> + Clone, prefix: &str) -> (Vec<u64>, bool) {
    let number = |name: &str| name.strip_prefix(prefix).unwrap_or(name).parse().ok();
    let parsed: Option<Vec<u64>> = names.clone().map(number).collect();
    match parsed {
        Some(numbers) if numbers.iter().collect::<HashSet<_>>().len() == numbers.len() => (numbers, false),
        _ => ((0..).take(names.count()).collect(), true),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::{BoundsRecord, CovarianceRecord, ObjectRecord};
    use quadlift::geometry::BodyKind;

    #[test]
    fn names_that_are_numbers_stay() {
        assert_eq!(numbers_for(["000090", "000091"].into_iter(), ""), (vec![90, 91], false));
        assert_eq!(numbers_for(["a", "7"].into_iter(), ""), (vec![0, 1], true));
        assert_eq!(numbers_for(["07", "7"].into_iter(), ""), (vec![0, 1], true), "one number twice");
        assert_eq!(numbers_for(["t12", "7"].into_iter(), "t"), (vec![12, 7], false));
    }

    #[test]
    fn bodies_are_those_of_the_estimate_and_their_absence_is_told() {
        let mut file = test_scene::three_bodies();
        let matrix = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
        let covariance =
            CovarianceRecord { coordinates: "center_vech_shape".into(), matrix, ..CovarianceRecord::default() };
        file.objects[0].covariance = Some(Box::new(covariance));
        file.objects.push(ObjectRecord { id: "lost".into(), ..ObjectRecord::default() });
        let checked = CheckedScene::new(&file, BodyChoice::Body).unwrap();
        let kinds: Vec<BodyKind> = checked.objects.iter().map(|object| object.body.kind).collect();
        assert_eq!(kinds, [BodyKind::Ellipsoid, BodyKind::Cuboid, BodyKind::Superellipsoid(1.5)]);
        assert_eq!((checked.bodies(), &checked.without_body[..]), (3, &["lost".to_owned()][..]));
        assert_eq!(checked.categories(), ["cup", "box"]);
        let enclosing = CheckedScene::new(&file, BodyChoice::Enclosing).unwrap();
        let half = |scene: &CheckedScene, k: usize| scene.objects[k].body.half_extents.x;
        let factor = |k: usize| half(&enclosing, k) / half(&checked, k);
        // The last one has no enclosing ellipsoid.
        assert_eq!([factor(0), factor(1), factor(2)], [1.25, 1.25, 1.0]);
        // A covariance stays that of the estimated body.
        let estimated = enclosing.objects[0].covariance.map(|(_, body)| body.half_extents.x);
        assert_eq!(estimated, Some(half(&checked, 0)));
        // Bounds are the box of an object, but where enclosing ellipsoids are written.
        let bounds = BoundsRecord {
            center: [1.0, 0.5, 0.5],
            rotation: [1.0, 0.0, 0.0, 0.0],
            half_extents: [0.6, 0.3, 0.8],
            ..BoundsRecord::default()
        };
        file.objects[0].bounds = Some(Box::new(bounds));
        let boxed = |choice: BodyChoice, k: usize| {
            let checked = CheckedScene::new(&file, choice).unwrap();
            let boxed = checked.objects[k].boxed();
            (boxed.kind, boxed.half_extents.x)
        };
        assert_eq!(boxed(BodyChoice::Body, 0), (BodyKind::Cuboid, 0.6));
        assert_eq!(boxed(BodyChoice::Enclosing, 0), (BodyKind::Ellipsoid, 0.625));
        assert_eq!(boxed(BodyChoice::Body, 2), (BodyKind::Superellipsoid(1.5), 0.5));
        file.objects.iter_mut().for_each(|object| object.enclosing = None);
        assert_eq!(CheckedScene::new(&file, BodyChoice::Enclosing).unwrap_err().entry, "objects");
        file.objects[0].ellipsoid.as_mut().unwrap().semi_axes[1] = -1.0;
        assert_eq!(CheckedScene::new(&file, BodyChoice::Body).unwrap_err().entry, "objects[0].ellipsoid.semi_axes");
    }
}
