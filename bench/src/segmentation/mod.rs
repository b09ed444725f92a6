//! Masks and ellipses from images (PfD section 4.2), and what they are worth in 3D: PfD+ES, PfD+REG+ES and ours.
//!
//! The paper has no figures of its segmentation; we compare with our numpy prototype.

mod errors;
mod prototype;
mod scenes;

use std::path::Path;

use quadlift::scene::Scene;
use quadlift::solve::{Method, PosteriorOptions};
use quadlift::{LocalizeOptions, MeasurementKind};
use quadlift_segment::{SegmentMethod, SegmentOptions};
use rayon::prelude::*;

use self::errors::{COLUMNS, ViewErrors, cells, mean_angle, mean_ellipse_iou};
use self::prototype::PrototypeRow;
use self::scenes::ImageScene;
use crate::data::{TrueScene, data_folder};
use crate::error::Error;
use crate::methods::{MethodRow, RowScores, reg, run_rows};
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, Measure, pooled};
use crate::table::{Cell, Table};

/// Real images: the scenes, and the source of their boxes.
const REAL_SCENES: [&str; 2] = ["lmo_A", "lmo_B"];
const SOURCE: &str = "visible-mask";

/// Rendered scenes, each of four objects in 20 views.
fn rendered_scenes(run: &Run) -> u64 {
    run.either(6, 2)
}

/// The rows of masks; in the short form those of the default method.
fn mask_rows(run: &Run) -> Vec<MaskRow> {
    MASK_ROWS.into_iter().filter(|row| !run.short || row.headline_ids().is_some()).collect()
}

fn measured(run: &Run) -> &'static [Measured] {
    run.first(&[Measured::Boxes, Measured::Found, Measured::True], 2)
}

/// A row of the tables of masks.
#[derive(Debug, Clone, Copy)]
struct MaskRow {
    method: SegmentMethod,
    setting: MaskSetting,
}

/// The handling of masks and views in a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MaskSetting {
    /// Like the program: an unreliable mask is replaced by the ellipse in the box.
    FallsBack,
    /// The mask is kept whatever it looks like.
    KeepsAll,
    /// Falls back, and only the views that are scored are segmented, as by the prototype.
    ScoredViews,
}

/// All settings of the tables of masks.
const MASK_ROWS: [MaskRow; 4] = {
    use MaskSetting::{FallsBack, KeepsAll, ScoredViews};
    use SegmentMethod::{GraphCut, Sca};
    [
        MaskRow { method: Sca, setting: KeepsAll },
        MaskRow { method: GraphCut, setting: KeepsAll },
        MaskRow { method: GraphCut, setting: FallsBack },
        MaskRow { method: GraphCut, setting: ScoredViews },
    ]
};

impl MaskRow {
    fn setting(&self) -> &'static str {
        match self.setting {
            MaskSetting::FallsBack => "falls back",
            MaskSetting::KeepsAll => "keeps every mask",
            MaskSetting::ScoredViews => "falls back, scored views only",
        }
    }

    fn options(&self, seed: u64) -> SegmentOptions {
        let fall_back = self.setting != MaskSetting::KeepsAll;
        SegmentOptions { method: self.method, fall_back, seed, ..Default::default() }
    }

    /// The errors of each object of the scenes.
    fn errors(&self, scenes: &[ImageScene], seed: u64) -> Result<Vec<Vec<ViewErrors>>, Error> {
        let of_scene = |scene: &ImageScene| -> Result<Vec<Vec<ViewErrors>>, Error> {
            let scored = (self.setting == MaskSetting::ScoredViews).then(|| scene.scored_views());
            let scene = scored.as_ref().unwrap_or(scene);
            Ok(scene.errors(&scene.segment(&self.options(seed))?))
        };
        Ok(scenes.par_iter().map(of_scene).collect::<Result<Vec<_>, _>>()?.concat())
    }

    /// The ids of its headlines: the IoU of the ellipses, the error of their angles.
    fn headline_ids(&self) -> Option<[&'static str; 2]> {
        match (self.method == SegmentMethod::default(), self.setting) {
            (true, MaskSetting::FallsBack) => {
                Some(["segmentation_all_views_ellipse_iou", "segmentation_all_views_angle"])
            }
            (true, MaskSetting::ScoredViews) => Some(["segmentation_ellipse_iou", "segmentation_angle"]),
            _ => None,
        }
    }
}

