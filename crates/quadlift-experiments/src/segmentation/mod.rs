//! Masks and ellipses from images (PfD section 4.2), and what they are worth in 3D: PfD+ES, PfD+REG+ES and ours.
//!
//! The paper prints no figures of its segmentation; the rows beside ours are those of our numpy prototype.

mod errors;
mod scenes;

use std::path::Path;

use quadlift::solve::{MapOptions, Method};
use quadlift::{Options, UsedMeasurements};
use quadlift_segment::{SegmentMethod, SegmentOptions};
use rayon::prelude::*;

use self::errors::{COLUMNS, ViewErrors, cells, mean_angle, mean_ellipse_iou};
use self::scenes::{ImageScene, Seen, segment};
use crate::data::{TrueScene, data_folder};
use crate::error::Error;
use crate::methods::{MethodRow, RowScores, run_rows};
use crate::progress::{Progress, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, Measure, pooled};
use crate::table::{Cell, Table};

/// Real images: the scenes, and the source of their boxes.
const REAL_SCENES: [&str; 2] = ["lmo_A", "lmo_B"];
const SOURCE: &str = "visible-mask";

/// Rendered scenes, each of four objects in 20 views.
const RENDERED_SCENES: u64 = 6;

/// The methods of the tables of masks: all settings of this experiment. Without falling back the mask is kept whatever
/// it looks like.
const METHODS: [(SegmentMethod, bool); 7] = [
    (SegmentMethod::Box, true),
    (SegmentMethod::PlainMixture, false),
    (SegmentMethod::Sca, false),
    (SegmentMethod::ScaCut, false),
    (SegmentMethod::ScaCut, true),
    (SegmentMethod::GraphCut, false),
    (SegmentMethod::GraphCut, true),
];

/// A row of the numpy prototype: name, and the figures of the columns except the last one.
type PrototypeRow = (&'static str, [f64; 7]);

/// The prototype on the real images (the same images, boxes and truth as ours).
const PROTOTYPE_REAL: [PrototypeRow; 8] = [
    ("box", [0.636, 0.735, 0.739, 17.1, 0.163, 0.181, 0.018]),
    ("GrabCut (OpenCV), each frame alone", [0.427, 0.702, 0.738, 17.0, 0.242, 0.370, 0.132]),
    ("gmm", [0.501, 0.588, 0.617, 15.5, 0.296, 0.712, 0.255]),
    ("sca", [0.756, 0.811, 0.832, 7.7, 0.146, 0.088, 0.000]),
    ("sca+cut", [0.766, 0.818, 0.846, 7.6, 0.141, 0.084, 0.000]),
    ("sca+cut, fall-back", [0.763, 0.819, 0.846, 7.4, 0.144, 0.082, 0.000]),
    ("graphcut", [0.777, 0.827, 0.851, 7.1, 0.130, 0.094, 0.015]),
    ("sca, then GrabCut", [0.745, 0.794, 0.845, 8.0, 0.142, 0.150, 0.037]),
];

/// Runs the experiment. Without real data the rendered scenes remain, unless `data` names a folder that has none.
///
/// # Errors
/// [`Error::NoData`], [`Error::Read`], [`Error::Synthetic`].
pub fn run(data: Option<&Path>, seed: u64, progress: Progress) -> Result<Report, Error> {
    let folder = match data_folder(data) {
        Ok(folder) => Some(folder),
        Err(error) if data.is_some() => return Err(error),
        Err(_) => None,
    };
    let scenes = RENDERED_SCENES as usize + folder.as_ref().map_or(0, |_| REAL_SCENES.len());
    let rows: usize = ELLIPSES.iter().map(|ellipses| rows(*ellipses).len()).sum();
    let steps = Steps::new("segmentation", scenes * (1 + METHODS.len() + rows), progress);
    let mut report = Report::new("segmentation", "Segmentation: ellipses from images (section 4.2)");
    report.text(
        "Masks of the objects are found in the crops of their boxes, those of one object in all frames together \
         (`sca`: Stel Component Analysis; `sca+cut`: finished by graph cuts; `graphcut`: graph cuts with the colours of \
         all frames, without stels; `gmm`: mixtures of colours that know no places), and compared with the true masks. \
         The ellipses have the second moments of the masks. Means over sequences, an object in a scene each; the median \
         of the ellipse IoU and the angle between the long axes are over all views (objects whose axes differ by less \
         than a fifth have no angle); centre is the distance of the centres over the mean semi-axis, log area the \
         absolute logarithm of the ratio of the areas. Views count in which at least 70 % of the object is visible.",
    );
    let rendered = (0..RENDERED_SCENES).into_par_iter().map(|scene| {
        let scene = ImageScene::rendered(seed + scene);
        steps.done();
        scene
    });
    let mut sets = vec![ImageSet {
        title: "rendered scenes",
        short: "rendered",
        scenes: rendered.collect::<Result<_, _>>()?,
        source: None,
        prototype: &[],
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
                prototype: &PROTOTYPE_REAL,
            };
            sets.insert(0, real);
        }
        None => report.text("The real images are not at hand: only the rendered scenes are shown."),
    }
    for set in &sets {
        set.add_masks(seed, &steps, &mut report)?;
    }
    let scores: Vec<Vec<RowScores>> = sets.iter().map(|set| set.scores(seed, &steps)).collect::<Result<_, _>>()?;
    report.table(table_3d(&sets, &scores));
    for (set, rows) in sets.iter().zip(&scores).filter(|(set, _)| set.source.is_some()) {
        report.headlines.extend(headlines_3d(set, rows));
    }
    Ok(report)
}

