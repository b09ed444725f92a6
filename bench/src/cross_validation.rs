//! Whether cross-validation predicts the quality of estimates: the IoU of left-out views and the true overlap (ours).

use std::path::Path;

use quadlift::cross_validation::Extent;
use quadlift::geometry::BodyKind;
use quadlift::metrics::{PairedBy, TruthObject, evaluate};
use quadlift::scene::{Scene, SceneError};
use quadlift::solve::{Method, PosteriorOptions};
use quadlift::{LocalizeOptions, localize};
use quadlift_io::builtin_priors;
use rayon::prelude::*;

use crate::data::{TrueScene, estimated_objects};
use crate::error::Error;
use crate::paper::ACCV_SEQUENCES;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, Measure, mean, pooled};
use crate::table::{Cell, Table};

/// Views of an object that are kept, evenly spread over those it has: with fewer views the estimates differ more.
const VIEWS: [Option<usize>; 4] = [None, Some(10), Some(5), Some(4)];

/// Height of KITTI's cameras above the road, meters.
const CAMERA_HEIGHT: f64 = 1.65;

/// Bounds of the bins of the last table.
const BINS: [f64; 7] = [0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];

/// Scenes with the used detections and their ground truth.
struct Set {
    name: &'static str,
    scenes: Vec<TrueScene>,
    sources: &'static [&'static str],
    options: LocalizeOptions,
    /// The reference of the comparison.
    measure: Measure,
}

/// One object of a set.
#[derive(Debug, Clone, Copy)]
struct Pair {
    /// Mean IoU of its left-out views.
    left_out: f64,
    /// Less the root mean square residual over the mean half size of its boxes.
    residual: f64,
    /// Less the standard deviation of the center over the geometric mean of the semi-axes.
    deviation: f64,
    /// Its true overlap.
    truth: f64,
}

/// The sets: all settings of this experiment.
fn sets(data: &Path, seed: u64) -> Result<Vec<Set>, Error> {
    let read = |file: &str| TrueScene::read(data, file, file);
    let all = |files: Vec<String>| files.iter().map(|file| read(file)).collect::<Result<Vec<_>, _>>();
    let mut options = LocalizeOptions { seed, ..Default::default() };
    options.cross_validation.extent = Extent::All;
    let mut cars = options.clone();
    (cars.max_occluded, cars.max_truncated) = (Some(1.0), Some(0.0));
    cars.method = Method::Posterior(PosteriorOptions {
        body: Some(BodyKind::Cuboid),
        priors: builtin_priors(),
        camera_height: Some(CAMERA_HEIGHT),
        ..Default::default()
    });
    let kitti = |poses: &str| all(["S05", "S09", "S22", "S36"].map(|name| format!("kitti_{name}_{poses}")).to_vec());
    let accv = ACCV_SEQUENCES.map(|name| format!("accv_{name}")).to_vec();
    let (tangent, enclosing) = (Measure::O3d, Measure::EnclosingO3d);
    let set = |name, scenes, sources, options: &LocalizeOptions, measure| Set {
        name,
        scenes,
        sources,
        options: options.clone(),
        measure,
    };
    Ok(vec![
        set("LINEMOD (accv)", all(accv)?, &["model", "yolo"], &options, enclosing),
        set(
            "LINEMOD-Occluded",
            all(vec!["lmo_A".into(), "lmo_B".into()])?,
            &["model", "visible-mask"],
            &options,
            enclosing,
        ),
        set("TUW", all(vec!["tuw_demo".into()])?, &["authors"], &options, tangent),
        set("KITTI, aligned poses", kitti("aligned")?, &["rrc"], &cars, tangent),
        set("KITTI, GPS poses", kitti("oxts")?, &["rrc"], &cars, tangent),
    ])
}