/// Runs the experiment. Without real data the rendered scenes remain, unless `data` names a folder that has none.
///
/// # Errors
/// [`Error::NoData`], [`Error::Read`], [`Error::Synthetic`].
pub fn run(data: Option<&Path>, run: &Run) -> Result<Report, Error> {
    let folder = match data_folder(data) {
        Ok(folder) => Some(folder),
        Err(error) if data.is_some() => return Err(error),
        Err(_) => None,
    };
    let scenes = rendered_scenes(run) as usize + folder.as_ref().map_or(0, |_| REAL_SCENES.len());
    let rows: usize = measured(run).iter().map(|measured| rows(*measured).len()).sum();
    let steps = Steps::new("segmentation", scenes * (1 + mask_rows(run).len() + rows), run.progress);
    let mut report = Report::new("segmentation", "Segmentation: ellipses from images (section 4.2)");
    report.text(
        "Objects are segmented in the crops of their boxes, jointly over all frames of an object (`sca`: Stel \
         Component Analysis; `graphcut`: graph cuts with the colors of all frames), and the masks are compared with the true ones. \
         The ellipses have the second moments of the masks. Means over sequences (one object in one scene each); the \
         median of the ellipse IoU and the angle between the long axes are over all views (objects whose axes differ \
         by less than a fifth have no angle); center is the distance of the centers over the mean semi-axis, log area \
         the absolute logarithm of the ratio of the areas. All views are segmented; those in which at least 70 % of \
         the object is visible are scored. The prototype was given only these; \"scored views only\" does the same.",
    );
    let rendered = (0..rendered_scenes(run)).into_par_iter().map(|scene| {
        let scene = ImageScene::rendered(run.seed + scene);
        steps.done();
        scene
    });
    let mut sets = vec![ImageSet {
        title: "rendered scenes",
        short: "rendered",
        scenes: rendered.collect::<Result<_, _>>()?,
        source: None,
        prototype: &prototype::RENDERED,
    }];
    match &folder {
        Some(folder) => {
            let read = |file: &&str| {
                let scene = ImageScene::read(folder, file, SOURCE);
                steps.done();
                scene
            };
            let real = ImageSet {
                title: "real images (LINEMOD-Occluded, lmo_A and lmo_B)",
                short: "real",
                scenes: REAL_SCENES.par_iter().map(read).collect::<Result<_, _>>()?,
                source: Some(SOURCE),
                prototype: &prototype::REAL,
            };
            sets.insert(0, real);
        }
        None => report.text("The real images are not available: only the rendered scenes are shown."),
    }
    for set in &sets {
        set.add_masks(run, &steps, &mut report)?;
    }
    let scores: Vec<Vec<RowScores>> = sets.iter().map(|set| set.scores(run, &steps)).collect::<Result<_, _>>()?;
    report.table(table_3d(&sets, &scores));
    for (set, rows) in sets.iter().zip(&scores).filter(|(set, _)| set.source.is_some()) {
        report.headlines.extend(headlines_3d(set, rows));
    }
    Ok(report)
}

/// The errors of a detection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Measured {
    /// Its box.
    Boxes,
    /// The box, and a mask that the default method has found, with its ellipse.
    Found,
    /// The box and the true mask: what a perfect segmentation would give.
    True,
}