/// What is known of the shapes, beside the boxes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ellipses {
    /// Nothing.
    None,
    /// Ellipses found by the default method.
    Found,
    /// Ellipses of the true masks: what a perfect segmentation would give.
    OfTruth,
}

const ELLIPSES: [Ellipses; 3] = [Ellipses::None, Ellipses::Found, Ellipses::OfTruth];

/// The rows of the table of bodies: all settings of this part.
fn rows(ellipses: Ellipses) -> Vec<MethodRow> {
    let closed = |method| {
        let setting = if ellipses == Ellipses::None { "boxes" } else { "ellipses" };
        MethodRow { setting: setting.to_owned(), ..MethodRow::closed_form(method) }
    };
    let map = |setting: &str, measurements| {
        let row = MethodRow::map(setting, MapOptions::default());
        MethodRow { options: Options { measurements, ..row.options }, ..row }
    };
    let paper = [Method::Pfd, Method::Reg, Method::Lfd];
    match ellipses {
        Ellipses::None => paper.map(closed).into_iter().chain([map("boxes", UsedMeasurements::Box)]).collect(),
        Ellipses::Found => paper
            .map(closed)
            .into_iter()
            .chain([map("ellipses", UsedMeasurements::Ellipse), map("boxes and ellipses", UsedMeasurements::Auto)])
            .collect(),
        Ellipses::OfTruth => vec![
            map("ellipses of the true masks", UsedMeasurements::Ellipse),
            map("boxes and ellipses of the true masks", UsedMeasurements::Auto),
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
    fn add_masks(&self, seed: u64, steps: &Steps, report: &mut Report) -> Result<(), Error> {
        let sequences: Vec<Vec<&Seen>> = self.scenes.iter().flat_map(ImageScene::sequences).collect();
        let views: usize = sequences.iter().map(Vec::len).sum();
        let title = format!("Masks and ellipses, {}: {} sequences, {views} views", self.title, sequences.len());
        let mut table = Table::new(title, ["method", "setting"].iter().chain(&COLUMNS));
        for (name, figures) in self.prototype {
            // Angles are in degrees, all others are shares.
            let cells = figures.iter().enumerate().map(|(k, x)| Cell::number(*x, if k == 3 { 1 } else { 3 }));
            table.push([(*name).into(), "prototype".into()].into_iter().chain(cells).collect());
        }
        for (method, fall_back) in METHODS {
            let options = SegmentOptions { method, fall_back, seed, ..Default::default() };
            let errors = |views: &Vec<&Seen>| -> Result<Vec<ViewErrors>, Error> {
                let found = segment(views.iter().copied(), &options)?;
                Ok(found.iter().zip(views).filter_map(|(view, seen)| ViewErrors::of(view, &seen.truth)).collect())
            };
            let errors: Vec<Vec<ViewErrors>> = sequences.par_iter().map(errors).collect::<Result<_, _>>()?;
            self.scenes.iter().for_each(|_| steps.done());
            let setting = match (method, fall_back) {
                (SegmentMethod::Box, _) => "",
                (_, true) => "falls back",
                (_, false) => "keeps every mask",
            };
            table.push([method.name().into(), setting.into()].into_iter().chain(cells(&errors)).collect());
            if self.source.is_some() && method == SegmentMethod::default() && fall_back {
                report.headlines.extend(headlines_masks(&errors, method));
            }
        }
        report.table(table);
        Ok(())
    }

    /// Localises all objects with each row.
    fn scores(&self, seed: u64, steps: &Steps) -> Result<Vec<RowScores>, Error> {
        let mut all = Vec::new();
        let protocol = |options: &mut Options| {
            options.source = self.source.map(str::to_owned);
            options.seed = seed;
        };
        for ellipses in ELLIPSES {
            let scene = |scene: &ImageScene| match ellipses {
                Ellipses::None => Ok(scene.scene.clone()),
                Ellipses::Found => scene.with_ellipses(SegmentMethod::default(), seed),
                Ellipses::OfTruth => Ok(scene.with_true_ellipses()),
            };
            let scenes: Vec<TrueScene> = self.scenes.iter().map(scene).collect::<Result<_, _>>()?;
            all.extend(run_rows(&rows(ellipses), &scenes, &protocol, steps)?);
        }
        Ok(all)
    }
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
        "Means over the objects of all scenes, from all of their views. Ellipses are those of `sca+cut`, beside the same \
         boxes; where no mask could be trusted there is none, and the closed forms take the one in the box. `reg` and \
         `pfd` on ellipses are the paper's PfD+REG+ES and PfD+ES. `map` takes place and size from a box, and the shape \
         from an ellipse beside it.",
    );
    table
}

fn headlines_masks(errors: &[Vec<ViewErrors>], method: SegmentMethod) -> Vec<Headline> {
    let headline = |id, what: &str, ours, decimals| {
        let what = format!("{what}, real images");
        Headline { id, what, paper: None, ours, row: method.name().to_owned(), decimals }
    };
    let iou = mean_ellipse_iou(errors);
    let angle = mean_angle(errors).map(|value| Figure { value, standard_error: None });
    let iou = iou.map(|ours| headline("segmentation_ellipse_iou", "ellipse IoU", ours, 3));
    iou.into_iter().chain(angle.map(|ours| headline("segmentation_angle", "angle [deg]", ours, 1))).collect()
}

fn headlines_3d(set: &ImageSet, rows: &[RowScores]) -> Vec<Headline> {
    let of = |setting: &str, id, measure: Measure| {
        let row = rows.iter().find(|row| row.row.method == "map" && row.row.setting == setting)?;
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