/// The scene with at most so many of each object's detections of a source, evenly spread over its frames.
fn thinned(scene: &Scene, source: &str, options: &LocalizeOptions, views: usize) -> Result<Scene, SceneError> {
    let source = scene.sources.iter().position(|name| name == source).map(|index| index as u32);
    let hidden = scene.occluded_edges(|d| d.source_index == source);
    let within = |level: Option<f64>, limit: Option<f64>| limit.is_none_or(|l| level.is_none_or(|x| x <= l));
    let mut groups = scene.detections_by_object(|d| {
        d.source_index == source
            && within(d.occluded, options.max_occluded)
            && within(d.truncated, options.max_truncated)
    });
    let mut kept = vec![false; scene.detections.len()];
    for group in &mut groups {
        group.sort_by_key(|&index| scene.detections[index as usize].frame_index);
        let count = group.len().min(views);
        (0..count).for_each(|k| kept[group[k * group.len() / count] as usize] = true);
    }
    let mut thinned = scene.clone().into_parts();
    // What hides an edge may be left out.
    let detections = thinned.detections.iter_mut().zip(hidden);
    detections.for_each(|(detection, hidden)| detection.occluded_edges = Some(hidden));
    let mut index = 0;
    thinned.detections.retain(|_| {
        index += 1;
        kept[index - 1]
    });
    Scene::from_parts(thinned)
}

/// The objects of a scene of which views could be left out, paired by id with the truth.
fn pairs(set: &Set, scene: &TrueScene, source: &str, views: Option<usize>) -> Result<Vec<Pair>, Error> {
    let options = LocalizeOptions { source: Some(source.to_owned()), enclosing: true, ..set.options.clone() };
    let scene = match views {
        Some(views) => TrueScene { scene: thinned(&scene.scene, source, &options, views)?, ..scene.clone() },
        None => scene.clone(),
    };
    let localization = localize(&scene.scene, &options)?;
    let estimated = estimated_objects(&scene.scene, &localization);
    let mut pairs = Vec::new();
    for object in &localization.cross_validation.objects {
        let estimate = &localization.estimates[object.estimate_index];
        let id = &scene.scene.object_ids[estimate.object_index];
        let truth: Vec<TruthObject> = scene.truth.iter().filter(|truth| truth.id == *id).cloned().collect();
        let scores = evaluate(&estimated, &truth, &[], PairedBy::Ids).objects;
        let sizes: Vec<f64> = object.predictions.iter().map(|p| p.measured.mean_half_size()).collect();
        let deviation =
            estimate.center_sd().zip(estimate.closest_ellipsoid()).map(|(sd, e)| -sd / e.semi_axes.product().cbrt());
        if let (Some(left_out), Some(truth), Some(residual), Some(size), Some(deviation)) = (
            object.iou(),
            scores.first().and_then(|score| set.measure.of(score)),
            estimate.rms_residual_px(),
            mean(&sizes),
            deviation,
        ) {
            pairs.push(Pair { left_out, residual: -residual / size, deviation, truth });
        }
    }
    Ok(pairs)
}