/// All settings of the table of bodies: the rows for what is measured.
fn rows(measured: Measured) -> Vec<MethodRow> {
    // The closed forms take the ellipse where there is one, and that in the box where there is none.
    let closed = |method, setting: &str| MethodRow { setting: setting.to_owned(), ..MethodRow::closed_form(method) };
    let map = |setting: &str, measurements| {
        let row = MethodRow::posterior(setting, PosteriorOptions::default());
        MethodRow { options: LocalizeOptions { measurements, ..row.options }, ..row }
    };
    let masks = |row: MethodRow| MethodRow {
        options: LocalizeOptions { measurements: MeasurementKind::Mask, ..row.options },
        ..row
    };
    match measured {
        Measured::Boxes => vec![
            closed(Method::Pfd, "boxes (the paper's PfD)"),
            closed(reg(), "boxes (the paper's PfD+REG)"),
            closed(Method::Lfd, "boxes"),
            closed(Method::Planes, "boxes"),
            map("boxes", MeasurementKind::Box),
        ],
        Measured::Found => vec![
            closed(Method::Pfd, "ellipses (the paper's PfD+ES)"),
            closed(reg(), "ellipses (the paper's PfD+ES+REG)"),
            closed(Method::Lfd, "ellipses"),
            map("ellipses", MeasurementKind::Ellipse),
            map("boxes and ellipses", MeasurementKind::Auto),
            masks(closed(Method::Planes, "masks")),
            map("masks", MeasurementKind::Mask),
        ],
        Measured::True => vec![
            map("ellipses of the true masks", MeasurementKind::Ellipse),
            map("boxes and ellipses of the true masks", MeasurementKind::Auto),
            masks(closed(Method::Planes, "true masks")),
            map("true masks", MeasurementKind::Mask),
        ],
    }
}

/// Scenes that are scored together.
struct ImageSet {
    title: &'static str,
    /// The name in a column's title.
    short: &'static str,
    scenes: Vec<ImageScene>,
    source: Option<&'static str>,
    prototype: &'static [PrototypeRow],
}

impl ImageSet {
    /// Adds the table of masks, and its headlines where the images are real.
    fn add_masks(&self, run: &Run, steps: &Steps, report: &mut Report) -> Result<(), Error> {
        let sequences: Vec<usize> = self.scenes.iter().flat_map(ImageScene::scored_counts).collect();
        let views: usize = sequences.iter().sum();
        let title = format!("Masks and ellipses, {}: {} sequences, {views} views", self.title, sequences.len());
        let mut table = Table::new(title, ["method", "setting"].iter().chain(&COLUMNS));
        self.prototype.iter().for_each(|row| table.push(prototype::cells(row)));
        for row in mask_rows(run) {
            let errors = row.errors(&self.scenes, run.seed)?;
            self.scenes.iter().for_each(|_| steps.done());
            table.push([row.method.name().into(), row.setting().into()].into_iter().chain(cells(&errors)).collect());
            if let Some(ids) = row.headline_ids().filter(|_| self.source.is_some()) {
                report.headlines.extend(headlines_masks(&errors, ids, &row));
            }
        }
        report.table(table);
        Ok(())
    }

    /// Localizes all objects with each row.
    fn scores(&self, run: &Run, steps: &Steps) -> Result<Vec<RowScores>, Error> {
        let mut all = Vec::new();
        let protocol = |options: &mut LocalizeOptions| {
            options.source = self.source.map(str::to_owned);
            options.seed = run.seed;
        };
        let segmentation = SegmentOptions { seed: run.seed, ..Default::default() };
        for &measured in measured(run) {
            let scene = |scene: &ImageScene| match measured {
                Measured::Boxes => Ok(scene.scene.clone()),
                Measured::Found => Ok(scene.with_found(&scene.segment(&segmentation)?)?),
                Measured::True => Ok(scene.with_true_masks()?),
            };
            let scenes: Vec<TrueScene> = self.scenes.iter().map(scene).collect::<Result<_, Error>>()?;
            // Rows of boxes and ellipses do not use the lines of masks.
            let without_lines: Vec<TrueScene> = scenes.iter().map(without_lines).collect::<Result<_, _>>()?;
            for row in rows(measured) {
                let of_masks = row.options.measurements == MeasurementKind::Mask;
                let scenes = if of_masks { &scenes } else { &without_lines };
                all.extend(run_rows(&[row], scenes, &protocol, steps)?);
            }
        }
        Ok(all)
    }
}

/// The scene without the tangent lines of masks.
fn without_lines(scene: &TrueScene) -> Result<TrueScene, Error> {
    let mut parts = scene.scene.clone().into_parts();
    parts.detections.iter_mut().for_each(|detection| detection.tangent_lines = None);
    Ok(TrueScene { scene: Scene::from_parts(parts)?, ..scene.clone() })
}

