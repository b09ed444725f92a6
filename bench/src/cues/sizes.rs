//! Sizes that are learned from the scene (`--learn-sizes`): synthetic categories, and the real scenes.

use std::path::Path;

use quadlift::geometry::BodyKind;
use quadlift::metrics::nees;
use quadlift::nalgebra::{Unit, Vector3};
use quadlift::solve::PosteriorOptions;
use quadlift::synthetic::{CategoryOptions, CategorySizes, Noise, Observations, SyntheticOptions, generate_categories};
use quadlift::{LocalizeOptions, localize};
use rayon::prelude::*;

use crate::data::TrueScene;
use crate::error::Error;
use crate::kitti::{AVERAGED, protocol};
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, Measure, average, median_figure, pooled};
use crate::table::{Cell, Table};

/// Objects and categories of a scene, and scenes of each row.
const OBJECTS: usize = 32;
const CATEGORIES: usize = 4;
const SCENES: u64 = 6;
const FIRST_SEED: u64 = 31;

const VIEWS: [usize; 4] = [2, 3, 5, 20];

/// Standard deviation of the edges of the boxes, in mean half sizes.
const EDGE_NOISE: f64 = 0.03;

/// Differences between things of a category, logarithms.
const SPREAD: f64 = 0.05;

/// What the objects of a category have in common.
const SIZES: [(&str, CategorySizes); 3] = [
    ("one size", CategorySizes::Alike(SPREAD)),
    ("two sizes", CategorySizes::TwoSizes(SPREAD)),
    ("any size", CategorySizes::Any),
];

/// The objects of a row.
const BODIES: [(&str, BodyKind, bool); 3] = [
    ("ellipsoids", BodyKind::Ellipsoid, false),
    ("standing ellipsoids", BodyKind::Ellipsoid, true),
    ("standing cuboids", BodyKind::Cuboid, true),
];

fn options(learn_sizes: bool, body: Option<BodyKind>, seed: u64) -> LocalizeOptions {
    // By the same estimator with and without.
    let options = PosteriorOptions { learn_sizes, body, by_evidence: false, ..Default::default() };
    LocalizeOptions { seed, ..options.into() }
}

/// O3D and NEES of each object.
type Scores = (Vec<f64>, Vec<f64>);

/// O3D of each object of a synthetic scene, without and with learned sizes, and the NEES of ellipsoids.
fn synthetic(
    views: usize,
    (_, body, standing): (&str, BodyKind, bool),
    sizes: CategorySizes,
    seed: u64,
) -> Result<[Scores; 2], Error> {
    let scene = generate_categories(
        &SyntheticOptions {
            seed,
            objects: OBJECTS,
            views,
            body,
            standing,
            cube_side: 10.0,
            distance: 40.0,
            observations: Observations::Boxes,
            noise: vec![Noise::BoxEdges(EDGE_NOISE)],
            ..Default::default()
        },
        &CategoryOptions { categories: CATEGORIES, sizes },
    )?;
    let mut both = [(Vec::new(), Vec::new()), (Vec::new(), Vec::new())];
    for (learn, (o3d, errors)) in both.iter_mut().enumerate() {
        let found = localize(&scene.scene, &options(learn == 1, Some(body), seed))?;
        for estimate in &found.estimates {
            let truth = scene.truth[estimate.object_index].1.closest_ellipsoid();
            let ellipsoid = estimate.closest_ellipsoid();
            o3d.push(ellipsoid.map_or(0.0, |e| quadlift::metrics::iou3d_ellipsoids(&e, &truth)));
            let covariance = estimate.covariance.filter(|_| body == BodyKind::Ellipsoid);
            errors.extend(ellipsoid.zip(covariance).and_then(|(e, c)| nees(&e, &truth, &c.matrix)));
        }
    }
    Ok(both)
}

/// Adds the table of synthetic scenes.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cues", BODIES.len() * SIZES.len() * VIEWS.len(), run.progress);
    let count = run.scenes(SCENES);
    report.text(format!(
        "Sizes learned from the scene (`--learn-sizes`): {OBJECTS} objects of {CATEGORIES} categories in each of {count} scenes, cameras \
         at 40 from the middle of a cube of 10, boxes with {EDGE_NOISE} of their half size of noise. \"One size\": the extents of \
         things of a category differ by {SPREAD} (logarithms); \"two sizes\": every second one is twice as large; \"any size\": the \
         category is a name only. Each object's prior is learned from the others. NEES: median, 9 parameters (8.34)."
    ));
    let mut table = Table::new(
        "Sizes from the scene: O3D of synthetic categories",
        ["objects", "sizes", "views", "without", "with", "NEES without", "NEES with"],
    );
    let (mut worse, mut gains) = (0.0f64, Vec::new());
    for body in BODIES {
        for (name, sizes) in SIZES {
            for views in VIEWS {
                let of_scene = |k: u64| synthetic(views, body, sizes, run.seed.wrapping_add(FIRST_SEED + k));
                let scenes: Vec<_> = (0..count).into_par_iter().map(of_scene).collect::<Result<_, Error>>()?;
                steps.done();
                let o3d = [0, 1].map(|k: usize| pooled(&scenes.iter().map(|s| s[k].0.clone()).collect::<Vec<_>>()));
                let errors = [0, 1].map(|k: usize| median_figure(scenes.iter().flat_map(|s| s[k].1.clone()).collect()));
                if let [Some(without), Some(with)] = o3d {
                    worse = worse.max(without.value - with.value);
                    gains.push(with.value - without.value);
                }
                let label = [body.0.into(), name.into(), views.to_string().as_str().into()];
                let figures = o3d.map(|figure| Cell::figure(figure, 3));
                table.push(label.into_iter().chain(figures).chain(errors.map(|f| Cell::figure(f, 1))).collect());
            }
        }
    }
    report.table(table);
    let headline = |id, what, value| Headline::ours(id, what, "posterior", value);
    let mean = gains.iter().sum::<f64>() / gains.len().max(1) as f64;
    report.headlines.push(headline("cues_sizes_gain", "mean gain of O3D with sizes from the scene, synthetic", mean));
    report.headlines.push(headline(
        "cues_sizes_worse",
        "most that O3D falls with sizes from the scene, synthetic",
        worse,
    ));
    Ok(())
}

