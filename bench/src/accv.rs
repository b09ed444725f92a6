//! The ACCV sequences (PfD section 5.2, table `tab:accv`): one object each, 100 views.

use std::path::Path;

use quadlift::solve::PosteriorOptions;

use crate::data::TrueScene;
use crate::error::Error;
use crate::methods::{MethodRow, RowScores, closed_forms, run_rows};
use crate::paper::{ACCV_O3D, ACCV_SEQUENCES, ACCV_THETA_ERR};
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Measure, average};
use crate::sequences::Columns;

/// Where the boxes come from.
const SOURCES: [(&str, &str); 2] =
    [("yolo", "boxes of a real detector (YOLO)"), ("model", "tight boxes of the projected models")];

const MEASURES: [Measure; 3] = [Measure::O3d, Measure::EnclosingO3d, Measure::ThetaErr];

/// The rows: all settings of this experiment.
fn rows() -> Vec<MethodRow> {
    let mut rows = closed_forms();
    rows.push(MethodRow::posterior("auto", PosteriorOptions::default()));
    rows
}

/// Runs the experiment.
///
/// # Errors
/// [`Error::Read`], [`Error::Localize`].
pub(crate) fn run(data: &Path, run: &Run) -> Result<Report, Error> {
    let scenes: Vec<TrueScene> = ACCV_SEQUENCES
        .iter()
        .map(|name| TrueScene::read(data, &format!("accv_{name}"), name))
        .collect::<Result<_, _>>()?;
    let rows = rows();
    let steps = Steps::new("accv", SOURCES.len() * rows.len() * scenes.len(), run.progress);
    let mut report = Report::new("accv", "ACCV: objects on a table (section 5.2)");
    report.text(
        "The ground truth is the envelope of the object's point cloud, and the object fills only part of it: the \
         volume of a body that is tangent to exact boxes is 0.66 of the envelope's. The enclosing ellipsoid is \
         therefore the one to compare with the paper; the tangent one is shown for comparison. The paper simulated \
         its boxes. Not reproducible with this data: ellipses from segmented images (ES), for which the paper prints \
         no figures here either.",
    );
    let columns = Columns { averaged: &ACCV_SEQUENCES, pooled: None, beside: &[] };
    for (source, what) in SOURCES {
        let protocol = |options: &mut quadlift::LocalizeOptions| {
            options.source = Some(source.to_owned());
            options.seed = run.seed;
        };
        let scores = run_rows(&rows, &scenes, &protocol, &steps)?;
        let mut table = columns.table(format!("ACCV, {what} (source `{source}`)"));
        columns.push_paper(&mut table, &ACCV_SEQUENCES, &ACCV_O3D, Measure::O3d);
        columns.push_paper(&mut table, &ACCV_SEQUENCES, &ACCV_THETA_ERR, Measure::ThetaErr);
        for ours in &scores {
            columns.push_ours(&mut table, &ACCV_SEQUENCES, ours, &MEASURES);
        }
        report.table(table);
        if let Some(map) = scores.iter().find(|s| s.row.method == "posterior") {
            report.headlines.extend(headlines(source, what, map));
        }
    }
    Ok(report)
}

fn headlines(source: &str, what: &str, map: &RowScores) -> Vec<Headline> {
    let figure = |measure: Measure| average(&map.sequences.iter().map(|s| measure.values(s)).collect::<Vec<_>>());
    let headline = |id, measure: Measure, paper| {
        let what = format!("{}, {what}", measure.name());
        let (row, decimals) = (map.row.name(), measure.decimals());
        Some(Headline { id, what, paper: Some((paper, "PfD")), ours: figure(measure)?, row, decimals })
    };
    let all = match source {
        "yolo" => vec![
            headline("accv_yolo_enclosing", Measure::EnclosingO3d, ACCV_O3D.average),
            headline("accv_yolo_theta_err", Measure::ThetaErr, ACCV_THETA_ERR.average),
        ],
        _ => vec![headline("accv_model_enclosing", Measure::EnclosingO3d, ACCV_O3D.average)],
    };
    all.into_iter().flatten().collect()
}
