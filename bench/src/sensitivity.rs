//! Sensitivity (ours): each tuned constant halved and doubled, and what the figures do.
//!
//! A constant whose figures hardly move is as good as derived; one that moves a single data set is tuned to it.

use std::path::Path;

use quadlift::association::AssociateOptions;
use quadlift::geometry::BodyKind;
use quadlift::solve::PosteriorOptions;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions};
use quadlift::{LocalizeOptions, tuning};
use quadlift_io::builtin_priors;
use rayon::prelude::*;

use crate::association::synthetic::{case, with_parts_to_do};
use crate::data::{TrueScene, data_folder};
use crate::error::Error;
use crate::noise_curves::true_scene;
use crate::paper::ACCV_SEQUENCES;
use crate::progress::{Run, Steps};
use crate::report::Report;
use crate::scores::{Measure, mean};
use crate::table::{Cell, Table};

/// Scenes of each synthetic figure.
const SCENES: u64 = 4;

/// Factors on the constants.
const FACTORS: [f64; 2] = [0.5, 2.0];

/// Height of KITTI's cameras above the road, meters.
const CAMERA_HEIGHT: f64 = 1.65;

/// Figures that move by less than this are not shown.
const SHOWN: f64 = 5e-4;

/// A figure: its name, and how it is measured.
struct Measured {
    name: &'static str,
    scenes: Vec<TrueScene>,
    options: LocalizeOptions,
    measure: Measure,
}

impl Measured {
    /// The mean over the sequences of the mean over their objects.
    fn value(&self) -> Result<Option<f64>, Error> {
        let of_scene = |scene: &TrueScene| -> Result<Option<f64>, Error> {
            Ok(mean(&self.measure.values(&scene.scores(&self.options)?)))
        };
        let values: Vec<Option<f64>> = self.scenes.par_iter().map(of_scene).collect::<Result<_, _>>()?;
        Ok(mean(&values.into_iter().flatten().collect::<Vec<_>>()))
    }
}

fn synthetic(name: &'static str, views: usize, seed: u64) -> Result<Measured, Error> {
    let scene = |k: u64| {
        true_scene(&SyntheticOptions {
            seed: seed.wrapping_add(k),
            objects: 30,
            views,
            observations: Observations::Boxes,
            noise: vec![Noise::BoxEdges(0.05)],
            outlier_share: if views > 5 { 0.1 } else { 0.0 },
            ..Default::default()
        })
    };
    let scenes = (0..SCENES).map(scene).collect::<Result<_, _>>()?;
    Ok(Measured { name, scenes, options: LocalizeOptions::default(), measure: Measure::O3d })
}

fn real(data: &Path) -> Result<Vec<Measured>, Error> {
    let read = |file: String| TrueScene::read(data, &file, &file);
    let cars = |name, poses: &str| -> Result<Measured, Error> {
        let files = ["S05", "S09", "S22", "S36"].map(|sequence| format!("kitti_{sequence}_{poses}"));
        let map = PosteriorOptions {
            body: Some(BodyKind::Cuboid),
            priors: builtin_priors(),
            camera_height: Some(CAMERA_HEIGHT),
            ..Default::default()
        };
        let options = LocalizeOptions {
            source: Some("rrc".to_owned()),
            max_occluded: Some(1.0),
            max_truncated: Some(0.0),
            ..LocalizeOptions::from(map)
        };
        let scenes = files.into_iter().map(read).collect::<Result<_, _>>()?;
        Ok(Measured { name, scenes, options, measure: Measure::O3d })
    };
    let of = |source: &str| LocalizeOptions { source: Some(source.to_owned()), ..Default::default() };
    let accv = ACCV_SEQUENCES.iter().map(|name| read(format!("accv_{name}"))).collect::<Result<_, _>>()?;
    Ok(vec![
        cars("KITTI cars", "aligned")?,
        cars("KITTI, GPS poses", "oxts")?,
        Measured {
            name: "TUW",
            scenes: vec![read("tuw_demo".to_owned())?],
            options: of("authors"),
            measure: Measure::O3d,
        },
        Measured { name: "LINEMOD, YOLO", scenes: accv, options: of("yolo"), measure: Measure::EnclosingO3d },
    ])
}

/// Mean F1 of associations of synthetic scenes.
fn association(seed: u64) -> Result<f64, Error> {
    let conditions = with_parts_to_do();
    let score = |k: usize| -> Result<f64, Error> {
        let make = &conditions[k % conditions.len()].1;
        let case = case(&SyntheticOptions { seed: seed + (k / conditions.len()) as u64, ..make.clone() })?;
        Ok(case.division(&AssociateOptions::default())?.score.f1)
    };
    let values: Vec<f64> = (0..2 * conditions.len()).into_par_iter().map(score).collect::<Result<_, _>>()?;
    Ok(mean(&values).unwrap_or_default())
}

/// Runs the experiment; without data on synthetic scenes alone.
///
/// # Errors
/// [`Error`] of a scene that cannot be made, read or localized.
pub(crate) fn run(data: Option<&Path>, run: &Run) -> Result<Report, Error> {
    let mut measured = vec![synthetic("3 views", 3, run.seed)?, synthetic("10 views, outliers", 10, run.seed)?];
    if let Ok(folder) = data_folder(data) {
        measured.extend(real(&folder)?);
    }
    let constants = run.first(tuning::CONSTANTS, 2);
    let steps = Steps::new("sensitivity", 1 + FACTORS.len() * constants.len(), run.progress);
    let figures = || -> Result<Vec<Option<f64>>, Error> {
        let mut figures: Vec<Option<f64>> = measured.iter().map(Measured::value).collect::<Result<_, _>>()?;
        figures.push(Some(association(run.seed)?));
        steps.done();
        Ok(figures)
    };
    let mut report = Report::new("sensitivity", "Tuned constants, halved and doubled");
    report.text(
        "Each tuned constant is halved and doubled while all others are unchanged. The first row has the figures with \
         unchanged constants: mean O3D of synthetic ellipsoids (boxes with 5 % noise), of KITTI's cars (RRC boxes, \
         car prior), of TUW and LINEMOD (enclosing bodies), and F1 of associations. The other rows show differences; \
         those below 0.0005 are omitted.",
    );
    let names = measured.iter().map(|figure| figure.name).chain(["association, F1"]);
    let mut table = Table::new("Sensitivity", ["constant", "value"].into_iter().chain(names));
    let before = figures()?;
    let number = |x: &Option<f64>| x.map_or_else(|| Cell::from(""), |x| Cell::number(x, 3));
    table.push(["as they are".into(), "".into()].into_iter().chain(before.iter().map(number)).collect());
    for (index, (name, value)) in constants.iter().enumerate() {
        for factor in FACTORS {
            tuning::scale(index, factor);
            let after = figures();
            tuning::scale(index, 1.0);
            let change = |(before, after): (&Option<f64>, Option<f64>)| -> Cell {
                match before.zip(after).map(|(before, after)| after - before) {
                    Some(change) if change.abs() >= SHOWN => format!("{change:+.3}").as_str().into(),
                    _ => "".into(),
                }
            };
            let cells = before.iter().zip(after?).map(change);
            let value = format!("{}", value * factor);
            table.push([(*name).into(), value.as_str().into()].into_iter().chain(cells).collect());
        }
    }
    report.table(table);
    Ok(report)
}