const MEASURES: [Measure; 3] = [Measure::O3d, Measure::EnclosingO3d, Measure::ThetaErr];

/// The mean over all objects of all scenes.
fn figure(row: &RowScores, measure: Measure) -> Option<Figure> {
    pooled(&row.sequences.iter().map(|scores| measure.values(scores)).collect::<Vec<_>>())
}

fn table_3d(sets: &[ImageSet], scores: &[Vec<RowScores>]) -> Table {
    let titles = sets.iter().flat_map(|set| MEASURES.map(|measure| format!("{}, {}", measure.name(), set.short)));
    let columns: Vec<String> = ["method".to_owned(), "measurements".to_owned()].into_iter().chain(titles).collect();
    let mut table = Table::new("Bodies from boxes and from ellipses", &columns);
    let first = scores.first().map_or(&[][..], Vec::as_slice);
    for (index, RowScores { row, .. }) in first.iter().enumerate() {
        let figures = scores.iter().flat_map(|rows| {
            let row = rows.get(index);
            MEASURES.map(|measure| Cell::figure(row.and_then(|row| figure(row, measure)), measure.decimals()))
        });
        table.push([row.method.into(), row.setting.as_str().into()].into_iter().chain(figures).collect());
    }
    table.note(
        "Means over the objects of all scenes, from all of their views. Ellipses and masks are those of `graphcut`, \
         together with the same boxes; without a reliable mask, the closed forms use the ellipse in the box, `posterior` \
         uses the box alone, and with masks the view is skipped. theta_err is over the objects with an ellipsoid: \
         with `pfd` they are few. `posterior` takes position and size from a box and the shape from the ellipse beside it; \
         from a mask, `posterior` and `planes` use the supporting lines in eight directions; those along x and y of masks that \
         were found in boxes are the edges of the boxes, and at other objects and at the border a line bounds the object from below.",
    );
    table.note(
        "If `posterior` on ellipses is not the best row, the ellipses are the cause: the ellipse of a partly occluded or \
         non-convex object is not the projection of an ellipsoid, and the ellipses of several views are not \
         projections of the same one, even with true masks. They are also smaller than the outline that the boxes \
         touch, so ellipses alone underestimate the size. Supporting lines of a mask are not affected by its shape, \
         but by single pixels: they are the best measurement of position and size, those of the estimated masks too, \
         but on the real images not of the axes. The gain of the rows with true masks is the error of the estimated \
         masks.",
    );
    table
}

fn headlines_masks(errors: &[Vec<ViewErrors>], ids: [&'static str; 2], row: &MaskRow) -> Vec<Headline> {
    let row = format!("{}, {}", row.method.name(), row.setting());
    let headline = |id, what: &str, ours, decimals| {
        let what = format!("{what}, real images");
        Headline { id, what, paper: None, ours, row: row.clone(), decimals }
    };
    let iou = mean_ellipse_iou(errors).map(|iou| headline(ids[0], "ellipse IoU", iou, 3));
    let angle = mean_angle(errors).map(|value| Figure { value, standard_error: None });
    iou.into_iter().chain(angle.map(|angle| headline(ids[1], "angle [deg]", angle, 1))).collect()
}

fn headlines_3d(set: &ImageSet, rows: &[RowScores]) -> Vec<Headline> {
    let of = |setting: &str, id, measure: Measure| {
        let row = rows.iter().find(|row| row.row.method == "posterior" && row.row.setting == setting)?;
        let what = format!("{}, {} images, {setting}", measure.name(), set.short);
        Some(Headline { id, what, paper: None, ours: figure(row, measure)?, row: row.row.name(), decimals: 3 })
    };
    [
        of("boxes", "segmentation_boxes_enclosing", Measure::EnclosingO3d),
        of("boxes and ellipses", "segmentation_both_enclosing", Measure::EnclosingO3d),
        of("boxes", "segmentation_boxes_theta_err", Measure::ThetaErr),
        of("boxes and ellipses", "segmentation_both_theta_err", Measure::ThetaErr),
    ]
    .into_iter()
    .flatten()
    .collect()
}