/// Runs the experiment.
///
/// # Errors
/// [`Error::Read`], [`Error::Localize`].
pub(crate) fn run(data: &Path, run: &Run) -> Result<Report, Error> {
    let sets = sets(data, run.seed)?;
    let runs: usize = sets.iter().map(|set| set.scenes.len() * set.sources.len()).sum();
    let steps = Steps::new("cross-validation", runs * VIEWS.len(), run.progress);
    let mut report = Report::new("cross-validation", "Cross-validation: quality without a truth");
    report.text(
        "Each view of each object is left out, the object is localized from the others, and its box in that view is \
         predicted (`quadlift localize --cross-validate`). The mean IoU of predicted and measured boxes needs no \
         ground truth; here it is compared with the true overlap (O3D; for LINEMOD, whose truth is the envelope of \
         the object, that of the enclosing body). KITTI: boxes of a detector (`rrc`), cuboids with the built-in car \
         prior and the height of the cameras, 1.65 m. All others: default options, boxes of the named sources. \
         \"Views\" is the number of views kept per object, evenly spread; objects with fewer views are used with all \
         of them. Objects with two views cannot be checked.",
    );
    let mut table = Table::new(
        "Correlation of the left-out IoU with the true overlap",
        [
            "data",
            "views",
            "objects",
            "mean left-out IoU",
            "mean O3D",
            "Spearman",
            "Pearson",
            "Spearman of the residual",
            "of the sd of the center",
        ],
    );
    let mut of_views: Vec<Vec<Pair>> = vec![Vec::new(); VIEWS.len()];
    let mut within: Vec<Pair> = Vec::new();
    for set in &sets {
        for (&views, pooled) in VIEWS.iter().zip(&mut of_views) {
            let cases: Vec<(&TrueScene, &str)> =
                set.scenes.iter().flat_map(|scene| set.sources.iter().map(move |source| (scene, *source))).collect();
            let found: Vec<Vec<Pair>> = cases
                .par_iter()
                .map(|(scene, source)| {
                    let pairs = pairs(set, scene, source, views);
                    steps.done();
                    pairs
                })
                .collect::<Result<_, Error>>()?;
            let found = found.concat();
            table.push(row(set.name, views, &found));
            within.extend(centered(&found));
            pooled.extend(found);
        }
    }
    for (&views, pooled) in VIEWS.iter().zip(&of_views) {
        table.push(row("together", views, pooled));
    }
    let all = of_views.concat();
    table.push(row_of("together", "each of these".into(), &all));
    let mut less_the_means = row_of("together, less the mean of each row above", "each of these".into(), &within);
    (less_the_means[3], less_the_means[4]) = (Cell::Empty, Cell::Empty);
    table.push(less_the_means);
    table.note(
        "Spearman is the rank correlation: 1 if a larger left-out IoU always means a larger true overlap, 0 if they \
         are unrelated. \"Of the residual\" is that of the root mean square residual of the used views over the mean \
         half size of the boxes, with its sign inverted, \"of the sd of the center\" that of its standard deviation \
         over the size of the body, likewise: these are available without leaving views out. Objects that occur with \
         several numbers of views are not independent.",
    );
    report.table(table);
    report.table(bins(&all));
    if let Some(value) = spearman(&within, |pair| pair.left_out) {
        report.headlines.push(Headline {
            id: "cross_validation_within",
            what: "rank correlation of left-out IoU and O3D within the sets of real objects".to_owned(),
            paper: None,
            ours: Figure { value, standard_error: None },
            row: "posterior".to_owned(),
            decimals: 2,
        });
    }
    Ok(report)
}

/// The pairs minus their means, for the correlation within each set.
fn centered(pairs: &[Pair]) -> Vec<Pair> {
    let mean_of = |of: fn(&Pair) -> f64| mean(&pairs.iter().map(of).collect::<Vec<_>>()).unwrap_or(0.0);
    let [left_out, residual, deviation, truth] =
        [mean_of(|p| p.left_out), mean_of(|p| p.residual), mean_of(|p| p.deviation), mean_of(|p| p.truth)];
    let less = |p: &Pair| Pair {
        left_out: p.left_out - left_out,
        residual: p.residual - residual,
        deviation: p.deviation - deviation,
        truth: p.truth - truth,
    };
    pairs.iter().map(less).collect()
}

fn row(name: &str, views: Option<usize>, pairs: &[Pair]) -> Vec<Cell> {
    row_of(name, views.map_or("all".into(), |views| Cell::number(views as f64, 0)), pairs)
}

fn row_of(name: &str, views: Cell, pairs: &[Pair]) -> Vec<Cell> {
    let cell = |value: Option<f64>| value.map_or(Cell::Empty, |value| Cell::number(value, 2));
    let values = |of: fn(&Pair) -> f64| -> Vec<f64> { pairs.iter().map(of).collect() };
    vec![
        name.into(),
        views,
        Cell::number(pairs.len() as f64, 0),
        cell(mean(&values(|pair| pair.left_out))),
        cell(mean(&values(|pair| pair.truth))),
        cell(spearman(pairs, |pair| pair.left_out)),
        cell(pearson(&values(|pair| pair.left_out), &values(|pair| pair.truth))),
        cell(spearman(pairs, |pair| pair.residual)),
        cell(spearman(pairs, |pair| pair.deviation)),
    ]
}