/// A row of the real scenes: its name, its scenes, their source, whether KITTI's protocol holds.
pub(super) struct RealRow {
    pub name: &'static str,
    pub scenes: Vec<TrueScene>,
    pub source: &'static str,
    pub cars: bool,
}

pub(super) fn real_rows(data: &Path) -> Result<Vec<RealRow>, Error> {
    let kitti = |poses: &str| -> Result<Vec<TrueScene>, Error> {
        AVERAGED.iter().map(|name| TrueScene::read(data, &format!("kitti_{name}_{poses}"), name)).collect()
    };
    let tuw = TrueScene::read(data, "tuw_demo", "demo")?;
    let mut upright = tuw.clone();
    upright.scene.edit(|parts| parts.up = Some(Unit::new_unchecked(Vector3::z())))?;
    let lmo = ["lmo_A", "lmo_B"].map(|name| TrueScene::read(data, name, name));
    let [a, b] = lmo;
    let row = |name, scenes, source, cars| RealRow { name, scenes, source, cars };
    Ok(vec![
        row("KITTI, RRC boxes, aligned poses", kitti("aligned")?, "rrc", true),
        row("KITTI, RRC boxes, GPS poses", kitti("oxts")?, "rrc", true),
        row("KITTI, labeled boxes, aligned poses", kitti("aligned")?, "label", true),
        row("KITTI, exact boxes, aligned poses", kitti("aligned")?, "ellipsoid", true),
        row("TUW", vec![tuw], "authors", false),
        row("TUW, up known", vec![upright], "authors", false),
        row("LMO", vec![a?, b?], "yolo", false),
    ])
}

/// Every view of each object, or one in so many.
pub(super) const STRIDES: [usize; 3] = [1, 3, 6];

/// The scene with one in `stride` of the views of each object.
pub(super) fn thinned(scene: &TrueScene, source: &str, stride: usize) -> Result<TrueScene, Error> {
    let mut thinned = scene.clone();
    let index = scene.scene.sources.iter().position(|name| name == source);
    let mut seen = vec![0; scene.scene.object_ids.len()];
    let mut kept = scene.scene.detections.to_vec();
    kept.retain(|detection| {
        let Some(object) = detection.object_index else { return false };
        let of_source = detection.source_index.map(|k| k as usize) == index;
        let count = &mut seen[object as usize];
        *count += usize::from(of_source);
        of_source && (*count - 1).is_multiple_of(stride)
    });
    thinned.scene.edit(|parts| parts.detections = kept)?;
    Ok(thinned)
}

/// Adds the table of the real scenes.
pub(super) fn run_real(data: &Path, run: &Run, report: &mut Report) -> Result<(), Error> {
    let rows = real_rows(data)?;
    let kinds = [("auto", None), ("cuboid", Some(BodyKind::Cuboid))];
    let steps = Steps::new("cues", rows.len(), run.progress);
    let mut table = Table::new(
        "Sizes from the scene: O3D of real objects, no other prior",
        ["data", "views", "auto, without", "auto, with", "cuboid, without", "cuboid, with"],
    );
    let mut gains = Vec::new();
    for row in &rows {
        for stride in STRIDES {
            let scenes: Vec<TrueScene> =
                row.scenes.iter().map(|scene| thinned(scene, row.source, stride)).collect::<Result<_, _>>()?;
            let mut cells: Vec<Cell> = vec![
                row.name.into(),
                if stride == 1 { "all".into() } else { format!("one in {stride}").as_str().into() },
            ];
            for (_, body) in kinds {
                let of = |learn: bool| -> Result<Option<Figure>, Error> {
                    let mut options = options(learn, body, run.seed);
                    options.source = Some(row.source.to_owned());
                    if row.cars {
                        protocol(row.source, run.seed)(&mut options);
                    }
                    let scores: Vec<Vec<f64>> = scenes
                        .par_iter()
                        .map(|scene| Ok(Measure::O3d.values(&scene.scores(&options)?)))
                        .collect::<Result<_, Error>>()?;
                    Ok(average(&scores))
                };
                let (without, with) = (of(false)?, of(true)?);
                gains.extend(without.zip(with).map(|(a, b)| b.value - a.value));
                cells.extend([Cell::figure(without, 3), Cell::figure(with, 3)]);
            }
            table.push(cells);
        }
        steps.done();
    }
    report.table(table);
    report.headlines.push(Headline::ours(
        "cues_sizes_real",
        "mean gain of O3D with sizes from the scene, real data",
        "posterior",
        gains.iter().sum::<f64>() / gains.len().max(1) as f64,
    ));
    Ok(())
}