/// The expected overlap for a left-out IoU.
fn bins(pairs: &[Pair]) -> Table {
    let mut table = Table::new(
        "The true overlap of objects by their left-out IoU, all of the above together",
        ["left-out IoU", "objects", "mean O3D", "O3D below 0.5, %"],
    );
    for bounds in BINS.windows(2) {
        let inside = |pair: &&Pair| pair.left_out >= bounds[0] && (pair.left_out < bounds[1] || bounds[1] == 1.0);
        let truths: Vec<f64> = pairs.iter().filter(inside).map(|pair| pair.truth).collect();
        let low = truths.iter().filter(|&&truth| truth < 0.5).count() as f64;
        let share = if truths.is_empty() { Cell::Empty } else { Cell::number(100.0 * low / truths.len() as f64, 0) };
        table.push(vec![
            format!("{} to {}", bounds[0], bounds[1]).into(),
            Cell::number(truths.len() as f64, 0),
            Cell::figure(pooled(&[truths]), 2),
            share,
        ]);
    }
    table
}

/// Pearson's correlation; `None` for fewer than three pairs, or where one side does not vary.
fn pearson(a: &[f64], b: &[f64]) -> Option<f64> {
    let (mean_a, mean_b) = (mean(a)?, mean(b)?);
    let sum = |x: &dyn Fn(f64, f64) -> f64| a.iter().zip(b).map(|(a, b)| x(a - mean_a, b - mean_b)).sum::<f64>();
    let variances = sum(&|a, _| a * a) * sum(&|_, b| b * b);
    (a.len() > 2 && variances > 0.0).then(|| sum(&|a, b| a * b) / variances.sqrt())
}

/// Spearman's correlation with the truth: Pearson's of the ranks.
fn spearman(pairs: &[Pair], of: fn(&Pair) -> f64) -> Option<f64> {
    let ranks_of = |of: fn(&Pair) -> f64| ranks(&pairs.iter().map(of).collect::<Vec<_>>());
    pearson(&ranks_of(of), &ranks_of(|pair| pair.truth))
}

/// The ranks of values, the mean rank for equal ones.
fn ranks(values: &[f64]) -> Vec<f64> {
    let rank = |value: &f64| {
        let below = values.iter().filter(|other| other.total_cmp(value).is_lt()).count() as f64;
        let equal = values.iter().filter(|other| other.total_cmp(value).is_eq()).count() as f64;
        below + 0.5 * (equal + 1.0)
    };
    values.iter().map(rank).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlations_of_known_pairs() {
        assert_eq!(ranks(&[0.3, 0.1, 0.3, 0.9]), [2.5, 1.0, 2.5, 4.0]);
        let pair = |left_out: f64, truth: f64| Pair { left_out, truth, residual: -left_out, deviation: 0.0 };
        let curve: Vec<Pair> = (1..6).map(|k| pair(k as f64, (k * k) as f64)).collect();
        assert!((spearman(&curve, |pair| pair.left_out).unwrap() - 1.0).abs() < 1e-12);
        assert!((spearman(&curve, |pair| pair.residual).unwrap() + 1.0).abs() < 1e-12);
        // By hand: 1 2 3 4 5 against 1 4 9 16 25: 60 / sqrt(10 * 374).
        let (a, b): (Vec<f64>, Vec<f64>) = curve.iter().map(|pair| (pair.left_out, pair.truth)).unzip();
        assert!((pearson(&a, &b).unwrap() - 60.0 / 3740f64.sqrt()).abs() < 1e-12);
        assert_eq!(pearson(&[1.0, 1.0, 1.0], &[1.0, 2.0, 3.0]), None);
        assert_eq!(pearson(&[1.0, 2.0], &[1.0, 2.0]), None);
    }
}
